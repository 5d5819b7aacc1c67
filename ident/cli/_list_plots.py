"""Plots of the tables of a list: a plane as heat map, the others as curves.

Imported only where something is drawn: matplotlib takes longer to load than a list.
"""

import dataclasses
import pathlib
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...data.lists import OffsetCurve
from ..report._iso_chart import write_chart
from ..report._style import heat, house_style, new_figure

_Drawn = Sequence[tuple[str, OffsetCurve]]
"""Tables of one compensation, each with what it is called: ``old``, ``new``, or nothing."""


def draw_tables(
    new: Sequence[OffsetCurve],
    out: pathlib.Path,
    old: Sequence[OffsetCurve] | None = None,
) -> list[pathlib.Path]:
    """Draw each table of a list, over those of an old one if given; return the files."""
    sides = [("", new)] if old is None else [("old", old), ("new", new)]
    paths: list[pathlib.Path] = []
    every = (curve for _, side in reversed(sides) for curve in side)
    for name in dict.fromkeys(curve.compensation for curve in every):
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
        stem = name if old is None else f"diff_{name}"
        with house_style():
            draw = _curves if len(drawn[0][1].nodes) == 1 else _planes
            paths += write_chart(draw(drawn), out, stem)
    return paths


def _curves(drawn: _Drawn) -> Figure:
    """Draw offsets over one position, with the nodes marked."""
    figure, (axes,) = new_figure(4.8)
    for age, curve in drawn:
        form, label = "--o" if age == "old" else "-o", _title(age, curve)
        axes.plot(curve.nodes[0], curve.offsets[0], form, ms=3, label=label)
    axes.set_xlabel(_along(drawn[0][1], 0))
    axes.set_ylabel(_adds(drawn[0][1]))
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def _planes(drawn: _Drawn) -> Figure:
    """Draw planes, and what changed between two, with one scale of colours."""
    if len(drawn) == 2:
        drawn = [*drawn, ("new - old", _difference(drawn[0][1], drawn[1][1]))]
    figure, every = new_figure(4.8, 1, len(drawn))
    figure.set_figwidth(6.4 * len(drawn))
    figure.set_layout_engine("compressed")
    fields = [np.asarray(plane.offsets) for _, plane in drawn]
    limit = max(float(np.abs(field).max(initial=0.0)) for field in fields) or 1.0
    layers = []
    for axes, (age, plane), field in zip(every, drawn, fields, strict=True):
        nodes, labels = map(np.asarray, plane.nodes), [_along(plane, k) for k in (0, 1)]
        layers.append(heat(axes, [*nodes], field, (-limit, limit), labels))
        axes.set_title(_title(age, plane))
    figure.colorbar(layers[0], ax=every, label=_adds(drawn[0][1]))
    return figure


def _difference(old: OffsetCurve, new: OffsetCurve) -> OffsetCurve:
    """Return new − old on the nodes of both, rounded to the entries of a list."""
    pairs = zip(old.nodes, new.nodes, strict=True)
    grid = tuple(tuple(sorted({*a, *b})) for a, b in pairs)
    change = np.subtract(new.sample(grid), old.sample(grid)) / new.entry_size
    entries = tuple(tuple(row) for row in np.round(change).astype(int).tolist())
    return dataclasses.replace(new, nodes=grid, entries=entries)


def _title(age: str, curve: OffsetCurve) -> str:
    return f"{age}: {curve.title}" if age else curve.title


def _along(curve: OffsetCurve, direction: int) -> str:
    master = curve.masters[direction]
    of_axis = "" if master is None else f" of axis {master}"
    return f"position{of_axis} / {'mm' if curve.metric else 'increments'}"


def _adds(curve: OffsetCurve) -> str:
    return f"offset that the controller adds / {'µm' if curve.metric else 'inc'}"
