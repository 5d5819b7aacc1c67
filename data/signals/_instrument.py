"""How late an external instrument is against the encoder of a moving axis."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ._aligned import InstrumentClock, aligned_error, encoder_spline
from ._errors import check_lengths

_WINDOW = 1.5
"""s: within it the true error is a line over the position, as far as a delay goes."""
_LEAST_ROWS = 8
_LEAST_WINDOWS = 6
_NODES = 17
_MOST_ROWS = 100_000
_STEPS = 12
_HALF = 1.4826
_HEAVY = 2.5
"""Robust standard deviations beyond which a reading counts less and less."""
_SURE = 3.0


def estimate_instrument(
    time: Float[np.ndarray, " t"],
    encoder: Float[np.ndarray, " t"],
    reference: Float[np.ndarray, " t"],
    *,
    longest: float = 0.05,
) -> InstrumentClock:
    r"""Return how late a reference is, and how its clock runs, from an axis in motion.

    The reference shows $x(t - \tau) + e$, so that reference − encoder has a part
    $-\tau v$: that part is told from the true error, which a delay must not take up, by
    changes of speed. In windows of 1.5 s the true error is a line over the position;
    beside it, over the whole record, stands what changes with the direction (backlash,
    also in proportion to the position) and with the acceleration. What is left in
    proportion to the velocity is the delay, and to velocity times time the rate of the
    clock. Readings that contradict the others count less. Standard deviations are those
    that the scatter between windows shows.

    Args:
        time: In s, ascending.
        encoder: Of the axis itself, in mm or °.
        reference: Of the external instrument, same unit; NaN = missed.
        longest: Delay in s, of either sign, that is looked for.

    Raises:
        SignalError: If the record is shorter than a few samples.
    """
    check_lengths("instrument clock", time.size, encoder.size, reference.size, least=8)
    spline = encoder_spline(time, encoder)
    middle = 0.5 * float(time[0] + time[-1])
    half = max(0.5 * float(time[-1] - time[0]), 1e-9)
    found = InstrumentClock(0.0, 0.0, middle, np.inf, np.inf, False, "")
    if spline is None:
        return dataclasses.replace(found, statement=_words(found, "nothing moves"))
    thin = max(1, time.size // _MOST_ROWS)
    deviation = np.full(2, np.inf)
    rows = 0
    left = np.inf
    for with_rate in (True, False):
        found = dataclasses.replace(found, rate=0.0)
        for _ in range(_STEPS):
            seen = aligned_error(time, encoder, reference, found, spline=spline)
            known = seen.valid.copy()
            known[np.arange(time.size) % thin != 0] = False
            system = _Windows(seen.instants, spline, seen.error, known, middle, half)
            if system.count < _LEAST_WINDOWS:
                return dataclasses.replace(
                    found, statement=_words(found, "its speed hardly changes")
                )
            change, deviation, left, rows = system.solve(with_rate)
            found = dataclasses.replace(
                found,
                delay=float(np.clip(found.delay + change[0], -longest, longest)),
                rate=found.rate + change[1] / half,
            )
            if abs(change[0]) < 1e-3 * deviation[0]:
                break
        # A rate that does not show is none.
        if abs(found.rate) * half > _SURE * deviation[1]:
            break
    return _judged(found, deviation, half, left, float(system.speed), longest, rows)


def _judged(
    found: InstrumentClock,
    deviation: Float[np.ndarray, "2"],
    half: float,
    left: float,
    speed: float,
    longest: float,
    rows: int,
) -> InstrumentClock:
    """Return the clock with its verdict: is it known well enough to be taken off?"""
    del rows
    found = dataclasses.replace(
        found,
        standard_deviation=float(deviation[0]),
        rate_deviation=float(deviation[1]) / half if found.rate else 0.0,
    )
    reason = ""
    if abs(found.delay) >= longest:
        reason = f"it is longer than the {1e3 * longest:g} ms that were looked for"
    elif not deviation[0] * speed < 2.0 * left:
        reason = (
            f"{1e6 * deviation[0]:.2g} µs of doubt are {1e3 * deviation[0] * speed:.2g}"
            f" µm (or 0.001°) at {speed:.3g} per s"
        )
    return dataclasses.replace(
        found, determined=not reason, statement=_words(found, reason)
    )


def _words(found: InstrumentClock, reason: str) -> str:
    if reason:
        return f"the delay of the instrument cannot be told: {reason}"
    late = "late" if found.delay >= 0 else "early"
    words = (
        f"the instrument is {1e3 * abs(found.delay):.4f} ms ±"
        f" {1e3 * found.standard_deviation:.2g} ms {late}"
    )
    if found.rate:
        slow = "slow" if found.rate > 0 else "fast"
        words += f", its clock {1e6 * abs(found.rate):.3g} ppm {slow}"
    return words


class _Windows:
    """Sums of a regression in windows, each with a line of its own."""

    def __init__(
        self,
        instants: Float[np.ndarray, " t"],
        spline: object,
        error: Float[np.ndarray, " t"],
        known: Bool[np.ndarray, " t"],
        middle: float,
        half: float,
    ) -> None:
        rows = np.flatnonzero(known)
        at = instants[rows]
        place, speed, rate = (np.asarray(spline(at, k)) for k in range(3))  # type: ignore[operator]
        number = np.floor((at - at[0]) / _WINDOW).astype(np.int64) if rows.size else at
        number = np.unique(number, return_inverse=True)[1].reshape(-1)
        keep = _changing(number, speed)
        rows, at, place, speed, rate = (
            each[keep] for each in (rows, at, place, speed, rate)
        )
        self.number = np.unique(number[keep], return_inverse=True)[1].reshape(-1)
        self.count = int(self.number.max(initial=-1)) + 1
        self.speed = float(np.percentile(np.abs(speed), 90)) if rows.size else 0.0
        self.error = error[rows]
        self.place = place
        way = np.sign(speed) * (np.abs(speed) > 1e-3 * np.abs(speed).max(initial=0.0))
        late = (at - middle) / half
        # The first two are what is asked for; e = −τ v.
        self.columns = np.stack(
            [-speed, -speed * late, rate, *_shapes(place, way)], axis=1
        )

    def solve(
        self, with_rate: bool
    ) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"], float, int]:
        """Return delay and rate, their deviations, the scatter left, and the rows."""
        use = [k for k in range(self.columns.shape[1]) if with_rate or k != 1]
        columns = self.columns[:, use]
        scale = np.maximum(np.sqrt((columns**2).mean(axis=0)), 1e-300)
        columns = columns / scale
        weight = np.ones(len(self.error))
        left = np.inf
        for _ in range(8):
            flat, own = self._without_lines(columns, weight)
            normal = (own * weight[:, None]).T @ own
            normal += 1e-10 * np.trace(normal) / len(use) * np.eye(len(use))
            values = np.linalg.solve(normal, own.T @ (weight * flat))
            residual = flat - own @ values
            left = _HALF * float(np.median(np.abs(residual)))
            weight = 1.0 / (1.0 + (residual / max(_HEAVY * left, 1e-15)) ** 2)
        scores = np.stack(
            [
                np.bincount(self.number, weight * residual * own[:, k], self.count)
                for k in range(len(use))
            ],
            axis=1,
        )
        inverse = np.linalg.inv(normal)
        spread = inverse @ (scores.T @ scores) @ inverse
        deviation = np.sqrt(np.diag(spread)) / scale
        values = values / scale
        if with_rate:
            return values[:2], deviation[:2], left, len(residual)
        return (
            np.array([values[0], 0.0]), np.array([deviation[0], np.inf]), left,
            len(residual),
        )  # fmt: skip

    def _without_lines(
        self, columns: Float[np.ndarray, "n k"], weight: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n k"]]:
        """Return error and columns less each window's line over the position."""

        def mean(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
            sums = np.bincount(self.number, weight * values, self.count)
            return np.asarray((sums / whole)[self.number])

        whole = np.maximum(np.bincount(self.number, weight, self.count), 1e-12)
        place = self.place - mean(self.place)
        power = mean(place * place) + 1e-18

        def flat(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
            level = values - mean(values)
            return np.asarray(level - place * mean(place * level) / power)

        return flat(self.error), np.stack([flat(c) for c in columns.T], axis=1)


def _shapes(
    place: Float[np.ndarray, " n"], way: Float[np.ndarray, " n"]
) -> list[Float[np.ndarray, " n"]]:
    """Return what a table of two directions could express: hats over the position."""
    if not place.size:
        return []
    nodes = np.linspace(place.min(), place.max(), _NODES)
    step = max(nodes[1] - nodes[0], 1e-12)
    hats = [np.maximum(1.0 - np.abs(place - node) / step, 0.0) for node in nodes]
    return [*hats[1:], *(way * hat for hat in hats)]


def _changing(
    number: Int[np.ndarray, " n"], speed: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Return the rows of windows in which the speed changes, and that are not too few."""
    if not number.size:
        return np.zeros(0, dtype=bool)
    count = int(number.max()) + 1
    size = np.bincount(number, minlength=count)
    mean = np.bincount(number, speed, count) / np.maximum(size, 1)
    spread = np.bincount(number, (speed - mean[number]) ** 2, count)
    most = np.abs(speed).max()
    good = (size >= _LEAST_ROWS) & (spread / np.maximum(size, 1) > (0.02 * most) ** 2)
    return np.asarray(good[number] & (most > 0))
