"""How noisy a sampled signal is, whatever it does, and how that passes a filter."""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from ._errors import check_lengths
from ._order import median

_THIRD = math.sqrt(20.0)
"""Third differences of white noise are that many times as large (1, 3, 3, 1)."""
NORMAL = 1.4826
"""Standard deviation per median of the absolute value, of normal noise."""
CLOSER, MANY = 0.16, 10
"""Part of the scatter of readings of a machine below which others of it never scatter, and how many
tell how they do."""


def noise_of(
    values: Float[np.ndarray, " t"], time: Float[np.ndarray, " t"] | None = None
) -> float:
    """Return the standard deviation of the white noise on a smooth signal.

    From third differences (divided ones where the times are given, which need not be
    equally far apart), which a motion of moderate jerk does not show, by their median,
    which reversals do not show. Of a signal that hardly changes the resolution counts:
    a step of the display stands for 1/√12 of it.
    """
    check_lengths("noise", values.size, least=8)
    return max(scatter_of(values, time), resolution(values) / math.sqrt(12.0))


def third_differences(values: Float[np.ndarray, " t"]) -> Float[np.ndarray, " _n"]:
    """Return the third differences of a signal, as large as white noise on it."""
    return np.diff(values, 3) / _THIRD


def scatter_of(
    values: Float[np.ndarray, " t"], time: Float[np.ndarray, " t"] | None = None
) -> float:
    """Return the noise as `noise_of`, of four values at least, whatever the resolution is."""
    third = third_differences(values) if time is None else _divided(values, time)
    return NORMAL * median(np.abs(third))


def repeatability(
    place: Int[np.ndarray, " t"], values: Float[np.ndarray, " t"]
) -> tuple[float, int]:
    """Return how values of one place scatter, and how many repeats tell that.

    By how the steps from one to the next of a place differ from those of the next place: an axis
    that warms up, or a zero that is set anew, moves neighbours alike, and is no scatter.

    Args:
        place: Number of the place of each, in their order.
        values: As they follow each other in time at each place.
    """
    order = np.argsort(place, kind="stable")
    place, values = place[order], values[order]
    again = np.flatnonzero(np.diff(place) == 0)
    turn = again - np.searchsorted(place, place[again])
    steps = np.diff(values)[again[np.argsort(turn, kind="stable")]]
    if steps.size < 2:
        return 0.0, 0
    return 0.5 * NORMAL * median(np.abs(np.diff(steps))), steps.size


def _divided(
    values: Float[np.ndarray, " t"], time: Float[np.ndarray, " t"]
) -> Float[np.ndarray, " n"]:
    """Return third divided differences, scaled so that they keep white noise as it is."""
    scale = median(np.abs(np.diff(time))) or 1.0
    places = [time[k : time.size - 3 + k] / scale for k in range(4)]
    total, power = np.zeros(time.size - 3), np.zeros(time.size - 3)
    for k, place in enumerate(places):
        product = np.ones(time.size - 3)
        for other in range(4):
            if other != k:
                product *= place - places[other]
        # The same time twice tells nothing; its quotient is left out below.
        weight = 1.0 / np.where(product == 0.0, np.nan, product)
        total += weight * values[k : time.size - 3 + k]
        power += weight**2
    third = total / np.sqrt(power)
    finite: Float[np.ndarray, " n"] = third[np.isfinite(third)]
    return finite


def resolution(values: Float[np.ndarray, " t"]) -> float:
    """Return the step of a quantised signal; the smallest difference of two values.

    Of a signal with full precision this is as small as rounding.
    """
    if values.size < 2:
        return 0.0
    levels = np.sort(values)
    gaps = levels[1:] - levels[:-1]
    # Equal numbers may differ in the last bits after a conversion of units.
    distinct = gaps[gaps > 1e-9 * float(levels[-1] - levels[0])]
    return float(distinct.min()) if distinct.size else 0.0


def noise_gain(
    pipeline: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]],
    length: int,
) -> float:
    """Return the standard deviation that white noise of 1 has behind a linear filter.

    Args:
        pipeline: Linear and the same for every sample.
        length: Samples that its impulse response takes.
    """
    impulse = np.zeros(2 * length + 1)
    impulse[length] = 1.0
    return float(np.linalg.norm(pipeline(impulse)))


def long_run_deviations(
    values: Float[np.ndarray, "k t"], lag: int
) -> Float[np.ndarray, " k"]:
    """Return the standard deviation of the sum of correlated values about 0, per row.

    Bartlett weights up to a lag (Newey and West, Econometrica 55(3), 1987). These are
    how often sums over lag + 1 values in a row, at the ends over fewer, hold both of two
    values: the mean square of such sums has them.
    """
    rows, size = values.shape
    lag = min(lag, size - 1)
    total = np.cumsum(values, axis=1)
    sums = np.empty((rows, size + lag))
    sums[:, :size] = total
    sums[:, size:] = total[:, -1:]
    sums[:, lag + 1 :] -= total[:, :-1]
    return np.sqrt(np.array([row @ row for row in sums]) / (lag + 1))


def independent(residual: Float[np.ndarray, " r"]) -> float:
    """Return to how many independent rows a residual amounts.

    From the correlations of neighbours, up to the distance at which chance alone would
    make them: what a model leaves out is seen in many rows, and is yet one observation.
    """
    count = len(residual)
    spectrum = np.square(np.abs(np.fft.rfft(residual, 2 * count)))
    correlation = np.fft.irfft(spectrum)[:count]
    if correlation[0] <= 0.0:
        return float(count)
    correlation = correlation / correlation[0]
    uncorrelated = correlation < 2.0 / np.sqrt(count)
    reach = int(np.argmax(uncorrelated)) if uncorrelated.any() else count
    return max(2.0, count / (2.0 * float(correlation[:reach].sum()) - 1.0))
