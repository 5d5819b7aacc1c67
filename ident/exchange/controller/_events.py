"""Events at a controller beside its motion: COMP commands, homing, program end, reload."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from typing import Literal, final

import numpy as np
from jaxtyping import Bool

from ....data.lists import ListFile
from ....models import (
    COMPENSATIONS,
    CompCommand,
    PositionController,
    ProgramEnd,
    commanded,
)
from ...kinds import kinds
from .._identity import axis_number
from .._units import ExchangeError, expect

Action = Literal["on", "off", "homed", "not homed", "end", "reload"]
Windows = Mapping[tuple[int, str], tuple[int, int]]
"""First row in which a list is loaded, and the first in which it is not, by axis and name."""

_WORDS: dict[str, Action] = {
    "HOMED": "homed",
    "NOT HOMED": "not homed",
    "PROGRAM END": "end",
    "M30": "end",
    "RESET": "end",
}
_COMP = re.compile(r"COMP (ON|OFF|OFF_ALL)((?: [A-Z]+)*)")
EVENT_FORMS = (
    "COMP ON CROSS, COMP OFF LEAD TEMP, COMP OFF_ALL, HOMED, NOT HOMED, PROGRAM END or"
    " RELOAD FILE.lis"
)
"""What an event may be, for messages."""


@final
@dataclasses.dataclass(frozen=True)
class ControllerEvent:
    """Something that happens at the controller.

    Attributes:
        row: First row of the motion in which it acts.
        action: What happens.
        axis: Logical number; None: all axes.
        names: Of the compensations that are switched; none: all.
        listing: The compensation list that is loaded from then on.
        where: Where it stands, for messages.
    """

    row: int
    action: Action
    axis: int | None = None
    names: tuple[str, ...] = ()
    listing: ListFile | None = None
    where: str = "events"


def parse_action(text: str, where: str) -> tuple[Action, tuple[str, ...]]:
    """Return what the text of an event says, and which compensations it names.

    A text that is none is refused. A reload is no part of this: it names a file.
    """
    plain = " ".join(text.upper().replace("[", " ").replace("]", " ").split())
    if plain in _WORDS:
        return _WORDS[plain], ()
    match = _COMP.fullmatch(plain)
    keywords = {kind.keyword: kind.name for kind in kinds()}
    words = match[2].split() if match else []
    unknown = [word for word in words if word not in keywords]
    if match is None or unknown or (match[1] == "OFF_ALL" and words):
        raise ExchangeError(
            where=where,
            found=repr(text),
            expected=f"{EVENT_FORMS}, the axis in the column axis; compensations are"
            f" {', '.join(keywords)}",
        )
    return ("on" if match[1] == "ON" else "off"), tuple(keywords[w] for w in words)


def homed_rows(
    events: Sequence[ControllerEvent], numbers: Sequence[int], rows: int
) -> Bool[np.ndarray, "t a"] | None:
    """Return which axes are homed per row; None: all, and have been for long.

    An axis that is homed by an event was not before, and the reverse.
    """
    homing = [event for event in events if event.action in ("homed", "not homed")]
    if not homing:
        return None
    homed = np.ones((rows, len(numbers)), dtype=bool)
    changed: set[int] = set()
    for event in homing:
        is_homed = event.action == "homed"
        for column in _columns(event, numbers):
            if column not in changed:
                homed[: event.row, column] = not is_homed
            changed.add(column)
            homed[event.row :, column] = is_homed
    return homed


def selected_rows(
    controller: PositionController,
    events: Sequence[ControllerEvent],
    numbers: Sequence[int],
    rows: int,
    windows: Windows,
) -> Bool[np.ndarray, "t a c"]:
    """Return which of `COMPENSATIONS` are selected per row: commanded, and loaded."""
    commands: list[CompCommand | ProgramEnd] = []
    for event in events:
        columns = _columns(event, numbers)
        if event.action == "end":
            commands.append(ProgramEnd(event.row, tuple(columns)))
        elif event.action in ("on", "off"):
            is_on = event.action == "on"
            commands += [
                CompCommand(event.row, axis, is_on, event.names) for axis in columns
            ]
    selected = commanded(controller, rows, commands)
    for (axis, name), (start, end) in windows.items():
        column = selected[:, numbers.index(axis), COMPENSATIONS.index(name)]
        column[:start] = False
        column[end:] = False
    return selected


def _columns(event: ControllerEvent, numbers: Sequence[int]) -> list[int]:
    """Return the columns of its axes; an axis that the machine lacks is refused."""
    if event.axis is None:
        return list(range(len(numbers)))
    axes = ", ".join(f"A{number}" for number in numbers)
    expected = f"one of those that the lists name, {axes}"
    expect(event.axis in numbers, event.where, f"axis {event.axis}", expected)
    return [list(numbers).index(event.axis)]


def loaded_versions(
    lists: Sequence[ListFile], events: Sequence[ControllerEvent], rows: int
) -> tuple[list[tuple[list[ListFile], ListFile | None]], dict[int, tuple[int, int]]]:
    """Return the lists at first and after each reload, and in which rows each is loaded.

    Beside the lists stands the one that was loaded again; None: all are as at first.
    """
    current, spans = list(lists), {id(listing): (0, rows) for listing in lists}
    versions: list[tuple[list[ListFile], ListFile | None]] = [(current, None)]
    for event in events:
        if event.listing is None:
            continue
        place = _replaced(current, event)
        spans[id(current[place])] = spans[id(current[place])][0], event.row
        # A copy: the same list may be loaded several times.
        new = dataclasses.replace(event.listing)
        spans[id(new)] = event.row, rows
        current = [*current[:place], new, *current[place + 1 :]]
        versions.append((current, new))
    return versions, spans


def _replaced(version: Sequence[ListFile], event: ControllerEvent) -> int:
    """Return the place of the list that an event loads again."""
    listing = event.listing
    assert listing is not None
    for place, entry in enumerate(version):
        same_kind = entry.kind == listing.kind == "compensation"
        if same_kind and axis_number(entry) == axis_number(listing):
            return place
    found = f"{listing.source}, a list of axis {axis_number(listing)}"
    expected = "a compensation list of an axis that has one; axis lists are not updated at run time"
    raise ExchangeError(event.where, found, expected)
