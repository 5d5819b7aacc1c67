"""Tables with one column per run and direction, as one row per reading."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ._convert import as_run
from ._errors import MeasurementError
from ._roles import ColumnSpec
from ._table import Column, Table


def unfolded(
    table: Table, mapping: Mapping[str, ColumnSpec]
) -> tuple[Table, dict[str, ColumnSpec]]:
    """Return a table with one reading per row, and where its roles are then.

    The readings of a run follow those of the run before; those of the negative
    direction stand in the reverse order, as they are measured. One run that all columns
    share says nothing beside a column of runs. Empty cells are no readings; a remark
    counts them. Without such a role all is returned as it is.

    Args:
        table: As read.
        mapping: Column per role; those with `ColumnSpec.parts` are unfolded.

    Raises:
        ColumnError: If a column does not exist.
        MeasurementError: If several roles have columns per run, the units of a role's
            columns differ, or run and direction are columns as well.
    """
    wide = {role: spec for role, spec in mapping.items() if spec.parts}
    if not wide:
        return table, dict(mapping)
    source = str(table.path)
    if len(wide) > 1:
        reason = f"found columns per run for {' and '.join(wide)}, expected one role"
        raise MeasurementError(source, reason)
    ((role, spec),) = wide.items()
    direction_key = f"{role.partition('.')[0]}.direction"
    parts = sorted(spec.parts, key=lambda part: part.run or 0)
    if "run" in mapping and len({part.run for part in parts}) == 1:
        parts = [dataclasses.replace(part, run=None) for part in parts]
    sides = [part.direction for part in parts]
    for key, stated in (("run", parts[0].run), (direction_key, sides[0])):
        if key in mapping and stated is not None:
            reason = f"found {key} as a column and beside each column of {role}"
            raise MeasurementError(source, f"{reason}, expected one of them")
    columns = [table.column(part.column) for part in parts]
    _refuse_mixed(table, role, parts, columns)
    pieces = [
        (at, _order(table, mapping, role, sides[at], _filled(columns[at], rows)))
        for rows in _rows_of_runs(table, mapping)
        for at in range(len(parts))
    ]
    rows = np.concatenate([order for _, order in pieces])
    values = np.concatenate([columns[at].values[order] for at, order in pieces])
    name = f"{role} of all runs"
    bad = next((c.bad for c in columns if c.bad and not _has_gaps(c)), None)
    new = [
        dataclasses.replace(columns[0], name=name, header=name, values=values, bad=bad)
    ]
    result = {key: value for key, value in mapping.items() if key != role}
    result[role] = ColumnSpec(name, parts[0].unit, sign=parts[0].sign)
    for key, numbers in (("run", [p.run for p in parts]), (direction_key, sides)):
        if None not in numbers:
            label = f"{key} of the column"
            codes = [float(numbers[at] or 0) for at, _ in pieces]
            sizes = [order.size for _, order in pieces]
            new.append(Column(label, None, None, np.repeat(codes, sizes), header=label))
            result[key] = ColumnSpec(label)
    remaining = [_at_rows(column, rows) for column in table.columns]
    missing = len(parts) * table.rows - rows.size
    remarks = table.remarks
    if missing:
        remarks = (*remarks, f"{missing} empty cells of {role} hold no reading.")
    return dataclasses.replace(
        table,
        columns=(*remaining, *new),
        rows=int(rows.size),
        lines=table.lines[rows],
        remarks=remarks,
    ), result


def _refuse_mixed(
    table: Table, role: str, parts: Sequence[ColumnSpec], columns: Sequence[Column]
) -> None:
    units = {
        part.unit or column.unit for part, column in zip(parts, columns, strict=True)
    }
    if len({part.factor for part in parts}) > 1:
        reason = f"{role}: found columns of both signs, expected one sign"
        raise MeasurementError(str(table.path), reason)
    if len(units) > 1:
        names = ", ".join(sorted(unit or "none" for unit in units))
        reason = f"{role}: found columns in the units {names}, expected one unit"
        raise MeasurementError(str(table.path), reason)
    for column in columns:
        if column.text is not None:
            table.numbers(column)  # raises: words are no readings


def _rows_of_runs(table: Table, mapping: Mapping[str, ColumnSpec]) -> list[np.ndarray]:
    """Return the rows of each run that a column tells, as the runs come; else all."""
    spec = mapping.get("run")
    if spec is None or not spec.column:
        return [np.arange(table.rows)]
    run = as_run(table, table.column(spec.column))
    return [np.flatnonzero(run == each) for each in dict.fromkeys(run.tolist())]


def _filled(column: Column, rows: np.ndarray) -> np.ndarray:
    """Return those of the rows that hold a reading."""
    return rows[np.isfinite(column.values[rows])] if _has_gaps(column) else rows


def _order(
    table: Table,
    mapping: Mapping[str, ColumnSpec],
    role: str,
    side: int | None,
    rows: np.ndarray,
) -> np.ndarray:
    """Return the rows of a column in the order of measurement."""
    spec = mapping.get(f"{role.partition('.')[0]}.position")
    if spec is None:  # errors across the axis that moves
        places = [s for name, s in mapping.items() if name.endswith(".position")]
        spec = places[0] if len(places) == 1 else None
    if side is None or spec is None or not spec.column or not rows.size:
        return rows
    place = table.column(spec.column).values[rows]
    rises = place[-1] >= place[0]
    return rows if rises == (side > 0) else rows[::-1]


def _has_gaps(column: Column) -> bool:
    return column.bad is not None and not column.bad.found.strip()


def _at_rows(column: Column, rows: np.ndarray) -> Column:
    """Return a column at some rows."""
    text = column.text and tuple(column.text[row] for row in rows.tolist())
    return dataclasses.replace(column, values=column.values[rows], text=text)
