"""Several files of one measurement as one table on one clock."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ._table import Column, Table

CLOCK = "time"
"""Name of the common clock among the columns of joined files."""


@dataclasses.dataclass(frozen=True)
class TimedTable:
    """A file with the instants of its rows.

    Attributes:
        table: As read.
        time: Of each row on the common clock in s, in ascending order.
    """

    table: Table
    time: Float[np.ndarray, " t"]


def join_tables(parts: Sequence[TimedTable]) -> Table:
    """Return the columns of several files side by side, on the clock of the first.

    There is one row per row of each file, in order of time; a column has samples in
    the rows of its own file only, so that `measurement` brings the channels together as
    it does for channels of several sample times. A name that several files use is
    followed by that of the file; the files' own clocks are left out.
    """
    shares = [name for part in parts for name in _names(part.table)]
    time = np.concatenate([part.time for part in parts])
    order = np.argsort(time, kind="stable")
    lines = np.concatenate([part.table.lines for part in parts])[order]
    columns = [Column(CLOCK, "time", "s", time[order], header=CLOCK)]
    start = 0
    for part in parts:
        own = np.zeros(len(time), dtype=bool)
        own[start : start + part.table.rows] = True
        start += part.table.rows
        for column in part.table.columns:
            if column.role == "time" or column.text is not None:
                continue
            values = np.full(len(time), np.nan)
            values[own] = column.values
            present = own.copy()
            if column.present is not None:
                present[own] = column.present
            name = column.name
            if shares.count(name) > 1 or name == CLOCK:
                name = joined_name(part.table, column)
            columns.append(
                dataclasses.replace(
                    column,
                    name=name,
                    header=name,
                    values=values[order],
                    present=present[order],
                )
            )
    first = parts[0].table
    names = " + ".join(part.table.path.name for part in parts)
    return Table(
        path=first.path.with_name(names),
        format=first.format,
        columns=tuple(columns),
        rows=len(time),
        lines=lines,
        skipped=tuple(each for part in parts for each in part.table.skipped),
        remarks=tuple(each for part in parts for each in part.table.remarks),
    )


def joined_name(table: Table, column: Column) -> str:
    """Return the name of a column that stands in several of the joined files."""
    return f"{column.name} ({table.path.name})"


def _names(table: Table) -> list[str]:
    return [column.name for column in table.columns if column.role != "time"]
