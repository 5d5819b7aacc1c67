"""Where header and body of a text table lie, and what the columns are called."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

from ._dialect import Dialect, sniff
from ._errors import MeasurementError
from ._header import Name, looks_like_names, parse_name
from ._table import Skipped
from ._units import find_unit

_SAMPLE = 400
_BELOW = 200
"""Rows that tell what a column holds."""
_FIRST = re.compile(rf"(?:[^\n]*+\n){{1,{_BELOW}}}+")
"""So many lines, or fewer."""
_LONGEST_HEADER = 10_000
"""Characters of a header line that one look is enough for."""


@dataclasses.dataclass(frozen=True)
class Layout:
    """How a text table is laid out.

    Attributes:
        dialect: Separator and decimal mark.
        names: One per column.
        header: Cells of the header line; empty where there is none.
        body: Offset of the first row in the text.
        body_line: Its line (1-based).
        numeric: Whether a column looks like numbers, from the first rows.
        skipped: Comments above the body.
        plain: Every row of the text is seen to be plain numbers, one per name.
    """

    dialect: Dialect
    names: tuple[Name, ...]
    header: tuple[str, ...]
    body: int
    body_line: int
    numeric: tuple[bool, ...]
    skipped: tuple[Skipped, ...]
    plain: bool = dataclasses.field(default=False, compare=False)


def _head(text: str) -> tuple[list[int], list[str]]:
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


def find_layout(path: Path, text: str) -> Layout:
    """Return the layout of a text table, from its first lines.

    Raises:
        MeasurementError: If there is no row of data.
    """
    return _plain_layout(text) or _layout_by_lines(path, text)


def _layout_by_lines(path: Path, text: str) -> Layout:
    """Return the layout of any text table."""
    offsets, head = _head(text)
    dialect = sniff([line for line in head if line.strip()])
    comments = [
        at
        for at, line in enumerate(head)
        if dialect.is_comment(line) or (at == 0 and line.startswith("sep="))
    ]
    aside = set(comments)
    content = [at for at, line in enumerate(head) if line.strip() and at not in aside]
    if not content:
        reason = "found only comments or blank lines, expected rows of numbers"
        raise MeasurementError(str(path), reason)
    rows = [dialect.split(head[at]) for at in content]
    first = 0
    header: tuple[str, ...] = ()
    units: Sequence[str] = ()
    if _is_header(dialect, rows):
        header, first = tuple(rows[0]), 1
        if len(rows) > 1 and _is_unit_row(rows[1], len(header)):
            units, first = rows[1], 2
    below = rows[first : first + _BELOW]
    if not below:
        reason = f"found a header ({', '.join(header)[:60]}) and no rows, expected rows"
        raise MeasurementError(str(path), reason)
    width = len(header) or len(below[0])
    if header and header[-1] == "" and width > 1:
        width -= 1  # every line ends with a separator
    names = [parse_name(cell) for cell in header[:width]]
    if not header:
        names = _names_from_comment(dialect, head[: content[0]], width)
    for at, cell in enumerate(units[:width]):
        unit = find_unit(cell.strip("[]() "))
        if unit is not None:
            names[at] = dataclasses.replace(names[at], unit=unit.name, doubtful=False)
    body_at = content[first]
    return Layout(
        dialect=dialect,
        names=tuple(names),
        header=header,
        body=offsets[body_at],
        body_line=body_at + 1,
        numeric=tuple(_is_numeric(dialect, below, at) for at in range(width)),
        skipped=tuple(Skipped(at + 1, "comment") for at in comments if at < body_at),
    )


def is_plain(text: str) -> bool:
    """Whether a text, or the first lines of one, is a header above plain numbers."""
    return _plain_layout(text) is not None


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
    if len(below) < 2 or width < 2 or not header[-1] or dialect.is_comment(top):
        return None
    if {line.count(",") for line in below} != {width - 1}:
        return None
    if not dialect.all_plain(body.replace(",", "\n")):
        return None
    one = dialect.split(below[0])
    if not _is_header(dialect, [header, one]) or _is_unit_row(one, width):
        return None
    return Layout(
        dialect=dialect,
        names=tuple(map(parse_name, header)),
        header=tuple(header),
        body=len(top) + 1,
        body_line=2,
        numeric=(True,) * width,
        skipped=(),
        plain=not many,
    )


def _is_header(dialect: Dialect, rows: Sequence[Sequence[str]]) -> bool:
    """Whether the first line names columns: words above numbers, and no number."""
    top, below = rows[0], rows[1:50]
    if not below:
        return not any(dialect.number(cell) is not None for cell in top)
    text_above = number_above = False
    for at, cell in enumerate(top):
        column = [row[at] for row in below if at < len(row)]
        # "nan" is meant as a number: a column with one is no column of words.
        numbers = dialect.count_numbers([cell for cell in column if cell != ""])
        if 2 * numbers < len(column) or not numbers:
            continue
        # A word: "24 -1448819" above numbers is a row that does not fit, not a name.
        text_above |= dialect.number(cell) is None and any(map(str.isalpha, cell))
        number_above |= dialect.is_number(cell)
    return text_above and not number_above


def _is_unit_row(cells: Sequence[str], width: int) -> bool:
    named = [cell.strip("[]() ") for cell in cells if cell.strip("[]() ")]
    return len(cells) == width and bool(named) and all(map(find_unit, named))


def _is_numeric(dialect: Dialect, rows: Sequence[Sequence[str]], at: int) -> bool:
    cells = [row[at] for row in rows if at < len(row) and row[at]]
    return 2 * dialect.count_numbers(cells) >= len(cells)


def _names_from_comment(
    dialect: Dialect, above: Sequence[str], width: int
) -> list[Name]:
    """Return names from the last comment if that is a header, else column numbers."""
    comments = [line.strip() for line in above if line.strip()]
    if comments:
        cells = dialect.split(comments[-1].lstrip("#%/!; "))
        if len(cells) == width and looks_like_names(cells):
            return [parse_name(cell) for cell in cells]
    return [Name(str(at + 1), None, False, str(at + 1), "") for at in range(width)]
