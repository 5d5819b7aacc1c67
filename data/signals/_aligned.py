"""The error of a moving axis: an instrument that is late, against the encoder."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ._noise import NORMAL, resolution, scatter_of

_FOURTH = 0.05
"""Error of a cubic spline between samples, per fourth difference, at a jump of jerk."""
_SHARE = 0.5
"""Of the noise that this error may be."""
_WHILE = 0.2
"""s in which an axis that stands shows no more than one digit of its encoder."""
_FLICKER, _DIGITS, _SHORT, _FINE = 10.0, 2.5, 1e-6, 1e-3
"""Deviations of an encoder, its digits, and share of its whole way, that are no travel; share of
it that a digit is less than."""


@dataclasses.dataclass(frozen=True)
class InstrumentClock:
    """How an instrument's clock stands to that of the encoder.

    Attributes:
        delay: In s at `middle`; positive where the instrument is late.
        rate: Growth of the delay in s per s.
        middle: Time in s.
        standard_deviation: Of the delay in s.
        rate_deviation: Of the rate in s per s.
        determined: Whether the record tells the delay.
        statement: In words.
    """

    delay: float
    rate: float
    middle: float
    standard_deviation: float
    rate_deviation: float
    determined: bool
    statement: str

    def instants(self, time: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return when in s what the instrument shows at each time was so."""
        return time - self.delay - self.rate * (time - self.middle)


@dataclasses.dataclass(frozen=True)
class AlignedError:
    """Reference − encoder at the same instants.

    Attributes:
        instants: In s, those that the instrument's readings belong to.
        error: In mm or °; NaN where it is not known.
        valid: Where it is known: the encoder can be told between its samples.
    """

    instants: Float[np.ndarray, " t"]
    error: Float[np.ndarray, " t"]
    valid: Bool[np.ndarray, " t"]


def encoder_spline(
    time: Float[np.ndarray, " t"], encoder: Float[np.ndarray, " t"]
) -> Any | None:
    """Return the cubic spline through an encoder's samples; None where it stands still."""
    from scipy.interpolate import CubicSpline

    if np.ptp(encoder) == 0.0:
        return None
    return CubicSpline(time, encoder)


def aligned_error(
    time: Float[np.ndarray, " t"],
    encoder: Float[np.ndarray, " t"],
    reference: Float[np.ndarray, " t"],
    clock: InstrumentClock,
    *,
    spline: Any | None = None,
) -> AlignedError:
    """Return reference − encoder with the delay of the instrument taken out.

    The encoder, which is hardly noisy, is taken between its samples at the instants that
    the readings belong to. Where its samples are too far apart for that, in hard
    accelerations of a thinned log, there is no error, rather than a wrong one.

    Args:
        time: In s, ascending.
        encoder: In mm or °.
        reference: Same unit; NaN = missed.
        clock: Of the instrument.
        spline: Of the encoder, where it has been made.
    """
    at = clock.instants(time)
    spline = encoder_spline(time, encoder) if spline is None else spline
    if spline is None:
        error = reference - encoder
        return AlignedError(at, error, np.isfinite(error))
    error = reference - np.asarray(spline(at))
    after = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    step = time[after] - time[after - 1]
    share = np.clip((at - time[after - 1]) / step, 0.0, 1.0)
    # None at the samples themselves, most halfway between.
    between = 16.0 * (share * (1.0 - share)) ** 2
    rough = _roughness(encoder)
    doubt = _FOURTH * between * np.maximum(rough[after], rough[after - 1])
    usual = float(np.median(np.diff(time)))
    valid = np.isfinite(error) & (at >= time[0]) & (at <= time[-1])
    valid &= step <= 3.0 * usual
    valid &= doubt <= max(_SHARE * _scatter(error, doubt, valid), 1e-9)
    return AlignedError(at, np.where(valid, error, np.nan), valid)


def _scatter(
    error: Float[np.ndarray, " t"],
    doubt: Float[np.ndarray, " t"],
    valid: Bool[np.ndarray, " t"],
) -> float:
    """Return how far neighbouring errors scatter where the encoder is known best."""
    if valid.sum() < 8:
        return 0.0
    best = valid & (doubt <= np.percentile(doubt[valid], 20.0))
    pairs = best[1:] & best[:-1]
    steps = np.abs(np.diff(error))[pairs]
    return NORMAL * float(np.median(steps)) / 2.0**0.5 if steps.size else 0.0


def _roughness(encoder: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    """Return the largest fourth difference of the samples about each one."""
    fourth = np.zeros(encoder.size)
    fourth[2:-2] = np.abs(np.diff(encoder, 4))
    padded = np.pad(fourth, 1, mode="edge")
    return np.asarray(np.max([padded[:-2], padded[1:-1], padded[2:]], axis=0))


def standing(
    time: Float[np.ndarray, " t"],
    position: Float[np.ndarray, " t"],
    *,
    settled: float = 0.3,
) -> Bool[np.ndarray, " t"]:
    """Return where an axis has stood for a while and stays until the next sample.

    Args:
        time: In s, ascending.
        position: In mm or °.
        settled: In s; until then a loop may still settle, and a late instrument show it.
    """
    moving = _moving(time, position)
    last = np.concatenate([[-np.inf], np.where(moving, time[1:], -np.inf)])
    quiet = time - np.maximum.accumulate(last) >= settled
    quiet &= time - time[0] >= settled
    return np.asarray(quiet & ~np.concatenate([moving, [False]]))


def last_direction(
    speed: Float[np.ndarray, " t"], slow: float
) -> Float[np.ndarray, " t"]:
    """Return the direction of the last motion, ±1, in the order of time.

    What is not faster than ``slow`` is no motion; before the first one its direction
    counts.
    """
    moving = np.flatnonzero(np.abs(speed) > slow)
    if not moving.size:
        return np.ones(len(speed))
    last = np.searchsorted(moving, np.arange(len(speed)), side="right") - 1
    return np.asarray(np.sign(speed[moving[np.maximum(last, 0)]]))


def travel_direction(place: Float[np.ndarray, " t"]) -> Int[np.ndarray, " t"]:
    """Return the direction of the last travel, ±1, at each sample of a position.

    Travel goes further back from where the axis turned than its encoder flickers: neither its
    noise nor its last digit at a standstill is one. Before the first travel its direction
    counts; 0 where there is none.
    """
    if place.size < 2:
        return np.zeros(place.size, np.int64)
    noise = scatter_of(place) if place.size > 3 else 0.0
    whole = float(np.ptp(place))
    least = max(_FLICKER * noise, _DIGITS * _digit_of(place), _SHORT * whole)
    low = high = float(place[0])
    turns, ways, way = [0], [0], 0
    for row, here in enumerate(place.tolist()):
        if here > high:
            high = here
            low = here if way > 0 else low
        elif here < low:
            low = here
            high = here if way < 0 else high
        if way <= 0 and here - low > least:
            way, high = 1, here
        elif way >= 0 and high - here > least:
            way, low = -1, here
        if way != ways[-1]:
            turns.append(row)
            ways.append(way)
    ways[0] = ways[min(1, len(ways) - 1)]
    return np.repeat(ways, np.diff([*turns, place.size]))


def _digit_of(place: Float[np.ndarray, " t"]) -> float:
    """Return the step of an encoder; 0 where its samples show none.

    Targets, and what moves on by the same from sample to sample, do not.
    """
    fastest, whole = (float(np.ptp(each)) for each in (np.diff(place), place))
    digit = resolution(place)
    return digit if digit < min(0.25 * fastest, _FINE * whole) else 0.0


def first_motion(
    time: Float[np.ndarray, " t"], position: Float[np.ndarray, " t"]
) -> int:
    """Return the row in which an axis moves for the first time; 0 where it never does."""
    return int(np.argmax(_moving(time, position)))


def _moving(
    time: Float[np.ndarray, " t"], position: Float[np.ndarray, " t"]
) -> Bool[np.ndarray, " n"]:
    """Return from which rows on to the next an axis moves."""
    # How an encoder flickers; third differences of a steady motion do not show the motion.
    third = np.abs(np.diff(position, 3)) if position.size > 3 else np.zeros(1)
    flicker = float(np.percentile(third, 20.0))
    step = float(np.median(np.diff(time)))
    slow = max(1e-3, 3.0 * flicker / step)
    moving = np.abs(np.diff(position)) > slow * np.diff(time)
    digit = _digit_of(position) if position.size > 3 else 0.0
    if digit > 0.0:
        from scipy.ndimage import maximum_filter1d, minimum_filter1d

        # A digit that changes now and then is no motion while it comes back.
        size = 2 * max(round(0.5 * _WHILE / step), 1) + 1
        span = maximum_filter1d(position, size) - minimum_filter1d(position, size)
        moving &= np.maximum(span[1:], span[:-1]) > 1.5 * digit
    return np.asarray(moving)
