"""How a text table is written: separator, decimal mark, comments, by its content."""

import csv
import dataclasses
import functools
import itertools
import re
from collections import Counter
from collections.abc import Sequence

_NUMBER = {
    ".": re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"),
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
# Cells that stand for a number which is not there.
_NO_NUMBER = re.compile(
    r"[+-]?(?:nan|inf|infinity)|n/?a|#n/a|null|none|-", re.IGNORECASE
)
_LONGEST = 400
"""Characters of the longest number; converting a longer run of digits takes forever."""
_BLANKS = re.compile(r"[ \t]+")
_COMMENT = re.compile(r"\s*(?:#|%|//|!)")
_CANDIDATES = (
    ("\t", "."),
    (";", "."),
    (",", "."),
    (" ", "."),
    ("\t", ","),
    (";", ","),
    (" ", ","),
    (",", ","),  # only sensible where the numbers are quoted
)


@dataclasses.dataclass(frozen=True)
class Dialect:
    """Separator (a blank stands for any run of blanks and tabs) and decimal mark."""

    separator: str
    decimal: str

    def split(self, line: str) -> list[str]:
        """Return the stripped cells of one line."""
        if self.separator == " ":
            return _BLANKS.split(line.strip())
        if '"' in line:
            row = next(
                csv.reader([line], delimiter=self.separator, skipinitialspace=True)
            )
            return [cell.strip() for cell in row]
        return [cell.strip() for cell in line.split(self.separator)]

    def number(self, cell: str) -> float | None:
        """Return the number in a cell (NaN where it says so), or None for text."""
        return None if len(cell) > _LONGEST else _number(cell, self.decimal)

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
        return (
            len(cell) <= _LONGEST and _NUMBER[self.decimal].fullmatch(cell) is not None
        )

    def is_comment(self, line: str) -> bool:
        """Whether a line opens with ``#``, ``%``, ``!``, ``//`` or a free ``;``."""
        if _COMMENT.match(line):
            return True
        return self.separator != ";" and line.lstrip().startswith(";")


@functools.lru_cache(maxsize=4096)
def _number(cell: str, decimal: str) -> float | None:
    # A table is sniffed several times over, and its cells repeat.
    if _NUMBER[decimal].fullmatch(cell):
        return float(cell.replace(",", "."))
    if cell == "" or _NO_NUMBER.fullmatch(cell):
        return float("nan")
    return None


def sniff(lines: Sequence[str]) -> Dialect:
    """Return the dialect under which most lines split alike and most cells are numbers.

    Args:
        lines: The first lines of the file; comments and blank lines are left aside.
    """
    stated = re.fullmatch(r"sep=(.)\s*", lines[0]) if lines else None
    best, best_score = Dialect(",", "."), (False, -1.0, False, 0)
    lines = lines[1:] if stated else lines
    text = "\n".join(line.strip() for line in lines)
    plain = '"' not in text
    whole: dict[str, tuple[bool, float, bool, int]] = {}
    for separator, decimal in _CANDIDATES:
        if stated is not None and separator != stated.group(1):
            continue
        dialect = Dialect(separator, decimal)
        parts = separator in text or (separator == " " and "\t" in text)
        if best_score[0] and (not parts or (separator == "," == decimal and plain)):
            # A single column does not beat several; nor do, without quotes, numbers
            # that a decimal comma must not split, which are numbers without one too.
            continue
        # All separators that occur nowhere leave the same single column.
        score = None if parts else whole.get(decimal)
        if score is None:
            score = _score(dialect, lines)
            if not parts:
                whole[decimal] = score
        if score > best_score:
            best, best_score = dialect, score
    return best


def _score(dialect: Dialect, lines: Sequence[str]) -> tuple[bool, float, bool, int]:
    usable = (line for line in lines if line.strip() and not dialect.is_comment(line))
    rows = [dialect.split(line) for line in itertools.islice(usable, 200)]
    if not rows:
        return (False, 0.0, False, 0)
    width, alike = Counter(map(len, rows)).most_common(1)[0]
    cells = [cell for row in rows if len(row) == width for cell in row]
    head = len(rows[0]) if len(rows[0]) == width else 0
    # The first row may be a header; all below it are mostly numbers through and through.
    numbers = dialect.count_numbers(cells[:head]) + dialect.count_numbers(cells[head:])
    share = alike / len(rows) * numbers / len(cells)
    # A header that splits like the rows settles "1,5" against "1" and "5"; and several
    # columns that are mostly whole beat a single one, or one short line of few would
    # hide itself.
    header = len(rows[0]) == width
    several = width > 1 and header and share >= 0.3
    return (several, round(share, 2), header, width)
