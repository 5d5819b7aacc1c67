"""Events of a crosstalk as the report shows them."""

import numpy as np
from jaxtyping import Float

from ...kinds.crosstalk.effect import BRANCHES, Event
from ._identify import Identified
from ._result import CrosstalkView, EventCourse

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
