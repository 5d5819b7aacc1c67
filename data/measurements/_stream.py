"""Large logs in pieces: constant memory, however long the file is."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ._errors import MeasurementError

ROWS = 1 << 20
"""Rows of a piece."""
_BYTES = 1 << 25
"""Of a CSV file that are read at once."""
BUFFER = 1 << 20
"""Bytes of each column of a Parquet file that are read at once."""
_LEAST, _MOST = 1 << 16, 1 << 21
"""Rows of the row groups that are read one by one, which is faster; smaller ones go together,
larger ones must not lie in memory whole."""


@dataclasses.dataclass(frozen=True)
class LogPart:
    """Part of a log that can be read on its own, here or on another machine.

    Attributes:
        path: Parquet or CSV file with a header.
        columns: Names of the columns wanted.
        first: First row group of a Parquet file.
        stop: The one after the last; None for all.
    """

    path: Path
    columns: tuple[str, ...]
    first: int = 0
    stop: int | None = None

    def pieces(self, rows: int = ROWS) -> Iterator[Float[np.ndarray, "t c"]]:
        """Yield the columns as numbers, some rows at a time, in the order of the file.

        Raises:
            MeasurementError: If a column is missing, or a cell holds no finite number; names
                the row of the part.
        """
        for columns in self.columns_of(rows):
            yield np.stack(columns, axis=1)

    def columns_of(
        self, rows: int = ROWS, *, threads: bool = True, checked: bool = True
    ) -> Iterator[list[Float[np.ndarray, " t"]]]:
        """Yield the same, column by column, without a copy where the file allows it.

        Args:
            rows: Of a piece at most.
            threads: Read columns side by side; not where parts are.
            checked: Refuse cells that hold no finite number; else they come as they are,
                missing ones as NaN.

        Raises:
            MeasurementError: As `pieces`.
        """
        row = 0
        for batch in self._batches(rows, threads):
            found = [
                self._numbers(batch.column(k), name)
                for k, name in enumerate(self.columns)
            ]
            # Summing up finds any bad cell; looking for it is for when there is one.
            if checked and not all(np.isfinite(column.sum()) for column in found):
                self._refuse_gaps(np.stack(found, axis=1), row)
            row += batch.num_rows
            yield found

    def _batches(self, rows: int, threads: bool) -> Iterator[Any]:
        import pyarrow as pa
        import pyarrow.csv as pv
        import pyarrow.parquet as pq

        names = list(self.columns)
        try:
            if self.path.suffix.lower() == ".csv":
                reader = pv.open_csv(
                    self.path,
                    read_options=pv.ReadOptions(block_size=_BYTES),
                    convert_options=pv.ConvertOptions(
                        include_columns=names,
                        column_types=dict.fromkeys(names, pa.float64()),
                    ),
                )
                with reader:
                    for batch in reader:
                        for start in range(0, batch.num_rows, rows):
                            yield batch.slice(start, rows)
                return
            # Else the bytes of every row group stay in memory until the last one is read.
            with pq.ParquetFile(
                self.path, pre_buffer=False, buffer_size=BUFFER
            ) as file:
                self._refuse_missing(file.schema_arrow.names)
                groups = list(range(self.first, _stop(file, self.stop)))
                about = file.metadata
                sizes = [about.row_group(k).num_rows for k in groups]
                how: Any = {"columns": names, "use_threads": threads}
                if not all(_LEAST <= size <= _MOST for size in sizes):
                    for batch in file.iter_batches(rows, groups, **how):
                        yield batch.select(names)
                    return
                for group in groups:
                    table = file.read_row_group(group, **how).select(names)
                    yield from table.to_batches(max_chunksize=rows)
        except (pa.ArrowInvalid, pa.ArrowKeyError) as error:
            raise MeasurementError(str(self.path), str(error).splitlines()[0]) from None

    def _refuse_missing(self, found: Sequence[str]) -> None:
        for name in self.columns:
            if name not in found:
                reason = f"found the columns {', '.join(found)}, expected {name!r}"
                raise MeasurementError(str(self.path), reason)

    def _numbers(self, cells: Any, name: str) -> Float[np.ndarray, " t"]:
        import pyarrow as pa

        try:
            values = cells.cast(pa.float64()) if cells.type != pa.float64() else cells
        except pa.ArrowInvalid as error:
            reason = f"{name}: {str(error).splitlines()[0]}, expected numbers"
            raise MeasurementError(str(self.path), reason) from None
        # A missing cell becomes NaN, which is refused with its row.
        return np.asarray(values.to_numpy(zero_copy_only=False), dtype=np.float64)

    def _refuse_gaps(self, found: Float[np.ndarray, "t c"], row: int) -> None:
        bad = np.argwhere(~np.isfinite(found))
        if not len(bad):
            return
        at, column = (int(place) for place in bad[0])
        reason = (
            f"row {row + at + 1}, {self.columns[column]}: found {found[at, column]:g},"
            " expected a finite number"
        )
        raise MeasurementError(str(self.path), reason)


def log_parts(
    path: Path, columns: Sequence[str], count: int = 1
) -> tuple[LogPart, ...]:
    """Return a log as parts of about equal length.

    A CSV file is one part; a Parquet file has no more of them than row groups.

    Raises:
        OSError: If the file cannot be read.
    """
    names = tuple(columns)
    if count <= 1 or path.suffix.lower() == ".csv":
        return (LogPart(path, names),)
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        groups = file.num_row_groups
    ends = np.unique(np.linspace(0, groups, min(count, groups) + 1).astype(int))
    return tuple(
        LogPart(path, names, int(first), int(stop))
        for first, stop in itertools.pairwise(ends)
    )


def _stop(file: Any, stop: int | None) -> int:
    groups: int = file.num_row_groups
    return groups if stop is None else min(stop, groups)
