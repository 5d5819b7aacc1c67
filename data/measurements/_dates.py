"""Instants that a file gives as date and time: seconds since its first row."""

import datetime
import functools
import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ._table import BadCell, Column, Table

_DATE = re.compile(
    r"(?:(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})"
    r"|(?P<one>\d{1,2})(?P<mark>[-/.])(?P<two>\d{1,2})(?P=mark)(?P<short>\d{4}|\d{2}))"
)
_CLOCK = re.compile(
    r"(?P<hour>\d{1,3}):(?P<minute>\d{2})(?::(?P<second>\d{2})(?P<part>[.,]\d+)?)?"
    r"(?:\s*(?P<half>[ap])\.?m\.?)?(?P<zone>Z|[+-]\d{2}:?\d{2})?",
    re.IGNORECASE,
)
_EXPECTED = "a number of seconds or a date like 2026-11-21 14:30:00"
_UNCLEAR = (
    "a date like 2026-11-21 or 21.11.2026: nothing in this column tells day from month"
)
_SLOW = 0.5
"""Steps of a clock below which they are in s: no controller logs at fractions of a µs."""
_FASTEST = 5.0
"""mm or ° per ms: no axis of a machine tool is faster."""
MOST_SECONDS = 1e11
"""The year 5000, as seconds since 1970: more is no time in s."""
_DAY = 86_400.0
_EPOCH = datetime.date(2020, 1, 1).toordinal()
"""Days are counted from near: the last digits of a second are kept."""


def is_instant(cell: str) -> bool:
    """Whether a cell holds a date, a time of day, or both."""
    date, clock = _parts(cell)
    return date is not None or clock is not None


def may_be_ms(clock: Column, places: Sequence[Column] = ()) -> bool:
    """Whether instants without a unit go on by so much that they may be in ms.

    Args:
        clock: They.
        places: Positions in mm or ° at these instants: none of them may be too fast then.
    """
    steps = np.abs(np.diff(clock.values))
    known = np.isfinite(steps) & (steps > 0.0)
    if not known.any() or float(np.median(steps[known])) < _SLOW:
        return False
    ways = [np.nan_to_num(np.diff(one.values))[known] for one in places]
    return not any(np.any(np.abs(way) > _FASTEST * steps[known]) for way in ways)


def seconds_of_dates(table: Table, column: Column) -> Float[np.ndarray, " t"]:
    """Return the instants of a text column in s since its first row.

    Dates with a time, or times alone, which go on past midnight. Day and month of
    03/04/2026 are told by another row of the column or not at all.

    Raises:
        CellError: Naming the first cell that is none of these.
    """
    assert column.text is not None  # of a number column nobody asks this
    cells = [cell.strip() for cell in column.text]
    order = _day_first(cells)
    seconds: list[float] = []
    kinds: set[tuple[bool, bool]] = set()
    for line, cell in zip(table.lines, cells, strict=True):
        date, clock = _parts(cell)
        instant = None if clock is None else _seconds(date, clock, order)
        kind = (date is None, clock is None or clock["zone"] is None)
        if instant is None or (kinds and kind not in kinds):
            unclear = clock is not None and date is not None and order is None
            expected = _UNCLEAR if unclear else _EXPECTED
            raise table.cell_error(column, BadCell(int(line), cell), expected)
        kinds.add(kind)
        seconds.append(instant)
    elapsed = np.array(seconds) - seconds[0]
    if kinds == {(True, True)}:
        elapsed += _DAY * np.cumsum(np.diff(elapsed, prepend=0.0) < -0.5 * _DAY)
    return elapsed


@functools.lru_cache(maxsize=1024)
def _parts(cell: str) -> tuple[re.Match[str] | None, re.Match[str] | None]:
    """Return date and time of day of a cell, None for what it lacks; two None for neither."""
    date = _DATE.match(cell)
    remainder = cell[date.end() :].lstrip(" T-_,;") if date else cell
    if date and not remainder:
        return date, None
    clock = _CLOCK.fullmatch(remainder)
    return (date, clock) if clock else (None, None)


def _day_first(cells: Sequence[str]) -> bool | None:
    """Return whether the first of two small numbers is the day; None where none tells."""
    for cell in cells:
        date, _ = _parts(cell)
        if date is None or date["one"] is None:
            continue
        if date["mark"] == "." or int(date["one"]) > 12:
            return True
        if int(date["two"]) > 12:
            return False
    return None


def _seconds(
    date: re.Match[str] | None, clock: re.Match[str], day_first: bool | None
) -> float | None:
    """Return seconds since some instant, None where there is no such instant."""
    hour, minute = int(clock["hour"]), int(clock["minute"])
    if clock["half"]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + 12 * (clock["half"].lower() == "p")
    second = int(clock["second"] or 0)
    if minute > 59 or second > 59 or (date is not None and hour > 23):
        return None
    part = float((clock["part"] or ".0").replace(",", "."))
    time = 3600.0 * hour + 60.0 * minute + second + part - _zone(clock["zone"])
    if date is None:
        return time
    if date["year"]:
        year, month, day = (int(date[k]) for k in ("year", "month", "day"))
    elif day_first is None:
        return None
    else:
        year = int(date["short"]) + (2000 if len(date["short"]) == 2 else 0)
        one, two = int(date["one"]), int(date["two"])
        day, month = (one, two) if day_first else (two, one)
    try:
        days = datetime.date(year, month, day).toordinal() - _EPOCH
        return _DAY * days + time
    except ValueError:
        return None


def _zone(text: str | None) -> float:
    if not text or text in "Zz":
        return 0.0
    sign = -1.0 if text[0] == "-" else 1.0
    digits = text[1:].replace(":", "")
    return sign * (3600.0 * int(digits[:2]) + 60.0 * int(digits[2:]))
