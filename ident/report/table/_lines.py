"""One-dimensional tables: error curve with its uncertainty."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...job import SampleView, TableResult
from .. import _style as style
from .._body import Plot
from .._scale import Scale, number
from ._fitted import Fitted, branches_of, say_drawn, say_empty

_ERROR_BARS = 130
"""Up to this many nodes carry bars; more would run together, so they get a band."""


def curve_plot(fit: TableResult, readings: SampleView, scale: Scale) -> Plot:
    """Draw the measured error, the nodes with ± 2 sd, and the unmeasured ones."""
    branches = branches_of(fit, scale)
    figure, (axes,) = style.new_figure(3.4)
    drawn = _draw_readings(axes, readings)
    for branch in branches:
        _draw_branch(axes, branch)
    _frame_curve(axes, branches, readings)
    axes.set_xlabel(branches[0].labels[0])
    axes.set_ylabel(f"error of {fit.axis} in {scale.error}")
    axes.margins(x=0.02)
    figure.legend(*_unique(axes), loc="outside upper right", ncols=2)
    caption = _say_curve(branches, scale, drawn, fit.readings - fit.wild)
    return Plot("error-curve", "Measured error and the fitted table", figure, caption)


def _draw_readings(axes: Axes, readings: SampleView) -> int:
    """Draw a sample of the sound readings behind the curve; return how many."""
    chosen = style.thin(len(readings.error))
    chosen = chosen[~readings.wild[chosen]]
    style.draw_cloud(
        axes,
        readings.positions[chosen, 0],
        readings.before[chosen],
        readings.signs[chosen],
        names=dict.fromkeys((1, -1, 0), "readings"),
        alpha=0.4,
        most=style.DRAWN_POINTS,
    )
    return len(chosen)


def _draw_branch(axes: Axes, branch: Fitted) -> None:
    (nodes,) = branch.nodes
    colour = style.DIRECTION_COLOR[branch.direction]
    marker = style.DIRECTION_MARKER[branch.direction]
    name = style.DIRECTION_NAME[branch.direction]
    label = "table ± 2 sd" if branch.direction == 0 else f"table ± 2 sd, {name}"
    measured = branch.measured
    if len(nodes) <= _ERROR_BARS:
        # The line is the whole table, measured or not.
        axes.plot(nodes, branch.value, color=colour, linewidth=1.1)
        axes.errorbar(
            nodes[measured], branch.value[measured], 2 * branch.sd[measured],
            color=colour, marker=marker, markersize=3.6, linestyle="none", capsize=1.8,
            elinewidth=0.8, label=label,
        )  # fmt: skip
    else:
        axes.fill_between(
            nodes, branch.value - 2 * branch.sd, branch.value + 2 * branch.sd,
            color=colour, alpha=0.25, linewidth=0,
        )  # fmt: skip
        axes.plot(nodes, branch.value, color=colour, label=label)
    if not measured.all():
        axes.errorbar(
            nodes[~measured], branch.value[~measured], 2 * branch.sd[~measured],
            linestyle="none", marker=marker, markersize=5, capsize=1.8,
            elinewidth=0.8, color=colour, markerfacecolor="white",
            label="not measured", zorder=5,
        )  # fmt: skip


def _frame_curve(axes: Axes, branches: Sequence[Fitted], readings: SampleView) -> None:
    """Choose the limits by what is sound; wild readings become marks at the edge.

    The bars of nodes that nobody measured may leave the frame.
    """
    sound = readings.before[~readings.wild]
    bars = [np.where(branch.measured, 2 * branch.sd, 0.0) for branch in branches]
    tops = [branch.value + bar for branch, bar in zip(branches, bars, strict=True)]
    ends = [branch.value - bar for branch, bar in zip(branches, bars, strict=True)]
    high = max(*(float(top.max()) for top in tops), float(np.max(sound, initial=-1e99)))
    low = min(*(float(end.min()) for end in ends), float(np.min(sound, initial=1e99)))
    pad = 0.06 * (high - low or 1.0)
    low, high = low - pad, high + pad
    axes.set_ylim(low, high)
    wild = np.flatnonzero(readings.wild)
    wild = wild[style.thin(wild.size, 300)]
    if wild.size:
        axes.plot(
            readings.positions[wild, 0],
            np.clip(readings.before[wild], low, high),
            linestyle="none", marker="x", markersize=6, color=style.INK,
            label="wild reading (beyond the frame: at its edge)",
            clip_on=False, zorder=6,
        )  # fmt: skip


def _unique(axes: Axes) -> tuple[list[Any], list[str]]:
    handles, labels = axes.get_legend_handles_labels()
    kept = dict(zip(reversed(labels), reversed(handles), strict=True))
    return list(reversed(kept.values())), list(reversed(kept.keys()))


def _say_curve(branches: Sequence[Fitted], scale: Scale, drawn: int, sound: int) -> str:
    unit = scale.error
    names = {0: "At measured nodes the error"} | {
        sign: f"At nodes measured {style.DIRECTION_NAME[sign]} the error"
        for sign in (1, -1)
    }
    parts = [branch.runs(names[branch.direction], scale) for branch in branches]
    both = np.logical_and.reduce([branch.measured for branch in branches])
    if len(branches) == 2 and both.any():
        gap = np.where(both, branches[0].value - branches[1].value, np.nan)
        widest = int(np.nanargmax(np.abs(gap)))
        parts.append(
            f"The two directions differ by {number(float(np.nanmean(gap)))} {unit} on "
            f"average (+ minus −), most at {branches[0].where(widest)}: "
            f"{number(gap[widest])} {unit}."
        )
    sd = np.concatenate([branch.sd[branch.measured] for branch in branches])
    if sd.size:
        parts.append(
            f"Half of the measured nodes are known to ± {number(2 * np.median(sd))} "
            f"{unit} (2 sd) or better, the worst to ± {number(2 * sd.max())} {unit}."
        )
    parts.append(say_empty(branches, "hollow marks"))
    return " ".join(parts) + say_drawn(drawn, sound)
