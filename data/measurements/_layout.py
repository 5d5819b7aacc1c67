"""Where titles, header, units and rows of a text table lie, and what the columns are called."""

import dataclasses
import itertools
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ._dialect import (
    Dialect,
    begins_with_name,
    first_row_of_numbers,
    sniff,
    usual_width,
)
from ._errors import LineError, MeasurementError
from ._header import (
    Name,
    bare_role,
    heading,
    is_format,
    looks_like_names,
    parse_name,
    unit_in,
)
from ._table import Lines, Skipped

_SAMPLE = 400
_BELOW = 200
"""Rows that tell what a column holds."""
_FIRST = re.compile(rf"(?:[^\n]*+\n){{1,{_BELOW}}}+")
"""So many lines, or fewer."""
_LONGEST_HEADER = 10_000
"""Characters of a header line that one look is enough for."""
_MOST_HEADERS = 4
_LONGEST_UNIT = 8
_AS_SHOWN = Lines()
_BROKEN_NUMBER = re.compile(r"[\d.,]*\d\s?[-−]|\([\d.,]*\d\)")
"""A negative number as book-keepers write it."""
_ANY_NUMBER = re.compile(r"[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?")


@dataclasses.dataclass(frozen=True)
class Layout:
    """How a text table is laid out.

    Attributes:
        dialect: Separator and decimal mark.
        names: One per column.
        header: Cells of the lowest header line; empty where there is none.
        body: Offset of the first row in the text.
        body_line: Its line (1-based).
        numeric: Whether a column looks like numbers, from the first rows.
        skipped: Comments and titles above the body.
        header_lines: Lines of the header, units not among them.
        units_line: Line with the units; None where there is none.
        titles: Lines above the header that hold neither names nor numbers.
        comments: Comments above the rows.
        block: Line above the first rows that names their run or direction, as others do
            between the rows; None where there is none.
        plain: Every row of the text is seen to be plain numbers, one per name.
    """

    dialect: Dialect
    names: tuple[Name, ...]
    header: tuple[str, ...]
    body: int
    body_line: int
    numeric: tuple[bool, ...]
    skipped: tuple[Skipped, ...]
    header_lines: tuple[int, ...] = ()
    units_line: int | None = None
    titles: tuple[tuple[int, str], ...] = ()
    comments: tuple[tuple[int, str], ...] = ()
    block: tuple[int, str] | None = None
    plain: bool = dataclasses.field(default=False, compare=False)


def find_layout(path: Path, text: str, lines: Lines | None = None) -> Layout:
    """Return the layout of a text table, from its first lines.

    Args:
        path: The file.
        text: Its content.
        lines: What a job says of the lines; None: they tell it themselves.

    Raises:
        LineError: If a line above the rows holds numbers of another pattern, or the
            header has not as many names as the rows have cells.
        MeasurementError: If there is no row of data.
    """
    found = _plain_layout(text) if lines is None else None
    return found or _layout_by_lines(path, text, lines or _AS_SHOWN)


@dataclasses.dataclass(frozen=True)
class _Head:
    """The first lines of a text: those with content, split."""

    path: Path
    dialect: Dialect
    width: int
    lines: Sequence[int]
    texts: Sequence[str]
    rows: Sequence[Sequence[str]]

    def error(self, index: int, found: str, expected: str, advice: str) -> LineError:
        """Return the error that a line is, ready to raise."""
        return LineError(str(self.path), self.lines[index], found, expected, advice)


def _lines_of_head(text: str) -> tuple[list[int], list[str]]:
    """Return offsets and lines up to some hundred that are no comments."""
    offsets: list[int] = []
    lines: list[str] = []
    start = telling = 0
    while start < len(text) and telling < _SAMPLE:
        end = text.find("\n", start)
        end = len(text) if end < 0 else end
        offsets.append(start)
        lines.append(text[start:end])
        telling += not lines[-1].lstrip().startswith(("#", "%", "!", "//", ";"))
        start = end + 1
    return offsets, lines


def _layout_by_lines(path: Path, text: str, wanted: Lines = _AS_SHOWN) -> Layout:
    """Return the layout of any text table."""
    offsets, every = _lines_of_head(text)
    dialect = sniff([line for line in every if line.strip()])
    comments = [
        at
        for at, line in enumerate(every)
        if (dialect.is_comment(line) and at + 1 not in (wanted.header or ()))
        or (at == 0 and line.casefold().startswith("sep="))
    ]
    aside = set(comments)
    content = [at for at, line in enumerate(every) if line.strip() and at not in aside]
    if not content:
        reason = "found only comments or blank lines, expected rows of numbers"
        raise MeasurementError(str(path), reason)
    rows = [dialect.split(every[at]) for at in content]
    width = usual_width(dialect, rows)
    while width > 1 and not any(row[-1] for row in rows if len(row) == width):
        # Every line ends with a separator, or columns of a sheet are empty.
        rows = [row[:-1] if len(row) == width else row for row in rows]
        width -= 1
    texts = [every[at] for at in content]
    head = _Head(path, dialect, width, [at + 1 for at in content], texts, rows)
    first = _first_row(head, wanted)
    block = _block_above(head, first, wanted)
    top, units = _header_above(head, first - (block is not None), wanted)
    below = rows[first : first + _BELOW]
    names = _names(head, top)
    width = len(names) if top else len(rows[first])
    if not below or (not top and not _any_number(dialect, below) and len(below) == 1):
        words = ", ".join(rows[top[-1] if top else first])[:60]
        reason = f"found a header ({words}) and no rows, expected rows"
        raise MeasurementError(str(path), reason)
    if not top:
        names = _names_from_comment(dialect, every[: content[0]], width)
    if units is not None:
        cells = rows[units]
        if top and len(cells) < width:
            cells = _placed(head, units, top[-1])
        for at, cell in enumerate(cells[:width]):
            unit = unit_in(cell) or cell.strip("[]()- ")
            if unit and not is_format(cell):
                names[at] = dataclasses.replace(names[at], unit=unit, doubtful=False)
    above = top[0] if top else (first if units is None else units)
    _refuse_numbers(head, above)
    titles = tuple((head.lines[at], texts[at].strip()) for at in range(above))
    said = tuple((at + 1, every[at].strip()) for at in comments if at < content[first])
    left = [Skipped(line, "comment") for line, _ in said]
    left += [Skipped(line, "title") for line, _ in titles]
    if block is None and titles and top and heading(titles[-1][1]) is not None:
        block = titles[-1]
    return Layout(
        dialect=dialect,
        names=tuple(names),
        header=tuple(rows[top[-1]]) if top else (),
        body=offsets[content[first]],
        body_line=content[first] + 1,
        numeric=tuple(_is_numeric(dialect, below, at) for at in range(width)),
        skipped=tuple(sorted(left, key=lambda item: item.line)),
        header_lines=tuple(head.lines[at] for at in top),
        units_line=None if units is None else head.lines[units],
        titles=titles,
        comments=said,
        block=block,
    )


def _first_row(head: _Head, wanted: Lines) -> int:
    """Return the index of the first row of the body."""
    least = 0
    if wanted.rows is not None:
        least = wanted.rows[0]
    elif wanted.header:
        least = max(wanted.header) + 1
    index = next((k for k, line in enumerate(head.lines) if line >= least), None)
    if index is None:
        reason = f"found no row from line {least} on, as the job has it, expected some"
        raise MeasurementError(str(head.path), reason)
    if least:
        units = wanted.rows is None and is_unit_row(head.rows[index], head.width)
        return index + units if index + units < len(head.rows) else index
    first = first_row_of_numbers(head.dialect, head.rows, head.width)
    if first == 0 and not _any_number(head.dialect, head.rows[:1]):
        # A table of words: below what can only be a header.
        return int(len(head.rows) > 1 and looks_like_names(head.rows[0]))
    if _names_rows(head, first):
        return first + 1
    # A row of numbers with a word among them belongs to the body.
    while first > 0 and _is_damaged_row(head, first - 1):
        first -= 1
    return first


def _names_rows(head: _Head, index: int) -> bool:
    """Whether a line has a name in front of its numbers, and the next one names a run."""
    if index + 1 >= len(head.rows):
        return False
    name, below = head.rows[index][0], head.rows[index + 1][0]
    return begins_with_name(name) and heading(below) is not None


def _is_damaged_row(head: _Head, index: int) -> bool:
    cells = head.rows[index]
    if len(cells) != head.width or is_unit_row(cells, head.width):
        return False
    known = heading(cells[0]) is not None or looks_like_names(cells[:1])
    known |= not cells[0] or unit_in(cells[0]) is not None
    broken = any(map(_BROKEN_NUMBER.fullmatch, cells))
    return (broken or not known) and any(map(head.dialect.is_number, cells))


def _block_above(head: _Head, first: int, wanted: Lines) -> tuple[int, str] | None:
    """Return the line right above the rows that names their run or direction, or None."""
    if first == 0 or head.width == 1 or wanted.header is not None:
        return None
    cells = head.rows[first - 1]
    words = " ".join(filter(None, cells))
    if not cells[0] or first == 1 or heading(words) is None:
        return None
    return head.lines[first - 1], words


def _header_above(
    head: _Head, first: int, wanted: Lines
) -> tuple[list[int], int | None]:
    """Return the indices of the header lines above a body, and of the units."""
    at, units = first - 1, None
    if at >= 0 and (
        is_unit_row(head.rows[at], head.width) or _has_units_of_some(head, at)
    ):
        at, units = at - 1, at
    if wanted.header is not None:
        missing = [line for line in wanted.header if line not in head.lines]
        if missing:
            found = "nothing there, or a comment"
            raise LineError(str(head.path), missing[0], found, "the header line")
        return [head.lines.index(line) for line in sorted(wanted.header)], units
    top: list[int] = []
    while at >= 0 and len(top) < _MOST_HEADERS:
        if not (_is_upper_header if top else _is_header)(head, at):
            break
        top.insert(0, at)
        at -= 1
    return top, units


def _has_units_of_some(head: _Head, index: int) -> bool:
    """Whether a line between blanks holds units in brackets for some of the names above."""
    cells = head.rows[index]
    return (
        head.dialect.separator == " "
        and len(cells) < head.width
        and index > 0
        and head.dialect.header(head.texts[index - 1], head.width) is not None
        and all(cell[0] in "[(" and unit_in(cell) is not None for cell in cells)
    )


def _placed(head: _Head, units: int, names: int) -> list[str]:
    """Return the units of a line, each for the name that it stands nearest to.

    Raises:
        LineError: If two stand under one name.
    """
    cells = head.rows[units]
    above = head.dialect.header(head.texts[names], head.width) or []
    middles = np.array(_middles(head.texts[names], above))
    found = [""] * head.width
    for cell, middle in zip(cells, _middles(head.texts[units], cells), strict=True):
        nearest = int(np.argmin(np.abs(middles - middle)))
        if found[nearest]:
            stand = f"the units {found[nearest]} and {cell} under '{above[nearest]}'"
            raise head.error(units, stand, "one", f"skip = [{head.lines[units]}]")
        found[nearest] = cell
    return found


def _middles(text: str, cells: Sequence[str]) -> list[float]:
    """Return where the middle of each cell stands in a line."""
    found, end = [], 0
    text = text.expandtabs()
    for cell in cells:
        start = text.index(cell, end)
        end = start + len(cell)
        found.append(0.5 * (start + end))
    return found


def _is_header(head: _Head, index: int) -> bool:
    """Whether a line names the columns: words above numbers, as many as there are cells."""
    cells = head.dialect.header(head.texts[index], head.width)
    if cells is None:
        _refuse_other_width(head, index)
        return False
    filled = [cell for cell in cells if cell]
    words = [cell for cell in filled if any(map(str.isalpha, cell))]
    if head.width > 1 and len(filled) == 1 and index > 0:
        return heading(filled[0]) is not None
    return bool(words) or (len(filled) > 1 and looks_like_names(filled))


def _is_upper_header(head: _Head, index: int) -> bool:
    """Whether a line above a header names groups of columns."""
    cells = _upper_cells(head, index)
    if cells is None or heading(head.texts[index]) is not None:
        return False
    filled = [at for at, cell in enumerate(cells) if cell]
    below = head.rows[index + 1]
    fills = any(at < len(below) and not below[at] for at in filled)
    known = 2 * sum(looks_like_names([cells[at]]) for at in filled) > len(filled)
    wide = len(filled) > 1 and filled[-1] >= head.width // 2
    return known and (wide or (fills and len(filled) > 1))


def _upper_cells(head: _Head, index: int) -> list[str] | None:
    """Return the cells of a line above a header, empty ones added where it ends early."""
    cells = list(head.rows[index])
    if head.dialect.separator != " " and 1 < len(cells) < head.width:
        return cells + [""] * (head.width - len(cells))
    return head.dialect.header(head.texts[index], head.width)


def _refuse_other_width(head: _Head, index: int) -> None:
    """Raise where a line is meant as the header and has more or fewer names.

    Raises:
        LineError: That it is.
    """
    cells = [cell for cell in head.rows[index] if cell]
    if head.dialect.separator == "," and head.width == 2 * len(cells) > 2:
        found = f"{len(cells)} names above {head.width} cells between commas"
        expected = "semicolons between cells, or quotes, where decimals have commas"
        raise head.error(index, found, expected, "header = [], with columns by number")
    near = abs(len(head.rows[index]) - head.width) == 1
    named = near and (unit_in(cells[0]) is not None or looks_like_names(cells[:1]))
    marked = re.split(r"[\t;,|]+", head.texts[index].strip("\t;,| "))
    if len(marked) < 2 or not all(
        unit_in(cell) is not None or looks_like_names([cell.strip()]) for cell in marked
    ):
        marked = []
    if marked:
        cells, named = marked, True
    if len(cells) < 2 or (2 * len(cells) <= head.width and not named):
        return
    if (
        head.dialect.separator == " "
        and not marked
        and not (
            # Any title has words between blanks.
            near and sum(looks_like_names([cell]) for cell in cells) >= len(cells) - 1
        )
    ):
        return
    if not named and any(head.dialect.is_number(c) or ":" in c for c in cells):
        return
    found = f"{len(marked or head.rows[index])} names ({', '.join(cells)[:40]})"
    expected = f"{head.width} as the rows below have cells, {head.dialect.words}"
    advice = "header = [], with columns by number"
    raise head.error(index, found, expected, advice)


def _refuse_numbers(head: _Head, above: int) -> None:
    """Raise at a line above the header that is a row of another pattern.

    Raises:
        LineError: Naming the first one.
    """
    for at in range(above):
        text = head.texts[at].strip()
        cells = re.split(r",\s+|[;|\s]+", text)
        cells = text.split(",") if len(cells) == 1 else cells
        if len(cells) > 1 and all(map(_ANY_NUMBER.fullmatch, cells)):
            row = head.lines[above]
            expected = f"{head.width} cells, {head.dialect.words}, as in line {row}"
            advice = f"skip = [{head.lines[at]}]"
            raise head.error(at, f"'{text[:40]}'", expected, advice)


def _names(head: _Head, top: Sequence[int]) -> list[Name]:
    """Return the name of each column, from all its header lines."""
    if not top:
        return []
    rows = [_upper_cells(head, at) or list(head.rows[at]) for at in top]
    if len({len(row) for row in rows}) > 1:
        raise head.error(
            top[0], f"{len(rows[0])} names", f"{len(rows[-1])} as below", "header = …"
        )
    for row in rows[:-1]:  # the name of a group stands above its first column
        for at in range(1, len(row)):
            row[at] = row[at] or row[at - 1]
    return [_name(column) for column in zip(*rows, strict=True)]


def _name(cells: Sequence[str]) -> Name:
    """Return the name of a column from its cells in all header lines."""
    parts = list(dict.fromkeys(cell for cell in cells if cell))
    if len(parts) < 2:
        return parse_name("".join(parts))
    # "Run" and "Direction" in front of their rows are no part of the name below.
    labels = [
        bare_role(parse_name(part)) in ("run", "direction") for part in parts[:-1]
    ]
    parts = [*itertools.compress(parts, [not label for label in labels]), parts[-1]]
    units = [unit for part in parts[1:] if (unit := unit_in(part)) is not None]
    name = parse_name(" ".join(part for part in parts if part and not unit_in(part)))
    if not units or name.unit is not None:
        return parse_name(" ".join(parts))
    return dataclasses.replace(name, unit=units[0], doubtful=False)


def _plain_layout(text: str) -> Layout | None:
    """Return the layout of a header above rows of plain numbers between commas.

    That is what most files are, and one look at their first rows tells what `find_layout`
    finds line by line: no other separator leaves several columns, every cell is a number,
    and nothing stands aside. None for all others.
    """
    top, ended, _ = text[:_LONGEST_HEADER].partition("\n")
    if not (ended and top.strip()) or '"' in top or top.startswith("sep="):
        return None
    lines = _FIRST.match(text, len(top) + 1)
    if lines is None:
        return None
    many = lines[0].count("\n") == _BELOW  # else all: the last may end with the text
    body = (lines[0] if many else text[len(top) + 1 :]).removesuffix("\n")
    dialect = Dialect(",", ".")
    header, below = dialect.split(top), body.split("\n")
    width = len(header)
    if len(below) < 2 or width < 2 or not all(header) or dialect.is_comment(top):
        return None
    if {line.count(",") for line in below} != {width - 1}:
        return None
    if not dialect.all_plain(body.replace(",", "\n")):
        return None
    if any(dialect.number(cell) is not None for cell in header):
        return None
    if not any(map(str.isalpha, top)) or is_unit_row(header, width):
        return None
    return Layout(
        dialect=dialect,
        names=tuple(map(parse_name, header)),
        header=tuple(header),
        body=len(top) + 1,
        body_line=2,
        numeric=(True,) * width,
        skipped=(),
        header_lines=(1,),
        plain=not many,
    )


def is_unit_row(cells: Sequence[str], width: int) -> bool:
    """Whether a line holds units, and nothing else, for so many columns.

    Units that the library lacks, such as hPa, may be among them.
    """
    named = [cell for cell in cells if cell.strip("[]()- ") and not is_format(cell)]
    if len(cells) != width or not named:
        return False
    others = [cell for cell in named if unit_in(cell) is None]
    short = all(len(cell) <= _LONGEST_UNIT and not cell[0].isdigit() for cell in others)
    return 2 * len(others) < len(named) and short and not any(map(_says, others))


def _says(cell: str) -> bool:
    """Whether a cell says what a column holds."""
    return looks_like_names([cell])


def _any_number(dialect: Dialect, rows: Sequence[Sequence[str]]) -> bool:
    return any(dialect.is_number(cell) for row in rows for cell in row)


def _is_numeric(dialect: Dialect, rows: Sequence[Sequence[str]], at: int) -> bool:
    cells = [row[at] for row in rows if at < len(row) and row[at]]
    return 2 * dialect.count_numbers(cells) >= len(cells)


def _names_from_comment(
    dialect: Dialect, above: Sequence[str], width: int
) -> list[Name]:
    """Return names from the last comment if that is a header, else column numbers."""
    comments = [line.strip() for line in above if line.strip()]
    if comments:
        cells = dialect.header(comments[-1].lstrip("#%/!; "), width)
        if cells is not None and looks_like_names(cells):
            return [parse_name(cell) for cell in cells]
    return [Name(str(at + 1), None, False, str(at + 1), "") for at in range(width)]
