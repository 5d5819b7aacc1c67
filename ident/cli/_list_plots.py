"""Plots of the tables of a list: a plane as heat map, the others as curves.

Imported only where something is drawn: matplotlib takes longer to load than a list.
"""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...data.lists import OffsetCurve
from ..report._iso_chart import write_chart
from ..report._style import borders


def draw_tables(
    new: Sequence[OffsetCurve],
    out: pathlib.Path,
    old: Sequence[OffsetCurve] | None = None,
) -> list[pathlib.Path]:
    """Draw each table of a list, over those of an old one if given; return the files.

    Raises:
        OSError: If the folder cannot be written.
    """
    sides = [("", new)] if old is None else [("old", old), ("new", new)]
    paths: list[pathlib.Path] = []
    for name in dict.fromkeys(
        c.compensation for _, side in reversed(sides) for c in side
    ):
        # There is nothing to draw over positions that do not ascend.
        drawn = [
            (age, curve)
            for age, side in sides
            for curve in side
            if curve.compensation == name and curve.ascending and all(curve.nodes)
        ]
        if len({curve.metric for _, curve in drawn}) > 1:
            drawn = [pair for pair in drawn if pair[0] != "old"]
        if not drawn:
            continue
        if len(drawn[0][1].nodes) == 2:
            if len(drawn) == 2:
                drawn.append(("new - old", _difference(drawn[0][1], drawn[1][1])))
            figure = _plane_figure(drawn)
        else:
            figure = _line_figure(drawn)
        stem = name if old is None else f"diff_{name}"
        paths += write_chart(figure, out, stem)
    return paths


def _difference(old: OffsetCurve, new: OffsetCurve) -> OffsetCurve:
    """Return new − old on the nodes of both, rounded to the entries of a list."""
    pairs = zip(old.nodes, new.nodes, strict=True)
    grid = tuple(tuple(sorted({*a, *b})) for a, b in pairs)
    scale = new.entry_size
    entries = tuple(
        tuple(round((b - a) / scale) for a, b in zip(before, after, strict=True))
        for before, after in zip(old.sample(grid), new.sample(grid), strict=True)
    )
    return dataclasses.replace(new, nodes=grid, entries=entries)


def _new_figure(columns: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(6.4 * columns, 4.8), dpi=120, layout="constrained")
    return figure, [figure.add_subplot(1, columns, k + 1) for k in range(columns)]


def _line_figure(curves: Sequence[tuple[str, OffsetCurve]]) -> Figure:
    """Draw offsets over one position, with the nodes marked."""
    figure, (axes,) = _new_figure(1)
    metric = curves[0][1].metric
    many = max(len(curve.nodes[0]) for _, curve in curves) > 60
    for age, curve in curves:
        axes.plot(
            curve.nodes[0],
            curve.offsets[0],
            linestyle="--" if age == "old" else "-",
            marker="" if many else "o",
            markersize=3,
            linewidth=1.2,
            label=f"{age}: {curve.title}" if age else curve.title,
        )
    axis = curves[0][1].masters[0]
    name = "" if axis is None else f" of axis {axis}"
    axes.set_xlabel(f"position{name} / {'mm' if metric else 'increments'}")
    axes.set_ylabel(f"offset that the controller adds / {'µm' if metric else 'inc'}")
    axes.set_title(f"{curves[0][1].compensation} table")
    axes.axhline(0, color="0.6", linewidth=0.8, zorder=0)
    axes.grid(alpha=0.3)
    if len(curves) > 1:
        axes.legend()
    return figure


def _plane_figure(planes: Sequence[tuple[str, OffsetCurve]]) -> Figure:
    """Draw planes as heat maps of one colour scale, zero in its middle."""
    figure, all_axes = _new_figure(len(planes))
    fields = [np.asarray(plane.offsets) for _, plane in planes]
    limit = max(float(np.abs(field).max(initial=0.0)) for field in fields) or 1.0
    image: Any = None
    for axes, (label, plane), field in zip(all_axes, planes, fields, strict=True):
        image = axes.pcolormesh(
            borders(np.asarray(plane.nodes[0])),
            borders(np.asarray(plane.nodes[1])),
            field,
            cmap="RdBu_r",
            vmin=-limit,
            vmax=limit,
            rasterized=field.size > 10_000,
        )
        unit = "mm" if plane.metric else "increments"
        names = ["master" if m is None else f"axis {m}" for m in plane.masters]
        axes.set_xlabel(f"position of {names[0]} / {unit}")
        axes.set_ylabel(f"position of {names[1]} / {unit}")
        axes.set_title(f"{label}: plane table" if label else "plane table")
    unit = "µm" if planes[0][1].metric else "inc"
    figure.colorbar(
        image, ax=all_axes, label=f"offset that the controller adds / {unit}"
    )
    return figure
