"""Delay between two channels to a fraction of a sample."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ._errors import check_lengths
from ._filter import SETTLING, zero_phase
from ._noise import long_run_deviations

_LEAST_CORRELATION = 0.5
_SECOND_PEAK = 0.98
"""Share of the best correlation at which another place is as good as it."""
_STEPS = 30


@dataclasses.dataclass(frozen=True)
class Delay:
    """How much later one channel shows what another shows.

    Attributes:
        seconds: Positive where the second channel is late.
        standard_deviation: In s; noise of both channels, correlated or not.
        gain: Units of the second channel per unit of the first.
        correlation: Of the two, the delay taken out.
        determined: Whether the record tells the delay; else it is not to be used.
        statement: In words.
    """

    seconds: float
    standard_deviation: float
    gain: float
    correlation: float
    determined: bool
    statement: str


def estimate_delay(
    reference: Float[np.ndarray, " t"],
    delayed: Float[np.ndarray, " t"],
    sample_time: float,
    *,
    longest: float,
    cutoff: float | None = None,
) -> Delay:
    r"""Return the delay $\tau$ of $y(t) = a + b\,x(t - \tau)$ by least squares.

    Both channels pass the same zero-phase low pass, without which interpolation would
    smooth the noise of $x$ at half samples more than at whole ones and draw the delay
    there. The standard deviation allows for noise that the filter has correlated.

    Args:
        reference: $x$, in any unit; at equal steps and without jumps of the clock.
        delayed: $y$, in any unit.
        sample_time: In s.
        longest: Delay in s, of either sign, that is looked for.
        cutoff: Of the low pass in Hz; a tenth of the sample rate where left out.

    Raises:
        SignalError: If there are too few samples for the filter and the delay.
    """
    from scipy.interpolate import CubicSpline

    cutoff = 0.1 / sample_time if cutoff is None else cutoff
    most = int(np.ceil(longest / sample_time))
    edge = most + max(2, round(SETTLING / cutoff / sample_time))
    least = 2 * edge + 50
    check_lengths("delay", reference.size, delayed.size, least=least)
    x = zero_phase(reference, sample_time, cutoff=cutoff)
    y = zero_phase(delayed, sample_time, cutoff=cutoff)
    inner = slice(edge, x.size - edge)
    if min(np.ptp(x[inner]), np.ptp(y[inner])) == 0.0:
        words = "the delay cannot be told: one of the channels does not change"
        return Delay(0.0, float("inf"), 0.0, 0.0, False, words)
    start, second = _coarse(np.gradient(x), np.gradient(y), most, edge)
    rows = np.arange(edge, x.size - edge)
    spline = CubicSpline(np.arange(x.size), x)
    samples = _refine(spline, rows, y[rows], start, most)
    model, slope = spline(rows - samples), spline(rows - samples, 1)
    lag = max(3, round(3.0 / cutoff / sample_time))
    deviation, gain, correlation = _judge(model, slope, y[rows], lag)
    seconds, sigma = samples * sample_time, deviation * sample_time
    reason = ""
    if correlation < _LEAST_CORRELATION:
        reason = f"the channels are alike to {100 * correlation:.0f} % only"
    elif abs(samples) >= most:
        reason = f"it is longer than the {1e3 * longest:g} ms that were looked for"
    elif second > _SECOND_PEAK:
        reason = "the motion repeats, so that another delay fits as well"
    elif not sigma < 0.3 * longest:
        reason = f"its standard deviation is {1e3 * sigma:.2g} ms"
    words = f"delay {1e3 * seconds:.4f} ms ± {1e3 * sigma:.2g} ms"
    if reason:
        words = f"the delay cannot be told: {reason}"
    return Delay(seconds, sigma, gain, correlation, not reason, words)


def _coarse(
    x: Float[np.ndarray, " t"], y: Float[np.ndarray, " t"], most: int, edge: int
) -> tuple[int, float]:
    """Return the whole delay of best correlation, and how good another place is."""
    from scipy.signal import correlate

    y = y[edge : y.size - edge]
    products = correlate(
        x, y - y.mean(), mode="valid"
    )  # sum of y over each window of x
    size = y.size
    sums = np.concatenate([[0.0], np.cumsum(x)])
    squares = np.concatenate([[0.0], np.cumsum(x * x)])
    mean = (sums[size:] - sums[:-size]) / size
    power = (squares[size:] - squares[:-size]) - size * mean**2
    # Window k of x is late by k - edge: y(t) meets x(t - τ) with τ = edge - k.
    scores = np.abs(products) / np.sqrt(np.maximum(power, 1e-300))
    delays = edge - np.arange(scores.size)
    scores = np.where(np.abs(delays) <= most, scores, 0.0)
    best = int(np.argmax(scores))
    inner = (scores[1:-1] > scores[:-2]) & (scores[1:-1] >= scores[2:])
    others = [
        scores[peak]
        for peak in (1 + np.flatnonzero(inner)).tolist()
        # Ripples on the way down from the best, as samples that a recorder repeats make
        # them, are no other place.
        if scores[min(peak, best) : max(peak, best) + 1].min()
        < _SECOND_PEAK * scores[peak]
    ]
    return int(delays[best]), float(max(others, default=0.0) / scores[best])


def _refine(
    spline: Any,
    rows: Int[np.ndarray, " n"],
    target: Float[np.ndarray, " n"],
    start: int,
    most: int,
) -> float:
    """Return the delay in samples by Gauss-Newton steps from a whole one."""
    delay = float(start)
    for _ in range(_STEPS):
        model, slope = spline(rows - delay), spline(rows - delay, 1)
        columns = np.column_stack([np.ones(rows.size), model, slope])
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        fit = np.linalg.lstsq(columns / scale, target, rcond=None)[0] / scale
        if fit[1] == 0.0:
            break
        # a + b x(t - τ - δ) = a + b x - b δ x'
        step = float(np.clip(-fit[2] / fit[1], -0.5, 0.5))
        delay = float(np.clip(delay + step, -most, most))
        if abs(step) < 1e-9:
            break
    return delay


def _judge(
    model: Float[np.ndarray, " n"],
    slope: Float[np.ndarray, " n"],
    target: Float[np.ndarray, " n"],
    lag: int,
) -> tuple[float, float, float]:
    """Return the deviation of the delay in samples, gain, and correlation."""
    design = np.column_stack([np.ones(target.size), model - model.mean()])
    fit = np.linalg.lstsq(design, target, rcond=None)[0]
    residual = target - design @ fit
    projected = slope - design @ np.linalg.lstsq(design, slope, rcond=None)[0]
    gradient = fit[1] * projected
    power = float(gradient @ gradient)
    spread = float(np.linalg.norm(target - target.mean()))
    if power == 0.0 or spread == 0.0:
        return float("inf"), float(fit[1]), 0.0
    deviations = long_run_deviations((gradient * residual)[None], lag)
    deviation = float(deviations[0]) / power
    share = 1.0 - (float(np.linalg.norm(residual)) / spread) ** 2
    return deviation, float(fit[1]), max(share, 0.0) ** 0.5
