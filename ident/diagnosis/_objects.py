"""The CNC objects of all compensations of a machine, as a table."""

import csv
import dataclasses
import io
from collections.abc import Iterable, Sequence
from typing import final

from ...data.lists import ListFile
from ...data.measurements import CNC_OBJECTS, INDEX_GROUP, CncObject
from ...models import Conventions
from ..exchange import InUse, MachineLists, machine_lists
from ..kinds import kind

_NO_ADDRESS = (
    "no manual gives its address: choose it in the object browser of the target"
)
_VARIABLE = (
    "NC variable without an ADS address, the word of the axis behind it (….X); each reading"
    " flushes the channel"
)
_OPEN_TYPE = "the manual leaves the type open: set it before recording"


@final
@dataclasses.dataclass(frozen=True)
class Observable:
    """One thing to look at while a machine runs with its lists.

    Attributes:
        axis: Logical number; None: of the whole controller.
        compensation: As in a job, ``external``, or empty for a position.
        name: Of the object, as the manual prints it.
        unit: As printed.
        meaning: What it holds.
        source: Manual and page; empty: none names it.
        found: The object with its address; None: no manual gives it.
        channel: Name under which a recording shows it, as `read_log` reads it; None: it
            cannot be recorded.
        note: What the user must do or know.
    """

    axis: int | None
    compensation: str
    name: str
    unit: str
    meaning: str
    source: str
    found: CncObject | None = None
    channel: str | None = None
    note: str = ""

    @property
    def index_offset(self) -> int | None:
        """Index offset with the number of the axis; None: no manual gives it."""
        return None if self.found is None else self.found.index_offset(self.axis or 0)


def observables(
    lists: Sequence[ListFile], conventions: Conventions | None = None
) -> tuple[Observable, ...]:
    """Return what shows the compensations of a machine, by axis.

    Every compensation that a list holds counts, be it switched on or not.

    Args:
        lists: Compensation and axis lists in any order.
        conventions: Whose list holds cross data; the defaults where left out.

    Raises:
        ExchangeError: If the lists contradict each other.
    """
    rules = Conventions() if conventions is None else conventions
    machine = machine_lists(lists)
    switched = {(one.axis, one.name): one for one in machine.in_use(rules)}
    held = MachineLists(machine.compensation, {}).in_use(rules)
    used = switched | {(one.axis, one.name): one for one in held}
    found: list[Observable] = []
    for key in sorted(used):
        found += _compensation(used[key])
    found += _external(machine)
    return (*found, *_positions(used.values()))


def objects_csv(rows: Iterable[Observable]) -> str:
    """Return the table as CSV text, one line per object."""
    sink = io.StringIO()
    writer = csv.writer(sink, lineterminator="\n")
    writer.writerow(
        (
            "axis", "compensation", "name", "index_group", "index_offset", "type",
            "bytes", "access", "unit", "meaning", "source", "channel", "note",
        )
    )  # fmt: skip
    for row in rows:
        address = row.index_offset
        known = row.found
        writer.writerow(
            (
                "" if row.axis is None else f"A{row.axis}",
                row.compensation,
                row.name,
                "" if address is None else f"0x{INDEX_GROUP:X}",
                "" if address is None else f"0x{address:X}",
                "" if known is None else known.type,
                "" if known is None else known.size or "",
                "" if known is None else "read/write" if known.writable else "read",
                row.unit,
                row.meaning,
                row.source,
                row.channel or "",
                row.note,
            )
        )
    return sink.getvalue()


def _compensation(one: InUse) -> list[Observable]:
    """Return the objects of a compensation, then its NC variable."""
    facts = kind(one.name)
    rows = [
        _object(each, one.axis) for each in CNC_OBJECTS if each.compensation == one.name
    ]
    meaning = "value that acts" + (", a current" if facts.adds_current else "")
    rows.append(
        Observable(
            one.axis, one.name, facts.variable, "mm, inch", meaning, "[001] p.96",
            note=_VARIABLE,
        )
    )  # fmt: skip
    return rows


def _object(each: CncObject, axis: int | None) -> Observable:
    return Observable(
        axis,
        each.compensation,
        each.name,
        each.unit,
        each.meaning,
        each.source,
        found=each,
        channel=each.name if axis is None else f"A{axis}.{each.name}",
        note="" if each.size is not None else _OPEN_TYPE,
    )


def _external(machine: MachineLists) -> list[Observable]:
    """Return the objects of an external compensation, where an axis has limits for it."""
    axes = [
        number
        for number, listing in sorted(machine.machine.items())
        if any(key.startswith("lr_param.ext_comp.") for key in listing.columns)
    ]
    own = [each for each in CNC_OBJECTS if each.compensation == "external"]
    shared = [_object(each, None) for each in own if axes and not each.of_axis]
    return shared + [
        _object(each, axis) for axis in axes for each in own if each.of_axis
    ]


def _positions(used: Iterable[InUse]) -> list[Observable]:
    """Return the positions that a log needs beside the offsets."""
    pairs = [(one, kind(one.name).adds_current) for one in used]
    seen = sorted({axis for one, _ in pairs for axis in (one.axis, *one.masters)})
    moved = sorted({one.axis for one, is_current in pairs if not is_current})
    rows = [
        Observable(
            axis, "", f"A{axis}.position", "mm or °", "commanded position, uncompensated",
            "", channel=f"A{axis}.position", note=_NO_ADDRESS,
        )
        for axis in seen
    ]  # fmt: skip
    rows += [
        Observable(
            axis, "", "dig_cmd_pos", "mm or °", "position on the drive bus, with all offsets",
            "[001] p.19", channel=f"A{axis}.drive_position", note=_NO_ADDRESS,
        )
        for axis in moved
    ]  # fmt: skip
    return rows
