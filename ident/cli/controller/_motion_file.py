"""A motion, in columns called like roles after axis numbers, and what happens meanwhile."""

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...exchange import ControllerEvent, Motion

_RELOAD = "RELOAD "
_SLACK = 1e-9
"""s: times are written in decimals."""
_LONGEST_HEAD = 65_536
"""Characters; a motion may be no text at all."""


def read_motion(file: Path) -> "Motion":
    """Return the motion of a file, in mm, °, s and °C.

    Raises:
        MeasurementError: If an axis is no number, there is no position, or times do not
            ascend.
        OSError: If it cannot be read.
    """
    import numpy as np

    from ....data.measurements import MeasurementError, measurement, read_table
    from ...exchange import Motion

    def number(axis: str) -> int:
        found = axis.removeprefix("A")
        if not found.isdigit():
            reason = (
                f"found axis {axis!r}, expected A1, A2, … after the logical numbers"
            )
            raise MeasurementError(str(file), reason)
        return int(found)

    measured = measurement(read_table(file))
    motion = Motion.of(measured, number)
    if not motion.positions:
        reason = "found no position, expected a column such as A1.position"
        raise MeasurementError(str(file), reason)
    time = motion.time
    if time is not None and np.any(np.diff(time) <= 0):
        at = int(np.argmax(np.diff(time) <= 0))
        reason = (
            f"line {measured.lines[at + 1]}: found time {time[at + 1]:g} after"
            f" {time[at]:g}, expected ascending times"
        )
        raise MeasurementError(str(file), reason)
    return motion


def read_events(
    file: Path, motion: "Motion", is_motion: bool
) -> "tuple[ControllerEvent, ...] | None":
    """Return the events of a file in the order of their rows.

    An event acts from the first row at its time or after. Several stand in one cell with
    ``;`` between. A list that is loaded again is looked for beside the file.

    Args:
        file: Columns ``time`` in s, ``axis`` (``A3`` or 3; empty or missing: all axes)
            and ``event``.
        motion: Where the rows are.
        is_motion: The file is the motion itself; without a column ``event`` it has none.

    Returns:
        The events; None where the motion has no such column.

    Raises:
        MeasurementError: If a column is missing, or a time or an axis cannot be read.
        ExchangeError: If an event is none.
        OSError: If a file cannot be read.
    """
    from ....data.measurements import LineError, MeasurementError

    if is_motion and not _has_events(file):
        return None
    rows, columns = _rows(file)
    missing = [name for name in ("time", "event") if name not in columns]
    if missing:
        reason = f"found columns {', '.join(columns)}, expected {' and '.join(missing)}"
        raise MeasurementError(str(file), reason)
    if motion.time is None:
        return ()  # refused with the reason where they are used
    found: list[ControllerEvent] = []
    for line, cells in rows:
        texts = [text.strip() for text in (cells["event"] or "").split(";")]
        if not any(texts):
            continue
        time = _number(cells["time"])
        if time is None:
            raise LineError(str(file), line, f"time {cells['time']!r}", "a time in s")
        row = int(sum(motion.time < time - _SLACK))
        axis = _axis(file, line, cells.get("axis") or "")
        found += [_event(file, line, row, axis, text) for text in texts if text]
    return tuple(sorted(found, key=lambda event: event.row))


def _heads(line: str) -> tuple[list[str], str]:
    """Return the columns that a first line names, and what stands between them."""
    mark = next((mark for mark in ";\t" if mark in line), ",")
    cells = line.rstrip().split(mark)
    return [cell.strip(' "').removesuffix("[s]").strip() for cell in cells], mark


def _has_events(file: Path) -> bool:
    """Return whether the first line of a motion file names a column of events."""
    with file.open(encoding="utf-8-sig", errors="replace") as lines:
        return "event" in _heads(lines.readline(_LONGEST_HEAD))[0]


def _rows(file: Path) -> tuple[Iterator[tuple[int, Mapping[str, str]]], list[str]]:
    """Return line number and cells of each row, and the columns."""
    head, *lines = file.read_text(encoding="utf-8-sig").splitlines() or [""]
    columns, mark = _heads(head)
    reader = csv.DictReader(lines, columns, delimiter=mark)
    return ((reader.line_num + 1, cells) for cells in reader), columns


def _number(text: str) -> float | None:
    try:
        return float(text.replace(",", "."))
    except (ValueError, AttributeError):
        return None


def _axis(file: Path, line: int, text: str) -> int | None:
    from ....data.measurements import LineError

    plain = text.strip().removeprefix("A")
    if not plain:
        return None
    if not plain.isdigit():
        expected = "A1, A2, … after the logical numbers, or nothing for all axes"
        raise LineError(str(file), line, f"axis {text!r}", expected)
    return int(plain)


def _event(
    file: Path, line: int, row: int, axis: int | None, text: str
) -> "ControllerEvent":
    from ....data.lists import ListFile
    from ...exchange import ControllerEvent, parse_action

    where = f"{file}:{line}"
    if text.upper().startswith(_RELOAD):
        listing = ListFile.read(file.parent / text[len(_RELOAD) :].strip())
        return ControllerEvent(row, "reload", axis, listing=listing, where=where)
    action, names = parse_action(text, where)
    return ControllerEvent(row, action, axis, names, where=where)
