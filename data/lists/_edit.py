"""Editing the lines of a list: what is not named stays byte for byte as it is."""

import bisect
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from ._format import (
    EntryValueError,
    UnknownEntryError,
    comment_lines,
    known_place,
    value_texts,
)
from ._grammar import Line, read_line
from ._names import BLANKS, full_name, locate, meaning
from ._parameter import structure_of
from ._scan import PLAIN, Scan
from ._values import parse_boolean, parse_integer


class Addition(NamedTuple):
    """An entry to add."""

    key: str
    indices: tuple[int, ...]
    text: str

    @property
    def name(self) -> str:
        """Canonical name with indices."""
        return full_name(self.key, self.indices)


def changes(
    scan: Scan, values: Mapping[str, object], source: str, encoding: str
) -> dict[int, tuple[str, bool]]:
    """Return the new text of a value, and whether it is a number, by 1-based line.

    Raises:
        UnknownEntryError: If the list has no entry of a name.
        EntryValueError: If a value does not fit its parameter or the encoding.
    """
    lines: dict[str, list[int]] = {}
    names: dict[str, list[str]] = {}
    for name in values:
        place = scan.place(name)
        if place is None:
            raise UnknownEntryError(source, name, "the name of an entry of this list")
        rows, row = place
        lines.setdefault(rows.key, []).append(rows.lines[row])
        names.setdefault(rows.key, []).append(name)
    changed: dict[int, tuple[str, bool]] = {}
    for key, numbers in lines.items():
        inputs = [values[name] for name in names[key]]
        texts = value_texts(key, names[key], inputs, source)
        check_encoding(names[key], texts, source, encoding)
        sense = meaning(key)
        is_number = sense.style == "number" and not sense.boolean
        for number, text in zip(numbers, texts, strict=True):
            changed[number] = text, is_number
    return changed


def check_encoding(
    names: list[str], texts: list[str], source: str, encoding: str
) -> None:
    """Refuse texts that the encoding of the list lacks."""
    if "".join(texts).isascii():
        return
    for name, text in zip(names, texts, strict=True):
        if not text.isascii():
            try:
                text.encode(encoding)
            except UnicodeEncodeError:
                expected = f"characters that the encoding of the list ({encoding}) has"
                raise EntryValueError(source, name, repr(text), expected) from None


def rewrite(
    lines: tuple[str, ...], changed: Mapping[int, tuple[str, bool]]
) -> tuple[str, ...]:
    """Return the lines with new values; only the characters of a value change."""
    new = list(lines)
    for number, (text, is_number) in changed.items():
        match = PLAIN.match(lines[number - 1]) if is_number else None
        if match is not None:
            start, end = match.span(5)
            old = lines[number - 1]
            if parse_integer(match[5]) != parse_integer(text):
                new[number - 1] = f"{old[:start]}{text}{old[end:]}"
            continue
        line = read_line(lines[number - 1])
        if _holds(line, text):
            continue
        start, end = line.value_start, line.value_end
        before, after = lines[number - 1][:start], lines[number - 1][end:]
        # An entry without a value, and a comment glued to one, get the blank they need.
        lead = "" if before.endswith(tuple(BLANKS)) else " "
        tail = " " if line.glued or after.startswith(("#", "(", "/*")) else ""
        new[number - 1] = f"{before}{lead}{text}{tail}{after}"
    return tuple(new)


def _holds(line: Line, text: str) -> bool:
    """Return whether the line has the value already, in whatever spelling."""
    if not (line.value or line.quoted):
        return False
    sense = meaning(line.key)
    if sense.boolean:
        return parse_boolean(line.value) == parse_boolean(text)
    if sense.style == "text":
        return line.value == text.strip('"')
    number = parse_integer(line.value)
    return line.value == text or (number is not None and number == parse_integer(text))


def additions(
    values: Mapping[str, object], source: str, encoding: str
) -> list[Addition]:
    """Return the entries to add, checked against the registry.

    Raises:
        UnknownEntryError: If no manual knows a name.
        EntryValueError: If a value does not fit its parameter or the encoding.
    """
    columns: dict[str, list[tuple[tuple[int, ...], str]]] = {}
    for name in values:
        key, indices = known_place(name, source)
        columns.setdefault(key, []).append((indices, name))
    added: list[Addition] = []
    for key, places in columns.items():
        names = [name for _, name in places]
        texts = value_texts(key, names, [values[name] for name in names], source)
        check_encoding(names, texts, source, encoding)
        for (indices, _), text in zip(places, texts, strict=True):
            added.append(Addition(key, indices, text))
    return added


def insert(
    lines: tuple[str, ...],
    scan: Scan,
    entries: list[Addition],
    *,
    comment: str | None,
    newline: str,
    encoding: str,
) -> tuple[str, ...]:
    """Return the lines with new entries; see `ListFile.merge` for where they go.

    Args:
        lines: The list.
        scan: What it holds.
        entries: Those that it lacks.
        comment: Comment line above the first of them.
        newline: Line end of the list.
        encoding: Encoding of the list.
    """
    stems = list(dict.fromkeys(structure_of(entry.key) for entry in entries))
    entries = sorted(
        entries,
        key=lambda entry: (
            stems.index(structure_of(entry.key)),
            bool(entry.indices),
            entry.indices,
        ),
    )
    places = _Places(lines, scan)
    inserted: dict[int, list[str]] = {}
    for entry in entries:
        after, sample = places.find(entry)
        while after + 1 in scan.continued:
            after += 1  # never between a comment and its last line
        inserted.setdefault(after, []).append(_line_like(lines, sample, entry, newline))
    new: list[str] = []
    remarks = [] if comment is None else comment_lines(comment, encoding, newline)
    for number in range(len(lines) + 1):
        if number:
            new.append(lines[number - 1])
        if number not in inserted:
            continue
        if new and not new[-1].endswith(("\n", "\r")):
            new[-1] += newline  # the last line had no end of its own
        new += remarks + inserted[number]
        remarks = []
    return tuple(new)


def _line_like(
    lines: tuple[str, ...], sample: int | None, entry: Addition, newline: str
) -> str:
    """Return a line for the entry, laid out like its neighbour."""
    indent, column = "", len(entry.name) + 2
    if sample is not None:
        line = read_line(lines[sample - 1])
        indent = lines[sample - 1][: line.start]
        column = max(line.value_start - line.start, len(entry.name) + 1)
        if indent.strip(" \t"):
            indent = ""  # a byte order mark belongs to the first line alone
    return f"{indent}{entry.name:<{column}}{entry.text}{newline}"


class _Places:
    """Where new entries belong among the lines of a list."""

    def __init__(self, lines: tuple[str, ...], scan: Scan) -> None:
        self._scan = scan
        self._end = _end_of(lines, scan)
        self._sorted: dict[str, list[tuple[tuple[int, ...], int]] | None] = {}

    def find(self, entry: Addition) -> tuple[int, int | None]:
        """Return the line after which the entry goes, and one to lay it out like."""
        if entry.indices and (place := self._in_table(entry)) is not None:
            return place
        scalars, tables = self._structure(structure_of(entry.key))
        if not entry.indices and tables:
            # Sizes stand before the table that they speak of (semantics S-08).
            before = [line for line in scalars if line < tables[0]]
            return (before[-1], before[-1]) if before else (tables[0] - 1, tables[0])
        if scalars or tables:
            last = max(scalars[-1:] + tables[-1:])
            return last, last
        entries = self._scan.entry_lines
        if structure_of(entry.key) == "kopf" and entries:
            return entries[0] - 1, entries[0]
        return self._end, None

    def _in_table(self, entry: Addition) -> tuple[int, int] | None:
        """Return the place by index, where the column of the entry stands in order."""
        if entry.key not in self._sorted:
            rows = self._scan.columns.get(entry.key)
            pairs = (
                [] if rows is None else list(zip(rows.indices, rows.lines, strict=True))
            )
            self._sorted[entry.key] = pairs if pairs == sorted(pairs) else None
        ordered = self._sorted[entry.key]
        if not ordered:
            return None
        at = bisect.bisect_left(ordered, (entry.indices, 0))
        if at == 0:
            return ordered[0][1] - 1, ordered[0][1]
        return ordered[at - 1][1], ordered[at - 1][1]

    def _structure(self, stem: str) -> tuple[list[int], list[int]]:
        """Return the lines of a structure, scalars and table entries, ascending."""
        scalars: list[int] = []
        tables: list[int] = []
        for key, rows in self._scan.columns.items():
            if structure_of(key) == stem:
                (tables if "[" in key else scalars).extend(rows.lines)
        return sorted(scalars), sorted(tables)


def _end_of(lines: tuple[str, ...], scan: Scan) -> int:
    """Return the number of lines before the closing one, or of all lines."""
    if scan.end_line is not None:
        return scan.end_line - 1
    last = len(lines)
    while last and not lines[last - 1].strip():
        last -= 1
    if last and lines[last - 1].strip().lower() in ("# end", "# ende", "#end", "#ende"):
        return last - 1
    return len(lines)


def without(
    lines: tuple[str, ...], scan: Scan, names: Iterable[str]
) -> tuple[str, ...]:
    """Return the lines without those of the named entries."""
    columns: dict[str, set[tuple[int, ...]]] = {}
    for name in names:
        place = locate(name)
        if place is not None:
            columns.setdefault(place[0], set()).add(place[1])
    removed: set[int] = set()
    for key, indices in columns.items():
        rows = scan.columns.get(key)
        if rows is not None:
            for at, line in zip(rows.indices, rows.lines, strict=True):
                if at in indices:
                    removed.add(line)
    return tuple(line for number, line in enumerate(lines, 1) if number not in removed)
