"""Is the predicted uncertainty honest? Predicted sd against what was seen."""

import dataclasses

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from .. import _style as style
from .._body import Plot
from .._scale import Scale, number, percent
from ._readings import Readings

_INSIDE = 0.9545
"""Share of a normal distribution within ± 2 sd."""


@dataclasses.dataclass(frozen=True)
class Spread:
    """Predicted sd against the rms of the residuals, in groups of equal predicted sd.

    Attributes:
        predicted: Root mean square of the predicted sd per group in µm.
        seen: Rms of the residuals per group in µm.
        error: Its standard error in µm.
        z: Residual / predicted sd of every sound reading.
        inside: Share of readings within ± 2 predicted sd.
        ratio: Seen / predicted over all sound readings.
    """

    predicted: Float[np.ndarray, " g"]
    seen: Float[np.ndarray, " g"]
    error: Float[np.ndarray, " g"]
    z: Float[np.ndarray, " t"]
    inside: float
    ratio: float


def spread_of(readings: Readings) -> Spread | None:
    """Return predicted against seen scatter; None where nothing was predicted."""
    keep = (
        readings.sound
        & np.isfinite(readings.predicted_sd)
        & (readings.predicted_sd > 0)
    )
    if np.count_nonzero(keep) < 10:
        return None
    residual, sd = readings.predicted[keep], readings.predicted_sd[keep]
    order = np.argsort(sd, kind="stable")
    parts = np.array_split(order, int(np.clip(residual.size // 15, 1, 10)))
    seen = np.array([np.sqrt(np.mean(residual[part] ** 2)) for part in parts])
    size = np.array([part.size for part in parts])
    z = residual / sd
    return Spread(
        predicted=np.array([np.sqrt(np.mean(sd[part] ** 2)) for part in parts]),
        seen=seen,
        error=seen / np.sqrt(2 * size),
        z=z,
        inside=float(np.mean(np.abs(z) <= 2)),
        ratio=float(np.sqrt(np.mean(residual**2) / np.mean(sd**2))),
    )


def spread_plot(readings: Readings, scale: Scale) -> Plot | None:
    """Draw predicted against seen scatter, and residual / sd as a histogram."""
    spread = spread_of(readings)
    if spread is None:
        return None
    figure, (left, right) = style.new_figure(5.6, 2)
    _draw_groups(left, spread, scale)
    _draw_histogram(right, spread)
    return Plot(
        "honesty", "Is the stated uncertainty honest?", figure, _say(spread, scale)
    )


def _draw_groups(axes: Axes, spread: Spread, scale: Scale) -> None:
    axes.errorbar(
        spread.predicted, spread.seen, 2 * spread.error, linestyle="none", marker="o",
        markersize=4.5, color=style.BLUE, elinewidth=1, capsize=2,
        label="group of readings ± 2 se",
    )  # fmt: skip
    top = float(max(spread.predicted.max(), (spread.seen + 2 * spread.error).max()))
    low = float(min(spread.predicted.min(), (spread.seen - 2 * spread.error).min()))
    pad = 0.15 * (top - low) or 0.1 * top
    low, top = max(low - pad, 0.0), top + pad
    axes.plot([low, top], [low, top], color=style.INK, linewidth=0.9,
              label="seen = predicted")  # fmt: skip
    axes.set_xlim(low, top)
    axes.set_ylim(low, top)
    axes.set_xlabel(f"predicted sd in {scale.error}")
    axes.set_ylabel(f"seen rms in {scale.error}")
    _legend_above(axes)


def _draw_histogram(axes: Axes, spread: Spread) -> None:
    edges = np.linspace(-4.5, 4.5, 37)
    axes.hist(
        np.clip(spread.z, -4.5, 4.5), edges.tolist(), density=True, color=style.BLUE,
        alpha=0.45, label="seen",
    )  # fmt: skip
    grid = np.linspace(-4.5, 4.5, 181)
    axes.plot(grid, np.exp(-(grid**2) / 2) / np.sqrt(2 * np.pi), color=style.INK,
              label="expected")  # fmt: skip
    axes.set_xlabel("remaining error / predicted sd")
    axes.set_ylabel("density")
    _legend_above(axes)


def _legend_above(axes: Axes) -> None:
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)


def _say(spread: Spread, scale: Scale) -> str:
    mean = float(np.sqrt(np.mean(spread.predicted**2)))
    text = (
        f"Predicted sd of a left-out reading: {number(mean)} {scale.error}; seen is "
        f"{spread.ratio:.2f} × that. {percent(spread.inside)} of the readings lie "
        f"within ± 2 predicted sd ({percent(_INSIDE)} expected of a normal law): "
    )
    if spread.ratio <= 1.25 and spread.inside < 0.9:
        return (
            text + "right on the whole, but not everywhere: some places scatter more."
        )
    if 0.8 <= spread.ratio <= 1.25:
        return text + "the error bars in this report can be taken at their word."
    if spread.ratio > 1.25:
        return (
            text + "the error bars in this report are too small by about that factor."
        )
    return text + "the error bars in this report are on the safe side."
