"""Plots and sentences of a crosstalk and its list."""

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes

from ...report import _style as style
from ...report._body import Body, Plot
from ...report._scale import Scale, count, left_out_words, number, percent, spot
from ._result import SHORT, CrosstalkResult

_SIGN = (1, -1, 1, -1)
"""Direction of the master in each row of `BRANCHES`."""


def body(fit: CrosstalkResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted crosstalk."""
    plots = [_events_plot(fit, scale)]
    if fit.adaptation:
        plots.append(_tests_plot(fit, scale))
    facts = [*_facts(fit, scale)]
    return Body(plots=plots, facts=facts, wild_count=int(fit.fit.events.wild.sum()))


def _facts(fit: CrosstalkResult, scale: Scale) -> Iterator[tuple[str, str]]:
    crosstalk, form = fit.fit, fit.fit.effect
    where = f" over {' and '.join(fit.adaptation)}" if fit.adaptation else ""
    directions = "both directions have the same entries"
    if form.velocity_dependent:
        directions = "each direction has entries of its own"
    yield (
        "Law",
        f"Mode {form.mode}{where}: {fit.axis} is moved when {form.master} accelerates, in"
        f" full at {form.acceleration:g} and {form.deceleration:g} mm/s² and in"
        f" proportion below; {directions}.".replace("-", "−"),
    )
    names = (
        SHORT if form.velocity_dependent else ("accelerating", "", "decelerating", "")
    )
    numbers = fit.entries, fit.standard_deviation, fit.support
    for k, point in enumerate(fit.points):
        where = spot(fit.adaptation, point, ("mm",) * len(point))
        rows = zip(names, *(column[:, k] for column in numbers), strict=True)
        parts = [
            f"{name} {number(entry * scale.factor, signed=True)} ± {scale.shown(sd)}"
            f" ({count(int(support), 'event')})"
            for name, entry, sd, support in rows
            if name  # what both directions share rests on the events of both
        ]
        yield (f"Test {k + 1}" + f" at {where}" * bool(where), "; ".join(parts) + ".")
    noise = crosstalk.noise[np.isfinite(crosstalk.noise)]
    if noise.size:
        yield (
            "Events",
            f"{count(len(crosstalk.events), 'acceleration')} cut out of the log; one scatters"
            f" by {scale.shown(float(noise.max()))} (1 sd) about the list at most."
            + " One between two tests counts at both."
            * (len(fit.points) > 1),
        )


def _events_plot(fit: CrosstalkResult, scale: Scale) -> Plot:
    """Draw the error that each event shows over its acceleration, before and after."""
    crosstalk, form, events = fit.fit, fit.fit.effect, fit.fit.events
    x_label = f"acceleration of {form.master} in mm/s²"
    y_label = f"error of {fit.axis} in {scale.error}"
    figure, panels = style.side_by_side(
        3.2, ("before", "from the file"), x_label, y_label
    )
    branch, peak = events.branch, np.abs(events.peak)
    share = np.minimum(peak / crosstalk.full, 1.0) * scale.factor
    # Of accelerations by speed the sign of the peak does not tell the entry.
    signed = np.where(branch < 2, 1.0, -1.0) * peak
    sound, direction = ~events.wild, np.array(_SIGN)[branch]
    for panel, values in zip(panels, (events.value, fit.from_file), strict=True):
        shown = (values * share)[sound]
        style.draw_cloud(panel, signed[sound], shown, direction[sound], size=4.0)
        panel.locator_params(axis="x", nbins=5)
    _mean_lines(panels[0], fit, scale)
    panels[0].legend(loc="best")
    before, after = (fit.error[key].sound.rms for key in ("before", "from_file"))
    caption = (
        f"Each mark is one acceleration of {form.master} (right of 0) or deceleration"
        f" (left): the error of {fit.axis} at its peak."
    )
    if not len(fit.points):
        caption += " No list is written."
    else:
        caption += (
            f" At full acceleration events show {scale.shown(before)} rms, with the"
            f" written list {scale.shown(after)}."
        )
        axes = " and ".join(fit.adaptation)
        lines = "the lines are the means of the tests"
        caption += f" The spread before is that over {axes}; {lines}." if axes else ""
    caption += left_out_words(int(events.wild.sum()), "contradicting event")
    return Plot("events", "Every acceleration, before and after", figure, caption)


def _mean_lines(panel: Axes, fit: CrosstalkResult, scale: Scale) -> None:
    """Draw the fitted lines through 0, mean of the tests, held above."""
    form = fit.fit.effect
    for row, values in enumerate(fit.fit.values):
        finite = values[np.isfinite(values)]
        if not finite.size:
            continue
        full = float(form.acceleration if row < 2 else form.deceleration)
        top = float(finite.mean()) * scale.factor
        panel.plot(
            [0.0, full, 1.15 * full], [0.0, top, top], linewidth=1.0,
            color=style.DIRECTION_COLOR[_SIGN[row]],
        )  # fmt: skip


def _tests_plot(fit: CrosstalkResult, scale: Scale) -> Plot:
    """Draw the tests over each adaptation axis with the events that tell them."""
    crosstalk, events, points = fit.fit, fit.fit.events, fit.fit.effect.points
    columns = len(fit.adaptation)
    figure, panels = style.new_figure(
        5.5, rows=2, columns=columns, sharex="col", sharey=True
    )
    for k, panel in enumerate(panels):
        pair, axis = divmod(k, columns)
        for row in (2 * pair, 2 * pair + 1):
            rows = (events.branch == row) & ~events.wild
            finite = np.isfinite(crosstalk.values[row])
            places, errors = events.positions[rows, axis], events.value[rows]
            directions = np.full(len(errors), _SIGN[row])
            style.draw_cloud(
                panel, places, errors * scale.factor, directions, size=3.5, alpha=0.45
            )
            panel.errorbar(
                points[finite, axis], crosstalk.values[row, finite] * scale.factor,
                yerr=crosstalk.standard_deviation[row, finite] * scale.factor,
                fmt="s", markersize=5, capsize=2, markeredgecolor=style.INK,
                color=style.DIRECTION_COLOR[_SIGN[row]],
            )  # fmt: skip
        panel.set_title(("accelerating", "decelerating")[pair], fontsize=10)
        if pair:
            panel.set_xlabel(f"{fit.adaptation[axis]} in mm")
        if not axis:
            panel.set_ylabel(f"error of {fit.axis} in {scale.error}")
    panels[0].legend(loc="best")
    caption = (
        f"Error at full acceleration over {' and '.join(fit.adaptation)}: dots are"
        " events, squares the tests with 1 sd. Between tests the controller goes along the"
        " surface, beyond them it is taken to hold the last value; they cover"
        f" {percent(fit.coverage)} of the workspace. The entries are the negative of this."
    )
    return Plot("tests", "Tests over the adaptation axes", figure, caption)
