"""How a text table is written: separator, decimal mark, comments, by its content."""

import csv
import dataclasses
import functools
import itertools
import re
from collections import Counter
from collections.abc import Sequence

from ._dates import is_instant
from ._headings import looks_like_names
from ._words import kind_said

NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
"""A number with a decimal point."""
_NUMBER = {
    ".": NUMBER,
    ",": re.compile(r"[+-]?(?:\d+(?:,\d+)?|,\d+)(?:[eE][+-]?\d+)?"),
}
# Lines of short numbers: one look at all of them, faster without other scripts' digits.
_MANY = {
    ".": re.compile(
        r"(?:[+-]?+(?:\d{1,40}+\.?+\d{0,40}+|\.\d{1,40}+)(?:[eE][+-]?+\d{1,9}+)?+(?:\n|\Z))++",
        re.ASCII,
    ),
    ",": re.compile(
        r"(?:[+-]?+(?:\d{1,40}+(?:,\d{1,40}+)?+|,\d{1,40}+)(?:[eE][+-]?+\d{1,9}+)?+(?:\n|\Z))++",
        re.ASCII,
    ),
}
# Digits in groups of three with a mark between them, by the decimal mark.
_GROUPED = {
    ".": re.compile(
        r"[+-]?\d{1,3}(?:(?P<mark>[,' ])\d{3})(?:(?P=mark)\d{3})*(?:\.\d+)?"
    ),
    ",": re.compile(
        r"[+-]?\d{1,3}(?:(?P<mark>[.' ])\d{3})(?:(?P=mark)\d{3})*(?:,\d+)?"
    ),
}
_WHOLE = re.compile(r"[+-]?[1-9]\d{2}|0")
_GROUP_OF_NONE = {
    mark: re.compile(
        rf"(?<![\d{mark}])[+-]?[1-9]\d{{0,2}}(?:[{mark}]\d{{3}})*[{mark}]\d00(?![\d{mark}])"
    )
    for mark in (".", ",")
}
_OTHER = {".": ",", ",": "."}
# Cells that stand for a number which is not there.
_NO_NUMBER = re.compile(
    r"[+-]?(?:nan|inf|infinity)|n/?a|#n/a|#nv|null|none|-+|k\.?a\.?|#?div/0!?",
    re.IGNORECASE,
)
_LONGEST = 400
"""Characters of the longest number; converting a longer run of digits takes forever."""
_BLANKS = re.compile(r"[ \t]+")
_UNIT_IN_BRACKETS = re.compile(r"\s+(?=[\[(][^\])]*[\])])")
_UNIT_BEHIND = re.compile(r"\s*[\[(/].*")
_COMMENT = re.compile(r"\s*(?:#|%|//|!)")
_RULE = re.compile(r"[\s|;,+:=-]*(?:-{3}|={3}|_{3})[\s|;,+:=_-]*")
"""A line that is drawn below a header or around a table."""
_CANDIDATES = (
    ("\t", "."),
    (";", "."),
    (",", "."),
    (" ", "."),
    ("\t", ","),
    (";", ","),
    (" ", ","),
    (",", ","),  # only sensible where the numbers are quoted
    ("|", "."),
    ("|", ","),
)
SEPARATORS = {
    ",": "commas",
    ";": "semicolons",
    "\t": "tabs",
    " ": "blanks",
    "|": "bars '|'",
}
"""Separators in words."""


@dataclasses.dataclass(frozen=True)
class Dialect:
    """Separator (a blank stands for any run of blanks and tabs), decimal and group mark."""

    separator: str
    decimal: str
    thousands: str = ""

    @property
    def words(self) -> str:
        """How the cells are separated, for messages."""
        return f"separated by {SEPARATORS.get(self.separator, repr(self.separator))}"

    def split(self, line: str) -> list[str]:
        """Return the stripped cells of one line."""
        if self.separator == " ":
            return _BLANKS.split(line.strip())
        if self.separator == "|":  # also as in Markdown, with bars around the row
            line = line.strip().removeprefix("|").removesuffix("|")
        if '"' in line:
            row = next(
                csv.reader([line], delimiter=self.separator, skipinitialspace=True)
            )
            return [cell.strip() for cell in row]
        return [cell.strip() for cell in line.split(self.separator)]

    def header(self, line: str, width: int) -> list[str] | None:
        """Return the names that a line gives to so many columns, or None.

        Between blanks, names and units may hold blanks themselves. Names that can be nothing
        else may stand between other separators than the rows.
        """
        splits = [self.split(line)]
        if self.separator == " ":
            text = line.strip()
            splits.append(re.split(r"\s{2,}|\t", text))
            glued = _UNIT_IN_BRACKETS.sub("\0", text)
            splits.append([cell.replace("\0", " ") for cell in glued.split()])
        for cells in splits:
            while len(cells) > width and cells[-1] == "":
                cells = cells[:-1]
            if len(cells) == width:
                return cells
        for mark in SEPARATORS.keys() - {self.separator, " "}:
            cells = [cell.strip() for cell in line.split(mark)]
            if len(cells) == width > 1 and looks_like_names(cells):
                return cells
        return None

    def number(self, cell: str) -> float | None:
        """Return the number in a cell (NaN where it says so), or None for text."""
        if len(cell) > _LONGEST:
            return None
        return _number(cell, self.decimal, self.thousands)

    def count_numbers(self, cells: Sequence[str]) -> int:
        """Return how many cells hold a number, or say that one is not there."""
        if self.all_plain("\n".join(cells)):
            return len(cells)
        return sum(self.number(cell) is not None for cell in cells)

    def all_plain(self, cells: str) -> bool:
        """Whether every line is one finite number of ordinary length in ASCII digits."""
        if not cells or cells.endswith("\n"):
            return False  # the pattern takes the end of a line for the last one's
        return _MANY[self.decimal].fullmatch(cells) is not None

    def is_number(self, cell: str) -> bool:
        """Whether a cell holds a finite number."""
        value = self.number(cell)
        return value is not None and value == value and abs(value) != float("inf")

    def is_comment(self, line: str) -> bool:
        """Whether a line opens with ``#``, ``%``, ``!``, ``//``, a free ``;``, or is drawn."""
        if _COMMENT.match(line) or _RULE.fullmatch(line):
            return True
        return self.separator != ";" and line.lstrip().startswith(";")


@functools.lru_cache(maxsize=4096)
def _number(cell: str, decimal: str, thousands: str) -> float | None:
    # A table is sniffed several times over, and its cells repeat.
    if _NUMBER[decimal].fullmatch(cell):
        return float(cell.replace(",", "."))
    if cell == "" or _NO_NUMBER.fullmatch(cell):
        return float("nan")
    grouped = _GROUPED[decimal].fullmatch(cell)
    if grouped and (mark := grouped["mark"]):
        # "1.234" alone may be either; with a decimal mark behind it, it is a group. An
        # apostrophe is never anything else.
        if mark in (thousands, "'") or decimal in cell:
            return float(cell.replace(mark, "").replace(",", "."))
    return None


def sniff(lines: Sequence[str]) -> Dialect:
    """Return the dialect under which most lines split alike and most cells are numbers.

    Args:
        lines: The first lines of the file; comments and blank lines are left aside.
    """
    declared = re.fullmatch(r"sep=(.)\s*", lines[0], re.IGNORECASE) if lines else None
    best, best_score = Dialect(",", "."), (False, -1.0, False, 0)
    lines = lines[1:] if declared else lines
    text = "\n".join(line.strip() for line in lines)
    unquoted = '"' not in text
    single: set[str] = set()
    for separator, decimal in _CANDIDATES:
        if declared is not None and separator != declared.group(1):
            continue
        # "1.234" beside a decimal comma is a group of digits.
        dialect = Dialect(separator, decimal, "." if decimal == "," else "")
        parts = separator in text or (separator == " " and "\t" in text)
        if best_score[0] and (not parts or (separator == "," == decimal and unquoted)):
            # A single column does not beat several; nor do, without quotes, numbers
            # that a decimal comma must not split, which are numbers without one too.
            continue
        if not parts and decimal in single:
            continue  # separators that occur nowhere leave the same single column
        if not parts:
            single.add(decimal)
        score = _score(dialect, lines)
        if score > best_score:
            best, best_score = dialect, score
    if _grouped_whole(best, lines):
        return Dialect(best.separator, _OTHER[best.decimal], best.decimal)
    return dataclasses.replace(best, thousands=_group_mark(best, lines))


def _grouped_whole(dialect: Dialect, lines: Sequence[str]) -> bool:
    """Whether all marks of a table stand in whole numbers, as of 0, 500, 1.000, 1.500.

    Nobody writes decimals of 1.000 and none of 500 or 0.
    """
    mark, other = dialect.decimal, _OTHER[dialect.decimal]
    of_none = _GROUP_OF_NONE[mark]
    if not any(of_none.search(line) for line in lines):
        return False
    rows = [dialect.split(line) for line in itertools.islice(lines, 400)]
    cells = [cell for row in rows for cell in row if dialect.is_number(cell)]
    marked = [cell for cell in cells if mark in cell]
    if not all(
        _GROUPED[other].fullmatch(cell) and cell.lstrip("+-")[0] != "0"
        for cell in marked
    ):
        return False
    columns = itertools.zip_longest(*rows, fillvalue="")
    return any(
        any(map(_WHOLE.fullmatch, column)) and any(map(of_none.fullmatch, column))
        for column in columns
    )


def _group_mark(dialect: Dialect, lines: Sequence[str]) -> str:
    """Return the mark between groups of digits, from numbers that can only be such."""
    other = _OTHER[dialect.decimal]
    if not any(mark in line for line in lines for mark in (other, "'", " ")):
        return ""
    for line in itertools.islice(lines, 100):
        for cell in dialect.split(line):
            grouped = _GROUPED[dialect.decimal].fullmatch(cell)
            mark = grouped["mark"] if grouped else ""
            if mark == "." or (
                mark and (dialect.decimal in cell or cell.count(mark) > 1)
            ):
                return str(mark)
    return ""


def _score(dialect: Dialect, lines: Sequence[str]) -> tuple[bool, float, bool, int]:
    usable = (line for line in lines if line.strip() and not dialect.is_comment(line))
    rows = [dialect.split(line) for line in itertools.islice(usable, 100)]
    if not rows:
        return (False, 0.0, False, 0)
    width = usual_width(dialect, rows)
    first = first_row_of_numbers(dialect, rows, width)
    body = [row for row in rows[first:] if len(row) == width]
    cells = [cell for row in body for cell in row]
    numbers = dialect.count_numbers(cells)
    if numbers < len(cells):
        numbers = sum(dialect.number(c) is not None or is_instant(c) for c in cells)
    share = len(body) / len(rows[first:]) * numbers / len(cells)
    # A header that splits like the rows settles "1,5" against "1" and "5"; and several
    # columns that are mostly whole beat a single one, or one short line of few would
    # hide itself.
    above = rows[first - 1]
    header = first == 0 or len(above) == width
    header |= len(above) == width + 1 and above[-1] == ""
    header |= width > 3 and abs(len(above) - width) == 1  # with a name too few or many
    header |= begins_with_name(body[0][0])  # targets along the top
    several = width > 1 and header and share >= 0.3
    return (several, round(share, 2), header or len(above) > 1, width)


def begins_with_name(cell: str) -> bool:
    """Whether the first cell of a line of numbers names what these are: positions or runs."""
    return kind_said(_UNIT_BEHIND.sub("", cell)) in ("position", "run")


def usual_width(dialect: Dialect, rows: Sequence[Sequence[str]]) -> int:
    """Return the number of cells of most rows that hold a number.

    A row of words of that width, which may be a header, counts half.
    """
    weights: Counter[int] = Counter()
    words = set()
    for row in rows:
        numbers = sum(map(dialect.is_number, row))
        weights[len(row)] += 2 * (numbers > 0)
        if not numbers and len(row) > 1:
            words.add(len(row))
    for width in words:
        weights[width] += 1
    return max(weights, key=lambda width: (weights[width], width))


def first_row_of_numbers(
    dialect: Dialect, rows: Sequence[Sequence[str]], width: int
) -> int:
    """Return the index of the first row that is like the most: numbers where they have some.

    The first one, where no row is like that.
    """
    regular = [row for row in rows if len(row) == width]
    lower = regular[len(regular) // 2 :]
    columns = [
        at
        for at in range(width)
        if (filled := [row[at] for row in lower if row[at]])
        and 2 * sum(map(dialect.is_number, filled)) > len(filled)
    ]
    if not columns:
        return 0
    for index, row in enumerate(rows):
        if len(row) != width:
            continue
        numbers = sum(dialect.is_number(row[at]) for at in columns)
        words = sum(dialect.number(row[at]) is None for at in columns)
        first = dialect.number(row[columns[0]]) is not None and row[columns[0]] != ""
        if numbers and first and (2 * numbers >= len(columns)) and words < numbers:
            return index
    return 0
