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

from ._aside import columns_of_blocks, without_foot, without_headings
from ._errors import LineError, MeasurementError
from ._head_lines import is_unit_row
from ._header import Name, parse_name, unit_in
from ._headings import looks_like_names
from ._layout import Layout, find_layout
from ._meaning import with_meaning
from ._table import BadCell, Column, Lines, Skipped, Table, TextForm, first_bad
from ._titles import axis_in_title
from ._words import DIRECTIONS

_COMMENT_BYTES = re.compile(rb"(?m)^[ \t]*(?:#|%|//|!).*$")
_COMMENT_OR_SEMICOLON = re.compile(rb"(?m)^[ \t]*(?:#|%|//|!|;).*$")
_EMPTY_ROW = re.compile(r"(?m)^[;,\t ]+$")
"""What a spreadsheet writes below a table, and between two."""
_SMALL = 1 << 20
"""Bytes up to which one thread reads a file."""
_NULLS = [
    *("", "nan", "NaN", "NAN", "-nan"),
    *("NA", "N/A", "n/a", "#N/A", "null", "NULL", "-"),
]


def read_csv(
    path: Path, text: str, *, encoding: str = "utf-8", lines: Lines | None = None
) -> Table:
    """Return the table that a text holds.

    Args:
        path: The file.
        text: Its content.
        encoding: For the record.
        lines: What a job says of the lines.

    Raises:
        MeasurementError: If it holds no rows, or a line has more or fewer cells than
            the others; names the line.
    """
    if lines is not None:
        text = lines.keep(text)
    if any(mark in text for mark in ("\n;", "\n,", "\n\t")):
        text = _EMPTY_ROW.sub("", text)
    layout = find_layout(path, text, lines)
    table = read_body(path, layout, text, encoding)
    if lines is None or not lines.skip:
        return table
    omitted = (Skipped(line, "left out, as the job has it") for line in lines.skip)
    skipped = sorted((*table.skipped, *omitted), key=lambda item: item.line)
    return dataclasses.replace(table, skipped=tuple(skipped))


def read_body(path: Path, layout: Layout, text: str, encoding: str = "utf-8") -> Table:
    """Return the table that a text of known layout holds: the whole of it, or further lines.

    Raises:
        MeasurementError: As `read_csv`.
    """
    _refuse_cut_number(path, layout, text)
    result = _read_fast(layout, text)
    blocks: list[tuple[int, str]] = []
    if result is None:
        body, foot = without_foot(layout, text)
        body, blocks = without_headings(layout, body)
        if foot or blocks:
            result = _read_fast(layout, body)
        columns, lines, skipped = result or _read_slow(path, layout, body)
        below = [Skipped(line, "below the rows") for line, _ in foot]
        result = columns, lines, [*skipped, *below]
        layout = dataclasses.replace(layout, comments=(*layout.comments, *foot))
    columns, lines, skipped = result
    if not lines.size:
        reason = "found no rows, expected at least one line of numbers"
        raise MeasurementError(str(path), reason)
    if blocks:
        assert layout.block is not None
        blocks = [layout.block, *blocks]
        further = list(columns_of_blocks(blocks, lines))
        names = (*layout.names, *(parse_name(column.name) for column in further))
        layout = dataclasses.replace(layout, names=names)
        columns = [*columns, *further]
    return table_of(path, layout, columns, lines, skipped, encoding)


def _refuse_cut_number(path: Path, layout: Layout, text: str) -> None:
    """Raise where a text ends in a row whose last number ends in its decimal mark.

    Where all numbers do, they are whole ones; a last line of words is none of the table.

    Raises:
        LineError: That the file was cut off there.
    """
    mark, separator = layout.dialect.decimal, layout.dialect.separator
    if not text.endswith(mark) or mark == separator or f"{mark}\n" in text:
        return
    body = text[layout.body :]
    number = layout.body_line + body.count("\n")
    last = body.rpartition("\n")[2].strip()
    *others, cut = layout.dialect.split(last)
    whole = any(cell.strip().endswith(mark) for cell in others)
    first = next(iter(others), cut)
    if (
        whole
        or not cut[:-1].strip()[-1:].isdigit()
        or layout.dialect.number(first) is None
    ):
        return
    found = f"'{last[-40:]}' in the last line, which ends within its number"
    expected = "a whole line: the file was cut off, export it again"
    raise LineError(str(path), number, found, expected, f"skip = [{number}]")


def table_of(
    path: Path,
    layout: Layout,
    columns: Sequence[Column],
    lines: Int[np.ndarray, " t"],
    skipped: Sequence[Skipped],
    encoding: str,
) -> Table:
    """Return the columns as a table, with the meaning that header and titles give them."""
    dialect = layout.dialect
    form = TextForm(
        encoding=encoding,
        separator=dialect.separator,
        decimal=dialect.decimal,
        thousands=dialect.thousands,
        titles=tuple(line for line, _ in layout.titles),
        header=layout.header_lines,
        units=layout.units_line,
        first=int(lines[0]),
    )
    table = Table(
        path=path,
        format="CSV",
        columns=tuple(columns),
        rows=int(lines.size),
        lines=lines,
        skipped=(*layout.skipped, *skipped),
        form=form,
        titles=dict((*layout.comments, *layout.titles)),
    )
    return with_meaning(table, layout.names)


_Read = tuple[list[Column], Int[np.ndarray, " t"], list[Skipped]]


def _read_fast(layout: Layout, text: str) -> _Read | None:
    """Read the body with pyarrow; None where anything is not plain."""
    body = (text[layout.body :] if layout.body else text).encode()
    dialect, width = layout.dialect, len(layout.names)
    if dialect.thousands or (dialect.separator == " " and b'"' in body):
        return None
    body, skipped = _without_comments(body, layout)
    if dialect.separator == " ":
        body = _single_blanks(body)
    # Lines may all end with a separator that the header lacks.
    first = layout.dialect.split(body.lstrip(b"\n").split(b"\n", 1)[0].decode())
    ends = len(first) == width + 1 and first[-1] == ""
    cells = read_cells(body, layout, ends=ends)
    if cells is None:
        return None
    lines = _lines_of_rows(body, cells.num_rows)
    if cells.num_rows != lines.size:
        return None
    lines += layout.body_line
    if ends and any(cell.strip() for cell in cells.column(width).to_pylist()):
        return None
    columns = [
        _fast_column(layout, text, lines, at, cells.column(at)) for at in range(width)
    ]
    return columns, lines, skipped


def read_cells(
    body: Any,
    layout: Layout,
    *,
    ends: bool = False,
    blank_lines: bool = True,
    threads: bool | None = None,
) -> Any:
    """Return the cells of a body as a `pyarrow.Table`; None where they are not plain.

    Args:
        body: Bytes, or a buffer of pyarrow.
        layout: How it is laid out.
        ends: Every line ends with a separator.
        blank_lines: Blank lines are left out; else there must be none.
        threads: Read with several; left out: where the body is long.
    """
    import pyarrow as pa
    import pyarrow.csv as pv

    keys = [str(at) for at in range(len(layout.names))] + ["\0end"] * ends
    types = [pa.float64() if numeric else pa.string() for numeric in layout.numeric]
    types += [pa.string()] * ends
    try:
        return pv.read_csv(
            pa.BufferReader(body),
            # Threads cost more than a small file does.
            read_options=pv.ReadOptions(
                column_names=keys,
                use_threads=len(body) > _SMALL if threads is None else threads,
            ),
            parse_options=pv.ParseOptions(
                delimiter=layout.dialect.separator, ignore_empty_lines=blank_lines
            ),
            convert_options=pv.ConvertOptions(
                column_types=dict(zip(keys, types, strict=True)),
                decimal_point=layout.dialect.decimal,
                null_values=_NULLS,
                strings_can_be_null=False,
            ),
        )
    except (pa.ArrowInvalid, pa.ArrowKeyError):
        return None


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
    line_ends = np.flatnonzero(np.frombuffer(body, np.uint8) == 10)
    numbers = np.searchsorted(line_ends, np.array(offsets, dtype=np.int64))
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
        return number_column(name, values, None)
    number = int(lines[finite.argmin()])
    line = text[layout.body :].split("\n")[number - layout.body_line]
    return number_column(name, values, BadCell(number, layout.dialect.split(line)[at]))


def _single_blanks(body: bytes) -> bytes:
    """Return the text with each run of blanks and tabs as one, none at line ends."""
    raw = np.frombuffer(body, np.uint8)
    blank = (raw == 32) | (raw == 9)
    after = np.empty_like(blank)  # previous byte is a blank or a line end
    after[0] = True
    after[1:] = blank[:-1] | (raw[:-1] == 10)
    packed = raw[~(blank & after)]
    end = np.empty(packed.size, bool)  # next byte is a line end
    end[-1] = True
    end[:-1] = packed[1:] == 10
    packed = packed[~(((packed == 32) | (packed == 9)) & end)]
    return np.where(packed == 9, np.uint8(32), packed).astype(np.uint8).tobytes()


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


def _read_slow(path: Path, layout: Layout, text: str) -> _Read:
    """Read line by line; the place where a wrong line or cell is found and named."""
    dialect, width = layout.dialect, len(layout.names)
    skipped: list[Skipped] = []
    lines: list[int] = []
    rows: list[list[str]] = []
    usual = 0  # cells, empty ones at the end among them
    for at, line in enumerate(text[layout.body :].split("\n")):
        number = at + layout.body_line
        if not line.strip():
            continue
        if dialect.is_comment(line):
            skipped.append(Skipped(number, "comment"))
            continue
        cells = dialect.split(line)
        count = len(cells)
        while len(cells) > width and cells[-1] == "":
            cells.pop()
        if again := _repeats_head(path, layout, number, cells):
            skipped.append(Skipped(number, again))
            continue
        short = count < usual and not _more(text, layout, at)
        if len(cells) != width or short:
            last = "" if _more(text, layout, at) else " in the last line"
            found = f"{count} cells{last} ('{line.strip()[:40]}')"
            expected = f"{max(width, usual)} {dialect.words} as in the lines above"
            raise LineError(str(path), number, found, expected, f"skip = [{number}]")
        usual = min(usual, count) if rows else count
        lines.append(number)
        rows.append(cells)
    columns = [
        _slow_column(layout, at, lines, [row[at] for row in rows])
        for at in range(width)
    ]
    return columns, np.array(lines, dtype=np.int64), skipped


def _repeats_head(path: Path, layout: Layout, number: int, cells: list[str]) -> str:
    """Return what of the head a line between rows repeats; empty for a row.

    Raises:
        LineError: If it begins a block of another axis, or of other names or units: without
            it, the rows below would count as those above.
    """
    width, text = len(layout.names), layout.dialect.separator.join(cells)
    if layout.header and tuple(cells) == layout.header[:width]:
        return "the header line again"
    axis = axis_in_title(text) if len(cells) != width else None
    other = again = ""
    if axis is not None:
        titles = [axis_in_title(words) for _, words in layout.titles]
        other = f"title of axis {axis}" if axis not in titles else ""
    elif layout.units_line and is_unit_row(cells, width):
        again = "the units again"
        same = _same_units(layout, [unit_in(cell) for cell in cells])
        other = "" if same else "line of other units"
    elif names := _names_between_rows(layout, cells):
        again = "the header line again"
        stems = [parse_name(cell).stem.casefold() for cell in layout.header[:width]]
        if [name.stem.casefold() for name in names] != stems:
            other = "header of other columns"
        elif not _same_units(layout, [name.unit for name in names]):
            other = "header of other units"
    if other:
        found = f"'{text[:40]}' between rows, a {other}"
        expected = "rows as above it: split the file there, a file for each block"
        raise LineError(str(path), number, found, expected)
    return again


def _same_units(layout: Layout, stated: Sequence[str | None]) -> bool:
    pairs = zip(layout.names, stated, strict=True)
    return all(unit in (None, name.unit) for name, unit in pairs)


def _names_between_rows(layout: Layout, cells: Sequence[str]) -> list[Name]:
    """Return the names in a line that can only be a header; none where it is a row."""
    width = len(layout.names)
    if len(cells) != width or width < 2 or not layout.header or not any(layout.numeric):
        return []
    pairs = zip(layout.numeric, cells, strict=True)
    if any(
        number and layout.dialect.number(cell) is not None for number, cell in pairs
    ):
        return []
    names = [*map(parse_name, cells)]
    known = {name.stem.casefold() for name in layout.names}
    as_above = all(name.stem.casefold() in known for name in names)
    units = any(name.unit is not None for name in names)
    return names if as_above or (units and looks_like_names(cells)) else []


def _more(text: str, layout: Layout, at: int) -> bool:
    """Whether a body goes on below a line of it."""
    return any(line.strip() for line in text[layout.body :].split("\n")[at + 1 :])


def _slow_column(
    layout: Layout, at: int, lines: Sequence[int], cells: Sequence[str]
) -> Column:
    name, dialect = layout.names[at], layout.dialect
    parsed = [dialect.number(cell) for cell in cells]
    filled = sum(cell != "" for cell in cells)
    # Beside a plus, a minus is no missing number.
    signs = "+" in cells and all(cell in DIRECTIONS or not cell for cell in cells)
    if signs or (filled and 2 * parsed.count(None) > filled):
        return _text_column(name, tuple(cells))
    values = np.array([np.nan if v is None else v for v in parsed], dtype=np.float64)
    return number_column(name, values, first_bad(values, lines, cells))


def number_column(name: Name, values: np.ndarray, bad: BadCell | None) -> Column:
    """Return a column of numbers; NaN where a cell holds none."""
    if bad is not None:
        values = np.where(np.isfinite(values), values, np.nan)
    return Column(
        name.name, None, name.unit, values, None, bad, name.header, name.doubtful
    )


_SEXAGESIMAL = re.compile(
    r"(?P<sign>[-+]?)(?P<deg>\d+)[:°]\s*(?P<min>[0-5]?\d)[:'\u2032]?\s*"
    r"(?:(?P<sec>[0-5]?\d(?:[.,]\d+)?)(?:''|[\"\u2033])?)?"
)
"""An angle as ``30:15:00`` or ``30°15'00"``."""


def _text_column(name: Name, cells: tuple[str, ...]) -> Column:
    if name.unit == "deg":
        matches = [_SEXAGESIMAL.fullmatch(cell.strip()) for cell in cells]
        angles = [_degrees(match) for match in matches if match is not None]
        if len(angles) == len(cells):
            return number_column(name, np.array(angles), None)
    values = np.full(len(cells), np.nan)
    return Column(name.name, None, None, values, cells, None, name.header)


def _degrees(match: re.Match[str]) -> float:
    """Return an angle of degrees, minutes and seconds in °."""
    seconds = float((match["sec"] or "0").replace(",", "."))
    size = int(match["deg"]) + int(match["min"]) / 60.0 + seconds / 3600.0
    return -size if match["sign"] == "-" else size
