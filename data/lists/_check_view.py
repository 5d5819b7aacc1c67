"""One list as the checker sees it: typed values, places, and the findings so far."""

import functools
from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

from ._entry import Rows
from ._finding import Finding, Level
from ._grammar import Line, read_line
from ._listfile import ListFile
from ._names import full_name
from ._parameter import Parameter
from ._registry import build_has, registry
from ._values import (
    INTEGER_LIMITS,
    parse_bits,
    parse_boolean,
    parse_integer,
    parse_real,
)

LIMIT = 10
"""Findings of one sort that are named one by one; the rest is counted."""

Place: TypeAlias = tuple[int, int]
"""1-based line and column."""


class ListView:
    """One list with its findings; the rules of the checker write into it."""

    def __init__(
        self,
        file: ListFile,
        build: str | None,
        increment: float | None = None,
        plane_index: str = "ji",
        modulo: Mapping[int, tuple[float, float]] | None = None,
    ) -> None:
        """Look at ``file`` as a controller of ``build`` would, the newest if None.

        Args:
            file: The list.
            build: Of the controller.
            increment: mm (or degrees) per encoder increment, where it is known.
            plane_index: First index of a plane table: master 2 (``ji``) or 1 (``ij``).
            modulo: Range in ° by logical number of the axes that go round; None: unknown.
        """
        self.file = file
        self.plane_index = plane_index
        self.build = build
        self.increment = increment
        self.modulo = modulo
        self.columns: Mapping[str, Rows] = file.columns
        self.findings: list[Finding] = []
        self._lines: dict[int, Line] = {}
        self._values: dict[str, int | float | str | None] = {}

    # ---------------------------------------------------------------- what stands there

    def rows(self, key: str) -> Rows | None:
        """Return all entries of a key, None where there is none."""
        return self.columns.get(key)

    def text(self, key: str) -> str | None:
        """Return the text of the entry that counts (the last one), for scalar keys."""
        rows = self.columns.get(key)
        return rows.texts[-1] if rows is not None else None

    def value(self, key: str) -> int | float | str | None:
        """Return the value of a scalar entry, with the default where it is missing.

        None where it cannot be read or is not allowed, which is a finding of its own
        and must not be blamed on others; and where it has no default.
        """
        if key not in self._values:  # several rules ask for the same ones
            self._values[key] = self._value(key)
        return self._values[key]

    def _value(self, key: str) -> int | float | str | None:
        row = registry().by_key[key]
        text = self.text(key)
        if text is None or not build_has(row, self.build):
            return row.default
        value = read_value(row, text)
        if value == 0 and row.zero_is_default:
            return row.default
        return value if _is_allowed(row, value) else None

    def integer(self, key: str) -> int | None:
        """Return the value of a scalar whole number, with its default; None if none."""
        value = self.value(key)
        return value if isinstance(value, int) else None

    def given(self, key: str) -> bool:
        """Return whether the entry stands in the list and is not 0."""
        text = self.text(key)
        if text is None:
            return False
        row = registry().by_key[key]
        return build_has(row, self.build) and bool(read_value(row, text))

    @functools.cached_property
    def structures(self) -> frozenset[str]:
        """Structures that have an entry, such as ``kw.ssfk``."""
        rows = registry().by_key
        return frozenset(rows[key].structure for key in self.columns if key in rows)

    @functools.cached_property
    def in_use(self) -> frozenset[str]:
        """Structures of the compensations that the list sets up.

        A structure that holds only a size, a unit or zeros is idle.
        """
        indexed = [key for key in self.columns if "[]" in key]
        tables = {
            structure
            for structure in self.structures
            if any(key.startswith(f"{structure}.") for key in indexed)
        }
        for function in registry().functions:
            stem = function.structure
            if stem in self.structures and any(
                self.given(f"{stem}.{sign}") for sign in function.signs
            ):
                tables.add(stem)
        return frozenset(tables)

    def first_line(self, structure: str) -> int:
        """Return the first line with an entry of the structure, else 1."""
        parameters = registry().by_key
        lines = (
            rows.lines[0]
            for key, rows in self.columns.items()
            if key in parameters and parameters[key].structure == structure
        )
        return min(lines, default=1)

    # ---------------------------------------------------------------- where it stands

    def line(self, number: int) -> Line:
        """Return the parts of a line by its 1-based number."""
        if number not in self._lines:
            self._lines[number] = read_line(self.file.lines[number - 1])
        return self._lines[number]

    def value_place(self, rows: Rows, row: int) -> Place:
        """Return where the value of a row stands."""
        number = rows.lines[row]
        return number, self.line(number).value_start + 1

    def name_place(self, rows: Rows, row: int) -> Place:
        """Return where the name of a row stands."""
        number = rows.lines[row]
        return number, self.line(number).start + 1

    def place(self, key: str) -> Place:
        """Return where a scalar's value stands, else the start of its structure, or list."""
        rows = self.columns.get(key)
        if rows is not None:
            return self.value_place(rows, len(rows.lines) - 1)
        row = registry().by_key.get(key)
        return (1, 1) if row is None else (self.first_line(row.structure), 1)

    # ---------------------------------------------------------------- findings

    def add(
        self,
        level: Level,
        message: str,
        key: str = "",
        *,
        place: Place | None = None,
        number: int | None = None,
        found: str = "",
        expected: str = "",
    ) -> None:
        """Note a finding.

        Args:
            level: How much it matters.
            message: What it says.
            key: Parameter that it is about; empty: none.
            place: Where; left out: at the parameter, see `place`.
            number: What the controller reports.
            found: What the list holds.
            expected: What the manuals ask for.
        """
        row = registry().by_key.get(key)
        place = self.place(key) if place is None else place
        identity = None if row is None else row.id
        finding = Finding(
            self.file.source, *place, level, identity, number, message, found, expected
        )
        self.findings.append(finding)

    def add_rows(
        self,
        level: Level,
        rows: Rows,
        positions: Sequence[int],
        message: str,
        expected: str,
        number: int | None = None,
    ) -> None:
        """Note a finding for each row; behind `LIMIT` of them, one for the rest.

        Args:
            level: Level of the findings.
            rows: Column of the list.
            positions: In it, ascending.
            message: Sentence with ``{name}`` and ``{text}`` of an entry.
            expected: What the manuals ask for.
            number: What the controller reports.
        """
        further = len(positions) - LIMIT
        for count, row in enumerate(positions[: LIMIT + 1]):
            text = rows.texts[row]
            found, name = text, full_name(rows.key, rows.indices[row])
            words = message.format(name=name, text=text)
            if count == LIMIT:
                words = message.format(name=rows.key, text=text)
                words += f"; {further} such values from here on"
                found = f"{further} values"
            self.add(
                level,
                words,
                rows.key,
                place=self.value_place(rows, row),
                number=number,
                found=found,
                expected=expected,
            )


def read_value(row: Parameter, text: str) -> int | float | str | None:
    """Return the value of an entry in list units; None where it cannot be read."""
    if row.type == "BOOLEAN":
        truth = parse_boolean(text)
        return parse_integer(text) if truth is None else int(truth)
    if row.type == "REAL64":
        return parse_real(text)
    if row.type == "BITS":
        return parse_bits(text)
    if row.type == "STRING":
        return text.upper() if row.words else text
    return parse_integer(text)


def _is_allowed(row: Parameter, value: int | float | str | None) -> bool:
    """Return whether at least one statement of the manuals allows the value."""
    if value is None or isinstance(value, str):
        return not row.words or value in row.words
    bottom, top = INTEGER_LIMITS.get(row.type, (value, value))
    if not bottom <= value <= top:
        return False
    if row.values:
        return value in row.values
    ranges = [range_ for range_ in (row.range, row.wide_range) if range_ is not None]
    allowed = not ranges or any(range_.holds(value, value) for range_ in ranges)
    return allowed or value in row.also


def shorten(numbers: Iterable[object], count: int) -> str:
    """Return the first few of ``count`` things: ``3, 4, 5, … (17)``."""
    texts: list[str] = []
    for number in numbers:
        texts.append(str(number))
        if len(texts) == 3:
            break
    return ", ".join(texts) + (f", … ({count})" if count > len(texts) else "")
