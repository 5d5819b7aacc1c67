"""Parquet files: numbers or text, units from the names or the field metadata."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from ._errors import MeasurementError, damaged
from ._header import parse_name, roles_of
from ._table import BadCell, Column, Skipped, Table, first_bad
from ._units import find_unit


def read_parquet(path: Path) -> Table:
    """Return the columns of a Parquet file; `Table.lines` are row numbers.

    Times become seconds since the first row. Columns of other types are listed as
    skipped.

    Raises:
        MeasurementError: If the file is damaged or holds no rows.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table: Any = pq.read_table(path, use_threads=True)
    except pa.ArrowException as error:
        raise damaged(path, "Parquet", error) from error
    return table_of_arrow(path, table)


def table_of_arrow(path: Path, table: Any, row: int = 0) -> Table:
    """Return the columns of an Arrow table: a whole file, or some rows of it.

    Args:
        path: The file.
        table: A `pyarrow.Table`.
        row: Rows of the file before the first one.

    Raises:
        MeasurementError: If there are no rows.
    """
    import pyarrow as pa

    if not table.num_rows or not table.num_columns:
        raise MeasurementError(str(path), "found no rows, expected at least one")
    types = pa.types
    numeric = (types.is_integer, types.is_floating, types.is_decimal, types.is_boolean)
    columns: list[Column] = []
    names = []
    skipped: list[Skipped] = []
    for field in table.schema:
        name = parse_name(field.name)
        stated = (field.metadata or {}).get(b"unit")
        if stated is not None and (unit := find_unit(stated.decode())) is not None:
            name = dataclasses.replace(name, unit=unit.name, doubtful=False)
        cells: Any = table.column(field.name)
        kind: Any = field.type
        if types.is_dictionary(kind):  # categories, as pandas and polars write them
            kind = kind.value_type
            cells = cells.cast(kind)
        if types.is_timestamp(kind) or types.is_duration(kind):
            form = "M" if types.is_timestamp(kind) else "m"
            ticks = cells.to_numpy().astype(f"<{form}8[ns]")
            values = (ticks - ticks[0]) / np.timedelta64(1, "s")
            name = dataclasses.replace(name, unit="s", doubtful=False)
        elif any(test(kind) for test in numeric):
            values = np.asarray(cells.cast(pa.float64()).to_numpy(), dtype=np.float64)
        elif types.is_string(kind) or types.is_large_string(kind):
            text = tuple(cell or "" for cell in cells.to_pylist())
            nothing = np.full(len(text), np.nan)
            names.append(name)
            columns.append(
                Column(name.name, None, None, nothing, text, None, name.header)
            )
            continue
        else:
            reason = f"column '{field.name}' holds {kind}, which is no number"
            skipped.append(Skipped(0, reason))
            continue
        bad = first_bad(values, range(row + 1, row + values.size + 1))
        if bad is not None and cells[bad.line - row - 1].as_py() is None:
            bad = BadCell(bad.line, "")
        names.append(name)
        columns.append(
            Column(
                name.name,
                None,
                name.unit,
                values,
                bad=bad,
                header=name.header,
                doubtful_unit=name.doubtful,
            )
        )
    roles, laser = roles_of(names)
    return Table(
        path=path,
        format="Parquet laser table" if laser else "Parquet",
        columns=tuple(
            dataclasses.replace(column, role=role)
            for column, role in zip(columns, roles, strict=True)
        ),
        rows=table.num_rows,
        lines=np.arange(row + 1, row + table.num_rows + 1, dtype=np.int64),
        skipped=tuple(skipped),
        counts_rows=True,
    )
