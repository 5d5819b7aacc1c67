"""Plots and sentences of a crosstalk and its list."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ...report import _style as style
from ...report._body import Body, Plot
from ...report._scale import Scale, count, number, percent, place
from .._drawing import directed_marks, left_out_words, side_by_side
from ._events import QUIET
from ._result import SHORT, CrosstalkResult
from ._tests import ModeScore
from .effect import BRANCHES

_WAY = (1, -1, 1, -1)
"""Direction of the master in each row of `BRANCHES`."""
_COURSES = 8
"""Events of each sign and direction that are shown in full."""


def body(fit: CrosstalkResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted crosstalk."""
    drawn = [events_plot(fit, scale), tests_plot(fit, scale), course_plot(fit, scale)]
    return Body(
        plots=[plot for plot in drawn if plot is not None],
        facts=[*_facts(fit, scale)],
        wild_count=int(fit.wild.sum()),
    )


def _facts(fit: CrosstalkResult, scale: Scale) -> Iterator[tuple[str, str]]:
    own = fit.fit
    yield ("Law", _law(fit))
    yield from _tests(fit, scale)
    yield from _left_out(fit, scale)
    noise = [each for each in own.noise if np.isfinite(each)]
    if noise:
        yield (
            "Events",
            f"{count(len(own.events), 'acceleration')} cut out of the log; one scatters"
            f" by {scale.shown(max(noise))} (1 sd) about the list at most.",
        )
    if own.scores:
        yield ("Choice of tests", _choice(fit, scale))


def _law(fit: CrosstalkResult) -> str:
    own = fit.fit
    where = f" over {' and '.join(fit.adaptation)}" if fit.adaptation else ""
    ways = (
        "each direction has entries of its own"
        if own.velocity_dependent
        else "both directions have the same entries"
    )
    return (
        f"Mode {own.mode}{where}: {fit.axis} is moved when {fit.master} accelerates, in"
        f" full at {own.acceleration:g} and {own.deceleration:g} mm/s² and in proportion"
        f" below; {ways}.".replace("-", "−")
    )


def _tests(fit: CrosstalkResult, scale: Scale) -> Iterator[tuple[str, str]]:
    """Return one line per written test: entries, deviations and support."""
    numbers = fit.entries, fit.standard_deviation, fit.support
    for k, point in enumerate(fit.points):
        parts = [
            f"{name} {number(entry * scale.factor, signed=True)} ± {scale.shown(sd)}"
            f" ({count(int(support), 'event')})"
            for name, entry, sd, support in zip(
                SHORT, *(each[:, k] for each in numbers), strict=True
            )
        ]
        yield (f"Test {k + 1}{_at(fit, point)}", "; ".join(parts) + ".")


def _left_out(fit: CrosstalkResult, scale: Scale) -> Iterator[tuple[str, str]]:
    """Return what is known of tests that are not written."""
    own = fit.fit
    for k in np.flatnonzero(~own.complete):
        values = dict(zip(BRANCHES, own.values[:, k], strict=True))
        lost = [name for name, value in values.items() if not np.isfinite(value)]
        words = f"Not known: {', '.join(lost)}."
        known = [
            f"{name} {scale.shown(value, signed=True)}"
            for name, value in values.items()
            if name not in lost
        ]
        if known:
            words += f" Error measured: {', '.join(known)}."
        yield (f"Not measured{_at(fit, own.points[k])}", words)


def _choice(fit: CrosstalkResult, scale: Scale) -> str:
    def tests(score: ModeScore) -> str:
        return count(math.prod(score.counts), "test")

    worst_first = sorted(reversed(fit.fit.scores), key=lambda score: -score.held_out)
    best = {score.mode: score for score in worst_first}
    parts = [
        f"mode {mode} {scale.shown(best[mode].held_out)} with {tests(best[mode])}"
        for mode in sorted(best)
    ]
    chosen = next(score for score in fit.fit.scores if score.chosen)
    return (
        f"Events held out at other places are predicted within (rms, best of each mode):"
        f" {'; '.join(parts)}. Taken: mode {chosen.mode} with {tests(chosen)}, the fewest"
        " that are not worse than the best by more than chance."
    )


def _at(fit: CrosstalkResult, point: np.ndarray) -> str:
    words = [
        f"{name} = {place(value)}"
        for name, value in zip(fit.adaptation, point, strict=True)
    ]
    return f" at {', '.join(words)} mm" if words else ""


def events_plot(fit: CrosstalkResult, scale: Scale) -> Plot:
    """Draw the error that each event shows over its acceleration, before and after."""
    own, sound = fit.fit, ~fit.wild
    across, up = f"acceleration of {fit.master} in mm/s²", _error_of(fit, scale)
    figure, panels = side_by_side(3.2, ("before", "from the file"), across, up)
    branch, peak = own.events.branch, np.abs(own.events.peak)
    share = np.minimum(peak / own.full, 1.0) * scale.factor
    # Of accelerations by speed the sign of the peak does not tell the entry.
    reach = np.where(branch < 2, 1.0, -1.0) * peak
    for panel, values in zip(panels, (fit.before, fit.from_file), strict=True):
        for way in (1, -1):
            rows = (np.array(_WAY)[branch] == way) & sound
            directed_marks(panel, way, reach[rows], (values * share)[rows], 4.0)
        panel.locator_params(axis="x", nbins=5)
    _mean_lines(panels[0], fit, scale)
    panels[0].legend(loc="best")
    before, after = (fit.error[key].sound.rms for key in ("before", "from_file"))
    caption = (
        f"Each mark is one acceleration of {fit.master} (right of 0) or deceleration"
        f" (left): the error of {fit.axis} at its peak."
    )
    if not len(fit.points):
        caption += " No list is written."
    else:
        caption += (
            f" At full acceleration events show {scale.shown(before)} rms, with the"
            f" written list {scale.shown(after)}."
        )
        if fit.adaptation:
            caption += (
                f" The spread before is that over {' and '.join(fit.adaptation)}; the"
                " lines are the means of the tests."
            )
    caption += left_out_words(int(fit.wild.sum()), "contradicting event")
    return Plot("events", "Every acceleration, before and after", figure, caption)


def _error_of(fit: CrosstalkResult, scale: Scale) -> str:
    return f"error of {fit.axis} in {scale.error}"


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
    if not fit.adaptation:
        return None
    return (_along_one if len(fit.adaptation) == 1 else _over_two)(fit, scale)


def _shown(fit: CrosstalkResult, row: int) -> tuple[Float[np.ndarray, "n k"], Any]:
    """Return places and errors of the events of a branch, wild ones left out."""
    rows = (fit.fit.events.branch == row) & ~fit.wild
    return fit.fit.events.positions[rows], fit.before[rows]


def _along_one(fit: CrosstalkResult, scale: Scale) -> Plot:
    own = fit.fit
    figure, panels = side_by_side(
        3.0, ("accelerating", "decelerating"), f"{fit.adaptation[0]} in mm",
        _error_of(fit, scale), shared=False,
    )  # fmt: skip
    for row, way in enumerate(_WAY):
        panel = panels[row // 2]
        places, errors = _shown(fit, row)
        directed_marks(panel, way, places[:, 0], errors * scale.factor, 3.5, 0.45)
        known = np.isfinite(own.values[row])
        panel.errorbar(
            own.points[known, 0], own.values[row, known] * scale.factor,
            yerr=own.standard_deviation[row, known] * scale.factor,
            marker="s", markersize=4, capsize=2, linewidth=1.2,
            color=style.DIRECTION_COLOR[way],
        )  # fmt: skip
    panels[0].legend(loc="best")
    caption = (
        f"Error at full acceleration over {fit.adaptation[0]}: events, and the tests"
        " with 1 sd. Between tests the controller goes along the line, beyond them it is"
        f" taken to hold the last value; they cover {percent(fit.coverage)} of the"
        " workspace. The entries are the negative of this."
    )
    return Plot("tests", "Tests along the adaptation axis", figure, caption)


def _over_two(fit: CrosstalkResult, scale: Scale) -> Plot:
    own = fit.fit
    figure, panels = style.new_figure(6.0, rows=2, columns=2, sharex=True, sharey=True)
    known = np.abs(fit.before[~fit.wild])
    limit = float(np.max(known, initial=0.0)) * scale.factor or 1.0
    # Any: matplotlib gives every keyword a type of its own.
    options: dict[str, Any] = {"cmap": style.DIVERGING, "vmin": -limit, "vmax": limit}
    dots = []
    for row, panel in enumerate(panels):
        places, errors = _shown(fit, row)
        dots.append(
            panel.scatter(
                places[:, 0], places[:, 1], s=14, linewidths=0,
                c=errors * scale.factor, **options,
            )
        )  # fmt: skip
        told = np.isfinite(own.values[row])
        first, second = own.points.T
        panel.scatter(
            first[told], second[told], s=70, marker="s", edgecolors=style.INK,
            c=own.values[row, told] * scale.factor, **options,
        )  # fmt: skip
        panel.scatter(
            first[~told], second[~told], s=60, marker="x", color=style.INK,
            linewidths=1.2,
        )  # fmt: skip
        panel.set_title(BRANCHES[row], fontsize=10)
        (x0, x1), (y0, y1) = fit.workspace
        panel.plot(
            [x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=style.GREY, linewidth=0.8
        )
    for panel in panels[2:]:
        panel.set_xlabel(f"{fit.adaptation[0]} in mm")
    for panel in panels[::2]:
        panel.set_ylabel(f"{fit.adaptation[1]} in mm")
    figure.colorbar(dots[-1], ax=panels, label=_error_of(fit, scale), shrink=0.7)
    caption = (
        "Error at full acceleration over the adaptation axes: dots are events, squares"
        " the tests, crosses tests without events. The frame is the workspace, of which"
        f" the tests cover {percent(fit.coverage)}. The entries are the negative of this."
    )
    return Plot("tests", "Tests over the adaptation axes", figure, caption)


def course_plot(fit: CrosstalkResult, scale: Scale) -> Plot:
    """Draw single events in time, before and with the written list."""
    figure, panels = style.new_figure(4.4, rows=2, columns=2, sharey=True)
    for row, panel in enumerate(panels):
        own = np.flatnonzero((fit.fit.events.branch == row) & ~fit.wild)
        # Spread evenly over the log.
        picks = np.linspace(0, len(own) - 1, min(len(own), _COURSES)).astype(int)
        for k, event in enumerate(own[picks]):
            clock, before, added = _course(fit, int(event))
            stages = {"before": before, "with the list": before + added}
            colours = (style.ORANGE, style.BLUE)
            for (name, values), colour in zip(stages.items(), colours, strict=True):
                panel.plot(
                    1e3 * clock, values * scale.factor, color=colour,
                    linewidth=0.7, alpha=0.6, label=None if k else name,
                )  # fmt: skip
        if not own.size:
            panel.text(0.5, 0.5, "no event", ha="center", transform=panel.transAxes)
        panel.axvline(0, color=style.INK, linewidth=0.7)
        panel.set_title(BRANCHES[row], fontsize=10)
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


def _course(fit: CrosstalkResult, event: int) -> tuple[Float[np.ndarray, " t"], ...]:
    """Return time in s, error about its level beside the event, and what is added, in mm."""
    log, events = fit.readings, fit.fit.events
    start, stop = events.start[event], events.stop[event]
    rows = slice(max(2 * start - stop, 0), 2 * stop - start)
    full = max(fit.fit.acceleration, -fit.fit.deceleration)
    error = log.error[rows]
    quiet = np.abs(log.acceleration[rows]) < QUIET * full
    beside = error[quiet & np.isfinite(error)]
    level = np.median(beside) if beside.size else np.nanmedian(error)
    clock = log.time[rows] - log.time[start]
    return clock, error - float(level), fit.added[rows]
