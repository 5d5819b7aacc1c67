"""What a job found of the crosstalk from one axis to another."""

import dataclasses
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...job._result import AbstractResult
from ._identify import Identified
from ._remarks import remarks_of_fit
from .effect import BRANCHES, CrosstalkFit, Event


@dataclasses.dataclass(frozen=True)
class EventCourse:
    """One event as it was recorded: error of the slave about its level beside the event.

    Attributes:
        branch: Row of `BRANCHES`.
        time: In s from the beginning of the acceleration.
        before: In mm, as measured.
        after: In mm, with what the written list adds.
    """

    branch: int
    time: Float[np.ndarray, " t"]
    before: Float[np.ndarray, " t"]
    after: Float[np.ndarray, " t"]


@dataclasses.dataclass(frozen=True)
class CrosstalkView:
    """All events, one row each.

    Attributes:
        time: Beginning in s.
        branch: Row of `BRANCHES`.
        positions: Of the adaptation axes of the list in mm, shape ``(n, k)``.
        peak: Largest acceleration in mm/s², with its sign.
        share: Share of the specified acceleration that the event reaches, up to 1.
        before: Error of the slave at full acceleration in mm.
        predicted: What the list fitted to other events leaves of it.
        from_file: What the written file, read back, leaves of it.
        standard_deviation: Of one event, from its own scatter.
        wild: Events that contradict the others.
        courses: Some events in full.
    """

    time: Float[np.ndarray, " n"]
    branch: Int[np.ndarray, " n"]
    positions: Float[np.ndarray, "n k"]
    peak: Float[np.ndarray, " n"]
    share: Float[np.ndarray, " n"]
    before: Float[np.ndarray, " n"]
    predicted: Float[np.ndarray, " n"]
    from_file: Float[np.ndarray, " n"]
    standard_deviation: Float[np.ndarray, " n"]
    wild: Bool[np.ndarray, " n"]
    courses: tuple[EventCourse, ...]


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class CrosstalkResult(AbstractResult):
    """The crosstalk of an axis.

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
        fit: The estimate behind it (sign of the error).
        view: The events before and after.
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
    view: CrosstalkView

    @property
    def over(self) -> tuple[str, ...]:
        """Axes over whose motion it acts."""
        return (self.master, *self.adaptation)

    @property
    def message(self) -> str:
        """What is to be known of events and tests, in sentences."""
        return " ".join(remark.message for remark in remarks_of_fit(self.fit))

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        fit, view = self.fit, self.view
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
                    "time": view.time[k],
                    "kind": BRANCHES[view.branch[k]],
                    "positions": view.positions[k],
                    "peak": view.peak[k],
                    "error": view.before[k],
                    "standard_deviation": view.standard_deviation[k],
                    "predicted": view.predicted[k],
                    "from_file": view.from_file[k],
                    "wild": view.wild[k],
                }
                for k in range(len(view.time))
            ],
            "choice": [dataclasses.asdict(score) for score in fit.scores],
            "message": self.message,
        }


_COURSES = 8
"""Events of each sign and direction that are shown in full."""
_QUIET = 0.02


def view_of(
    found: Identified,
    from_file: Float[np.ndarray, " n"],
    added: Float[np.ndarray, " t"],
) -> CrosstalkView:
    """Return all events before and after.

    Args:
        found: The estimate.
        from_file: What the written list leaves of each event in mm.
        added: What it adds in each row of the log in mm.
    """
    fit, readings = found.fit, found.readings
    events = fit.events
    peak = np.array([event.peak for event in events])
    branch = np.array([event.branch for event in events], dtype=np.int64)
    full = np.where(branch < 2, fit.acceleration, -fit.deceleration)
    positions = [
        readings.positions[event.start : event.stop].mean(axis=0) for event in events
    ]
    return CrosstalkView(
        time=readings.time[[event.start for event in events]],
        branch=branch,
        positions=np.array(positions).reshape(len(events), -1),
        peak=peak,
        share=np.minimum(np.abs(peak) / full, 1.0),
        before=found.values,
        predicted=found.held_out,
        from_file=from_file,
        standard_deviation=np.array([event.standard_deviation for event in events]),
        wild=found.wild,
        courses=tuple(
            _course(found, events[k], added) for k in _chosen(branch, found.wild)
        ),
    )


def _chosen(branch: np.ndarray, wild: np.ndarray) -> list[int]:
    """Return events spread evenly over the log, as many of each branch."""
    chosen: list[int] = []
    for each in range(len(BRANCHES)):
        rows = np.flatnonzero((branch == each) & ~wild)
        picks = np.linspace(0, len(rows) - 1, min(len(rows), _COURSES))
        chosen += [int(rows[int(k)]) for k in picks]
    return chosen


def _course(
    found: Identified, event: Event, added: Float[np.ndarray, " t"]
) -> EventCourse:
    readings = found.readings
    length = event.stop - event.start
    rows = np.arange(
        max(event.start - length, 0), min(event.stop + length, len(readings.time))
    )
    full = max(found.fit.acceleration, -found.fit.deceleration)
    quiet = np.abs(readings.acceleration[rows]) < _QUIET * full
    error = readings.error[rows]
    beside = error[quiet & np.isfinite(error)]
    level = float(np.median(beside)) if beside.size else float(np.nanmedian(error))
    shift = added[rows]
    return EventCourse(
        branch=event.branch,
        time=readings.time[rows] - readings.time[event.start],
        before=error - level,
        after=error - level + shift,
    )
