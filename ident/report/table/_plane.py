"""A fitted plane in display units, and how one layer of it is drawn."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline

from ...job import TableResult
from .. import _style as style
from .._scale import Scale, place


@dataclasses.dataclass(frozen=True)
class PlaneTable:
    """A fitted plane in display units; arrays are ``[j, i]`` with j along master 2.

    Attributes:
        masters: Names of master 1 (across) and master 2 (up).
        across: Node positions of master 1 in mm.
        up: Node positions of master 2 in mm.
        value: Error in µm.
        sd: Its standard deviation in µm.
        support: Readings that touch the node; 0 = not measured.
    """

    masters: tuple[str, str]
    across: Float[np.ndarray, " i"]
    up: Float[np.ndarray, " j"]
    value: Float[np.ndarray, "j i"]
    sd: Float[np.ndarray, "j i"]
    support: Int[np.ndarray, "j i"]

    @property
    def measured(self) -> Bool[np.ndarray, "j i"]:
        """Nodes that at least one reading touches."""
        return self.support > 0

    def where(self, index: int) -> str:
        """Return the place of a node, by its flat index, in words."""
        j, i = divmod(int(index), len(self.across))
        first, second = self.masters
        return f"{first} = {place(self.across[i])}, {second} = {place(self.up[j])}"


def plane_table(fit: TableResult, scale: Scale) -> PlaneTable:
    """Return the fitted plane in display units."""
    own = fit.fit
    return PlaneTable(
        (fit.masters[0], fit.masters[1]),
        own.layout.nodes[0],
        own.layout.nodes[1],
        own.values * scale.factor,
        own.standard_deviation * scale.factor,
        own.support,
    )


def heat(
    axes: Axes,
    table: PlaneTable,
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
        style.borders(table.across),
        style.borders(table.up),
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
    table: PlaneTable,
    measured: Bool[np.ndarray, "j i"] | None = None,
    colour: str = "#444444",
) -> None:
    """Hatch the cells of all nodes without readings, as one outline."""
    empty = ~(table.measured if measured is None else measured)
    if not empty.any():
        return
    across, up = style.borders(table.across), style.borders(table.up)
    corners: list[tuple[float, float]] = []
    for first, last, low, high in _rectangles(empty):
        left, right, bottom, top = across[first], across[last], up[low], up[high]
        corners += [(left, bottom), (right, bottom), (right, top), (left, top),
                    (left, bottom)]  # fmt: skip
    step = [Outline.MOVETO, *[Outline.LINETO] * 3, Outline.CLOSEPOLY]
    outline = Outline(corners, step * (len(corners) // 5))
    axes.add_patch(
        PathPatch(
            outline,
            facecolor="none",
            edgecolor=colour,
            hatch="////",
            linewidth=0,
            gid="not-measured",
        )
    )


def _rectangles(mask: Bool[np.ndarray, "j i"]) -> list[tuple[int, int, int, int]]:
    """Return few rectangles (first, last, low, high; ends exclusive) to fill a mask."""
    open_runs: dict[tuple[int, int], int] = {}
    done: list[tuple[int, int, int, int]] = []
    for row in range(mask.shape[0] + 1):
        runs: set[tuple[int, int]] = set()
        if row < mask.shape[0]:
            padded = np.concatenate([[False], mask[row], [False]]).astype(np.int8)
            turns = np.flatnonzero(np.diff(padded)).tolist()
            runs = set(zip(turns[::2], turns[1::2], strict=True))
        for run in [run for run in open_runs if run not in runs]:
            done.append((*run, open_runs.pop(run), row))
        for run in sorted(runs):
            open_runs.setdefault(run, row)
    return done


def hatch_key(label: str = "not measured") -> Patch:
    return Patch(facecolor="none", edgecolor="#444444", hatch="////", linewidth=0.5,
                 label=label)  # fmt: skip


def bar(figure: Figure, mesh: QuadMesh, panels: list[Axes], label: str) -> Colorbar:
    """Draw the colour bar of one layer beside its panels."""
    drawn = figure.colorbar(mesh, ax=panels, pad=0.015, fraction=0.05, aspect=22)
    drawn.set_label(label)
    drawn.outline.set_visible(False)
    return drawn


def label(axes: Axes, table: PlaneTable, scale: Scale) -> None:
    axes.set_xlabel(f"{table.masters[0]} in {scale.position}")
    axes.set_ylabel(f"{table.masters[1]} in {scale.position}")


def _ratio(table: PlaneTable) -> float:
    return float(np.ptp(table.up)) / (float(np.ptp(table.across)) or 1.0)


def map_height(table: PlaneTable) -> float:
    return float(np.clip(5.6 * _ratio(table), 1.9, 4.8)) + 0.3


def symmetric(value: Float[np.ndarray, "..."]) -> float:
    known = np.abs(value[np.isfinite(value)])
    return float(known.max(initial=0.0)) or 1.0


def spread_limits(table: PlaneTable) -> tuple[float, float]:
    """Return colour limits that unmeasured nodes, always the worst, do not stretch."""
    known = table.sd[table.measured] if table.measured.any() else table.sd
    return 0.0, float(known.max()) * 1.05 or 1.0
