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
    """How far the residuals scatter against what was predicted.

    Attributes:
        predicted: Median of the predicted sd in µm; that of readings far from all others,
            as at the end of a left-out block, is many times as large.
        z: Residual / predicted sd of every sound reading.
        inside: Share of readings within ± 2 predicted sd.
        ratio: Root mean square of `z`.
    """

    predicted: float
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
    z = residual / sd
    return Spread(
        predicted=float(np.median(sd)),
        z=z,
        inside=float(np.mean(np.abs(z) <= 2)),
        ratio=float(np.sqrt(np.mean(z**2))),
    )


def spread_plot(readings: Readings, scale: Scale) -> Plot | None:
    """Draw residual / predicted sd as a histogram beside the normal law."""
    spread = spread_of(readings)
    if spread is None:
        return None
    figure, (axes,) = style.new_figure(2.9)
    draw_scatter(axes, spread.z)
    axes.set_xlabel("remaining error / predicted sd")
    axes.set_ylabel("density")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    return Plot(
        "honesty", "Is the stated uncertainty honest?", figure, _say(spread, scale)
    )


def draw_scatter(axes: Axes, z: Float[np.ndarray, " t"]) -> None:
    """Draw how errors over their standard deviation are distributed, and a normal law."""
    edges = np.linspace(-4.5, 4.5, 37)
    axes.hist(
        np.clip(z, -4.5, 4.5), edges.tolist(), density=True, color=style.BLUE,
        alpha=0.45, label="seen",
    )  # fmt: skip
    grid = np.linspace(-4.5, 4.5, 181)
    normal = np.exp(-(grid**2) / 2) / np.sqrt(2 * np.pi)
    axes.plot(grid, normal, color=style.INK, label="expected")


def _say(spread: Spread, scale: Scale) -> str:
    text = (
        f"Half of the left-out readings are predicted to {number(spread.predicted)} "
        f"{scale.error} (1 sd) or better; what remains is {spread.ratio:.2f} × the "
        f"predicted sd (rms). {percent(spread.inside)} of the readings lie "
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
