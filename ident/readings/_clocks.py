"""The offset between the clocks of two files, from what both of them saw."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize_scalar

from ..core import FitError, Regression, one_blas_thread, regress

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
_GRID = 81
"""Offsets that are tried before the best one is refined."""
_FLAT = 0.98
"""Cost of the best offset, in those of the worst, that tells one from the other."""
_SAME = (
    "the signals are equally alike at all offsets tried: they do not tell the offset "
    "between the clocks."
)


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
    """An offset between two clocks.

    Attributes:
        seconds: First clock − other clock.
        standard_deviation: Of that.
        explained: Share of the scatter that the other file explains, 0 to 1.
    """

    seconds: float
    standard_deviation: float
    explained: float


@one_blas_thread()
def find_offset(
    time: Float[np.ndarray, " t"],
    signal: Float[np.ndarray, " t"],
    other_time: Float[np.ndarray, " l"],
    other: Float[np.ndarray, " l"],
    position: Float[np.ndarray, " t"] | None = None,
) -> Offset:
    r"""Return the offset between the clocks of two files.

    The signal is taken as a line in what the other file saw (the same temperature measured
    twice; an error that follows a temperature), with positions as a line whose slope and
    offset both follow it. Searched over all offsets at which half of the shorter record
    meets the other: by correlation, on a grid, and around the best place of that. The last
    steps are those of a regression with the slope over the offset beside its columns, which
    knows the deviation, too (P. J. Bickel, J. Am. Stat. Assoc. 70, 1975).

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
    span = min(float(np.ptp(time)), float(np.ptp(other_time)))
    if position is None:
        base, search = _coarse(time, signal, other_time, other)
    else:
        base = 0.5 * float(time[0] + time[-1] - other_time[0] - other_time[-1])
        search = _OVERLAP * span
    is_number = np.isfinite(other)
    other_time, other = other_time[is_number], other[is_number]
    rows = np.isfinite(signal) & np.isfinite(time)
    time, signal = time[rows], signal[rows]
    centred = (
        None if position is None else position[rows] - float(np.mean(position[rows]))
    )

    def in_common(offset: float) -> Bool[np.ndarray, " t"]:
        instants = time - offset
        return np.asarray((instants >= other_time[0]) & (instants <= other_time[-1]))

    def columns(
        offset: float, common: Bool[np.ndarray, " t"]
    ) -> Float[np.ndarray, "k c"]:
        reference = np.interp(time[common] - offset, other_time, other) - other.mean()
        parts = [np.ones(len(reference)), reference]
        if centred is not None:
            parts += [centred[common], centred[common] * reference]
        return np.column_stack(parts)

    def cost(offset: float, common: Bool[np.ndarray, " t"]) -> float:
        design = columns(offset, common)
        value = np.linalg.lstsq(design, signal[common], rcond=None)[0]
        size = np.abs(signal[common] - design @ value)
        return float(np.minimum(size, 5.0 * np.median(size) + 1e-300).mean())

    def overlapping(offset: float) -> float:
        common = in_common(offset)
        too_few = common.sum() < _LEAST or np.ptp(time[common]) < _OVERLAP * span
        return np.inf if too_few else cost(offset, common)

    grid = base + np.linspace(-search, search, _GRID)
    costs = np.array([overlapping(offset) for offset in grid])
    finite = costs[np.isfinite(costs)]
    if not finite.size or not finite.min() < _FLAT * finite.max():
        raise FitError(_SAME)
    start, step = float(grid[np.argmin(costs)]), float(grid[1] - grid[0])
    # A slope over less than the distance of the readings would be one of the log's noise.
    width = 0.5 * max(float(np.median(np.diff(np.unique(time)))), 0.2 * step)
    # The same readings for all offsets that are near.
    reach = 1.5 * step
    common = in_common(start - reach - width) & in_common(start + reach + width)
    bounds = start - reach, start + reach
    optimum = float(
        minimize_scalar(cost, bounds=bounds, args=(common,), method="bounded").x
    )

    def refined(
        offset: float, factors: Float[np.ndarray, " c"]
    ) -> tuple[float, Regression]:
        """Return a better offset, and the regression with the slope over it as a column."""
        change = columns(offset + width, common) - columns(offset - width, common)
        slope = change @ factors / (2.0 * width)
        design = np.column_stack([columns(offset, common), slope])
        regression = regress(design, signal[common], time=time[common])
        return float(np.clip(offset + regression.coefficients[-1], *bounds)), regression

    try:
        factors = regress(columns(optimum, common), signal[common]).coefficients
        optimum, regression = refined(optimum, factors)
        # The slope is another one there.
        optimum, regression = refined(optimum, regression.coefficients[:-1])
    except FitError as error:
        raise FitError(_SAME) from error
    deviation = float(regression.standard_deviation[-1])
    if not deviation < search:
        msg = (
            f"the offset between the clocks is uncertain by {deviation:.3g} s, expected "
            "signals that change sharply enough to tell it."
        )
        raise FitError(msg)
    spread = max(float(np.var(signal[common])), 1e-300)
    explained = 1.0 - float(np.var(regression.residual[~regression.wild])) / spread
    if explained < _ALIKE:
        msg = (
            f"at the best offset one explains {100 * max(explained, 0.0):.0f} % of the"
            f" scatter of the other, expected {100 * _ALIKE:.0f} % at least."
        )
        raise FitError(msg)
    return Offset(optimum, deviation, explained)


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
    steps = [float(np.median(np.diff(instants))) for instants in (time, other_time)]
    step = max(*steps, max(spans) / _MOST)
    first = _evenly(time, signal, step)
    second = _evenly(other_time, other, step)
    if min(float(np.ptp(first)), float(np.ptp(second))) <= 0.0:
        msg = "one of them does not change."
        raise FitError(msg)
    lags, score = _correlations(first, second)
    peak = int(np.argmax(score))
    is_high = score >= _NEAR * score[peak]
    low, high = peak, peak
    while low > 0 and is_high[low - 1]:
        low -= 1
    while high < len(score) - 1 and is_high[high + 1]:
        high += 1
    elsewhere = np.concatenate([score[:low], score[high + 1 :]])
    if elsewhere.size and float(elsewhere.max()) > _AGAIN * score[peak]:
        msg = "it repeats itself, so that another offset fits as well."
        raise FitError(msg)
    offset = float(time[0] - other_time[0]) + step * float(lags[peak])
    return offset, step * max(min(peak - low, high - peak), 4)


def _evenly(
    time: Float[np.ndarray, " t"], values: Float[np.ndarray, " t"], step: float
) -> Float[np.ndarray, " n"]:
    finite = np.isfinite(values)
    if int(finite.sum()) < _LEAST:
        msg = f"fewer than {_LEAST} readings of it are numbers."
        raise FitError(msg)
    clock = np.arange(time[0], time[-1] + 0.5 * step, step)
    return np.asarray(np.interp(clock, time[finite], values[finite]))


def _correlations(
    first: Float[np.ndarray, " n"], second: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return shifts of the second signal in steps, and how alike both are there."""
    from scipy.signal import correlate

    def over(signal: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.asarray(correlate(signal, other, mode="full", method="fft"))

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
