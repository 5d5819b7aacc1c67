"""A motion during which lists are loaded again: each acts while it is loaded.

The old table goes and the new one comes as at COMP OFF and ON: over the cycles of each, both at
the same time (S-06).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ...data.lists import ListFile
from ..kinds import NAMES, kind
from ._errors import ExchangeError
from ._events import ControllerEvent
from ._identity import axis_number
from ._machine_lists import Reading, machine_lists
from ._motion import Motion
from ._simulate import AxisOffsets, simulate


def simulate_events(
    lists: Sequence[ListFile],
    motion: Motion,
    reading: Reading,
    *,
    cycle_time: float | None = None,
    events: Sequence[ControllerEvent] | None = None,
) -> tuple[AxisOffsets, ...]:
    """Return what the controller adds along a motion with events.

    What waits for COMP ON waits for it; else as `simulate`.

    Args:
        lists: Compensation and axis lists as they are loaded in the first row.
        motion: Commanded motion with time.
        reading: How the lists are read.
        cycle_time: Of the controller in s, to hold the time step of the motion against.
        events: In the order of their rows; None: everything has been on and homed for
            long, also what waits for COMP ON.

    Raises:
        ExchangeError: As `simulate`; if the motion has no time, or a list that is loaded
            again replaces none.
    """
    if events is None:
        return simulate(lists, motion, reading, cycle_time=cycle_time)
    if motion.time is None:
        raise ExchangeError(
            where=motion.source, found="no time", expected="time, for events"
        )
    others = [one for one in events if one.action != "reload"]
    versions, spans = _versions(lists, events, motion.rows)
    found: tuple[AxisOffsets, ...] = ()
    known: set[int] = set()
    for version in versions:
        used = machine_lists(version).in_use(reading.conventions, reading.lines)
        offsets = simulate(
            version,
            motion,
            reading,
            cycle_time=cycle_time,
            events=others,
            windows={
                (one.axis, one.name): spans[id(one.listing)]
                for one in used
                if id(one.listing) in spans
            },
        )
        new = {id(one) for one in version} - known
        known |= new
        fresh = {(one.axis, one.name) for one in used if id(one.listing) in new}
        found = _joined(found, offsets, fresh) if found else offsets
    return found


def _versions(
    lists: Sequence[ListFile], events: Sequence[ControllerEvent], rows: int
) -> tuple[list[list[ListFile]], dict[int, tuple[int, int]]]:
    """Return the lists after each reload, and in which rows each list is loaded."""
    versions = [list(lists)]
    spans = {id(one): (0, rows) for one in lists}
    for event in events:
        if event.listing is None:
            continue
        place = _replaced(versions[-1], event)
        old = versions[-1][place]
        spans[id(old)] = (spans[id(old)][0], event.row)
        # A copy: the same list may be loaded several times.
        new = dataclasses.replace(event.listing)
        spans[id(new)] = (event.row, rows)
        versions.append([*versions[-1][:place], new, *versions[-1][place + 1 :]])
    return versions, spans


def _replaced(version: Sequence[ListFile], event: ControllerEvent) -> int:
    """Return the place of the list that an event loads again."""
    listing = event.listing
    assert listing is not None
    for place, one in enumerate(version):
        same_kind = one.kind == listing.kind == "compensation"
        if same_kind and axis_number(one) == axis_number(listing):
            return place
    raise ExchangeError(
        where=event.where,
        found=f"{listing.source}, a list of axis {axis_number(listing)}",
        expected="a compensation list of an axis that has one; axis lists are not"
        " updated at run time",
    )


def _joined(
    before: tuple[AxisOffsets, ...],
    after: tuple[AxisOffsets, ...],
    fresh: set[tuple[int, str]],
) -> tuple[AxisOffsets, ...]:
    """Add what the new tables of a version add to what is known."""
    by_axis = {one.axis: one for one in after}
    joined = [
        _added(one, by_axis.pop(one.axis), fresh) if one.axis in by_axis else one
        for one in before
    ]
    return tuple(sorted((*joined, *by_axis.values()), key=lambda one: one.axis))


def _added(
    before: AxisOffsets, after: AxisOffsets, fresh: set[tuple[int, str]]
) -> AxisOffsets:
    new = {n: v for n, v in after.parts.items() if (after.axis, n) in fresh}
    known, none = before.parts, np.zeros_like(before.total)
    parts = {
        name: known.get(name, none) + new.get(name, none)
        for name in NAMES
        if name in known or name in new
    }
    current = before.current
    pushes = any(kind(name).adds_current for axis, name in fresh if axis == after.axis)
    if after.current is not None and pushes:
        current = after.current if current is None else current + after.current
    return dataclasses.replace(
        before,
        parts=parts,
        total=before.total + sum(new.values(), none),
        current=current,
        left_out=tuple(dict.fromkeys((*before.left_out, *after.left_out))),
        remarks=tuple(dict.fromkeys((*before.remarks, *after.remarks))),
    )
