"""The lines of a list, sorted into columns, remarks and special lines.

Nearly every line of a large list is a plain table line, and most of those stand in a
run that differs in indices and values alone. A run is taken in one piece and never
becomes objects. All other lines go through `read_line`, which says the same of plain
lines too (a test holds them together).
"""

import functools
import io
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from ._entry import Rows, TextRemark
from ._grammar import Line, read_line
from ._names import full_name, locate, meaning, split_name
from ._remarks import RemarkCode

PLAIN = re.compile(
    r"[ \t]*+([a-z_][a-z0-9_.]*+)\[ *+([0-9]{1,9}+)\](?:\[ *+([0-9]{1,9}+)\])?+"
    r"\.([a-z_][a-z0-9_.]*+)[ \t]++(-?+[0-9]{1,18}+)(?:[ \t](?![^\S\r\n]*+[0-9])[^\r\n]*+)?+"
    r"(?:\r?+\n|\Z)"
)
"""A lower-case table line with a decimal integer, and maybe a comment that begins with no digit."""
_DIGITS = re.compile(r"-?[0-9]{1,18}")
_ENTRY_LIKE = re.compile(r"\s*[A-Za-z_]\w*(?:\[[\s\d]+\]|\.[A-Za-z_])", re.ASCII)


class Scan(NamedTuple):
    """What the lines of a list hold."""

    columns: dict[str, Rows]
    """Entries by canonical key, in order of first appearance."""
    remarks: tuple[TextRemark, ...]
    continued: frozenset[int]
    """1-based numbers of the lines that only continue a comment."""
    end_line: int | None
    """1-based number of the last closing line, ``End`` or ``Ende``, if any."""

    @property
    def entry_lines(self) -> list[int]:
        """1-based numbers of the lines that hold an entry, ascending."""
        return sorted(line for rows in self.columns.values() for line in rows.lines)

    def place(self, name: str) -> tuple[Rows, int] | None:
        """Return the column of a name, and the row in it that counts; None: no entry.

        The name may be in any case and generation; of several rows the last one counts
        (semantics S-08).
        """
        place = locate(name)
        rows = None if place is None else self.columns.get(place[0])
        if place is None or rows is None or place[1] not in rows.last:
            return None
        return rows, rows.last[place[1]]


class _Column:
    """A column while it grows: index digits, texts and lines as they come."""

    def __init__(self, key: str) -> None:
        self.key = key
        self.digits: list[list[str]] = [[] for _ in range(key.count("[]"))]
        self.texts: list[str] = []
        self.lines: list[int] = []
        self.plain = True

    def add(self, indices: Iterable[str], value: str, number: int) -> None:
        """Add a row of a plain line."""
        for digits, index in zip(self.digits, indices, strict=True):
            digits.append(index)
        self.texts.append(value)
        self.lines.append(number)

    def append(self, line: Line, number: int) -> None:
        """Add a row of any line that holds an entry."""
        self.add(map(str, line.indices), line.value, number)
        self.plain = self.plain and _DIGITS.fullmatch(line.value) is not None

    def rows(self) -> Rows:
        if self.digits:
            numbers = (map(int, digits) for digits in self.digits)
            indices = list(zip(*numbers, strict=True))
        else:
            indices = [()] * len(self.lines)
        return Rows(self.key, indices, self.texts, self.lines, self.plain)


class _Shape(NamedTuple):
    """How plain lines of one name look."""

    key: str
    """Canonical key."""
    line: str
    """Pattern of such a line."""
    ends: tuple[str, str]
    """What stands before its first index and behind its last."""


@functools.lru_cache(maxsize=4096)
def _shape(head: str, tail: str, plane: bool) -> _Shape | None:
    """Return how plain lines of a name look, None if they need a closer look."""
    parts = split_name(f"{head}[0][0].{tail}" if plane else f"{head}[0].{tail}")
    if parts is None:
        return None
    sense = meaning(parts[0])
    if sense.key != parts[0] or sense.style in ("text", "bits"):
        return None
    index = r"\[ *+[0-9]{1,9}+\]"
    name = f"{re.escape(head)}{index * (2 if plane else 1)}\\.{re.escape(tail)}"
    line = rf"[ \t]*+{name}[ \t]++-?+[0-9]{{1,18}}+[ \t]*+\r?+\n"
    return _Shape(sense.key, line, (f"{head}[", f"].{tail}"))


class _Run:
    """How to take a run of plain lines of some names in turn, mostly of one."""

    def __init__(self, shapes: Sequence[_Shape]) -> None:
        self._lines = re.compile(f"(?:{''.join(shape.line for shape in shapes)})++")
        # Of two where one is a part of the other, the longer one goes first.
        ends = {end for shape in shapes for end in shape.ends}
        self._ends = sorted(ends, key=len, reverse=True)

    def take(
        self, text: str, at: int, number: int, columns: Sequence[_Column]
    ) -> tuple[int, int]:
        """Add the rows of a run to their columns; return the place and line after it."""
        match = self._lines.match(text, at)
        if match is None:
            return at, number
        run = match.group()
        for end in self._ends:
            run = run.replace(end, " ")
        parts = run.replace("][", " ").split()
        sizes = [len(column.digits) + 1 for column in columns]
        turns = len(parts) // sum(sizes)
        after = number + turns * len(sizes)
        first = 0
        for place, (column, size) in enumerate(zip(columns, sizes, strict=True)):
            for part, into in enumerate((*column.digits, column.texts)):
                into.extend(parts[first + part :: sum(sizes)])
            column.lines.extend(range(number + place, after, len(sizes)))
            first += size
        return match.end(), after


_run = functools.lru_cache(maxsize=256)(_Run)
"""Lists of a kind of machine have the same tables."""


def split_lines(text: str) -> tuple[str, ...]:
    r"""Return the lines with their line ends: ``\n``, ``\r\n`` and a lone ``\r``."""
    return tuple(io.StringIO(text, newline=""))


def scan(lines: tuple[str, ...]) -> Scan:
    """Return what the lines hold; never raises on what they say."""
    text = "".join(lines)
    continued = _continued_comments(lines)
    columns: dict[str, _Column] = {}
    before: _Shape | None = None
    remarks: list[TextRemark] = []
    end_line: int | None = None
    at, number = 0, 1
    while number <= len(lines):
        match = PLAIN.match(text, at)
        if match is not None:
            head, first, second, tail, value = match.groups()
            shape = _shape(head, tail, second is not None)
            if shape is not None:
                if shape.key not in columns:
                    columns[shape.key] = _Column(shape.key)
                column = columns[shape.key]
                column.add([first, second] if second else [first], value, number)
                # On it goes with this name, or with the one before and this in turn.
                shapes: tuple[_Shape, ...] = (shape,)
                if before is not None and before.key != shape.key:
                    shapes = (before, shape)
                into = [columns[shape.key] for shape in shapes]
                at, number = _run(shapes).take(text, match.end(), number + 1, into)
                before = shape
                continue
        line = lines[number - 1]
        at += len(line)
        if number in continued:
            code = str(RemarkCode.COMMENT_LINE)
            remarks.append(TextRemark(number, 1, code, line.strip()[:20]))
        else:
            parsed = read_line(line)
            remarks.extend(TextRemark(number, *note) for note in parsed.notes)
            if parsed.kind == "end":
                end_line = end_line or number  # the first one ends the list
            elif parsed.kind == "entry":
                if parsed.key not in columns:
                    columns[parsed.key] = _Column(parsed.key)
                columns[parsed.key].append(parsed, number)
        number += 1
    filled = {key: column.rows() for key, column in columns.items() if column.lines}
    for rows in filled.values():
        if len(rows.lines) > 1:
            remarks.extend(_repeated(rows, lines))
    entries = [line for rows in filled.values() for line in rows.lines]
    if end_line is not None and (behind := [k for k in entries if k > end_line]):
        first, code = min(behind), str(RemarkCode.BEHIND_END)
        remarks.append(TextRemark(first, 1, code, lines[first - 1].strip()[:20]))
    remarks.sort(key=lambda remark: (remark.line, remark.column))
    return Scan(filled, tuple(remarks), continued, end_line)


def _continued_comments(lines: tuple[str, ...]) -> frozenset[int]:
    """Return the lines that only continue a ``/*`` comment of a line above.

    Comments end with their line (manual, 1.4: a ``/*`` without ``*/`` is complete), so
    an entry always counts, whatever was opened above it. Lines of plain words between
    an open ``/*`` and its ``*/`` are still better read as comment than as rubbish.
    """
    continued: set[int] = set()
    closers = [number for number, line in enumerate(lines) if "*/" in line]
    for closer in closers:
        line = lines[closer]
        if "/*" in line[: line.index("*/")] or _ENTRY_LIKE.match(line):
            continue
        for number in range(closer - 1, -1, -1):
            above = lines[number]
            opened = above.rfind("/*")
            if opened >= 0:
                if "*/" not in above[opened:]:
                    continued.update(range(number + 2, closer + 2))
                break
            if "*/" in above or _ENTRY_LIKE.match(above):
                break
    return frozenset(continued)


def _repeated(rows: Rows, lines: tuple[str, ...]) -> list[TextRemark]:
    """Return a remark for every entry that a later one of the same name replaces."""
    if len(rows.last) == len(rows.indices):
        return []
    remarks: list[TextRemark] = []
    for row, indices in enumerate(rows.indices):
        last = rows.last[indices]
        if row != last:
            column = read_line(lines[rows.lines[row] - 1]).start + 1
            name = full_name(rows.key, indices)
            text = f"{name}, again in line {rows.lines[last]}"
            remark = TextRemark(rows.lines[row], column, str(RemarkCode.REPEATED), text)
            remarks.append(remark)
    return remarks
