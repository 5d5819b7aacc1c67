"""What a person must know of a crosstalk, and what the events do not tell."""

from collections.abc import Collection, Iterator

import numpy as np

from ....models import Crosstalk
from ...job._result import Remark
from ._identify import Identified
from .effect import BRANCHES, SAFE_TESTS, CrosstalkFit
from .keys import Spec

_THREE = 3
"""Tests of mode 2 that the manual speaks of (S-37)."""
_QUADRANTS = ("crosstalk_accelerate", "crosstalk_sign")
_COVERED = 0.995
_ABOVE = 1.1
"""Share of the specified acceleration up to which a peak is its own noise."""


def remarks_of(
    fit: Spec,
    found: Identified,
    written: bool,
    model: Crosstalk | None,
    coverage: float,
    cycle_time: float,
    verified: Collection[str],
) -> Iterator[Remark]:
    """Return everything that the report has to say of a fit.

    Args:
        fit: Keys of the job.
        found: The estimate.
        written: Whether a list is written.
        model: That list, or None.
        coverage: Share of the workspace that its tests cover.
        cycle_time: In s.
        verified: Names of conventions that the user has verified.
    """
    yield from remarks_of_fit(found.fit)
    yield from _of_the_log(fit, found)
    if not written:
        yield _nothing(fit, found)
    if not found.judged.all():
        yield Remark.warning(
            f"{int((~found.judged).sum())} of {len(found.judged)} events could not"
            " be held out, since what remains determines no test: nothing is"
            " predicted for them."
        )
    if model is not None:
        yield from _of_the_list(fit, found, model, coverage, cycle_time)
        if not set(_QUADRANTS) <= set(verified):
            yield _assumed(fit)


def _of_the_log(fit: Spec, found: Identified) -> Iterator[Remark]:
    """Return what the log says of itself: a delay, and accelerations beyond the list."""
    if found.delay:
        way = "late" if found.delay > 0 else "early"
        yield Remark.warning(
            f"The error of {fit.axis} comes {1e3 * abs(found.delay):.3g} ms {way}"
            f" against the acceleration of {fit.master}; that was taken off, as the"
            " delay of an instrument is. If it is the machine that follows late, the"
            " correction will come too early by as much."
        )
    own = found.fit
    full = np.where(own.of_events("branch") < 2, own.acceleration, -own.deceleration)
    over = float(np.max(np.abs(own.of_events("peak")) / full))
    if over > _ABOVE:
        yield Remark.warning(
            f"{fit.master} accelerates up to {over:.0%} of the specified"
            f" acceleration ({own.acceleration:g} and {own.deceleration:g} mm/s²)."
            " Above it the controller is taken to hold the correction (S-36): state"
            " the largest one as acceleration and deceleration in the job."
        )


def _nothing(fit: Spec, found: Identified) -> Remark:
    if not found.fit.complete.any():
        return Remark.error(
            "No test has all four of its entries measured, and a missing one would be 0"
            f" in the controller: no list is written. Measure {fit.master} with"
            " acceleration and deceleration in both directions."
        )
    if found.significant:
        return Remark.error(
            "The tests whose four entries are all measured stand in a line, or are too"
            " few to span the adaptation axes: no list is written."
        )
    largest = 1e3 * found.fit.largest_error()
    return Remark.warning(
        f"No crosstalk from {fit.master} shows: no value exceeds what chance over all of"
        f" them would give (the largest is {largest:.2f} µm). Nothing is written."
    )


def _of_the_list(
    fit: Spec,
    found: Identified,
    model: Crosstalk,
    coverage: float,
    cycle_time: float,
) -> Iterator[Remark]:
    tests = len(np.asarray(model.surface.points))
    if found.fit.mode == 2 and tests != _THREE:
        yield Remark.info(
            f"Mode 2 with {tests} tests: the manual speaks of three ([001] p.84,"
            " S-37), its parameters of any number."
        )
    if coverage < _COVERED:
        axes = " and ".join(found.masters)
        yield Remark.warning(
            f"The tests cover {coverage:.0%} of the workspace of {axes}. Beyond them"
            " incorrect values can occur ([001] p.84); the controller is taken to"
            " hold the nearest (S-37, S-38)."
        )
    if model.cycles > 1:
        late = 0.5e3 * model.cycles * cycle_time
        yield Remark.info(
            f"The values pass a filter over {model.cycles} cycles (n_cycles,"
            f" P-COMP-00064), so that a step of the acceleration of {fit.master} is"
            f" no jump of {fit.axis}: the correction comes {late:.3g} ms late."
            " The figures from the file are those without this delay."
        )
    if not found.fit.velocity_dependent:
        yield Remark.info(
            "Both directions are written with equal entries and velocity_dependent"
            " 1, which settles what the manuals leave open without it (S-35)."
        )


def _assumed(fit: Spec) -> Remark:
    return Remark.warning(
        "What counts as accelerating (S-34) and the sign of the entries (S-42) are"
        " assumed: under another reading the correction has the wrong sign for one"
        f" direction and doubles the error there. Log {fit.master} with acceleration and"
        " deceleration in both directions together with CROSSTALK::end_offset of"
        f" {fit.axis}, and give the log to axcomp verify, before relying on this list."
    )


def remarks_of_fit(fit: CrosstalkFit) -> Iterator[Remark]:
    """Return what must be known of events and tests."""
    counts = np.bincount(fit.of_events("branch"), minlength=len(BRANCHES))
    if fit.directions == "unknown":
        missing = " or ".join(BRANCHES[k] for k in np.flatnonzero(counts == 0))
        words = (
            f"No event shows {missing}: whether the directions differ cannot be told,"
            " and nothing is known there."
        )
        yield Remark.warning(words)
    elif fit.directions != "given":
        words = {
            "differ": "The values differ by the direction of motion.",
            "alike": "The values are alike in both directions.",
        }[fit.directions]
        yield Remark.info(words)
    parts = ", ".join(
        f"{count} of {name}" for count, name in zip(counts, BRANCHES, strict=True)
    )
    yield Remark.info(f"{len(fit.events)} events: {parts}.")
    wild = sum(event.wild for event in fit.events)
    if wild:
        words = f"{wild} events contradict the others and were left out."
        yield Remark.warning(words)
    lacking = fit.support == 0
    empty = [BRANCHES[k] for k in np.flatnonzero(lacking.all(axis=1))]
    if empty:
        words = (
            f"Nothing is known for {' and '.join(empty)}: the entries of a test are"
            " written all four or not at all, so no test can be written."
        )
        yield Remark.error(words)
        return
    for number in np.flatnonzero(lacking.any(axis=0)):
        place = ", ".join(f"{value:g}" for value in fit.points[number])
        names = [BRANCHES[k] for k in np.flatnonzero(lacking[:, number])]
        words = (
            f"The test at ({place}) mm is left out: no event for {' and '.join(names)}."
        )
        yield Remark.error(words)
    if len(fit.points) > SAFE_TESTS:
        words = f"{len(fit.points)} tests: one statement of the manuals allows fewer than 15."
        yield Remark.info(words)
