"""What a job found of a crosstalk, and what a person must know of it."""

import dataclasses
from collections.abc import Collection, Iterator
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ....models import Crosstalk
from ...job._result import AbstractResult, Remark
from . import SAFE_TESTS
from ._identify import Identified
from .effect import BRANCHES, CrosstalkFit, CrosstalkReadings
from .keys import Spec

_THREE = 3
"""Tests of mode 2 that the manual speaks of (S-37)."""
_QUADRANTS = ("crosstalk_accelerate", "crosstalk_sign")
_COVERED = 0.995
_ABOVE = 1.1
"""Share of the specified acceleration up to which a peak is its own noise."""


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class CrosstalkResult(AbstractResult):
    """The crosstalk of an axis; errors of events are those at full acceleration, in mm.

    Attributes:
        master: Axis that accelerates.
        adaptation: Axes on whose positions it depends.
        points: Of the written tests in mm, shape ``(p, k)``.
        entries: Written entries in mm by row of `BRANCHES`, with the sign of the list;
            no tests where nothing is written.
        standard_deviation: Of the entries.
        support: Events that touch each entry.
        cycles: Of the sin² filter on the values (P-COMP-00064).
        coverage: Share of the workspace that the tests cover, 0 to 1.
        workspace: From where to where each adaptation axis goes in mm.
        fit: The estimate behind it with its events (sign of the error).
        predicted: What the list fitted to other events leaves of each event.
        from_file: What the written file, read back, leaves of each event.
        readings: The log from which the events are cut.
        added: What the written list adds in each row of the log in mm.
    """

    master: str
    adaptation: tuple[str, ...]
    points: Float[np.ndarray, "p k"]
    entries: Float[np.ndarray, "4 p"]
    standard_deviation: Float[np.ndarray, "4 p"]
    support: Int[np.ndarray, "4 p"]
    cycles: int
    coverage: float
    workspace: Float[np.ndarray, "k 2"]
    fit: CrosstalkFit
    predicted: Float[np.ndarray, " n"]
    from_file: Float[np.ndarray, " n"]
    readings: CrosstalkReadings
    added: Float[np.ndarray, " t"]

    @property
    def over(self) -> tuple[str, ...]:
        """Axes over whose motion it acts."""
        return (self.master, *self.adaptation)

    @property
    def before(self) -> Float[np.ndarray, " n"]:
        """Error that each event shows."""
        return self.fit.of_events("value")

    @property
    def wild(self) -> Bool[np.ndarray, " n"]:
        """Events that contradict the others."""
        return self.fit.of_events("wild").astype(bool)

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        fit = self.fit
        names = [name.replace(" ", "_") for name in BRANCHES]
        return {
            "master": self.master,
            "adaptation": list(self.adaptation),
            "parameters": {
                "mode": fit.mode,
                "acceleration": fit.acceleration,
                "deceleration": fit.deceleration,
                "velocity_dependent": fit.velocity_dependent,
                "n_cycles": self.cycles,
                "positions": self.points,
                "table": dict(zip(names, self.entries, strict=True)),
            },
            "standard_deviations": {
                "table": dict(zip(names, self.standard_deviation, strict=True))
            },
            "support": dict(zip(names, self.support, strict=True)),
            "measured": {
                "positions": fit.points,
                "error": dict(zip(names, fit.values, strict=True)),
                "complete": fit.complete,
            },
            "noise": dict(zip(names, fit.noise, strict=True)),
            "coverage": self.coverage,
            "events": [
                {
                    "time": self.readings.time[event.start],
                    "kind": BRANCHES[event.branch],
                    "positions": event.positions,
                    "peak": event.peak,
                    "error": event.value,
                    "standard_deviation": event.standard_deviation,
                    "predicted": predicted,
                    "from_file": left,
                    "wild": event.wild,
                }
                for event, predicted, left in zip(
                    fit.events, self.predicted, self.from_file, strict=True
                )
            ],
            "choice": [dataclasses.asdict(score) for score in fit.scores],
        }


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
