"""What remains after the list, over position, order and run."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ...job import SampleView, TableResult
from .. import _style as style
from .._body import Plot
from .._scale import Scale, number, percent
from ._fitted import Bins, bin_means, say_drawn

_MOST_RUNS = 60
"""More runs than this are not looked at one by one."""


def views_of(
    fit: TableResult, readings: SampleView
) -> dict[str, tuple[str, Float[np.ndarray, " t"]]]:
    """Return what to look over: each master, the time or the order, the runs.

    By its name in the caption, the label of its axis and a value per reading.
    """
    views = {
        name: (f"{name} in {unit}", readings.positions[:, column])
        for column, (name, unit) in enumerate(zip(fit.masters, fit.units, strict=True))
    }
    if readings.timed:
        views["time"] = "time in s", readings.order
    else:
        views["row"] = "row, in the order of measuring", readings.order
    runs = np.zeros(0) if readings.run is None else readings.run
    # Runs that lie apart by what is known of them show nothing new.
    if 2 <= len(np.unique(runs)) <= _MOST_RUNS and not fit.fit.runs:
        views["run"] = "run", np.asarray(runs, dtype=float)
    return views


def residual_plot(fit: TableResult, readings: SampleView, scale: Scale) -> Plot | None:
    """Draw the predicted remaining error over each master, the order, and the runs."""
    if not readings.sound.any():
        return None
    views = views_of(fit, readings)
    rows = len(views)
    figure, axes = style.new_figure(1.9 * rows + 0.5, rows, sharey=True)
    # All but a few of them lie within.
    remaining = np.abs(readings.predicted[readings.sound])
    limit = float(np.quantile(remaining, 0.995)) * 1.15 or 1.0
    beyond = []
    for panel, (name, (words, where)) in zip(axes, views.items(), strict=True):
        if _draw_cloud(panel, readings, where, limit).beyond_chance:
            beyond.append(name)
        panel.set_xlabel(words)
        panel.set_ylabel(f"remaining in {scale.error}")
        # Rows of a long log are long numbers, which would run into each other.
        panel.locator_params(axis="x", nbins=5 if np.max(where) < 1e5 else 3)
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper right", ncols=2, markerscale=1.6)
    caption = _say_residuals(fit, readings, scale, limit, _say_slices(fit, beyond))
    title = "What remains over position and order (predicted)"
    return Plot("residuals", title, figure, caption)


def _draw_cloud(
    axes: Axes, readings: SampleView, where: Float[np.ndarray, " t"], limit: float
) -> Bins:
    keep = np.flatnonzero(readings.sound)
    keep = keep[style.thin(keep.size)]
    names = {sign: f"reading, {name}" for sign, name in style.DIRECTION_NAME.items()}
    style.draw_cloud(
        axes,
        where[keep],
        readings.predicted[keep],
        readings.signs[keep],
        size=None,
        names={**names, 0: "reading"},
        alpha=0.4,
        most=style.DRAWN_POINTS,
    )
    sound = readings.sound
    slices = int(np.clip(np.count_nonzero(sound) // 12, 3, 24))
    slices = min(slices, len(np.unique(where)))
    bins = bin_means(where[sound], readings.predicted[sound], slices)
    filled = bins.count >= 3
    axes.errorbar(
        bins.centre[filled], bins.mean[filled], 2 * bins.error[filled], linestyle="none",
        marker="s", markersize=3.2, color=style.INK, elinewidth=1, capsize=1.5,
        label="mean of a slice ± 2 standard errors", zorder=5,
    )  # fmt: skip
    axes.axhline(0, color=style.INK, linewidth=0.7)
    axes.set_ylim(-limit, limit)
    return bins


def _say_slices(fit: TableResult, beyond: list[str]) -> str:
    """Return over which quantities the means of slices stand out more than by chance."""
    text = ""
    if beyond and fit.fit.runs and beyond[-1] in ("time", "row"):
        # A left-out run keeps the offset and drift of its own, as a new one would.
        text = "The runs lie apart by their own offset and drift. "
        beyond = beyond[:-1]
    if beyond:
        names = " and ".join(beyond)
        return f"{text}Over {names} the means of slices stand out more than by chance."
    return f"{text}Means of slices stand out no more than chance makes of so many."


def _say_residuals(
    fit: TableResult, readings: SampleView, scale: Scale, limit: float, slices: str
) -> str:
    sound = readings.sound
    value = readings.predicted[sound]
    before = readings.before[~readings.wild]
    text = [
        f"On readings whose {fit.held_out} was left out of the fit, "
        f"{number(float(np.sqrt(np.mean(value**2))))} {scale.error} rms remain of "
        f"{number(float(np.sqrt(np.mean(before**2))))} {scale.error}."
    ]
    text.append(slices)
    outside = float(np.mean(np.abs(value) > limit))
    if outside:
        text.append(f"Of the readings {percent(outside)} lie beyond the frame.")
    # Wild ones are not drawn here.
    drawn = say_drawn(min(value.size, style.DRAWN_POINTS), fit.readings)
    return " ".join(text) + drawn
