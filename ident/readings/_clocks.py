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
_GRID, _MOST_OFFSETS = 81, 1601
"""Offsets that are tried over the length of the shorter record, and in all."""
_FLAT = 0.98
"""Cost of the best offset, in those of the worst, that tells one from the other."""
_PLACES, _PER_PLACE, _VISITS = 32, 8, 2
"""Places of an axis whose own error is taken off at most, readings and visits of each at least."""
_NEVER = 1e9
"""Of an offset that explains too little to be compared."""
_CLOSE = 0.1
"""Share of the shorter record beyond which an offset is another one, however uncertain it is."""
_RIVAL = 0.7
"""Of what the best offset explains, what another one must explain to stand beside it."""
_REFUTED, _AGREES = 6.0, 4.0
"""Standard deviations from which on the readings refute an offset, and up to which clocks agree as
they are; noise of the other file, which is another one at each offset, takes some of them."""
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
        standard_deviation: In s; None where the offset is not fitted.
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
        seconds: First clock − other clock; 0 where it is not determined and the clocks agree
            as they are.
        standard_deviation: Of that; None where it is not determined.
        explained: Share of the scatter that the other file explains, 0 to 1.
    """

    seconds: float
    standard_deviation: float | None
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
    offset both follow it, beside an error of its own at each place. Searched over all offsets
    at which half of the shorter record meets the other: by correlation, on a grid, and around
    the best place of that, which explains most readings best. The last steps are those of a
    regression with the slope over the offset beside its columns, which knows the deviation,
    too (P. J. Bickel, J. Am. Stat. Assoc. 70, 1975).

    Offsets farther away may explain the readings that both can explain as well: a history
    that approaches its end exponentially is alike, up to a factor, however it is moved. Then
    the clocks stay as they are if the readings do not refute that.

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
    spans = float(np.ptp(time)), float(np.ptp(other_time))
    span = min(spans)
    if min(len(time), len(other_time)) < _LEAST or span <= 0.0:
        msg = f"a file has fewer than {_LEAST} instants."
        raise FitError(msg)
    if position is None:
        base, search = _coarse(time, signal, other_time, other)
    else:
        base = 0.5 * float(time[0] + time[-1] - other_time[0] - other_time[-1])
        search = _OVERLAP * max(spans)
    is_number, rows = np.isfinite(other), np.isfinite(signal) & np.isfinite(time)
    rows &= True if position is None else np.isfinite(position)
    time, signal, centred = time[rows], signal[rows], None
    if position is not None:
        signal = _without_places(signal, position[rows])
        centred = position[rows] - float(np.mean(position[rows]))
    pair = _Pair(time, signal, other_time[is_number], other[is_number], centred)

    def explanation(offset: float) -> tuple[float, float]:
        """Return the deviance that the other file explains, and what it leaves per reading."""
        common = pair.in_common(offset)
        if common.sum() < _LEAST or np.ptp(time[common]) < _OVERLAP * span:
            return 0.0, np.inf
        columns = pair.columns(offset, common)
        without = np.abs(pair.residual(columns[:, ::2], common)).mean()
        left = np.abs(pair.residual(columns, common)).mean()
        ratio = max(without, 1e-300) / max(left, 1e-9 * without, 1e-300)
        return float(common.sum() * np.log(ratio)), float(left)

    points = min(int(_GRID * 2.0 * search / span) + 1, _MOST_OFFSETS)
    grid = base + np.linspace(-search, search, max(points, _GRID))
    gain, costs = np.array([explanation(offset) for offset in grid]).T
    finite = costs[np.isfinite(costs)]
    if not finite.size or not finite.min() < _FLAT * finite.max():
        raise FitError(_SAME)
    # An offset that leaves few readings is not better for explaining these as well.
    start, step = float(grid[np.argmax(gain)]), float(grid[1] - grid[0])
    # A slope over less than these distances would be one of the log's noise.
    width = 0.5 * max(float(np.median(np.diff(np.unique(time)))), step)
    # The same readings for all offsets that are near.
    reach = 1.5 * step
    common = pair.in_common(start - reach - width)
    common &= pair.in_common(start + reach + width)
    bounds = start - reach, start + reach

    def cost(offset: float) -> float:
        size = pair.residual(pair.columns(offset, common), common)
        return float(np.abs(size).mean())

    def refined(
        offset: float, factors: Float[np.ndarray, " c"]
    ) -> tuple[float, Regression]:
        """Return a better offset, and the regression with the slope over it as a column."""
        change = pair.columns(offset + width, common)
        change -= pair.columns(offset - width, common)
        slope = change @ factors / (2.0 * width)
        design = np.column_stack([pair.columns(offset, common), slope])
        regression = regress(design, signal[common], time=time[common])
        return float(np.clip(offset + regression.coefficients[-1], *bounds)), regression

    optimum = float(minimize_scalar(cost, bounds=bounds, method="bounded").x)
    try:
        factors = regress(pair.columns(optimum, common), signal[common]).coefficients
        optimum, regression = refined(optimum, factors)
        # The slope is another one there.
        optimum, regression = refined(optimum, regression.coefficients[:-1])
    except FitError as error:
        raise FitError(_SAME) from error
    deviation = float(regression.standard_deviation[-1])
    reference = pair.in_common(optimum)
    left = np.full(len(time), np.nan)
    left[reference] = pair.residual(pair.columns(optimum, reference), reference)
    scale = max(1.4826 * float(np.nanmedian(np.abs(left))), 1e-300)
    # As many readings as the drift of the residual makes of one that is independent.
    alike = max(float(reference.sum() / max(regression.independent[-1], 1.0)), 1.0)

    def refutation(offset: float) -> float:
        """Return by how many standard deviations, squared, the same readings refute an offset."""
        both = reference & pair.in_common(offset)
        if explanation(offset)[0] < _RIVAL * gain.max():
            return _NEVER
        if both.sum() < _LEAST:
            return 0.0
        here = pair.residual(pair.columns(offset, both), both)
        return float(
            np.sum(_deviance(here / scale) - _deviance(left[both] / scale)) / alike
        )

    # Twice as far as a parabola of that deviation would be refuted.
    near = reach + min(2.0 * _REFUTED * deviation, _CLOSE * span)
    rivals = list[float]()
    far = grid[np.abs(grid - optimum) > near]
    for place in _lowest(far, np.array([*map(refutation, far)])):
        around = place - step, place + step
        lower = minimize_scalar(refutation, bounds=around, method="bounded").x
        rivals += [at for at in (place, float(lower)) if refutation(at) < _REFUTED**2]
    known: float | None = deviation
    if rivals or not deviation < search:
        if refutation(0.0) >= _AGREES**2:
            msg = (
                f"offsets between the clocks from {min([*rivals, optimum]):.4g} to"
                f" {max([*rivals, optimum]):.4g} s fit about as well."
            )
            raise FitError(msg)
        optimum, known = 0.0, None
    spread = max(float(np.var(signal[common])), 1e-300)
    explained = 1.0 - float(np.var(regression.residual[~regression.wild])) / spread
    if explained < _ALIKE:
        msg = (
            f"at the best offset one explains {100 * max(explained, 0.0):.0f} % of the"
            f" scatter of the other, expected {100 * _ALIKE:.0f} % at least."
        )
        raise FitError(msg)
    return Offset(optimum, known, explained)


@dataclasses.dataclass(frozen=True)
class _Pair:
    """Two signals, of which the first is a line in the second at the right offset.

    Attributes:
        time: Of the first in s.
        signal: Its values.
        other_time: Of the other in s.
        other: Its values.
        position: Of the axis in mm less its mean, where slope and offset of the line follow it.
    """

    time: Float[np.ndarray, " t"]
    signal: Float[np.ndarray, " t"]
    other_time: Float[np.ndarray, " l"]
    other: Float[np.ndarray, " l"]
    position: Float[np.ndarray, " t"] | None

    def in_common(self, offset: float) -> Bool[np.ndarray, " t"]:
        """Return which readings lie within the time of the other file."""
        instants = self.time - offset
        first, last = self.other_time[0], self.other_time[-1]
        return np.asarray((instants >= first) & (instants <= last))

    def columns(
        self, offset: float, common: Bool[np.ndarray, " t"]
    ) -> Float[np.ndarray, "k c"]:
        """Return what explains the signal: every second column comes from the other file."""
        reference = np.interp(self.time[common] - offset, self.other_time, self.other)
        reference -= self.other.mean()
        parts = [np.ones(len(reference)), reference]
        if self.position is not None:
            parts += [self.position[common], self.position[common] * reference]
        return np.column_stack(parts)

    def residual(
        self, columns: Float[np.ndarray, "k c"], common: Bool[np.ndarray, " t"]
    ) -> Float[np.ndarray, " k"]:
        """Return what columns leave of the signal, wild readings cut."""
        value = np.linalg.lstsq(columns, self.signal[common], rcond=None)[0]
        left = self.signal[common] - columns @ value
        most = 5.0 * np.median(np.abs(left)) + 1e-300
        return np.asarray(np.clip(left, -most, most))


def _deviance(ratio: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return that of Student's t with 4 degrees of freedom, where wild readings weigh little."""
    return np.asarray(5.0 * np.log1p(np.square(ratio) / 4.0))


def _lowest(
    places: Float[np.ndarray, " k"], values: Float[np.ndarray, " k"]
) -> list[float]:
    """Return where values are lowest among their neighbours."""
    padded = np.pad(values, 1, constant_values=_NEVER)
    low = (values < _NEVER) & (values <= padded[:-2]) & (values <= padded[2:])
    return [float(place) for place in places[low]]


def _coarse(
    time: Float[np.ndarray, " t"],
    signal: Float[np.ndarray, " t"],
    other_time: Float[np.ndarray, " l"],
    other: Float[np.ndarray, " l"],
) -> tuple[float, float]:
    """Return the middle of the offsets near the largest correlation, and how far to look."""
    longest = max(float(np.ptp(time)), float(np.ptp(other_time)))
    steps = [float(np.median(np.diff(instants))) for instants in (time, other_time)]
    step = max(*steps, longest / _MOST)
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
    offset = float(time[0] - other_time[0]) + step * float(lags[low] + lags[high]) / 2.0
    return offset, step * max(0.5 * (high - low), 4.0)


def _without_places(
    signal: Float[np.ndarray, " t"], position: Float[np.ndarray, " t"]
) -> Float[np.ndarray, " t"]:
    """Return errors less the median of those at the same place in the same direction.

    Raises:
        FitError: If no place is met again.
    """
    moves = np.diff(position, prepend=position[:1])
    moved = np.flatnonzero(moves)
    if not moved.size:
        return signal
    last = np.searchsorted(moved, np.arange(len(moves)), side="right") - 1
    forth = moves[moved[np.maximum(last, 0)]] > 0.0
    number = int(np.clip(len(signal) // (2 * _PER_PLACE), 1, _PLACES))
    edges = np.linspace(position.min(), position.max(), number + 1)
    place = 2 * (np.searchsorted(edges[1:-1], position, side="right")) + forth
    places, index = np.unique(place, return_inverse=True)
    if 1 + np.count_nonzero(np.diff(place)) < _VISITS * len(places):
        msg = (
            "each place is met once: the error of the axis there cannot be told from one that"
            " follows a temperature."
        )
        raise FitError(msg)
    own = np.array([np.median(signal[index == k]) for k in range(len(places))])
    return np.asarray(signal - own[index])


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
