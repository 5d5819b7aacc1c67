"""Where titles, header, units and rows of a text table lie, and what the columns are called."""

import dataclasses
import itertools
import re
from collections.abc import Sequence
from pathlib import Path

from ._dialect import Dialect, sniff, usual_width
from ._errors import LineError, MeasurementError
from ._head_lines import (
    Head,
    any_number,
    block_above,
    first_row,
    header_above,
    is_unit_row,
    placed,
    refuse_numbers,
    upper_cells,
)
from ._header import Name, bare_role, is_format, parse_name, unit_in
from ._headings import heading, looks_like_names
from ._table import Lines, Skipped

_SAMPLE = 400
_BELOW = 200
"""Rows that tell what a column holds."""
_FIRST = re.compile(rf"(?:[^\n]*+\n){{1,{_BELOW}}}+")
"""So many lines, or fewer."""
_LONGEST_HEADER = 10_000
"""Characters of a header line that one look is enough for."""
_AS_SHOWN = Lines()
_WITH_UNIT = re.compile(
    r"\s*[-+]?\d[\d.,']*\s?(?:mm|[uµ\u03bc]m|nm|m?°|deg|mdeg|arcsec)\s*[;\t|]"
)
"""A row whose first cell holds a number with its unit."""


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
    layout = _plain_layout(text) if lines is None else None
    return layout or _layout_by_lines(path, text, lines or _AS_SHOWN)


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


def _layout_by_lines(path: Path, text: str, rules: Lines = _AS_SHOWN) -> Layout:
    """Return the layout of any text table."""
    offsets, lines = _lines_of_head(text)
    dialect = sniff([line for line in lines if line.strip()])
    comments = [
        at
        for at, line in enumerate(lines)
        if (dialect.is_comment(line) and at + 1 not in (rules.header or ()))
        or (at == 0 and line.casefold().startswith("sep="))
    ]
    aside = set(comments)
    content = [at for at, line in enumerate(lines) if line.strip() and at not in aside]
    if not content:
        reason = "found only comments or blank lines, expected rows of numbers"
        raise MeasurementError(str(path), reason)
    with_units = [at for at in content if _WITH_UNIT.match(lines[at])]
    if 2 * len(with_units) > len(content):
        at = with_units[0]
        cell = (_WITH_UNIT.match(lines[at]) or [""])[0].strip(" ;\t|")
        found = f"'{cell}', a number with its unit"
        expected = "numbers alone, and units in the header, as in 'Soll [mm]'"
        raise LineError(str(path), at + 1, found, expected)
    rows = [dialect.split(lines[at]) for at in content]
    width = usual_width(dialect, rows)
    while width > 1 and not any(row[-1] for row in rows if len(row) == width):
        # Every line ends with a separator, or columns of a sheet are empty.
        rows = [row[:-1] if len(row) == width else row for row in rows]
        width -= 1
    texts = [lines[at] for at in content]
    head = Head(path, dialect, width, [at + 1 for at in content], texts, rows)
    first = first_row(head, rules)
    block = block_above(head, first, rules)
    top, units = header_above(head, first - (block is not None), rules)
    below = rows[first : first + _BELOW]
    names = _names(head, top)
    width = len(names) if top else len(rows[first])
    if not below or (not top and not any_number(dialect, below) and len(below) == 1):
        words = ", ".join(rows[top[-1] if top else first])[:60]
        reason = f"found a header ({words}) and no rows, expected rows"
        raise MeasurementError(str(path), reason)
    if not top:
        names = _names_from_comment(dialect, lines[: content[0]], width)
    if units is not None:
        cells = rows[units]
        if top and len(cells) < width:
            cells = placed(head, units, top[-1])
        for at, cell in enumerate(cells[:width]):
            unit = unit_in(cell) or cell.strip("[]()- ")
            if unit and not is_format(cell):
                stated = None if names[at].doubtful else names[at].unit
                if None not in (stated, unit_in(cell)) and stated != unit:
                    found = f"the unit {unit} below {names[at].header!r}"
                    advice = f"skip = [{head.lines[units]}]"
                    raise head.error(units, found, f"one unit, as {stated}", advice)
                names[at] = dataclasses.replace(names[at], unit=unit, doubtful=False)
    above = top[0] if top else (first if units is None else units)
    refuse_numbers(head, above)
    titles = tuple((head.lines[at], texts[at].strip()) for at in range(above))
    notes = tuple((at + 1, lines[at].strip()) for at in comments if at < content[first])
    skipped = [Skipped(line, "comment") for line, _ in notes]
    skipped += [Skipped(line, "title") for line, _ in titles]
    if block is None and titles and top and heading(titles[-1][1]) is not None:
        block = titles[-1]
    return Layout(
        dialect=dialect,
        names=tuple(names),
        header=tuple(rows[top[-1]]) if top else (),
        body=offsets[content[first]],
        body_line=content[first] + 1,
        numeric=tuple(_is_numeric(dialect, below, at) for at in range(width)),
        skipped=tuple(sorted(skipped, key=lambda item: item.line)),
        header_lines=tuple(head.lines[at] for at in top),
        units_line=None if units is None else head.lines[units],
        titles=titles,
        comments=notes,
        block=block,
    )


def _names(head: Head, top: Sequence[int]) -> list[Name]:
    """Return the name of each column, from all its header lines."""
    if not top:
        return []
    rows = [upper_cells(head, at) or list(head.rows[at]) for at in top]
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
    )


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
