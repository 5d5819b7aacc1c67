"""A measurement file too large for memory, as tables of a few hundred thousand rows each.

Every piece is what `read_table` would say of those rows alone: names, roles, units and lines
are those of the whole file.
"""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ._capture import is_capture
from ._csv import read_body
from ._errors import MeasurementError, damaged
from ._layout import Layout, find_layout
from ._parquet import table_of_arrow
from ._read import special_reader
from ._table import Table
from ._text import decode

_BUFFER = 1 << 20
"""Bytes of each column of a Parquet file that are read at once."""
_LOOK = 1000
"""Rows that show what a file holds."""
_TEXT = 1 << 18
"""Bytes of a text file that show the same."""
_BLOCK = 1 << 25
"""Bytes of a text file that make a piece."""
_LEAST = 1 << 20
"""Bytes below which no file is worth a second look."""


@dataclasses.dataclass(frozen=True)
class LargeFile:
    """A Parquet or CSV file of any length.

    Attributes:
        path: The file.
        head: Its first rows, with all columns.
        rows: Number of rows; of a CSV file as its size and its first lines tell.
    """

    path: Path
    head: Table
    rows: int

    def parts(self, columns: Sequence[str], count: int, rows: int) -> "list[TablePart]":
        """Return the file in parts of about equal length.

        Args:
            columns: Headers of those wanted (`Column.header`).
            count: Parts; a CSV file is one, a Parquet file has no more than row groups.
            rows: Rows of a piece.
        """
        names = tuple(columns)
        if not self.head.counts_rows:
            return [TablePart(self.path, names, rows)]
        import pyarrow.parquet as pq

        with pq.ParquetFile(self.path) as file:
            about = file.metadata
            lengths = [about.row_group(k).num_rows for k in range(about.num_row_groups)]
        starts = np.concatenate([[0], np.cumsum(lengths)])
        ends = np.unique(np.linspace(0, len(lengths), count + 1).astype(int))
        return [
            TablePart(self.path, names, rows, int(begin), int(end), int(starts[begin]))
            for begin, end in itertools.pairwise(ends)
        ]


@dataclasses.dataclass(frozen=True)
class TablePart:
    """Part of a large file.

    Attributes:
        path: The file.
        columns: Headers of the columns wanted.
        rows: Rows of a piece of a Parquet file.
        first: First row group of a Parquet file.
        stop: The one after the last; None: a CSV file, the whole of it.
        start: Row at which it begins.
    """

    path: Path
    columns: tuple[str, ...]
    rows: int
    first: int = 0
    stop: int | None = None
    start: int = 0

    def tables(self) -> Iterator[Table]:
        """Yield the rows piece by piece, each as a table.

        Raises:
            MeasurementError: If the file is damaged or a line has not as many cells as the
                others.
        """
        return _text_tables(self) if self.stop is None else _arrow_tables(self)


def open_large(path: Path, least: int | None = None) -> LargeFile | None:
    """Return a file that can be read in pieces; None where it is small, or of another kind.

    Args:
        path: The file.
        least: Bytes below which it is small; left out: a million.

    Raises:
        OSError: If it cannot be read.
        MeasurementError: If it is damaged.
    """
    size = path.stat().st_size
    if size < (_LEAST if least is None else least):
        return None
    with path.open("rb") as file:
        start = file.read(_TEXT)
    if start.startswith(b"PAR1"):
        return _open_parquet(path)
    return _open_text(path, start, size)


def _open_parquet(path: Path) -> LargeFile:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path, pre_buffer=False, buffer_size=_BUFFER) as file:
            rows = file.metadata.num_rows
            first: Any = next(file.iter_batches(_LOOK))
    except (pa.ArrowException, StopIteration) as error:
        raise damaged(path, "Parquet", error) from error
    return LargeFile(path, table_of_arrow(path, pa.Table.from_batches([first])), rows)


def _open_text(path: Path, start: bytes, size: int) -> LargeFile | None:
    end = start.rfind(b"\n")
    # Packed, UTF-16 or without line ends: not to be cut into pieces.
    if end < 0 or start[:2] in (b"\x1f\x8b", b"\xff\xfe", b"\xfe\xff"):
        return None
    try:
        decoded = decode(start[: end + 1], path)
        if is_capture(start) or special_reader(decoded):
            return None
        text = decoded.text
        layout = find_layout(path, text)
        head = read_body(path, layout, text)
    except MeasurementError:
        return None  # whoever reads the whole of it says what is wrong
    if any(column.run is not None for column in head.columns):
        return None  # its columns become rows
    body = len(text[layout.body :].encode())
    return LargeFile(path, head, int(head.rows * (size - end + body) / max(body, 1)))


def _arrow_tables(part: TablePart) -> Iterator[Table]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    row, names = part.start, list(part.columns)
    assert part.stop is not None  # a CSV file has none
    try:
        with pq.ParquetFile(part.path, pre_buffer=False, buffer_size=_BUFFER) as file:
            groups = list(range(part.first, part.stop))
            for batch in file.iter_batches(part.rows, groups, columns=names):
                table = pa.Table.from_batches([batch]).select(names)
                yield table_of_arrow(part.path, table, row)
                row += batch.num_rows
    except pa.ArrowException as error:
        raise damaged(part.path, "Parquet", error) from error


def _text_tables(part: TablePart) -> Iterator[Table]:
    layout: Layout | None = None
    line = 1
    with part.path.open("rb") as file:
        for block in _whole_lines(file):
            text = decode(block, part.path).text
            current = layout
            if current is None:
                layout = current = find_layout(part.path, text)
            else:
                current = dataclasses.replace(
                    current, body=0, body_line=line, skipped=()
                )
            line += text.count("\n")
            if text[current.body :].strip():
                yield read_body(part.path, current, text)


def _whole_lines(file: Any) -> Iterator[bytes]:
    """Yield blocks of a file that end with a line."""
    remainder = b""
    while block := file.read(_BLOCK):
        remainder += block
        end = remainder.rfind(b"\n") + 1
        if end:
            yield remainder[:end]
            remainder = remainder[end:]
    if remainder:
        yield remainder
