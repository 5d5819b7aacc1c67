"""Crosstalk drawn: events over acceleration, the tests, and single events in time."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...report import _style as style
from ...report._body import Plot
from ...report._scale import Scale, number, percent
from ._result import CrosstalkResult
from .effect import BRANCHES

_WAY = (1, -1, 1, -1)
"""Direction of the master in each row of `BRANCHES`."""


def events_plot(fit: CrosstalkResult, scale: Scale) -> Plot:
    """Draw the error that each event shows over its acceleration, before and after."""
    view = fit.view
    figure, panels = style.new_figure(3.2, columns=2, sharey=True)
    stages = {"before": view.before, "from the file": view.from_file}
    # Of accelerations by speed the sign of the peak does not tell the entry.
    reach = np.where(view.branch < 2, 1.0, -1.0) * np.abs(view.peak)
    sound = ~view.wild
    for panel, (name, values) in zip(panels, stages.items(), strict=True):
        shown = values * view.share * scale.factor
        for way in (1, -1):
            rows = np.flatnonzero((np.array(_WAY)[view.branch] == way) & sound)
            panel.plot(
                reach[rows], shown[rows], linestyle="none",
                marker=style.DIRECTION_MARKER[way], markersize=4, markeredgewidth=0,
                alpha=0.7, color=style.DIRECTION_COLOR[way],
                rasterized=style.as_raster(rows.size), label=style.DIRECTION_NAME[way],
            )  # fmt: skip
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_title(name)
        panel.set_xlabel(f"acceleration of {fit.master} in mm/s²")
        panel.locator_params(axis="x", nbins=5)
    _mean_lines(panels[0], fit, scale)
    panels[0].set_ylabel(f"error of {fit.axis} in {scale.error}")
    panels[0].legend(loc="best")
    before, after = (fit.error[key].sound.rms for key in ("before", "from_file"))
    caption = (
        f"Each mark is one acceleration of {fit.master} (right of 0) or deceleration"
        f" (left): the error of {fit.axis} at its peak. At full acceleration events show"
        f" {number(before * scale.factor)} {scale.error} rms, with the written list"
        f" {number(after * scale.factor)}."
    )
    if not len(fit.points):
        caption = (
            f"Each mark is one acceleration of {fit.master} (right of 0) or deceleration"
            f" (left): the error of {fit.axis} at its peak. No list is written."
        )
    elif fit.adaptation:
        caption += (
            f" The spread before is that over {' and '.join(fit.adaptation)}; the lines"
            " are the means of the tests."
        )
    if view.wild.any():
        caption += (
            f" {int(view.wild.sum())} events that contradict the others are left out."
        )
    return Plot("events", "Every acceleration, before and after", figure, caption)


def _mean_lines(panel: Axes, fit: CrosstalkResult, scale: Scale) -> None:
    """Draw the fitted lines through 0, mean of the tests, held above."""
    own = fit.fit
    for row, values in enumerate(own.values):
        known = values[np.isfinite(values)]
        if not known.size:
            continue
        full = own.acceleration if row < 2 else own.deceleration
        top = float(known.mean()) * scale.factor
        panel.plot(
            [0.0, full, 1.15 * full], [0.0, top, top], linewidth=1.0,
            color=style.DIRECTION_COLOR[_WAY[row]],
        )  # fmt: skip


def tests_plot(fit: CrosstalkResult, scale: Scale) -> Plot | None:
    """Draw the values over the adaptation axes with the events that tell them."""
    if len(fit.adaptation) == 1:
        return _along_one(fit, scale)
    if len(fit.adaptation) == 2:
        return _over_two(fit, scale)
    return None


def _along_one(fit: CrosstalkResult, scale: Scale) -> Plot:
    view, own = fit.view, fit.fit
    figure, panels = style.new_figure(3.0, columns=2)
    for panel, rows in zip(panels, ((0, 1), (2, 3)), strict=True):
        for row in rows:
            way = _WAY[row]
            events = np.flatnonzero((view.branch == row) & ~view.wild)
            panel.plot(
                view.positions[events, 0], view.before[events] * scale.factor,
                linestyle="none", marker=style.DIRECTION_MARKER[way], markersize=3.5,
                markeredgewidth=0, alpha=0.45, color=style.DIRECTION_COLOR[way],
            )  # fmt: skip
            known = np.isfinite(own.values[row])
            panel.errorbar(
                own.points[known, 0], own.values[row, known] * scale.factor,
                yerr=own.standard_deviation[row, known] * scale.factor,
                marker="s", markersize=4, capsize=2, linewidth=1.2,
                color=style.DIRECTION_COLOR[way], label=style.DIRECTION_NAME[way],
            )  # fmt: skip
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_title("accelerating" if rows[0] == 0 else "decelerating")
        panel.set_xlabel(f"{fit.adaptation[0]} in mm")
    panels[0].set_ylabel(f"error of {fit.axis} in {scale.error}")
    panels[0].legend(loc="best")
    caption = (
        f"Error at full acceleration over {fit.adaptation[0]}: events, and the tests"
        " with 1 sd. Between tests the controller goes along the line, beyond them it is"
        f" taken to hold the last value; they cover {percent(fit.coverage)} of the"
        " workspace. The entries are the negative of this."
    )
    return Plot("tests", "Tests along the adaptation axis", figure, caption)


def _over_two(fit: CrosstalkResult, scale: Scale) -> Plot:
    view, own = fit.view, fit.fit
    figure, panels = style.new_figure(6.0, rows=2, columns=2, sharex=True, sharey=True)
    known = view.before[~view.wild]
    limit = float(np.max(np.abs(known), initial=0.0)) * scale.factor or 1.0
    shown = None
    for row, panel in enumerate(panels):
        # Any: matplotlib gives every keyword a type of its own.
        options: dict[str, Any] = {
            "cmap": style.DIVERGING,
            "vmin": -limit,
            "vmax": limit,
        }
        events = np.flatnonzero((view.branch == row) & ~view.wild)
        shown = panel.scatter(
            view.positions[events, 0], view.positions[events, 1], s=14, linewidths=0,
            c=view.before[events] * scale.factor, **options,
        )  # fmt: skip
        told = np.isfinite(own.values[row])
        panel.scatter(
            own.points[told, 0], own.points[told, 1], s=70, marker="s",
            c=own.values[row, told] * scale.factor, edgecolors=style.INK, **options,
        )  # fmt: skip
        panel.scatter(
            own.points[~told, 0], own.points[~told, 1], s=60, marker="x",
            color=style.INK, linewidths=1.2,
        )  # fmt: skip
        panel.set_title(BRANCHES[row], fontsize=8)
        (x0, x1), (y0, y1) = fit.workspace
        panel.plot(
            [x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=style.GREY, linewidth=0.8
        )
    for panel in panels[2:]:
        panel.set_xlabel(f"{fit.adaptation[0]} in mm")
    for panel in panels[::2]:
        panel.set_ylabel(f"{fit.adaptation[1]} in mm")
    if shown is not None:
        figure.colorbar(
            shown, ax=panels, label=f"error of {fit.axis} in {scale.error}", shrink=0.7
        )
    caption = (
        "Error at full acceleration over the adaptation axes: dots are events, squares"
        " the tests, crosses tests without events. The frame is the workspace, of which"
        f" the tests cover {percent(fit.coverage)}. The entries are the negative of this."
    )
    return Plot("tests", "Tests over the adaptation axes", figure, caption)


def course_plot(fit: CrosstalkResult, scale: Scale) -> Plot | None:
    """Draw single events in time, before and with the written list."""
    if not fit.view.courses:
        return None
    figure, panels = style.new_figure(4.4, rows=2, columns=2, sharey=True)
    for row, panel in enumerate(panels):
        own = [course for course in fit.view.courses if course.branch == row]
        for k, course in enumerate(own):
            words = ("before", "with the list") if k == 0 else (None, None)
            clock = 1e3 * course.time
            panel.plot(
                clock, course.before * scale.factor, color=style.ORANGE,
                linewidth=0.7, alpha=0.6, label=words[0],
            )  # fmt: skip
            panel.plot(
                clock, course.after * scale.factor, color=style.BLUE,
                linewidth=0.7, alpha=0.6, label=words[1],
            )  # fmt: skip
        if not own:
            panel.text(0.5, 0.5, "no event", ha="center", transform=panel.transAxes)
        panel.axvline(0, color=style.INK, linewidth=0.7)
        panel.set_title(BRANCHES[row], fontsize=8)
    for panel in panels[2:]:
        panel.set_xlabel("time from the beginning of the event in ms")
    for panel in panels[::2]:
        panel.set_ylabel(f"{fit.axis} in {scale.error}")
    panels[0].legend(loc="best")
    caption = (
        f"Up to eight events of each sign and direction: the error of {fit.axis} about"
        " its level beside the event, as measured and with what the written list adds."
        " What stands before 0 and on the right belongs to the events beside."
    )
    return Plot("courses", "Single events in time", figure, caption)
