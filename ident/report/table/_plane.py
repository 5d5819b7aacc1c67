"""How one layer of a fitted plane is drawn."""

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from .. import _style as style
from .._scale import Scale
from ._fitted import Fitted


def heat(
    axes: Axes,
    table: Fitted,
    value: Float[np.ndarray, "j i"],
    *,
    limits: tuple[float, float] | None = None,
    diverging: bool = False,
) -> QuadMesh:
    if limits is None:
        span = symmetric(value)
        limits = (-span, span)
    axes.grid(False)
    mesh = axes.pcolormesh(
        style.borders(table.nodes[0]),
        style.borders(table.nodes[1]),
        value,
        cmap=style.DIVERGING if diverging else style.SEQUENTIAL,
        vmin=limits[0],
        vmax=limits[1],
        rasterized=True,
    )
    if 0.25 <= _ratio(table) <= 1.2:
        axes.set_aspect("equal")
    return mesh


def hatch(
    axes: Axes,
    table: Fitted,
    measured: Bool[np.ndarray, "j i"] | None = None,
    colour: str = "#444444",
) -> None:
    """Hatch the cells of all nodes without readings."""
    empty = ~(table.measured if measured is None else measured)
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


def hatch_key(label: str = "not measured") -> Patch:
    return Patch(facecolor="none", edgecolor="#444444", hatch="////", linewidth=0.5,
                 label=label)  # fmt: skip


def bar(figure: Figure, mesh: QuadMesh, panels: list[Axes], label: str) -> Colorbar:
    """Draw the colour bar of one layer beside its panels."""
    drawn = figure.colorbar(mesh, ax=panels, pad=0.015, fraction=0.05, aspect=22)
    drawn.set_label(label)
    drawn.outline.set_visible(False)
    return drawn


def label(axes: Axes, table: Fitted, scale: Scale) -> None:
    axes.set_xlabel(f"{table.masters[0]} in {scale.position}")
    axes.set_ylabel(f"{table.masters[1]} in {scale.position}")


def _ratio(table: Fitted) -> float:
    return float(np.ptp(table.nodes[1])) / (float(np.ptp(table.nodes[0])) or 1.0)


def map_height(table: Fitted) -> float:
    return float(np.clip(5.6 * _ratio(table), 1.9, 4.8)) + 0.3


def symmetric(value: Float[np.ndarray, "..."]) -> float:
    known = np.abs(value[np.isfinite(value)])
    return float(known.max(initial=0.0)) or 1.0


def spread_limits(table: Fitted) -> tuple[float, float]:
    """Return colour limits that unmeasured nodes, always the worst, do not stretch."""
    known = table.sd[table.measured] if table.measured.any() else table.sd
    return 0.0, float(known.max()) * 1.05 or 1.0
