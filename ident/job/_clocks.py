"""The offset between the clocks of two files, from what both of them saw."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..fit import FitError

_MOST = 2**17
"""Instants at which two signals are compared before the offset is refined."""
_LEAST = 8
_OVERLAP = 0.5
"""Share of the shorter record that must meet the other one."""
_AGAIN = 0.985
"""Correlation, in that of the best offset, at which another one is as good."""
_NEAR = 0.9
"""Correlation, in that of the best offset, up to which an offset is near it."""
_ALIKE = 0.5
"""Share of the scatter that the other file must explain."""


@dataclasses.dataclass(frozen=True)
class ClockState:
    """How the clock of a file was put onto that of the first.

    Attributes:
        measurement: Name in the job.
        file: As the job names it.
        offset: In s: instant on the first clock = instant on its own + offset.
        standard_deviation: In s; None where the job gives the offset.
        by: What both saw, in words.
        explained: Share of the scatter of that which the other file explains, 0 to 1;
            None where the job gives the offset.
    """

    measurement: str
    file: str
    offset: float
    standard_deviation: float | None
    by: str
    explained: float | None


@dataclasses.dataclass(frozen=True)
class Offset:
    """An offset between two clocks, or why there is none.

    Attributes:
        seconds: First clock − other clock.
        standard_deviation: Of that.
        explained: Share of the scatter that the other file explains, 0 to 1.
    """

    seconds: float
    standard_deviation: float
    explained: float


def find_offset(
    time: Float[np.ndarray, " t"],
    signal: Float[np.ndarray, " t"],
    other_time: Float[np.ndarray, " l"],
    other: Float[np.ndarray, " l"],
    position: Float[np.ndarray, " t"] | None = None,
) -> Offset:
    """Return the offset between the clocks of two files.

    Searched over all offsets at which half of the shorter record meets the other, then
    refined by `clock_offset`.

    Args:
        time: Of the first file in s, ascending.
        signal: What it saw; NaN = missed.
        other_time: Of the other file in s, ascending.
        other: What that saw of the same thing, in any unit.
        position: Of the axis in mm, where the first signal is an error at several
            positions that follows the other (a temperature).

    Raises:
        FitError: If they do not tell it.
    """
    from ..kinds.temperature import clock_offset  # takes long to load

    if position is not None:
        span = min(float(np.ptp(time)), float(np.ptp(other_time)))
        base = 0.5 * float(time[0] + time[-1] - other_time[0] - other_time[-1])
        search = _OVERLAP * span
    else:
        base, search = _coarse(time, signal, other_time, other)
    found = clock_offset(
        time, signal, other_time + base, other, search=search, position=position
    )
    if found.explained < _ALIKE:
        msg = (
            f"at the best offset one explains {100 * max(found.explained, 0.0):.0f} % of"
            f" the scatter of the other, expected {100 * _ALIKE:.0f} % at least."
        )
        raise FitError(msg)
    return Offset(found.offset + base, found.standard_deviation, found.explained)


def _coarse(
    time: Float[np.ndarray, " t"],
    signal: Float[np.ndarray, " t"],
    other_time: Float[np.ndarray, " l"],
    other: Float[np.ndarray, " l"],
) -> tuple[float, float]:
    """Return the offset of largest correlation, and how far around it to look on."""
    spans = float(np.ptp(time)), float(np.ptp(other_time))
    if min(len(time), len(other_time)) < _LEAST or min(spans) <= 0.0:
        msg = f"a file has fewer than {_LEAST} instants."
        raise FitError(msg)
    steps = [float(np.median(np.diff(each))) for each in (time, other_time)]
    step = max(*steps, max(spans) / _MOST)
    first = _evenly(time, signal, step)
    second = _evenly(other_time, other, step)
    if min(float(np.ptp(first)), float(np.ptp(second))) <= 0.0:
        msg = "one of them does not change."
        raise FitError(msg)
    lags, score = _correlations(first, second)
    best = int(np.argmax(score))
    near = score >= _NEAR * score[best]
    low, high = best, best
    while low > 0 and near[low - 1]:
        low -= 1
    while high < len(score) - 1 and near[high + 1]:
        high += 1
    beside = np.concatenate([score[:low], score[high + 1 :]])
    if beside.size and float(beside.max()) > _AGAIN * score[best]:
        msg = "it repeats itself, so that another offset fits as well."
        raise FitError(msg)
    offset = float(time[0] - other_time[0]) + step * float(lags[best])
    return offset, step * max(min(best - low, high - best), 4)


def _evenly(
    time: Float[np.ndarray, " t"], values: Float[np.ndarray, " t"], step: float
) -> Float[np.ndarray, " n"]:
    known = np.isfinite(values)
    if int(known.sum()) < _LEAST:
        msg = f"fewer than {_LEAST} readings of it are numbers."
        raise FitError(msg)
    clock = np.arange(time[0], time[-1] + 0.5 * step, step)
    return np.asarray(np.interp(clock, time[known], values[known]))


def _correlations(
    first: Float[np.ndarray, " n"], second: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return shifts of the second signal in steps, and how alike both are there."""
    from scipy.signal import correlate

    def over(one: np.ndarray, two: np.ndarray) -> np.ndarray:
        return np.asarray(correlate(one, two, mode="full", method="fft"))

    first = first - first.mean()
    second = second - second.mean()
    ones = np.ones(len(first)), np.ones(len(second))
    count = np.maximum(over(*ones), 1.0)
    sums = over(first, ones[1]), over(ones[0], second)
    product = over(first, second) - sums[0] * sums[1] / count
    power = [
        over(first**2, ones[1]) - sums[0] ** 2 / count,
        over(ones[0], second**2) - sums[1] ** 2 / count,
    ]
    size = np.sqrt(np.maximum(power[0], 0.0) * np.maximum(power[1], 0.0))
    # Where nearly nothing changes in the common time, anything is alike.
    floor = 1e-3 * float(np.sqrt(np.sum(first**2) * np.sum(second**2)))
    score = np.abs(product) / np.maximum(size, floor)
    score[count < _OVERLAP * min(len(first), len(second))] = 0.0
    return np.arange(len(score)) - (len(second) - 1.0), score
