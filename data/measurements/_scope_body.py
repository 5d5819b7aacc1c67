"""Samples of a TwinCAT Scope text export: groups of columns, each with its own times.

Groups may end early, either with blank cells or with shorter lines. The bulk goes
through pyarrow, one piece per number of cells; where that stumbles, the line and the
column that are wrong are looked for.
"""

import io
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from ._errors import CellError, LineError, MeasurementError
from ._scope_group import GroupSamples, Piece, join_group
from ._scope_header import Header

_BLANK = ["", " "]
_NUMBER = {
    ".": re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(?:\d+,?\d*|,\d+)(?:[eE][+-]?\d+)?"),
}
_NO_NUMBER = re.compile(r"[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
_STEP = 50_000
"""Lines looked at together when a wrong cell is searched."""
_SMALL = 1 << 20
"""Bytes up to which one thread reads a file."""
_TICK_DIGITS = 16
"""Digits from which on a time is one of 100 ns since 1601 and not one in ms."""


def read_body(path: Path, header: Header, text: str) -> list[GroupSamples]:
    """Return the samples below the header, group by group.

    Raises:
        CellError: If a cell is no number.
        LineError: If a line has a wrong number of cells, a time runs back, or the file
            ends early.
        MeasurementError: If a group has no samples.
    """
    body = _Body(path, header, text)
    keys = [
        name
        for at, group in enumerate(header.groups, start=1)
        for name in (f"time of group {at}", *(channel.name for channel in group))
    ]
    parts = [body.piece(rows, keys) for rows in body.pieces()]
    groups = []
    first = 0
    for group in header.groups:
        width = 1 + len(group)
        members = [part for part in parts if len(part.values) >= first + width]
        if not members:
            reason = f"found no samples of '{group[0].name}', expected some"
            raise MeasurementError(str(path), reason)
        columns = range(first, first + width)
        start = header.start if body.ticks else None
        groups.append(join_group(path, members, keys, columns, start))
        first += width
    body.complain_of_cut(groups)
    return groups


class _Body:
    """The lines below the header, counted and measured."""

    def __init__(self, path: Path, header: Header, text: str) -> None:
        self.path, self.header = path, header
        self.raw = text.split("\n", header.body_line - 1)[-1].encode()
        raw = np.frombuffer(self.raw, np.uint8)
        ends = np.flatnonzero(raw == 10)
        self.closed = bool(self.raw.endswith(b"\n"))
        self.ends = ends if self.closed else np.append(ends, raw.size)
        self.starts = np.concatenate([[0], self.ends[:-1] + 1])
        marks = np.flatnonzero(raw == ord(header.separator))
        self.widths = 1 + (
            np.searchsorted(marks, self.ends) - np.searchsorted(marks, self.starts)
        )
        self.decimal = self._decimal()
        self.rows = np.flatnonzero(self.ends > self.starts)
        while self.rows.size and not self.line(self.rows[-1]).strip():
            self.rows = self.rows[:-1]
        self.has_end_mark = False
        last = self.line(self.rows[-1]).strip() if self.rows.size else ""
        if last.strip(header.separator) == "EOF":
            self.has_end_mark = True
            self.rows = self.rows[:-1]
        self.ticks = self.rows.size > 0 and bool(
            re.match(rf"\d{{{_TICK_DIGITS},19}}\D", self.line(self.rows[0]) + "\n")
        )

    def line(self, row: int | np.int64) -> str:
        return self.raw[self.starts[row] : self.ends[row]].decode()

    def number(self, row: int | np.int64) -> int:
        """Return the line of the file."""
        return int(row) + self.header.body_line

    def _decimal(self) -> str:
        """Return the decimal mark, by what stands between digits in the first lines."""
        if self.header.separator == ",":
            return "."
        head = self.raw[:100_000].decode(errors="replace")
        commas = len(re.findall(r"\d,\d", head))
        return "," if commas > len(re.findall(r"\d\.\d", head)) else "."

    def pieces(self) -> Iterator[Int[np.ndarray, " _"]]:
        """Yield runs of lines that hold the same groups, checked for their width."""
        allowed = np.array(self.header.widths)
        widths = self.widths[self.rows]
        # Older versions end each line with a separator.
        trailing = np.isin(widths - 1, allowed) & ~np.isin(widths, allowed)
        for row in self.rows[trailing]:
            if not self.line(row).rstrip("\r ").endswith(self.header.separator):
                trailing[np.searchsorted(self.rows, row)] = False
                break
        widths = widths - trailing
        invalid = np.flatnonzero(~np.isin(widths, allowed))
        grown = 1 + np.flatnonzero(np.diff(widths) > 0)
        if grown.size and not (invalid.size and invalid[0] <= grown[0]):
            at = int(grown[0])
            found = f"{widths[at]} cells below a line with {widths[at - 1]}"
            expected = "no more than there: a group that has ended does not go on"
            raise LineError(str(self.path), self.number(self.rows[at]), found, expected)
        if invalid.size:
            self._refuse_width(int(self.rows[invalid[0]]), int(widths[invalid[0]]))
        if not widths.size:
            reason = "found a header and no samples, expected lines of numbers"
            raise MeasurementError(str(self.path), reason)
        cuts = np.flatnonzero(np.diff(widths) | np.diff(trailing.astype(np.int8))) + 1
        yield from np.split(self.rows, cuts)

    def _refuse_width(self, row: int, width: int) -> None:
        choices = [str(width) for width in self.header.widths[::-1]]
        counts = " or ".join(choices) if len(choices) < 5 else choices[0]
        expected = f"{counts} with {self.header.between} between"
        if row == self.ends.size - 1 and not self.closed:
            expected += "; the file is cut off here"
        found = f"{width} cell{'s' if width != 1 else ''}"
        raise LineError(str(self.path), self.number(row), found, expected)

    def piece(self, rows: Int[np.ndarray, " _"], keys: Sequence[str]) -> Piece:
        """Return the columns of some lines of one width.

        Raises:
            CellError: Naming the first cell that is no number.
        """
        width = int(self.widths[rows[0]])
        usable = max(w for w in self.header.widths if w <= width)
        columns = self._parse(rows, width)
        if columns is None:
            raise self._wrong_cell(rows, keys, width)
        values = [np.asarray(cells.to_numpy()) for cells in columns[:usable]]
        blank = [np.asarray(cells.is_null().to_numpy()) for cells in columns[:usable]]
        return Piece(values, blank, rows + self.header.body_line)

    def _parse(self, rows: Int[np.ndarray, " _"], width: int) -> list[Any] | None:
        """Return pyarrow's columns of some lines, or None where a cell is no number."""
        import pyarrow as pa
        import pyarrow.csv as pv

        names = [str(at) for at in range(width)]
        kinds = {name: pa.float64() for name in names}
        if self.ticks:
            starts = {0, *self.header.widths}
            kinds |= {str(at): pa.int64() for at in starts if at < width}
        body = self.raw[self.starts[rows[0]] : self.ends[rows[-1]]]
        try:
            table: Any = pv.read_csv(
                io.BytesIO(body),
                # Threads cost more than a small file does.
                read_options=pv.ReadOptions(
                    column_names=names, use_threads=len(body) > _SMALL
                ),
                parse_options=pv.ParseOptions(
                    delimiter=self.header.separator, quote_char=False
                ),
                convert_options=pv.ConvertOptions(
                    column_types=kinds,
                    decimal_point=self.decimal,
                    null_values=_BLANK,
                ),
            )
        except pa.ArrowInvalid:
            return None
        if table.num_rows != rows.size:
            return None
        return [table.column(at) for at in range(width)]

    def _wrong_cell(
        self, rows: Int[np.ndarray, " _"], keys: Sequence[str], width: int
    ) -> MeasurementError:
        """Return the error that the first cell is which is no number."""
        for at in range(0, rows.size, _STEP):
            batch = rows[at : at + _STEP]
            if rows.size > _STEP and self._parse(batch, width) is not None:
                continue
            for row in batch.tolist():
                cells = self.line(row).split(self.header.separator)
                for name, cell in zip(keys, cells, strict=False):
                    text = cell.strip()
                    if text and not (
                        _NUMBER[self.decimal].fullmatch(text)
                        or _NO_NUMBER.fullmatch(text)
                    ):
                        mark = "comma" if self.decimal == "," else "point"
                        expected = f"a number with a decimal {mark}"
                        line = self.number(row)
                        return CellError(str(self.path), line, name, text, expected)
        line = self.number(int(rows[0]))
        return LineError(str(self.path), line, "samples that cannot be read", "numbers")

    def complain_of_cut(self, groups: Sequence[GroupSamples]) -> None:
        """Refuse a file that ends long before the export did.

        Raises:
            LineError: Naming the last line.
        """
        if self.has_end_mark:
            return
        duration = 1000.0 * self.header.duration
        line = self.number(int(self.rows[-1]))
        for samples, channels in zip(groups, self.header.groups, strict=True):
            time = samples.time
            step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
            missing = duration - float(time[-1])
            if missing <= max(3.0 * step, 0.01 * duration):
                continue
            found = f"the samples of '{channels[0].name}' ending at {time[-1]:g} ms"
            expected = f"{duration:g} ms ('Endtime of export'): the file is cut off"
            raise LineError(str(self.path), line, found, expected)
