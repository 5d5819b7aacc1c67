"""The plane as maps: error, uncertainty, coverage."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ...job import SampleView, TableResult
from .. import _style as style
from .._body import Plot
from .._scale import Scale, count, grouped, number
from ._fitted import Fitted, branches_of, say_drawn, say_empty

_TALL = 3.8
"""Maps higher than this, in inches, are square rather than wide."""


def error_map(fit: TableResult, readings: SampleView, scale: Scale) -> Plot:
    """Draw the fitted error with the measured points; unmeasured nodes hatched."""
    (table,) = branches_of(fit, scale)
    figure, (axes,) = style.new_figure(map_height(table) + 0.5)
    span = symmetric(table.value)
    mesh = style.heat(axes, table.nodes, table.value, (-span, span), table.labels)
    bar(figure, mesh, [axes], f"error of {fit.axis} in {scale.error}")
    drawn = min(len(readings.error), style.DRAWN_POINTS)
    style.marks(
        axes, *readings.positions.T, color=style.INK, alpha=0.55, label="reading",
        size=float(np.clip(60 / np.sqrt(drawn), 0.9, 3)), most=drawn,
    )  # fmt: skip
    wild = np.flatnonzero(readings.wild)
    rows = wild[style.thin(wild.size, 400)]
    if wild.size:
        axes.plot(
            readings.positions[rows, 0], readings.positions[rows, 1],
            linestyle="none", marker="x", markersize=4.5, color=style.INK,
            label="wild reading",
        )  # fmt: skip
    hatch(axes, table)
    handles, _ = axes.get_legend_handles_labels()
    if not table.measured.all():
        look: dict[str, Any] = {"facecolor": "none", "edgecolor": "#444444"}
        handles.append(Patch(hatch="////", linewidth=0.5, label="not measured", **look))
    figure.legend(handles=handles, loc="outside upper right", ncols=3, markerscale=2)
    caption = (
        f"{table.runs('At measured nodes the error', scale)}"
        f" {say_empty([table], 'hatched')}{say_drawn(drawn, fit.readings)}"
    )
    return Plot("error-map", "Measured error of the surface", figure, caption)


def coverage_maps(fit: TableResult, scale: Scale) -> Plot:
    """Draw the standard deviation of every node, and how many readings touch it."""
    (table,) = branches_of(fit, scale)
    height = map_height(table)
    # Two wide maps stand one above the other, two square ones side by side.
    if height > _TALL:
        figure, (above, below) = style.new_figure(0.6 * height, 1, 2)
        figure.set_layout_engine("compressed")
    else:
        figure, (above, below) = style.new_figure(2 * height + 0.8, 2, 1)
    # Unmeasured nodes, always the worst, do not stretch the colours.
    sd = table.sd[table.measured] if table.measured.any() else table.sd
    limits = 0.0, float(sd.max()) * 1.05 or 1.0
    mesh = style.heat(above, table.nodes, table.sd, limits, table.labels)
    bar(figure, mesh, [above], f"sd in {scale.error}")
    largest = max(float(np.quantile(table.support, 0.98)), 1.0)
    support = table.support.astype(float)
    mesh = style.heat(below, table.nodes, support, (0.0, largest), table.labels)
    counts = bar(figure, mesh, [below], "readings per node")
    counts.locator = MaxNLocator(integer=True)
    above.set_title("standard deviation")
    below.set_title("readings that touch it")
    hatch(above, table)
    hatch(below, table, colour="white")
    caption = _say_coverage(table, scale)
    return Plot("coverage", "How well each node is known", figure, caption)


def _say_coverage(table: Fitted, scale: Scale) -> str:
    measured = table.measured
    if not measured.any():
        return "No node is touched by a reading."
    sd, support = table.sd[measured], table.support[measured]
    worst = int(np.argmax(np.where(measured, table.sd, -1.0)))
    low, high = int(support.min()), int(support.max())
    readings = ("" if low == high else f"{grouped(low)} to ") + count(high, "reading")
    text = (
        f"Half of the measured nodes have an sd of {number(float(np.median(sd)))} "
        f"{scale.error} or less, the worst {number(float(sd.max()))} "
        f"{scale.error} ({table.where(worst)}); each has {readings}."
    )
    if not measured.all():
        text += (
            f" Unmeasured nodes (hatched) reach an sd of "
            f"{number(float(table.sd[~measured].max()))} {scale.error}; the colours end "
            "at the worst measured node."
        )
    return text


def hatch(axes: Axes, table: Fitted, colour: str = "#444444") -> None:
    """Hatch the cells of all nodes without readings."""
    empty = ~table.measured
    if not empty.any():
        return
    # Each border twice: the contour of a cell is the cell.
    across, up = (np.repeat(style.borders(nodes), 2)[1:-1] for nodes in table.nodes)
    cells = empty.repeat(2, axis=0).repeat(2, axis=1)
    drawn = axes.contourf(
        across, up, cells, levels=[0.5, 1.5], colors="none", hatches=["////"]
    )
    drawn.set_edgecolor(colour)
    drawn.set_linewidth(0)
    drawn.set_gid("not-measured")


def bar(figure: Figure, mesh: QuadMesh, panels: list[Axes], label: str) -> Colorbar:
    """Draw the colour bar of one layer beside its panels."""
    drawn = figure.colorbar(mesh, ax=panels, pad=0.015, fraction=0.05, aspect=22)
    drawn.set_label(label)
    drawn.outline.set_visible(False)
    return drawn


def map_height(table: Fitted) -> float:
    return float(np.clip(5.6 * style.height_of(table.nodes), 1.9, 4.8)) + 0.3


def symmetric(value: Float[np.ndarray, "..."]) -> float:
    finite = np.abs(value[np.isfinite(value)])
    return float(finite.max(initial=0.0)) or 1.0
