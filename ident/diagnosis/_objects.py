"""The CNC objects of all compensations of a machine, as a table."""

import csv
import dataclasses
import io
from collections.abc import Collection, Iterable, Sequence
from typing import final

from ...data.lists import EXTERNAL_LIMITS, ListFile
from ...data.measurements import CNC_OBJECTS, INDEX_GROUP, CncObject
from ...models import Conventions
from ..exchange import InUse, MachineLists, machine_lists

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
    """One thing to look at while a machine runs with its lists: a row of the table.

    Attributes:
        axis: Logical number; None: of the whole controller.
        compensation: As in a job, ``external``, or empty for a position.
        name: Of the object, as the manual prints it.
        index_offset: With the number of the axis; None: no manual gives it.
        type: Of its value.
        bytes: Of its value; None: not known, or the manual leaves the type open.
        access: ``read`` or ``read/write``.
        unit: As printed.
        meaning: What it holds.
        source: Manual and page; empty: none names it.
        channel: Name under which a recording shows it, as `read_log` reads it; None: it
            cannot be recorded.
        note: What the user must do or know.
    """

    axis: int | None
    compensation: str
    name: str
    index_offset: int | None = None
    type: str = ""
    bytes: int | None = None
    access: str = ""
    unit: str = "mm or °"
    meaning: str = ""
    source: str = ""
    channel: str | None = None
    note: str = ""


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
    switched = {(use.axis, use.name): use for use in machine.in_use(rules)}
    held = MachineLists(machine.compensation, {}).in_use(rules)
    used = switched | {(use.axis, use.name): use for use in held}
    rows: list[Observable] = []
    for key in sorted(used):
        rows += _compensation(used[key])
    rows += _external(machine)
    return (*rows, *_positions(used.values()))


def objects_csv(rows: Iterable[Observable]) -> str:
    """Return the table as CSV text, one line per object."""
    columns = [field.name for field in dataclasses.fields(Observable)]
    columns.insert(columns.index("index_offset"), "index_group")
    sink = io.StringIO()
    writer = csv.DictWriter(sink, columns, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        shown = {}
        if row.axis is not None:
            shown["axis"] = f"A{row.axis}"
        if row.index_offset is not None:
            shown["index_group"] = f"0x{INDEX_GROUP:X}"
            shown["index_offset"] = f"0x{row.index_offset:X}"
        writer.writerow({**vars(row), **shown})
    return sink.getvalue()


def _compensation(one: InUse) -> list[Observable]:
    """Return the objects of a compensation, then its NC variable."""
    rows = [
        _object(each, one.axis) for each in CNC_OBJECTS if each.compensation == one.name
    ]
    meaning = "value that acts" + (", a current" if one.kind.adds_current else "")
    variable = Observable(
        one.axis, one.name, one.kind.variable, unit="mm, inch", meaning=meaning,
        source="[001] p.96", note=_VARIABLE,
    )  # fmt: skip
    return [*rows, variable]


def _object(each: CncObject, axis: int | None) -> Observable:
    return Observable(
        axis, each.compensation, each.name, each.index_offset(axis or 0), each.type,
        each.size, "read/write" if each.writable else "read", each.unit, each.meaning,
        each.source, each.name if axis is None else f"A{axis}.{each.name}",
        "" if each.size is not None else _OPEN_TYPE,
    )  # fmt: skip


def _external(machine: MachineLists) -> list[Observable]:
    """Return the objects of an external compensation, where an axis has limits for it."""
    axes = [
        number
        for number, listing in sorted(machine.machine.items())
        if any(key.startswith(f"{EXTERNAL_LIMITS}.") for key in listing.columns)
    ]
    own = [each for each in CNC_OBJECTS if each.compensation == "external"]
    shared = [_object(each, None) for each in own if axes and not each.of_axis]
    return shared + [
        _object(each, axis) for axis in axes for each in own if each.of_axis
    ]


def _positions(used: Collection[InUse]) -> list[Observable]:
    """Return the positions that a log needs beside the offsets."""
    seen = sorted({axis for use in used for axis in (use.axis, *use.masters)})
    moved = sorted({use.axis for use in used if not use.kind.adds_current})
    commanded, bus = "commanded position, uncompensated", "position on the drive bus"
    rows = [
        Observable(
            axis, "", f"A{axis}.position", meaning=commanded, note=_NO_ADDRESS,
            channel=f"A{axis}.position",
        )
        for axis in seen
    ]  # fmt: skip
    rows += [
        Observable(
            axis, "", "dig_cmd_pos", meaning=f"{bus}, with all offsets", note=_NO_ADDRESS,
            source="[001] p.19", channel=f"A{axis}.drive_position",
        )
        for axis in moved
    ]  # fmt: skip
    return rows
