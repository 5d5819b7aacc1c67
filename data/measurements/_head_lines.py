"""Which of the first lines of a text table are titles, header, units and rows."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ._dialect import Dialect, begins_with_name, first_row_of_numbers
from ._errors import LineError, MeasurementError
from ._header import is_format, unit_in
from ._headings import heading, looks_like_names
from ._table import Lines

_MOST_HEADERS = 4
_LONGEST_UNIT = 8
_BROKEN_NUMBER = re.compile(r"[\d.,]*\d\s?[-−]|\([\d.,]*\d\)")
"""A negative number as book-keepers write it."""
_ANY_NUMBER = re.compile(r"[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?")


@dataclasses.dataclass(frozen=True)
class Head:
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


def first_row(head: Head, lines: Lines) -> int:
    """Return the index of the first row of the body."""
    start = 0
    if lines.rows is not None:
        start = lines.rows[0]
    elif lines.header:
        start = max(lines.header) + 1
    index = next((k for k, line in enumerate(head.lines) if line >= start), None)
    if index is None:
        reason = f"found no row from line {start} on, as the job has it, expected some"
        raise MeasurementError(str(head.path), reason)
    if start:
        units = lines.rows is None and is_unit_row(head.rows[index], head.width)
        return index + units if index + units < len(head.rows) else index
    first = first_row_of_numbers(head.dialect, head.rows, head.width)
    if first == 0 and not any_number(head.dialect, head.rows[:1]):
        # A table of words: below what can only be a header.
        return int(len(head.rows) > 1 and looks_like_names(head.rows[0]))
    if _names_rows(head, first):
        return first + 1
    # A row of numbers with a word among them belongs to the body.
    while first > 0 and _is_damaged_row(head, first - 1):
        first -= 1
    return first


def _names_rows(head: Head, index: int) -> bool:
    """Whether a line has a name in front of its numbers, and the next one names a run."""
    if index + 1 >= len(head.rows):
        return False
    name, below = head.rows[index][0], head.rows[index + 1][0]
    return begins_with_name(name) and heading(below) is not None


def _is_damaged_row(head: Head, index: int) -> bool:
    cells = head.rows[index]
    if len(cells) != head.width or is_unit_row(cells, head.width):
        return False
    is_name = heading(cells[0]) is not None or looks_like_names(cells[:1])
    is_name |= not cells[0] or unit_in(cells[0]) is not None
    broken = any(map(_BROKEN_NUMBER.fullmatch, cells))
    return (broken or not is_name) and any(map(head.dialect.is_number, cells))


def block_above(head: Head, first: int, lines: Lines) -> tuple[int, str] | None:
    """Return the line right above the rows that names their run or direction, or None."""
    if first == 0 or head.width == 1 or lines.header is not None:
        return None
    cells = head.rows[first - 1]
    words = " ".join(filter(None, cells))
    if not cells[0] or first == 1 or heading(words) is None:
        return None
    return head.lines[first - 1], words


def header_above(head: Head, first: int, lines: Lines) -> tuple[list[int], int | None]:
    """Return the indices of the header lines above a body, and of the units."""
    if lines.rows is not None:
        # Rows may be left out at the top, between the names and those that count.
        while first > 0 and all(map(head.dialect.is_number, head.rows[first - 1])):
            first -= 1
    at, units = first - 1, None
    if at >= 0 and (
        is_unit_row(head.rows[at], head.width) or _has_units_of_some(head, at)
    ):
        at, units = at - 1, at
    if lines.header is not None:
        missing = [line for line in lines.header if line not in head.lines]
        if missing:
            found = "nothing there, or a comment"
            raise LineError(str(head.path), missing[0], found, "the header line")
        return [head.lines.index(line) for line in sorted(lines.header)], units
    top: list[int] = []
    while at >= 0 and len(top) < _MOST_HEADERS:
        if not (_is_upper_header if top else _is_header)(head, at):
            break
        top.insert(0, at)
        at -= 1
    return top, units


def _has_units_of_some(head: Head, index: int) -> bool:
    """Whether a line between blanks holds units in brackets for some of the names above."""
    cells = head.rows[index]
    return (
        head.dialect.separator == " "
        and len(cells) < head.width
        and index > 0
        and head.dialect.header(head.texts[index - 1], head.width) is not None
        and all(cell[0] in "[(" and unit_in(cell) is not None for cell in cells)
    )


def placed(head: Head, units: int, names: int) -> list[str]:
    """Return the units of a line, each for the name that it stands nearest to.

    Raises:
        LineError: If two stand under one name.
    """
    cells = head.rows[units]
    above = head.dialect.header(head.texts[names], head.width) or []
    middles = np.array(_middles(head.texts[names], above))
    result = [""] * head.width
    for cell, middle in zip(cells, _middles(head.texts[units], cells), strict=True):
        nearest = int(np.argmin(np.abs(middles - middle)))
        if result[nearest]:
            stand = f"the units {result[nearest]} and {cell} under '{above[nearest]}'"
            raise head.error(units, stand, "one", f"skip = [{head.lines[units]}]")
        result[nearest] = cell
    return result


def _middles(text: str, cells: Sequence[str]) -> list[float]:
    """Return where the middle of each cell stands in a line."""
    middles, end = [], 0
    text = text.expandtabs()
    for cell in cells:
        start = text.index(cell, end)
        end = start + len(cell)
        middles.append(0.5 * (start + end))
    return middles


def _is_header(head: Head, index: int) -> bool:
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


def _is_upper_header(head: Head, index: int) -> bool:
    """Whether a line above a header names groups of columns."""
    cells = upper_cells(head, index)
    if cells is None or heading(head.texts[index]) is not None:
        return False
    filled = [at for at, cell in enumerate(cells) if cell]
    below = head.rows[index + 1]
    fills = any(at < len(below) and not below[at] for at in filled)
    named = 2 * sum(looks_like_names([cells[at]]) for at in filled) > len(filled)
    wide = len(filled) > 1 and filled[-1] >= head.width // 2
    return named and (wide or (fills and len(filled) > 1))


def upper_cells(head: Head, index: int) -> list[str] | None:
    """Return the cells of a line above a header, empty ones added where it ends early."""
    cells = list(head.rows[index])
    if head.dialect.separator != " " and 1 < len(cells) < head.width:
        return cells + [""] * (head.width - len(cells))
    return head.dialect.header(head.texts[index], head.width)


def _refuse_other_width(head: Head, index: int) -> None:
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


def refuse_numbers(head: Head, above: int) -> None:
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


def is_unit_row(cells: Sequence[str], width: int) -> bool:
    """Whether a line holds units, and nothing else, for so many columns.

    Units that the library lacks, such as hPa, may be among them.
    """
    units = [cell for cell in cells if cell.strip("[]()- ") and not is_format(cell)]
    if len(cells) != width or not units:
        return False
    odd = [cell for cell in units if unit_in(cell) is None]
    short = all(len(cell) <= _LONGEST_UNIT and not cell[0].isdigit() for cell in odd)
    named = any(looks_like_names([cell]) for cell in odd)
    return 2 * len(odd) < len(units) and short and not named


def any_number(dialect: Dialect, rows: Sequence[Sequence[str]]) -> bool:
    return any(dialect.is_number(cell) for row in rows for cell in row)
