"""The friction curve: both directions in bins, the law with its band, the list."""

import dataclasses

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ..job import FrictionResult, LawCurve
from . import _style as style
from ._plot import Plot
from ._scale import Scale, percent, place

_BINS = 28
_FEW = 5
_SLOW = 0.12
"""Share of the speeds that the enlarged part shows."""


@dataclasses.dataclass(frozen=True)
class Bins:
    """Means of the samples in motion, by speed, of one direction.

    Attributes:
        speed: In mm/s.
        mean: Current against the friction, in units of current.
        spread: Standard deviation within the bin.
    """

    speed: Float[np.ndarray, " b"]
    mean: Float[np.ndarray, " b"]
    spread: Float[np.ndarray, " b"]


def bins_of(fit: FrictionResult, way: int) -> Bins:
    """Return the friction current in bins of speed; wild samples hardly move a median."""
    view = fit.view
    rows = view.moving & (np.sign(view.velocity) == way)
    speed, current = np.abs(view.velocity[rows]), way * view.before[rows]
    if speed.size < _FEW:
        empty = np.zeros(0)
        return Bins(empty, empty, empty)
    edges = np.unique(np.quantile(speed, np.linspace(0, 1, _BINS + 1)))
    where = np.clip(np.searchsorted(edges, speed, "right") - 1, 0, len(edges) - 2)
    found = []
    for k in range(len(edges) - 1):
        own = where == k
        if own.sum() >= _FEW:
            middle = float(np.median(current[own]))
            spread = 1.4826 * float(np.median(np.abs(current[own] - middle)))
            found.append((float(np.median(speed[own])), middle, spread))
    columns = np.array(found).reshape(-1, 3)
    return Bins(columns[:, 0], columns[:, 1], columns[:, 2])


def curve_plot(fit: FrictionResult, scale: Scale) -> Plot | None:
    """Draw friction over speed, all speeds and the slow ones enlarged."""
    curve = fit.curve
    if curve is None:
        return None
    figure, panels = style.new_figure(3.4, columns=2)
    every = {way: bins_of(fit, way) for way in (1, -1)}
    fast = float(curve.speed[-1])
    limits = (fast, max(_SLOW * fast, 4.0 * float(curve.speed[0])))
    for panel, limit in zip(panels, limits, strict=True):
        _draw(panel, fit, curve, every, limit)
        panel.set_xlim(-0.02 * limit, 1.02 * limit)
        panel.set_xlabel(f"speed in {fit.length_unit}/s")
    panels[0].set_ylabel(f"friction in {scale.error}")
    panels[0].set_title("all speeds")
    panels[1].set_title("slow speeds, enlarged")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper right", ncols=3)
    return Plot("curve", "Friction over speed", figure, _caption(fit, curve))


def _draw(
    panel: Axes,
    fit: FrictionResult,
    curve: LawCurve,
    every: dict[int, Bins],
    limit: float,
) -> None:
    laws = {
        1: (curve.positive, curve.positive_sd),
        -1: (curve.negative, curve.negative_sd),
    }
    near = curve.speed <= 1.05 * limit
    heights = []
    for way, (law, sd) in laws.items():
        colour = style.DIRECTION_COLOR[way]
        bins = every[way]
        seen = bins.speed <= limit
        panel.errorbar(
            bins.speed[seen], bins.mean[seen], bins.spread[seen],
            linestyle="none", marker=style.DIRECTION_MARKER[way], markersize=3.5,
            linewidth=0.7, color=colour, alpha=0.8,
            label=f"measured, {style.DIRECTION_NAME[way]}",
        )  # fmt: skip
        panel.plot(
            curve.speed, law, color=colour, linewidth=1.2, label=f"law, {'+−'[way < 0]}"
        )
        low, high = law - 2 * sd, law + 2 * sd
        panel.fill_between(
            curve.speed, low, high, color=colour, alpha=0.15, linewidth=0
        )
        heights += [law[near], bins.mean[seen]]
    if curve.listed is not None and fit.knots is not None:
        panel.plot(
            curve.speed, curve.listed, color=style.INK, linewidth=0.9, label="list"
        )
        places = fit.knots.velocity / 1000.0
        panel.plot(
            places, fit.knots.out * fit.knots.unit, linestyle="none", marker="s",
            markersize=3.2, color=style.INK, markerfacecolor="white", label="its entries",
        )  # fmt: skip
        heights.append(curve.listed[near])
    joined = np.concatenate([each for each in heights if each.size])
    low, high = float(joined.min()), float(joined.max())
    room = 0.25 * (high - low) or 0.1 * abs(high) or 1.0
    panel.set_ylim(
        min(low - room, 0.0) if low < 0.4 * high else low - room, high + room
    )


def _caption(fit: FrictionResult, curve: LawCurve) -> str:
    slow, fast = place(float(curve.speed[0])), place(float(curve.speed[-1]))
    text = (
        f"Median friction in bins of speed with their scatter, and the law with ± 2"
        f" standard deviations, from {slow} to {fast} {fit.length_unit}/s: only these speeds"
        " were driven."
    )
    if curve.listed is None:
        return f"{text} No list is written."
    share = curve.difference
    text += " The list is the same for both directions"
    if share > 0.02:
        return (
            f"{text}; they differ by {percent(share)} on average, which it cannot say."
        )
    return f"{text}, which differ by no more than {percent(share)} on average."
