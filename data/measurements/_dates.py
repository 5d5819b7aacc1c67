"""Instants that a file gives as date and time: seconds since its first row."""

import datetime

import numpy as np
from jaxtyping import Float

from ._table import BadCell, Column, Table

_PATTERNS = (
    "%Y/%m/%d-%H:%M:%S",
    "%Y/%m/%d %H:%M:%S",
    "%d.%m.%Y %H:%M:%S",
    "%Y/%m/%d-%H:%M:%S.%f",
    "%Y/%m/%d %H:%M:%S.%f",
    "%d.%m.%Y %H:%M:%S.%f",
)
"""Beside ISO 8601. Days and months are never guessed: 03/04/2026 is neither."""


def seconds_of_dates(table: Table, column: Column) -> Float[np.ndarray, " t"]:
    """Return the instants of a text column in s since its first row.

    Raises:
        CellError: Naming the first cell that is no date with a time.
    """
    assert column.text is not None  # of a number column nobody asks this
    instants: list[datetime.datetime] = []
    for line, cell in zip(table.lines, column.text, strict=True):
        instant = _instant(cell.strip())
        zoned = instants[0].tzinfo is not None if instants else None
        if instant is None or (
            zoned is not None and zoned != (instant.tzinfo is not None)
        ):
            bad = BadCell(int(line), cell)
            raise table.cell_error(
                column, bad, "a number of seconds or a date like 2026-11-21 14:30:00"
            )
        instants.append(instant)
    first = instants[0]
    return np.array([(instant - first).total_seconds() for instant in instants])


def _instant(cell: str) -> datetime.datetime | None:
    for pattern in _PATTERNS:
        try:
            return datetime.datetime.strptime(cell, pattern)
        except ValueError:
            continue
    try:
        return datetime.datetime.fromisoformat(cell)
    except ValueError:
        return None
