"""Tables with one column per run and direction, as one row per reading."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ._errors import MeasurementError
from ._roles import ColumnSpec
from ._table import Column, Table


def unfolded(
    table: Table, mapping: Mapping[str, ColumnSpec]
) -> tuple[Table, dict[str, ColumnSpec]]:
    """Return a table with one reading per row, and where its roles are then.

    The readings of a run follow those of the run before; those of the negative
    direction stand in the reverse order, as they are measured. Empty cells are no
    readings; a remark counts them. Without such a role all is returned as it is.

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
    sides = [part.direction for part in parts]
    for key, stated in (("run", parts[0].run), (direction_key, sides[0])):
        if key in mapping and stated is not None:
            reason = f"found {key} as a column and beside each column of {role}"
            raise MeasurementError(source, f"{reason}, expected one of them")
    columns = [table.column(part.column) for part in parts]
    _refuse_mixed(table, role, parts, columns)
    orders = [_order(table, mapping, role, side) for side in sides]
    filled = [
        order[np.isfinite(column.values[order])] if _has_gaps(column) else order
        for column, order in zip(columns, orders, strict=True)
    ]
    rows = np.concatenate(filled)
    values = np.concatenate(
        [column.values[order] for column, order in zip(columns, filled, strict=True)]
    )
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
            codes = [float(number or 0) for number in numbers]
            sizes = [order.size for order in filled]
            new.append(Column(label, None, None, np.repeat(codes, sizes), header=label))
            result[key] = ColumnSpec(label)
    remaining = [_at_rows(column, rows) for column in table.columns]
    missing = sum(order.size for order in orders) - rows.size
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
    if len({part.sign for part in parts}) > 1:
        reason = f"{role}: found columns of both signs, expected one sign"
        raise MeasurementError(str(table.path), reason)
    if len(units) > 1:
        names = ", ".join(sorted(unit or "none" for unit in units))
        reason = f"{role}: found columns in the units {names}, expected one unit"
        raise MeasurementError(str(table.path), reason)
    for column in columns:
        if column.text is not None:
            table.numbers(column)  # raises: words are no readings


def _order(
    table: Table, mapping: Mapping[str, ColumnSpec], role: str, side: int | None
) -> np.ndarray:
    """Return the rows of a column in the order of measurement."""
    rows = np.arange(table.rows)
    spec = mapping.get(f"{role.partition('.')[0]}.position")
    if spec is None:  # errors across the axis that moves
        places = [s for name, s in mapping.items() if name.endswith(".position")]
        spec = places[0] if len(places) == 1 else None
    if side is None or spec is None or not spec.column:
        return rows
    place = table.column(spec.column).values
    rises = place[-1] >= place[0]
    return rows if rises == (side > 0) else rows[::-1]


def _has_gaps(column: Column) -> bool:
    return column.bad is not None and not column.bad.found.strip()


def _at_rows(column: Column, rows: np.ndarray) -> Column:
    """Return a column at some rows."""
    text = column.text and tuple(column.text[row] for row in rows.tolist())
    return dataclasses.replace(column, values=column.values[rows], text=text)
