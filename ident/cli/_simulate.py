"""The command ``simulate``: what the controller would add along a motion."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ._console import note, print_json, working
from ._options import (
    AsJson,
    CycleTime,
    Increment,
    Lists,
    Modulo,
    Rules,
    axis_ranges,
    by_axis,
    read_lists,
    refuse_target,
    rules_of,
)

if TYPE_CHECKING:
    import numpy as np

    from ...data.lists import ListFile
    from ...data.measurements import Column, Table
    from ...models import Conventions, TemperatureLine
    from ..exchange import AxisOffsets, ControllerEvent, Motion, StoredConventions

_RELOAD = "RELOAD "
_SENSOR = r"[A-Za-z_][\w-]*"
_WARMED = rf"(?P<file>.+?)(?::(?P<sensors>{_SENSOR}(?:,{_SENSOR})?))?"
"""What stands behind ``A1=``: a temperature table, and one sensor of it, or two."""
_SLACK = 1e-9
"""s: times are written in decimals."""


def simulate(
    files: Lists,
    *,
    motion: Path,
    out: Path | None = None,
    increment: Increment = None,
    conventions: Rules = None,
    cycle_time: CycleTime = None,
    modulo: Modulo = None,
    temperature: list[str] | None = None,
    events: Path | None = None,
    force: bool = False,
    as_json: AsJson = False,
) -> None:
    """Compute what the controller would add, per row of a motion and compensation.

    Without an axis list everything in a list is active, from the first row on. With
    events, what waits for COMP ON waits for it, and an axis that an event homes was not
    homed before.

    Columns: time, then per axis each compensation and their sum: A3.cross … A3.offset,
    and A3.friction in drive units.

    Options:
        motion (M.csv): Columns A1.position, A2.position, … in mm or °, named after the logical
            axis numbers; time in s where the rows are cycles; A1.direction (±1) where they are
            not.
        out (O.csv): Where to write the offsets (.csv or .parquet); left out: as CSV on standard
            output.
        temperature (A1=T.csv): Temperature table of an axis as the PLC follows it
            (temperature_X.csv of a job), for the column temperature.<sensor> of the motion;
            A1=T.csv:frame where there are several sensors; A1=T.csv:frame,scale where the offset
            follows the first and the coefficient the second (left out: as the table says).
        events (E.csv): What happens meanwhile: columns time, axis (empty: all) and event, which
            is COMP ON CROSS, COMP OFF LEAD TEMP, COMP OFF_ALL, HOMED, NOT HOMED, PROGRAM END or
            RELOAD FILE.lis. Left out: the column event of the motion, if it has one.
        force: Replace a file that exists.

    Examples:
      axcomp simulate axcomp-out/achskw1.lis --motion motion.csv --out offsets.csv
    """
    from ...data.measurements import Lines, read_table
    from ..exchange import Reading, simulate as follow
    from ..job import use_compilation_cache, write_atomically

    ranges = axis_ranges(modulo, "--modulo")
    warmed = by_axis(temperature, "--temperature", _WARMED, "its file as in A1=T.csv")
    of_plc = [Path(match["file"]) for match in warmed.values()]
    read = [*files, motion, *of_plc, *([] if events is None else [events])]
    if out is not None:
        refuse_target(out, "--out", read, force=force)
    use_compilation_cache()
    rules = rules_of(conventions)
    lists = read_lists(files)
    with working("reading the motion") as step:
        table = read_table(motion)
        path, happened = _motion_in(table, ranges), None
        if events is not None:
            first = Lines.of(0, 1, None)  # whatever stands below it
            happened = _events_in(read_table(events, lines=first), path)
        elif any(column.name == "event" for column in table.columns):
            happened = _events_in(table, path)
        step("following the controller")
        lines = _lines(warmed, lists, path, rules.conventions)
        reading = Reading(rules.conventions, increment, ranges, lines)
        offsets = follow(lists, path, reading, cycle_time=cycle_time, events=happened)
    columns = _columns(path, offsets)
    note(dict.fromkeys(text for axis in offsets for text in axis.remarks))
    if out is not None:
        parquet = out.suffix.lower() == ".parquet"
        write_atomically(out, _content(columns, parquet=parquet))
    summary = _summary(columns, offsets, rules)
    if as_json:
        print_json(summary)
    elif out is None:
        typer.echo(_content(columns).decode("ascii"), nl=False)
    else:
        typer.echo(f"{summary['rows']} rows, {', '.join(columns)} in {out}", err=True)


def _lines(
    tables: "Mapping[int, re.Match[str]]",
    lists: "Sequence[ListFile]",
    motion: "Motion",
    conventions: "Conventions",
) -> "dict[int, TemperatureLine]":
    """Return the temperature lines that a PLC would follow, of their tables, by axis."""
    from ..exchange import machine_lists
    from ..kinds.temperature.entries import read_temperature_table

    machines = machine_lists(lists).machine if tables else {}
    lines, sensors = {}, list(motion.temperatures)
    for axis, match in tables.items():
        path, machine = Path(match["file"]), machines.get(axis)
        followed = match["sensors"].split(",") if match["sensors"] else ()
        lines[axis] = read_temperature_table(
            path, sensors, followed, conventions, machine
        )
    return lines


def _columns(
    motion: "Motion", offsets: "tuple[AxisOffsets, ...]"
) -> "dict[str, np.ndarray]":
    import numpy as np

    columns: dict[str, np.ndarray] = {}
    if motion.time is not None:
        columns["time"] = motion.time
    for axis in offsets:
        parts = {**axis.parts, "offset": axis.total}
        if axis.current is not None:
            parts["friction"] = axis.current
        for name, values in parts.items():
            # 1 pm: what stands behind it is the noise of floating point.
            columns[f"A{axis.axis}.{name}"] = np.round(values, 9)
    return columns


def _summary(
    columns: "dict[str, np.ndarray]",
    offsets: "tuple[AxisOffsets, ...]",
    rules: "StoredConventions",
) -> dict[str, object]:
    import numpy as np

    return {
        "columns": list(columns),
        "rows": len(next(iter(columns.values()))) if columns else 0,
        "largest": {
            name: float(np.max(np.abs(values), initial=0.0))
            for name, values in columns.items()
            if name != "time"
        },
        "conventions": {
            rule.name: {
                "value": rule.value,
                "state": "verified" if rule.name in rules.verified else "assumed",
            }
            for rule in rules.conventions.listing()
        },
        "remarks": [text for axis in offsets for text in axis.remarks],
    }


def _content(columns: "dict[str, np.ndarray]", *, parquet: bool = False) -> bytes:
    """Return columns as a file: Parquet, else CSV."""
    import io

    import pyarrow as pa
    from pyarrow import csv, parquet as pq

    table, sink = pa.table(columns), io.BytesIO()
    if parquet:
        pq.write_table(table, sink)
    else:
        sink.write((",".join(columns) + "\n").encode("ascii"))
        csv.write_csv(table, sink, csv.WriteOptions(include_header=False))
    return sink.getvalue()


def _motion_in(table: "Table", ranges: "Mapping[int, tuple[float, float]]") -> "Motion":
    """Return the motion of a file, in mm, °, s and °C; columns are roles of axis numbers.

    Refuses an axis that is no number, and a file without a position.
    """
    from ...data.measurements import MeasurementError, measurement
    from ..exchange import Motion

    def number(axis: str) -> int:
        digits = axis.removeprefix("A")
        if not digits.isdigit():
            words = f"found axis {axis!r}, expected A1, A2, … after the logical numbers"
            raise MeasurementError(str(table.path), words)
        return int(digits)

    turns = {f"A{axis}": high - low for axis, (low, high) in ranges.items()}
    measured = measurement(table, turns=turns)
    motion = Motion.of(measured, number)
    if not motion.positions:
        reason = "found no position, expected a column such as A1.position"
        raise MeasurementError(str(table.path), reason)
    return motion


def _events_in(table: "Table", motion: "Motion") -> "tuple[ControllerEvent, ...]":
    """Return the events of a file in the order of their rows.

    Its columns are ``time`` in s, ``axis`` (``A3`` or 3; empty or missing: all axes) and
    ``event``. An event acts from the first row at its time or after. Several stand in one
    cell with ``;`` between. A list that is loaded again is looked for beside the file.
    """
    from ...data.measurements import LineError, MeasurementError

    columns = {column.name: column for column in table.columns}
    if missing := [name for name in ("time", "event") if name not in columns]:
        reason = f"found columns {', '.join(columns)}, expected {' and '.join(missing)}"
        raise MeasurementError(str(table.path), reason)
    if motion.time is None:
        return ()  # refused with the reason where they are used
    found: list[ControllerEvent] = []
    times = table.numbers(columns["time"])
    for k, cell in enumerate(columns["event"].text or ()):
        texts = [text.strip() for text in cell.split(";") if text.strip()]
        if not texts:
            continue
        line, row = int(table.lines[k]), int(sum(motion.time < times[k] - _SLACK))
        axis = _text(columns.get("axis"), k).strip().removeprefix("A")
        if axis and not axis.isdigit():
            expected = "A1, A2, … after the logical numbers, or nothing for all axes"
            raise LineError(str(table.path), line, f"axis {axis!r}", expected)
        number = int(axis) if axis else None
        if row == len(motion.time):
            words = f"the event at {times[k]:g} s does not act: the motion ends at"
            note([f"{table.path}:{line}: {words} {motion.time[-1]:g} s"])
        found += [_event(table.path, line, row, number, text) for text in texts]
    return tuple(sorted(found, key=lambda event: event.row))


def _text(column: "Column | None", row: int) -> str:
    """Return a cell as text; empty where there is no column or no number."""
    cell = None if column is None else column.cell(row)
    return cell or "" if isinstance(cell, str | None) else f"{cell:.15g}"


def _event(
    file: Path, line: int, row: int, axis: int | None, text: str
) -> "ControllerEvent":
    from ...data.lists import ListFile
    from ...data.measurements import LineError
    from ..exchange import ControllerEvent, parse_action

    where = f"{file}:{line}"
    if text.upper().startswith(_RELOAD):
        listing = ListFile.read(file.parent / text[len(_RELOAD) :].strip())
        number = listing.integer("kopf.achs_nr")
        if axis is not None and number not in (None, axis):
            found, expected = f"a list of axis {number}", f"one of axis {axis}"
            raise LineError(str(file), line, f"{text!r}, {found}", expected)
        return ControllerEvent(row, "reload", axis, listing=listing, where=where)
    action, names = parse_action(text, where)
    return ControllerEvent(row, action, axis, names, where=where)
