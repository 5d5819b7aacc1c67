"""Plots of the tables of a list: a plane as heat map, the others as curves.

Imported only where something is drawn: matplotlib takes longer to load than a list.
"""

import dataclasses
import itertools
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...data.lists import OffsetCurve

FORMATS = ("svg", "png")


def draw_curves(curves: Sequence[OffsetCurve], out: pathlib.Path) -> list[pathlib.Path]:
    """Draw each compensation of a list and return the files written.

    Raises:
        OSError: If the folder cannot be written.
    """
    paths: list[pathlib.Path] = []
    for compensation in dict.fromkeys(curve.compensation for curve in curves):
        alike = [c for c in curves if c.compensation == compensation and _drawable(c)]
        if not alike:
            continue
        if len(alike[0].nodes) == 2:
            figure = _plane_figure([("", alike[0])])
        else:
            figure = _line_figure([(curve.title, curve, "-") for curve in alike])
        paths += _save(figure, out, compensation)
    return paths


def draw_comparison(
    old: Sequence[OffsetCurve], new: Sequence[OffsetCurve], out: pathlib.Path
) -> list[pathlib.Path]:
    """Draw the tables of two lists over each other and return the files written.

    Raises:
        OSError: If the folder cannot be written.
    """
    paths: list[pathlib.Path] = []
    for compensation in dict.fromkeys(curve.compensation for curve in (*new, *old)):
        before, after = (
            [c for c in side if c.compensation == compensation and _drawable(c)]
            for side in (old, new)
        )
        both = [("old", c) for c in before] + [("new", c) for c in after]
        if not both:
            continue
        if len({curve.metric for _, curve in both}) > 1:
            both = [pair for pair in both if pair[0] == "new"]
        if len(both[0][1].nodes) == 2:
            if len(both) == 2:
                both.append(("new - old", _difference(before[0], after[0])))
            figure = _plane_figure(both)
        else:
            figure = _line_figure(
                [
                    (f"{age}: {curve.title}", curve, "--" if age == "old" else "-")
                    for age, curve in both
                ]
            )
        paths += _save(figure, out, f"diff_{compensation}")
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


def _drawable(curve: OffsetCurve) -> bool:
    """Return whether there is anything to draw: positions that ascend."""
    return curve.ascending and all(curve.nodes)


def _new_figure(columns: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(6.4 * columns, 4.8), layout="constrained")
    return figure, [figure.add_subplot(1, columns, k + 1) for k in range(columns)]


def _line_figure(curves: Sequence[tuple[str, OffsetCurve, str]]) -> Figure:
    """Draw offsets over one position, with the nodes marked."""
    figure, (axes,) = _new_figure(1)
    metric = curves[0][1].metric
    many = max(len(curve.nodes[0]) for _, curve, _ in curves) > 60
    for label, curve, dash in curves:
        axes.plot(
            curve.nodes[0],
            curve.offsets[0],
            linestyle=dash,
            marker="" if many else "o",
            markersize=3,
            linewidth=1.2,
            label=label,
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
            _edges(plane.nodes[0]),
            _edges(plane.nodes[1]),
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


def _edges(nodes: Sequence[float]) -> list[float]:
    """Return the borders of cells that have the nodes in their middle."""
    if len(nodes) == 1:
        return [nodes[0] - 0.5, nodes[0] + 0.5]
    middles = [(a + b) / 2 for a, b in itertools.pairwise(nodes)]
    return [2 * nodes[0] - middles[0], *middles, 2 * nodes[-1] - middles[-1]]


def _save(figure: Figure, out: pathlib.Path, name: str) -> list[pathlib.Path]:
    out.mkdir(parents=True, exist_ok=True)
    paths = [out / f"{name}.{form}" for form in FORMATS]
    for path in paths:
        draft = path.with_name(f".{path.name}.part")
        figure.savefig(draft, format=path.suffix[1:], dpi=120)
        draft.replace(path)
    return paths
