"""What remains after the list, over position, order and run, and what belongs to the runs."""

import dataclasses

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ...job import TableResult
from .. import _style as style
from .._body import Plot
from .._scale import Scale, grouped, number, percent, place
from ._readings import Bins, Readings, bin_means, robust_limit

_MOST_RUNS = 60
"""More runs than this are not looked at one by one."""


@dataclasses.dataclass(frozen=True)
class View:
    """One quantity to look at the remaining error over.

    Attributes:
        name: In the caption.
        label: Of the axis.
        unit: With a leading blank, or empty.
        where: Value per reading.
        whole: Whether only whole numbers make sense.
    """

    name: str
    label: str
    unit: str
    where: Float[np.ndarray, " t"]
    whole: bool = False


def views_of(fit: TableResult, readings: Readings, scale: Scale) -> list[View]:
    """Return what to look over: each master, the time or the order, the runs."""
    unit = f" {scale.position}"
    views = [
        View(name, f"{name} in {scale.position}", unit, readings.positions[:, column])
        for column, name in enumerate(fit.masters)
    ]
    if readings.timed:
        views.append(View("time", "time in s", " s", readings.order))
    else:
        order = "row, in the order of measuring"
        views.append(View("row", order, "", readings.order, whole=True))
    runs = np.zeros(0) if readings.run is None else readings.run
    # What belongs to each run has a plot of its own.
    if 2 <= len(np.unique(runs)) <= _MOST_RUNS and not fit.fit.runs:
        views.append(View("run", "run", "", np.asarray(runs, dtype=float), whole=True))
    return views


def residual_plot(fit: TableResult, readings: Readings, scale: Scale) -> Plot | None:
    """Draw the predicted remaining error over each master, the order, and the runs."""
    if not readings.sound.any():
        return None
    views = views_of(fit, readings, scale)
    rows = len(views)
    figure, axes = style.new_figure(1.9 * rows + 0.5, rows, sharey=True)
    limit = robust_limit(readings.predicted[readings.sound])
    found = []
    for panel, view in zip(axes, views, strict=True):
        found.append(_draw_cloud(panel, readings, view.where, limit))
        panel.set_xlabel(view.label)
        panel.set_ylabel(f"remaining in {scale.error}")
        # Rows of a long log are long numbers, which would run into each other.
        panel.locator_params(axis="x", nbins=5 if np.max(view.where) < 1e5 else 3)
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper right", ncols=2, markerscale=1.6)
    caption = _say_residuals(
        fit, readings, scale, limit, _say_bins(fit, views, found, scale)
    )
    title = "What remains over position and order (predicted)"
    return Plot("residuals", title, figure, caption)


def _draw_cloud(
    axes: Axes, readings: Readings, where: Float[np.ndarray, " t"], limit: float
) -> Bins:
    keep = np.flatnonzero(readings.sound)
    keep = keep[style.thin(keep.size)]
    names = {way: f"reading, {name}" for way, name in style.DIRECTION_NAME.items()}
    style.draw_cloud(
        axes,
        where[keep],
        readings.predicted[keep],
        readings.direction[keep],
        size=None,
        names={**names, 0: "reading"},
        alpha=0.4,
    )
    sound = readings.sound
    slices = int(np.clip(np.count_nonzero(sound) // 12, 3, 24))
    slices = min(slices, len(np.unique(where)))
    bins = bin_means(where[sound], readings.predicted[sound], slices)
    known = bins.count >= 3
    axes.errorbar(
        bins.centre[known], bins.mean[known], 2 * bins.error[known], linestyle="none",
        marker="s", markersize=3.2, color=style.INK, elinewidth=1, capsize=1.5,
        label="mean of a slice ± 2 standard errors", zorder=5,
    )  # fmt: skip
    axes.axhline(0, color=style.INK, linewidth=0.7)
    axes.set_ylim(-limit, limit)
    return bins


def _say_bins(
    fit: TableResult, views: list[View], found: list[Bins], scale: Scale
) -> str:
    """Say which slice stands out most over each quantity, and whether by chance."""
    parts, beyond = [], []
    for view, bins in zip(views, found, strict=True):
        worst = bins.worst
        if worst is None:
            continue
        mean, error = float(bins.mean[worst]), float(bins.error[worst])
        digits = 0 if view.whole or np.ptp(bins.edges) > 50 else 2
        low, high = (round(float(bins.edges[worst + k]), digits) for k in (0, 1))
        parts.append(
            f"{view.name} {place(low)} to {place(high)}{view.unit} "
            f"{number(mean, signed=True)} {scale.error} "
            f"({abs(mean) / error:.1f} standard errors)"
        )
        # Largest of n independent normal means: expected below about sqrt(2 ln 2n)
        # standard errors; one more allows for few readings per slice.
        usual = float(np.sqrt(2 * np.log(2 * (bins.count >= 3).sum()))) + 1.0
        if abs(mean) > usual * error:
            beyond.append(view.name)
    if not parts:
        return ""
    text = f"Slices that stand out most: {'; '.join(parts)}. "
    if beyond and fit.fit.runs and beyond[-1] in ("time", "row"):
        # A left-out run keeps the offset and drift of its own, as a new one would.
        text += "The runs lie apart by their own offset and drift (next plot). "
        beyond = beyond[:-1]
        if not beyond:
            return text.strip()
    if beyond:
        return text + f"Over {' and '.join(beyond)} that is more than chance."
    return text + "That is no more than chance makes of so many slices."


def _say_residuals(
    fit: TableResult, readings: Readings, scale: Scale, limit: float, slices: str
) -> str:
    sound = readings.sound
    value = readings.predicted[sound]
    before = readings.before[~readings.wild]
    text = [
        f"On readings whose {fit.held_out} was left out of the fit, "
        f"{number(float(np.sqrt(np.mean(value**2))))} {scale.error} rms remain of "
        f"{number(float(np.sqrt(np.mean(before**2))))} {scale.error}."
    ]
    text += [slices] if slices else []
    outside = float(np.mean(np.abs(value) > limit))
    if outside:
        text.append(f"{percent(outside)} of the readings lie beyond the frame.")
    if readings.wild.any():
        text.append(
            f"{grouped(int(readings.wild.sum()))} wild readings are not drawn here."
        )
    if value.size > style.DRAWN_POINTS:
        text.append(
            f"{grouped(style.DRAWN_POINTS)} of {grouped(value.size)} readings are "
            "drawn; the slices use all of them."
            if readings.total == readings.size
            else f"{grouped(style.DRAWN_POINTS)} readings are drawn and "
            f"{grouped(value.size)} are in the slices, of {grouped(readings.total)}."
        )
    return " ".join(text)


def runs_plot(fit: TableResult, scale: Scale) -> Plot | None:
    """Draw the fitted run effects with ± 2 sd; None where there are none."""
    effects = fit.fit.runs
    if not effects:
        return None
    runs = np.array([effect.run for effect in effects])
    figure, (axes,) = style.new_figure(2.5)
    rows = (
        ("offset of the run", 0.0, "o", style.BLUE,
         [(effect.offset, effect.offset_sd) for effect in effects]),
        ("drift from its start to its end", 0.18, "D", style.ORANGE,
         [(effect.drift, effect.drift_sd) for effect in effects]),
    )  # fmt: skip
    drifts = any(effect.drift or effect.drift_sd for effect in effects)
    for label, shift, marker, colour, pairs in rows[: 1 + drifts]:
        value, sd = np.array(pairs).T
        axes.errorbar(
            runs + shift, value * scale.factor,
            2 * np.nan_to_num(sd) * scale.factor, linestyle="none", marker=marker,
            markersize=4.5, color=colour, elinewidth=1, capsize=2, label=label,
        )  # fmt: skip
    axes.axhline(0, color=style.INK, linewidth=0.7)
    axes.set_xlabel("run")
    if runs.size <= 25:
        axes.set_xticks(runs.tolist(), [str(run) for run in runs])
    axes.set_ylabel(f"against the mean in {scale.error}")
    figure.legend(loc="outside upper right", ncols=2)
    return Plot(
        "runs", "Offset and drift of the runs", figure, _say_runs(fit, scale, drifts)
    )


def _say_runs(fit: TableResult, scale: Scale, drifts: bool) -> str:
    effects = fit.fit.runs
    far = max(effects, key=lambda effect: abs(effect.offset))
    text = (
        f"Run {far.run} lies farthest from the mean of the {len(effects)} runs: "
        f"{number(far.offset * scale.factor, signed=True)} ± "
        f"{scale.shown(2 * far.offset_sd)} (2 sd)."
    )
    if drifts:
        fast = max(effects, key=lambda effect: abs(effect.drift))
        text += (
            f" Run {fast.run} drifts most, by "
            f"{scale.shown(fast.drift, signed=True)} from its "
            "start to its end against the mean drift of all runs."
        )
    return text + " This belongs to the runs and is kept out of the table."
