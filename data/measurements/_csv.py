"""Text tables: separators , ; tab or blanks, decimal point or comma, header or none.

The bulk goes through pyarrow. Where that stumbles, the careful path reads line by line
and finds the line and the column that are wrong.
"""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from ._errors import LineError, MeasurementError
from ._header import Name, roles_of
from ._layout import Layout, find_layout
from ._table import BadCell, Column, Skipped, Table

_COMMENT_BYTES = re.compile(rb"(?m)^[ \t]*(?:#|%|//|!).*$")
_COMMENT_OR_SEMICOLON = re.compile(rb"(?m)^[ \t]*(?:#|%|//|!|;).*$")
SHORT = 1 << 15
"""Characters up to which a body is short."""
_SMALL = 1 << 20
"""Bytes up to which one thread reads a file."""
_NULLS = [
    *("", "nan", "NaN", "NAN", "-nan"),
    *("NA", "N/A", "n/a", "#N/A", "null", "NULL", "-"),
]


def read_csv(path: Path, text: str) -> Table:
    """Return the table that a text holds.

    Raises:
        MeasurementError: If it holds no rows, or a line has more or fewer cells than
            the others; names the line.
    """
    return read_body(path, find_layout(path, text), text)


def read_body(path: Path, layout: Layout, text: str) -> Table:
    """Return the table that a text of known layout holds: the whole of it, or further lines.

    Raises:
        MeasurementError: As `read_csv`.
    """
    read = (
        _read_short(layout, text)
        or _read_fast(layout, text)
        or _read_slow(path, layout, text)
    )
    columns, lines, skipped = read
    if not lines.size:
        reason = "found no rows, expected at least one line of numbers"
        raise MeasurementError(str(path), reason)
    format_name, remarks, columns = _name_columns(layout, columns)
    return Table(
        path=path,
        format=format_name,
        columns=tuple(columns),
        rows=int(lines.size),
        lines=lines,
        skipped=(*layout.skipped, *skipped),
        remarks=remarks,
    )


_Read = tuple[list[Column], Int[np.ndarray, " t"], list[Skipped]]


def _read_short(layout: Layout, text: str) -> _Read | None:
    """Read a short body of plain numbers; None where it is not that.

    Setting up pyarrow takes longer than that.
    """
    dialect, width = layout.dialect, len(layout.names)
    if len(text) - layout.body > SHORT or dialect.separator == " ":
        return None
    if dialect.decimal != "." or not all(layout.numeric):
        return None
    body = text[layout.body :].split("\n")
    filled = [line for line in body if line]
    cells = dialect.separator.join(filled).split(dialect.separator)
    if not layout.plain:
        if any(line.count(dialect.separator) != width - 1 for line in filled):
            return None
        if not dialect.all_plain("\n".join(cells)):
            return None
    values = np.array(list(map(float, cells))).reshape(-1, width)
    if not np.isfinite(values).all():
        return None  # beyond floating point: where it stands is to be said
    lines = np.array([at for at, line in enumerate(body) if line], dtype=np.int64)
    columns = [
        _number_column(name, np.ascontiguousarray(values[:, at]), None)
        for at, name in enumerate(layout.names)
    ]
    return columns, lines + layout.body_line, []


def _read_fast(layout: Layout, text: str) -> _Read | None:
    """Read the body with pyarrow; None where anything is not plain."""
    import pyarrow as pa
    import pyarrow.csv as pv

    body = (text[layout.body :] if layout.body else text).encode()
    dialect, width = layout.dialect, len(layout.names)
    if dialect.separator == " " and b'"' in body:
        return None
    body, skipped = _without_comments(body, layout)
    if dialect.separator == " ":
        body = _single_blanks(body)
    # Lines may all end with a separator that the header lacks.
    first = layout.dialect.split(body.lstrip(b"\n").split(b"\n", 1)[0].decode())
    extra = ["\0end"] if len(first) == width + 1 and first[-1] == "" else []
    keys = [str(at) for at in range(width)] + extra
    types = [pa.float64() if numeric else pa.string() for numeric in layout.numeric]
    types += [pa.string() for _ in extra]
    try:
        read: Any = pv.read_csv(
            pa.BufferReader(body),
            # Threads cost more than a small file does.
            read_options=pv.ReadOptions(
                column_names=keys, use_threads=len(body) > _SMALL
            ),
            parse_options=pv.ParseOptions(delimiter=dialect.separator),
            convert_options=pv.ConvertOptions(
                column_types=dict(zip(keys, types, strict=True)),
                decimal_point=dialect.decimal,
                null_values=_NULLS,
                strings_can_be_null=False,
            ),
        )
    except (pa.ArrowInvalid, pa.ArrowKeyError):
        return None
    lines = _lines_of_rows(body, read.num_rows)
    if read.num_rows != lines.size:
        return None
    lines += layout.body_line
    if extra and any(cell.strip() for cell in read.column(width).to_pylist()):
        return None
    columns = [
        _fast_column(layout, text, lines, at, read.column(at)) for at in range(width)
    ]
    return columns, lines, skipped


def _without_comments(body: bytes, layout: Layout) -> tuple[bytes, list[Skipped]]:
    """Return the body with comments blanked; line ends stay, so lines still count."""
    semicolon = layout.dialect.separator != ";"
    marks = [b"#", b"%", b"//", b"!"]
    marks += [b"\n;", b"\n ;", b"\n\t;"] if semicolon else []
    # One byte is found faster than two of which the first is in every line.
    if not any(mark[-1:] in body and mark in body for mark in marks):
        return body, []
    pattern = _COMMENT_OR_SEMICOLON if semicolon else _COMMENT_BYTES
    offsets = [match.start() for match in pattern.finditer(body)]
    ends = np.flatnonzero(np.frombuffer(body, np.uint8) == 10)
    numbers = np.searchsorted(ends, np.array(offsets, dtype=np.int64))
    skipped = [Skipped(int(n) + layout.body_line, "comment") for n in numbers]
    return pattern.sub(b"", body), skipped


def _fast_column(
    layout: Layout, text: str, lines: Int[np.ndarray, " t"], at: int, cells: Any
) -> Column:
    """Return a column from pyarrow's; the text of a bad cell comes from the file."""
    name = layout.names[at]
    if not layout.numeric[at]:
        return _text_column(name, tuple(cell.strip() for cell in cells.to_pylist()))
    values = np.asarray(cells.to_numpy(), dtype=np.float64)
    finite = np.isfinite(values)
    if finite.all():
        return _number_column(name, values, None)
    number = int(lines[finite.argmin()])
    line = text[layout.body :].split("\n")[number - layout.body_line]
    return _number_column(name, values, BadCell(number, layout.dialect.split(line)[at]))


def _single_blanks(body: bytes) -> bytes:
    """Return the text with each run of blanks and tabs as one, none at line ends."""
    raw = np.frombuffer(body, np.uint8)
    blank = (raw == 32) | (raw == 9)
    after = np.empty_like(blank)  # previous byte is a blank or a line end
    after[0] = True
    after[1:] = blank[:-1] | (raw[:-1] == 10)
    kept = raw[~(blank & after)]
    end = np.empty(kept.size, bool)  # next byte is a line end
    end[-1] = True
    end[:-1] = kept[1:] == 10
    kept = kept[~(((kept == 32) | (kept == 9)) & end)]
    return np.where(kept == 9, np.uint8(32), kept).astype(np.uint8).tobytes()


def _lines_of_rows(body: bytes, rows: int) -> Int[np.ndarray, " t"]:
    """Return the indices of the lines that are not empty, of which so many were read."""
    is_end = np.frombuffer(body, np.uint8) == 10
    if rows == np.count_nonzero(is_end) + (not body.endswith(b"\n")):
        return np.arange(rows)  # one row of each line
    ends = np.flatnonzero(is_end)
    if not body.endswith(b"\n"):
        ends = np.append(ends, len(body))
    starts = np.concatenate([[0], ends[:-1] + 1])
    return np.flatnonzero(ends > starts)


_SIGNS = frozenset(("+", "-", "−", ""))
"""Cells of a column of directions: beside a plus, a minus is no missing number."""


def _read_slow(path: Path, layout: Layout, text: str) -> _Read:
    """Read line by line; the place where a wrong line or cell is found and named."""
    dialect, width = layout.dialect, len(layout.names)
    skipped: list[Skipped] = []
    lines: list[int] = []
    rows: list[list[str]] = []
    for at, line in enumerate(text[layout.body :].split("\n")):
        number = at + layout.body_line
        if not line.strip():
            continue
        if dialect.is_comment(line):
            skipped.append(Skipped(number, "comment"))
            continue
        cells = dialect.split(line)
        if len(cells) == width + 1 and cells[-1] == "":
            cells.pop()
        if layout.header and tuple(cells) == layout.header[:width]:
            skipped.append(Skipped(number, "the header line again"))
            continue
        if len(cells) != width:
            found = f"{len(cells)} cells ('{line.strip()[:40]}')"
            expected = f"{width} as in the lines above"
            raise LineError(str(path), number, found, expected)
        lines.append(number)
        rows.append(cells)
    columns = []
    for at, name in enumerate(layout.names):
        column = tuple(row[at] for row in rows)
        parsed = [dialect.number(cell) for cell in column]
        filled = sum(cell != "" for cell in column)
        texts = parsed.count(None)
        signs = "+" in column and _SIGNS.issuperset(column)
        if signs or (filled and 2 * texts > filled):
            columns.append(_text_column(name, column))
            continue
        values = np.array(
            [np.nan if v is None else v for v in parsed], dtype=np.float64
        )
        wrong = np.flatnonzero(~np.isfinite(values))
        bad = BadCell(lines[wrong[0]], column[wrong[0]]) if wrong.size else None
        columns.append(_number_column(name, values, bad))
    return columns, np.array(lines, dtype=np.int64), skipped


def _number_column(name: Name, values: np.ndarray, bad: BadCell | None) -> Column:
    if bad is not None:
        values = np.where(np.isfinite(values), values, np.nan)
    return Column(
        name.name, None, name.unit, values, None, bad, name.header, name.doubtful
    )


def _text_column(name: Name, cells: tuple[str, ...]) -> Column:
    values = np.full(len(cells), np.nan)
    return Column(name.name, None, None, values, cells, None, name.header)


def _name_columns(
    layout: Layout, columns: list[Column]
) -> tuple[str, tuple[str, ...], list[Column]]:
    """Give the columns the roles that the file states; recognise the laser table."""
    numbered = all(name.name == str(at + 1) for at, name in enumerate(layout.names))
    if not layout.header and numbered and _is_laser_body(columns):
        titles = ("target", "error", "run", "direction")
        roles = ("position", "error", "run", "direction")
        named = [
            dataclasses.replace(column, name=title, role=role, header=column.name)
            for column, title, role in zip(columns, titles, roles, strict=True)
        ]
        remark = (
            "No header: four columns with whole run numbers and directions ±1 are "
            "taken as target, error, run, direction in mm."
        )
        return "laser table", (remark,), named
    roles_found, laser = roles_of(layout.names)
    named = [
        column if role is None else dataclasses.replace(column, role=role)
        for column, role in zip(columns, roles_found, strict=True)
    ]
    return ("laser table" if laser else "CSV"), (), named


def _is_laser_body(columns: Sequence[Column]) -> bool:
    if len(columns) != 4 or any(column.text is not None for column in columns):
        return False
    run, direction = columns[2].values, columns[3].values
    whole = bool(np.all(run == np.round(run)))
    return whole and bool(np.all(np.abs(direction) == 1.0))
