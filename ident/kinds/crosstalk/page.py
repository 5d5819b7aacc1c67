"""Plots and sentences of a crosstalk and its list."""

from collections.abc import Iterator

import numpy as np

from ...report._body import Body
from ...report._scale import Scale, count, number, percent, place
from ._gate import SHORT
from ._plots import course_plot, events_plot, tests_plot
from ._result import CrosstalkResult
from .effect import BRANCHES


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
            f"{count(len(own.events), 'acceleration')} cut out of the log; one"
            f" scatters by {number(max(noise) * scale.factor)} {scale.error} (1 sd)"
            " about the list at most.",
        )
    if fit.adaptation and len(fit.points):
        spans = ", ".join(
            f"{name} {place(low)} … {place(high)} mm"
            for name, (low, high) in zip(fit.adaptation, fit.workspace, strict=True)
        )
        yield (
            "Coverage",
            f"The tests cover {percent(fit.coverage)} of the workspace ({spans}).",
        )
    if own.scores:
        yield ("Choice of tests", _choice(fit, scale))
    if len(fit.points):
        yield (
            "Filter",
            f"The values pass a sin² filter over {fit.cycles} cycles (n_cycles,"
            " P-COMP-00064).",
        )


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


def _tests(fit: CrosstalkResult, scale: Scale) -> list[tuple[str, str]]:
    """Return one line per written test: entries, deviations and support."""
    facts = []
    for k, point in enumerate(fit.points):
        parts = []
        for name, entry, sd, support in zip(
            SHORT,
            fit.entries[:, k],
            fit.standard_deviation[:, k],
            fit.support[:, k],
            strict=True,
        ):
            value = number(entry * scale.factor, signed=True)
            spread = number(sd * scale.factor)
            events = count(int(support), "event")
            parts.append(f"{name} {value} ± {spread} {scale.error} ({events})")
        facts.append((f"Test {k + 1}{_at(fit, point)}", "; ".join(parts) + "."))
    return facts


def _left_out(fit: CrosstalkResult, scale: Scale) -> list[tuple[str, str]]:
    """Return what is known of tests that are not written."""
    own = fit.fit
    facts = []
    for k in np.flatnonzero(~own.complete):
        known = [
            f"{name} {number(value * scale.factor, signed=True)} {scale.error}"
            for name, value in zip(BRANCHES, own.values[:, k], strict=True)
            if np.isfinite(value)
        ]
        lost = [
            name
            for name, value in zip(BRANCHES, own.values[:, k], strict=True)
            if not np.isfinite(value)
        ]
        words = f"Not known: {', '.join(lost)}."
        if known:
            words += f" Error measured: {', '.join(known)}."
        facts.append((f"Not measured{_at(fit, own.points[k])}", words))
    return facts


def _choice(fit: CrosstalkResult, scale: Scale) -> str:
    best = {score.mode: score for score in reversed(fit.fit.scores)}
    for score in fit.fit.scores:
        if score.held_out < best[score.mode].held_out:
            best[score.mode] = score
    parts = [
        f"mode {mode} {number(best[mode].held_out * scale.factor)} {scale.error} with"
        f" {count(int(np.prod(best[mode].counts, dtype=int)), 'test')}"
        for mode in sorted(best)
    ]
    chosen = next(score for score in fit.fit.scores if score.chosen)
    tests = count(int(np.prod(chosen.counts, dtype=int)), "test")
    return (
        f"Events held out at other places are predicted within (rms, best of each mode):"
        f" {'; '.join(parts)}. Taken: mode {chosen.mode} with {tests}, the fewest that"
        " are not worse than the best by more than chance."
    )


def _at(fit: CrosstalkResult, point: np.ndarray) -> str:
    words = [
        f"{name} = {place(value)}"
        for name, value in zip(fit.adaptation, point, strict=True)
    ]
    return f" at {', '.join(words)} mm" if words else ""
