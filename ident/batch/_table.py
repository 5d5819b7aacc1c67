"""``results.parquet``: all rows of a batch, and questions to it."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...data.files import write_atomically
from ._folder import BatchError
from ._rows import VERSION, Row, arrow_schema, as_date

NAME = "results.parquet"


def write_results(folder: Path, rows: Sequence[Row]) -> None:
    """Write the table of a batch, whole or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    dated = [row | {"measured_at": as_date(row.get("measured_at"))} for row in rows]
    table = pa.Table.from_pylist(dated, schema=arrow_schema())
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    write_atomically(folder / NAME, buffer.getvalue())


def read_results(folder: Path) -> Any:
    """Return the table of a batch as a pyarrow table.

    Raises:
        BatchError: If there is none, or one of a later version.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = folder / NAME if folder.is_dir() else folder
    try:
        table = pq.read_table(path)
    except FileNotFoundError:
        reason = "found no such file, expected the folder of a finished batch"
        raise BatchError(str(path), reason) from None
    except pa.ArrowException as error:
        reason = f"found no table of results: {str(error).splitlines()[0]}"
        raise BatchError(str(path), reason) from None
    version = int((table.schema.metadata or {}).get(b"axcomp.schema", b"0"))
    if not 1 <= version <= VERSION:
        reason = f"found version {version} of the table, expected 1 to {VERSION}"
        raise BatchError(str(path), reason)
    # A table that was written before there was some column has it, too.
    every = [table, arrow_schema().empty_table()]
    return pa.concat_tables(every, promote_options="default")


def query_results(
    folder: str | Path,
    where: str | None = None,
    select: str = "*",
    order: str | None = None,
    limit: int | None = None,
) -> Any:
    """Return rows of the table of a batch that DuckDB finds, as a pyarrow table.

    Args:
        folder: Of the batch.
        where: SQL condition over the columns (`COLUMNS`), None for all rows.
        select: SQL list of columns or expressions.
        order: SQL list to sort by.
        limit: Rows at most.

    Raises:
        BatchError: If the question cannot be answered, with DuckDB's reason, which names
            the nearest columns.
    """
    import duckdb

    table = read_results(Path(folder))
    names = [name.strip() for name in select.split(",")]
    if set(names) <= set(table.column_names):  # one of them, table, is a word of SQL
        select = ", ".join(f'"{name}"' for name in names)
    text = f"SELECT {select} FROM results"
    text += f" WHERE {where}" if where else ""
    text += f" ORDER BY {order}" if order else ""
    text += f" LIMIT {int(limit)}" if limit is not None else ""
    with duckdb.connect() as connection:
        connection.register("results", table)
        # A question reads the table, and nothing else of this machine.
        connection.execute("SET enable_external_access = false")
        try:
            return connection.sql(text).to_arrow_table()
        except duckdb.Error as error:
            reason = " ".join(str(error).partition("\nLINE ")[0].split())
            raise BatchError(text, reason) from None
