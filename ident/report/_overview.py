"""The whole job in one picture: each error before and after, at the same scale."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..job import AbstractResult, JobResult, TableResult
from . import _style as style
from ._body import Plot
from ._scale import Scale, number, scale_of
from .table._fitted import Fitted, branches_of, readings_of
from .table._maps import bar, symmetric

_MOST = 6
"""Fits that are drawn; the picture is a summary."""

_Cloud = tuple[
    Float[np.ndarray, "_t _d"], Float[np.ndarray, " _t"], Int[np.ndarray, " _t"]
]
"""Sound readings, for drawing: positions in mm, error in µm, direction (±1, or 0)."""


def overview_plot(fits: Sequence[AbstractResult]) -> Plot | None:
    """Draw every table before and after: verified where it was, else predicted."""
    tables = [fit for fit in fits if isinstance(fit, TableResult)][:_MOST]
    if not tables:
        return None
    heights = [2.0 if len(fit.masters) == 1 else 2.3 for fit in tables]
    figure = Figure(figsize=(7.2, sum(heights) + 0.2), layout="constrained")
    panels = figure.subplots(len(tables), 2, squeeze=False, height_ratios=heights)
    rows = list(zip(panels, tables, strict=True))
    sentences = [_draw_fit(figure, list(row), fit) for row, fit in rows]
    bilateral = [row[0] for row, fit in rows if fit.fit.layout.branches == 2]
    if bilateral:
        keys = bilateral[0].get_legend_handles_labels()
        figure.legend(*keys, loc="outside upper right", ncols=2, markerscale=2)
    caption = f"Left: as measured. Right: with the new list. {' '.join(sentences)}"
    return Plot("overview", "Before and after, at the same scale", figure, caption)


def write_picture(result: JobResult, path: Path) -> None:
    """Write the overview of a job with at least one fit as a PNG, small enough for a README."""
    with style.house_style():
        plot = overview_plot(result.fits)
        if plot is not None:
            plot.figure.savefig(path, format="png", dpi=110)


def _draw_fit(figure: Figure, panels: list[Axes], fit: TableResult) -> str:
    """Draw one row and return its sentence."""
    scale = scale_of(fit.unit)
    clouds = _clouds(fit, scale)
    kind = "predicted" if fit.measured is None else fit.measured_as
    if len(fit.masters) == 2:
        _draw_maps(figure, panels, fit, scale, clouds)
    else:
        _draw_clouds(panels, fit, scale, clouds)
    over = f" over {', '.join(fit.over)}" if fit.over else ""
    name = f"{fit.axis}{over}"
    sizes = [
        number(float(np.sqrt(np.mean(error**2)))) if error.size else "–"
        for _, error, _ in clouds
    ]
    # The right one has no name: it would run into the scale of colours of a map.
    words = f"{name}, before", kind
    for panel, size, word in zip(panels, sizes, words, strict=True):
        panel.set_title(f"{word}: {size} {scale.error} rms", fontsize=10)
    return f"{name}: {' → '.join(sizes)} {scale.error} rms ({kind})."


def _clouds(fit: TableResult, scale: Scale) -> tuple[_Cloud, _Cloud]:
    """Return the errors before, and those with the list: verified, else predicted."""
    readings = readings_of(fit, scale)

    def cloud(error: Float[np.ndarray, " t"], rows: Bool[np.ndarray, " t"]) -> _Cloud:
        return readings.positions[rows], error[rows], readings.signs[rows]

    before = cloud(readings.before, ~readings.wild)
    if (second := fit.measured) is None:
        return before, cloud(readings.predicted, readings.sound)
    sound, direction = second.sound, second.direction
    if direction is None:
        direction = np.zeros(len(sound), dtype=np.int64)
    error = second.error[sound] * scale.factor
    return before, (second.positions[sound], error, direction[sound])


def _draw_clouds(
    panels: list[Axes], fit: TableResult, scale: Scale, both: tuple[_Cloud, _Cloud]
) -> None:
    for panel, (positions, error, direction) in zip(panels, both, strict=True):
        style.draw_cloud(panel, positions[:, 0], error, direction, size=2.4)
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_xlabel(f"{fit.masters[0]} in {fit.units[0]}")
    every = np.concatenate([error for _, error, _ in both])
    low, high = float(every.min()), float(every.max())
    margin = 0.08 * (high - low or 1.0)
    for panel in panels:
        panel.set_ylim(low - margin, high + margin)
    panels[0].set_ylabel(f"error of {fit.axis} in {scale.error}")


def _draw_maps(
    figure: Figure,
    panels: list[Axes],
    fit: TableResult,
    scale: Scale,
    both: tuple[_Cloud, _Cloud],
) -> None:
    (table,) = branches_of(fit, scale)
    means = [_mean_by_cell(table, places, error) for places, error, _ in both]
    span = symmetric(np.stack(means))
    layers = [
        style.heat(panel, table.nodes, mean, (-span, span), table.labels)
        for panel, mean in zip(panels, means, strict=True)
    ]
    bar(figure, layers[0], panels, f"error in {scale.error}")


def _mean_by_cell(
    table: Fitted, positions: Float[np.ndarray, "t 2"], value: Float[np.ndarray, " t"]
) -> Float[np.ndarray, "j i"]:
    """Return the mean of the readings nearest to each node, NaN where there are none."""
    shape = len(table.nodes[1]), len(table.nodes[0])
    i = np.searchsorted(style.middles(table.nodes[0]), positions[:, 0])
    j = np.searchsorted(style.middles(table.nodes[1]), positions[:, 1])
    cell, count = j * shape[1] + i, shape[0] * shape[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(cell, value, count) / np.bincount(cell, minlength=count)
    return np.asarray(mean.reshape(shape))
