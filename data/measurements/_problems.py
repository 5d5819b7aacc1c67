"""What is wrong with the rows of a file: cells that cannot be used, rows that stand twice."""

from collections.abc import Iterator

import numpy as np

from ._convert import as_direction, as_run
from ._dates import seconds_of_dates
from ._errors import CellError
from ._table import BadCell, Column, Table

_FEW = 0.1
"""Share of the rows up to which repeated ones are damage, and not a habit of the file."""
_MANY = 200_000
"""Rows up to which a row is looked for among all others, not only above itself."""


def problems_of(table: Table) -> list[CellError]:
    """Return what is wrong with the rows: at most one error per column and per line.

    A cell of a column of numbers that holds none, of a direction, run or time that is none,
    and a row that stands there twice. An empty cell of a table with one column per run is
    no reading.
    """
    by_line: dict[int, CellError] = {}
    for error in _cell_errors(table):
        by_line.setdefault(error.line, error)
    return list(by_line.values())


def _cell_errors(table: Table) -> Iterator[CellError]:
    for column in table.columns:
        try:
            _use(table, column)
        except CellError as error:
            yield error
    if (repeated := _repeated_row(table)) is not None:
        yield repeated


def _use(table: Table, column: Column) -> None:
    """Convert a column as its role asks for.

    Raises:
        CellError: At the first cell that cannot be used.
    """
    kind = column.kind
    if kind == "direction":
        as_direction(table, column)
    elif kind == "run":
        as_run(table, column)
    elif kind == "time" and column.text is not None:
        seconds_of_dates(table, column)
    elif column.bad is not None and not (column.run and not column.bad.found.strip()):
        raise table.cell_error(column, column.bad, "a finite number", damaged=True)


def _repeated_row(table: Table) -> CellError | None:
    """Return the error that a row is which stands there a second time, or None.

    In a table with time stamps the stamp tells; where many repeat, the clock is coarse,
    and nothing is damaged. In others all its numbers must be the same.
    """
    kinds = {column.kind: column for column in table.columns}
    if any(c.present is not None for c in table.columns if c.role is not None):
        return None
    if "time" in kinds:
        return _late_row(table, kinds["time"], kinds.get("run"))
    wide = any(column.run is not None for column in table.columns)
    if "position" not in kinds or not (wide or {"run", "direction"} & kinds.keys()):
        return None  # that a probe is read twice at a place is no damage
    pair = _row_above(table) or _row_before(table)
    if pair is None:
        return None
    at, earlier = pair
    key = kinds["position"]
    bad = BadCell(int(table.lines[at]), f"{key.values[at]:.10g}")
    expected = f"another reading than in {_place(table, earlier)}, which it repeats"
    return table.cell_error(key, bad, expected, damaged=True)


def _late_row(table: Table, time: Column, run: Column | None) -> CellError | None:
    """Return the error that a row is which is not later than the one above it."""
    try:
        steps = np.diff(seconds_of_dates(table, time) if time.text else time.values)
    except CellError:
        return None  # an error of its own
    if run is not None:  # a clock may start with each run
        steps = np.where(_repeats(run), steps, 1.0)
    rows = np.flatnonzero(steps <= 0.0) + 1
    if not 0 < rows.size <= max(1.0, _FEW * table.rows):
        return None
    at = int(rows[0])
    bad = BadCell(
        int(table.lines[at]), time.text[at] if time.text else f"{time.values[at]:.10g}"
    )
    expected = f"a later time than in {_place(table, at - 1)}"
    return table.cell_error(time, bad, expected, damaged=True)


def _row_above(table: Table) -> tuple[int, int] | None:
    """Return the first row that is the same as the one above it, and that one."""
    equal = np.logical_and.reduce([_repeats(column) for column in table.columns])
    rows = np.flatnonzero(equal) + 1
    if not 0 < rows.size <= max(1.0, _FEW * table.rows):
        return None
    return int(rows[0]), int(rows[0]) - 1


def _row_before(table: Table) -> tuple[int, int] | None:
    """Return the first row that holds place and reading of an earlier one, and that one.

    Where places come back as a rule, some equal readings are chance, and where most rows
    come back, that is how they were made.
    """
    places = [
        column
        for column in table.columns
        if column.kind in ("position", "direction", "run")
    ]
    readings = [c for c in table.columns if c.kind in ("error", "actual")]
    if not readings or not 1 < table.rows <= _MANY:
        return None
    place, whole = _first_rows(places), _first_rows([*places, *readings])
    rows = np.arange(table.rows)
    repeated = np.flatnonzero(whole != rows)
    if not 0.9 * np.count_nonzero(place != rows) <= repeated.size < 0.5 * table.rows:
        return None
    return None if not repeated.size else (int(repeated[0]), int(whole[repeated[0]]))


def _first_rows(columns: list[Column]) -> np.ndarray:
    """Return for each row the first one that has the same cells."""
    codes = [
        np.unique(
            c.values if c.text is None else np.array(c.text), return_inverse=True
        )[1]
        for c in columns
    ]
    _, first, group = np.unique(
        np.column_stack(codes), axis=0, return_index=True, return_inverse=True
    )
    return np.asarray(first[group.reshape(-1)])


def _place(table: Table, row: int) -> str:
    return f"{'row' if table.counts_rows else 'line'} {table.lines[row]}"


def _repeats(column: Column) -> np.ndarray:
    if column.text is not None:
        text = np.array(column.text)
        return np.asarray(text[1:] == text[:-1])
    return np.asarray(np.diff(column.values) == 0.0)
