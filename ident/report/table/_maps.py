"""The plane as maps: error, uncertainty, coverage, change against the old list."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...job import TableResult
from .. import _style as style
from .._body import Plot
from .._scale import Scale, count, grouped, number
from ._fitted import Fitted, branches_of, say_change, say_drawn, say_empty
from ._plane import (
    bar,
    hatch,
    hatch_key,
    heat,
    label,
    map_height,
    spread_limits,
    symmetric,
)
from ._readings import Readings

_TALL = 3.8
"""Maps higher than this, in inches, are square rather than wide."""


def error_map(fit: TableResult, readings: Readings, scale: Scale) -> Plot:
    """Draw the fitted error with the measured points; unmeasured nodes hatched."""
    (table,) = branches_of(fit, scale)
    figure, (axes,) = style.new_figure(map_height(table) + 0.5)
    mesh = heat(axes, table, table.value, diverging=True)
    bar(figure, mesh, [axes], f"error of {fit.axis} in {scale.error}")
    drawn = min(readings.size, style.DRAWN_POINTS)
    style.marks(
        axes, *readings.positions.T, color=style.INK, alpha=0.55, label="reading",
        size=float(np.clip(60 / np.sqrt(drawn), 0.9, 3)), most=drawn,
    )  # fmt: skip
    wild = np.flatnonzero(readings.wild)
    shown = wild[style.thin(wild.size, 400)]
    if wild.size:
        axes.plot(
            readings.positions[shown, 0], readings.positions[shown, 1],
            linestyle="none", marker="x", markersize=4.5, color=style.INK,
            label="wild reading",
        )  # fmt: skip
    hatch(axes, table)
    label(axes, table, scale)
    handles, _ = axes.get_legend_handles_labels()
    if not table.measured.all():
        handles.append(hatch_key())
    figure.legend(handles=handles, loc="outside upper right", ncols=3, markerscale=2)
    caption = (
        f"{table.runs('At measured nodes the error', scale)}"
        f" {say_empty([table], 'hatched')}{say_drawn(drawn, readings.total)}"
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
    mesh = heat(above, table, table.sd, limits=spread_limits(table))
    bar(figure, mesh, [above], f"sd in {scale.error}")
    most = max(float(np.quantile(table.support, 0.98)), 1.0)
    mesh = heat(below, table, table.support.astype(float), limits=(0.0, most))
    counts = bar(figure, mesh, [below], "readings per node")
    counts.locator = MaxNLocator(integer=True)
    above.set_title("standard deviation")
    below.set_title("readings that touch it")
    hatch(above, table)
    hatch(below, table, colour="white")
    label(above, table, scale)
    label(below, table, scale)
    caption = _say_coverage(table, scale)
    return Plot("coverage", "How well each node is known", figure, caption)


def change_maps(fit: TableResult, scale: Scale) -> Plot | None:
    """Draw the old entries, the new ones and the difference, where there was a list."""
    if not fit.old_table or len(fit.masters) != 2:
        return None
    (table,) = branches_of(fit, scale)
    (name, new), *_ = fit.table.items()
    old = fit.old_table.get(name)
    if old is None:
        return None
    both = np.stack([old, new]) * scale.factor
    span = symmetric(both)
    change = both[1] - both[0]
    size = (7.2, 1.62 * map_height(table) + 0.5)
    figure = Figure(figsize=size, layout="constrained")
    # Old and new beside each other, their difference below.
    mosaic = figure.subplot_mosaic("ab\ncc", height_ratios=[0.62, 1.0])
    panels = [mosaic[name] for name in "abc"]
    layers = [
        heat(axes, table, value, limits=(-span, span), diverging=True)
        for axes, value in zip(panels, both, strict=False)
    ]
    for axes, title in zip(panels, ("old list", "new list", "new − old"), strict=True):
        axes.set_title(title)
    bar(figure, layers[0], panels[:2], f"entry in {scale.error}")
    mesh = heat(panels[2], table, change, diverging=True)
    bar(figure, mesh, panels[2:], f"change in {scale.error}")
    for axes in panels:
        hatch(axes, table)
        label(axes, table, scale)
    return Plot(
        "old-and-new", "Old list against new list", figure, say_change(fit, scale)
    )


@dataclasses.dataclass(frozen=True)
class CellMeans:
    """Mean of what remains in the cell around each node, in µm, and readings there."""

    mean: Float[np.ndarray, "j i"]
    count: Int[np.ndarray, "j i"]
    chance: float
    """Rms of the means in µm that chance alone would make."""
    basis: str
    """What `chance` rests on, in words."""


def cell_means(table: Fitted, readings: Readings) -> CellMeans:
    """Return the mean predicted error of the sound readings nearest to each node."""
    keep = readings.sound
    value = readings.predicted[keep]
    mean, number_of, cell = mean_by_cell(table, readings.positions[keep], value)
    seen = number_of > 0
    free = len(value) - int(seen.sum())
    if free >= seen.sum() / 2:
        scatter = np.sum((value - mean.ravel()[cell]) ** 2) / free
        chance = np.sqrt(scatter * np.mean(1 / number_of[seen]))
        return CellMeans(mean, number_of, float(chance), "scatter of the readings")
    # About one reading per cell says nothing of their scatter: ask the prediction.
    variance = np.bincount(cell, readings.predicted_sd[keep] ** 2, number_of.size)
    each = variance.reshape(seen.shape)[seen] / number_of[seen] ** 2
    chance = np.sqrt(np.mean(each)) if each.size else 0.0
    return CellMeans(mean, number_of, float(chance), "predicted scatter")


def mean_by_cell(
    table: Fitted,
    positions: Float[np.ndarray, "t 2"],
    value: Float[np.ndarray, " t"],
) -> tuple[Float[np.ndarray, "j i"], Int[np.ndarray, "j i"], Int[np.ndarray, " t"]]:
    """Return mean and number of the readings nearest to each node, and their node."""
    columns, rows = len(table.nodes[0]), len(table.nodes[1])
    i = np.searchsorted(style.middles(table.nodes[0]), positions[:, 0])
    j = np.searchsorted(style.middles(table.nodes[1]), positions[:, 1])
    cell = j * columns + i
    number_of = np.bincount(cell, minlength=rows * columns)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(cell, value, rows * columns) / number_of
    shape = (rows, columns)
    return mean.reshape(shape), number_of.reshape(shape), cell


def remainder_map(fit: TableResult, readings: Readings, scale: Scale) -> Plot:
    """Draw what the list leaves behind, as the mean around each node."""
    (table,) = branches_of(fit, scale)
    cells = cell_means(table, readings)
    figure, (axes,) = style.new_figure(map_height(table) + 0.5)
    mesh = heat(axes, table, cells.mean, diverging=True)
    bar(figure, mesh, [axes], f"remaining error in {scale.error}")
    hatch(axes, table, cells.count > 0)
    label(axes, table, scale)
    if not (cells.count > 0).all():
        figure.legend(handles=[hatch_key("no reading near the node")],
                      loc="outside upper right")  # fmt: skip
    caption = _say_remainder(table, cells, scale)
    return Plot(
        "remainder-map", "What the list leaves behind (predicted)", figure, caption
    )


def _say_coverage(table: Fitted, scale: Scale) -> str:
    known = table.measured
    if not known.any():
        return "No node is touched by a reading."
    sd, support = table.sd[known], table.support[known]
    worst = int(np.argmax(np.where(known, table.sd, -1.0)))
    least, most = int(support.min()), int(support.max())
    readings = ("" if least == most else f"{grouped(least)} to ") + count(
        most, "reading"
    )
    text = (
        f"Half of the measured nodes have an sd of {number(float(np.median(sd)))} "
        f"{scale.error} or less, the worst {number(float(sd.max()))} "
        f"{scale.error} ({table.where(worst)} "
        f"{scale.position}); each has {readings}."
    )
    if not known.all():
        text += (
            f" Unmeasured nodes (hatched) reach an sd of "
            f"{number(float(table.sd[~known].max()))} {scale.error}; the colours end "
            "at the worst measured node."
        )
    return text


def _say_remainder(table: Fitted, cells: CellMeans, scale: Scale) -> str:
    seen = cells.count > 0
    if not seen.any():
        return "No reading has a prediction."
    mean = cells.mean[seen]
    worst = int(np.argmax(np.where(seen, np.abs(np.nan_to_num(cells.mean)), -1.0)))
    chance = cells.chance
    found = float(np.sqrt(np.mean(mean**2)))
    if chance > 0 and found <= 1.3 * chance:
        verdict = "no pattern beyond chance is left"
    else:
        verdict = "more than chance: look for a pattern that the table cannot follow"
    return (
        f"Mean of what remains around each node, on readings left out of the fit: rms "
        f"{number(found)} {scale.error}, largest "
        f"{number(cells.mean.ravel()[worst])} {scale.error} at {table.where(worst)} "
        f"{scale.position}. The {cells.basis} alone would give "
        f"{number(chance)} {scale.error}: {verdict}."
    )
