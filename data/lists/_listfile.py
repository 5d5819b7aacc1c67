"""`ListFile`: a list as the file holds it, byte for byte, and what it says."""

import dataclasses
import functools
import html
import pathlib
import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Literal, TypeAlias

from ..html import table_html
from . import _edit
from ._entry import Entry, Rows, TextRemark
from ._grammar import read_line
from ._registry import registry
from ._remarks import RemarkCode
from ._scan import Scan, scan, split_lines
from ._values import parse_boolean

Value: TypeAlias = str | int | float | bool
"""What an entry can be set to."""
Encoding: TypeAlias = Literal["ascii", "utf-8", "latin-1"]

_SHORT = 2048
"""Lines up to which a list is looked up among the last ones."""
_SHOWN = 60
"""Entries that a notebook shows."""
_NOT_ASCII = re.compile(r"[^\x00-\x7f]")


_kept_scan = functools.lru_cache(maxsize=8)(scan)
"""A list is written, read back and checked: the same text then says the same."""


@dataclasses.dataclass(frozen=True)
class ListFile:
    """A compensation, axis or start-up list: lossless text below, typed access above.

    The lines are all there is; layout and comments live nowhere else, so
    ``ListFile.parse(raw).dumps() == raw`` for any bytes whatever. Entries are found on
    first use and kept. Editing returns a new list.
    """

    lines: tuple[str, ...]
    """The text, with its line ends."""
    source: str = "<text>"
    """Where the list comes from, for messages."""
    encoding: Encoding = "ascii"
    """How the file is encoded: ASCII, else UTF-8, else Latin-1 (semantics S-09)."""

    def _repr_html_(self) -> str:
        """Return the entries as a table, for a notebook; of a long list the first ones."""
        table = table_html((), [(e.name, e.value) for e in self.entries[:_SHOWN]])
        count = len(self.entries) - _SHOWN
        note = f"<p>… and {count} more entries</p>" if count > 0 else ""
        head = f"<p><b>{html.escape(self.source)}</b>: {self.kind} list</p>"
        return f"{head}{table}{note}"

    @classmethod
    def parse(cls, raw: bytes, source: str = "<text>") -> "ListFile":
        """Return the list that the bytes hold; never raises on what they are."""
        for encoding in ("ascii", "utf-8"):
            try:
                text = raw.decode(encoding)
            except UnicodeDecodeError:
                continue
            return cls(split_lines(text), source, encoding)
        return cls(split_lines(raw.decode("latin-1")), source, "latin-1")

    @classmethod
    def read(cls, path: pathlib.Path) -> "ListFile":
        """Return the list in a file.

        Raises:
            OSError: If the file cannot be read.
        """
        return cls.parse(path.read_bytes(), str(path))

    def dumps(self) -> bytes:
        """Return the bytes of the file; those of `parse` where nothing was edited."""
        return "".join(self.lines).encode(self.encoding)

    @functools.cached_property
    def _scan(self) -> Scan:
        short = len(self.lines) <= _SHORT
        return _kept_scan(self.lines) if short else scan(self.lines)

    @property
    def columns(self) -> Mapping[str, Rows]:
        """All entries as columns, by canonical key, in order of first appearance."""
        return MappingProxyType(self._scan.columns)

    @functools.cached_property
    def remarks(self) -> tuple[TextRemark, ...]:
        """What is odd about the text, in file order (code: see `RemarkCode`)."""
        if self.encoding == "utf-8" and self.lines[0].startswith("\ufeff"):
            code = str(RemarkCode.BYTE_ORDER_MARK)
            return (TextRemark(1, 1, code, "U+FEFF"), *self._scan.remarks)
        if self.encoding != "latin-1":
            return self._scan.remarks
        odd = next(filter(None, map(_NOT_ASCII.search, self.lines)), None)
        remarks: list[TextRemark] = []
        if odd is not None:
            line = self.lines.index(odd.string) + 1
            excerpt = "starts like UTF-16" if self.is_wide else repr(odd.group())[1:-1]
            code = str(RemarkCode.ENCODING)
            remarks.append(TextRemark(line, odd.start() + 1, code, excerpt))
        return (*remarks, *self._scan.remarks)

    @property
    def is_wide(self) -> bool:
        """Whether the bytes look like UTF-16, of which nothing here makes sense."""
        first = self.lines[0] if self.lines else ""
        return first.startswith(("\xff\xfe", "\xfe\xff")) or (
            3 * first.count("\0") > len(first)
        )

    @functools.cached_property
    def entries(self) -> tuple[Entry, ...]:
        """Every entry, in file order, repeated ones too.

        One object each: for the values of a large table `table` and `columns` are the
        fast way.
        """
        return tuple(self.entry_at(line) for line in self._scan.entry_lines)

    def entry_at(self, line: int) -> Entry:
        """Return the entry in a line (1-based) that holds one."""
        parts = read_line(self.lines[line - 1])
        return Entry(
            parts.name,
            parts.written,
            parts.value,
            line,
            parts.start + 1,
            parts.value_start + 1,
            parts.key,
            parts.indices,
            parts.quoted,
        )

    def get(self, name: str) -> Entry | None:
        """Return the entry of a name in any case and generation, or None.

        Of several the last one, which counts (semantics S-08).
        """
        place = self._scan.place(name)
        return None if place is None else self.entry_at(place[0].lines[place[1]])

    def integer(self, name: str) -> int | None:
        """Return the value of an entry that is a decimal integer, else None."""
        place = self._scan.place(name)
        return None if place is None else place[0].integers[place[1]]

    def boolean(self, name: str) -> bool | None:
        """Return the value of an entry that is 0, 1, TRUE or FALSE, else None."""
        place = self._scan.place(name)
        return None if place is None else parse_boolean(place[0].texts[place[1]])

    def text(self, name: str) -> str | None:
        """Return the text of an entry without quotes, or None where it has none."""
        entry = self.get(name)
        if entry is None or not (entry.value or entry.quoted):
            return None
        return entry.value

    def table(
        self, prefix: str, field: str
    ) -> dict[int, int] | dict[tuple[int, int], int]:
        """Return a table column as value by index, in list units.

        Args:
            prefix: Structure of the table, such as ``kw.crosscomp2``.
            field: Name behind the index, such as ``correction``.

        Returns:
            ``{i: value}``, or ``{(j, i): value}`` for a plane, j along master 2; empty
            where there is no such table. Entries that are not decimal integers are left
            out; of repeated ones the last counts.
        """
        for table in ("table[][]", "table[]", "position[]"):
            rows = self._scan.columns.get(f"{prefix}.{table}.{field}".lower())
            if rows is None:
                continue
            pairs = zip(rows.indices, rows.integers, strict=True)
            if len(rows.indices[0]) == 2:
                return {(j, i): v for (j, i), v in pairs if v is not None}
            return {i: v for (i,), v in pairs if v is not None}
        return {}

    @functools.cached_property
    def kind(self) -> Literal["compensation", "axis", "startup", "unknown"]:
        """What sort of list this is, by its entries.

        The header ``kopf`` opens axis lists too, so it decides only where nothing else
        does.
        """
        votes = {"compensation": 0, "axis": 0, "startup": 0}
        header = False
        for key, rows in self._scan.columns.items():
            kind = registry().kind(key)
            if key.startswith("kopf."):
                header = True
            elif kind != "unknown":
                votes[kind] += len(rows.lines)
        for kind in ("compensation", "axis", "startup"):
            if votes[kind] and votes[kind] == max(votes.values()):
                return kind
        return "compensation" if header else "unknown"

    @property
    def newline(self) -> str:
        """The line end that most lines have."""
        ends = {end: 0 for end in ("\n", "\r\n", "\r")}
        for line in self.lines:
            end = line[len(line.rstrip("\r\n")) :]
            if end:
                ends[end] += 1
        return max(ends, key=lambda end: ends[end])

    def replace(self, values: Mapping[str, Value]) -> "ListFile":
        """Return a copy with new values; every other byte stays as it was.

        Of a repeated entry the last one changes, which counts. A value that the entry
        has already, in whatever spelling, changes nothing.

        Raises:
            UnknownEntryError: If the list has no entry of a name.
            EntryValueError: If a value does not fit its parameter or the encoding.
        """
        changes = _edit.changes(self._scan, values, self.source, self.encoding)
        return self._with(_edit.rewrite(self.lines, changes))

    def merge(
        self, values: Mapping[str, Value], *, comment: str | None = None
    ) -> "ListFile":
        """Return a copy with these values, replaced where they stand, else added.

        An added entry goes to its neighbours: a table entry behind the one with the
        next smaller index, any other behind the last one of its structure and before
        its table; a new structure before the closing line, or at the end.

        Args:
            values: New value by name.
            comment: Comment line above the first added entry.

        Raises:
            UnknownEntryError: If a name to add is none that the manuals know.
            EntryValueError: If a value does not fit its parameter or the encoding.
        """
        existing = {name: v for name, v in values.items() if self._scan.place(name)}
        added = {name: value for name, value in values.items() if name not in existing}
        changed = self.replace(existing)
        if not added:
            return changed
        lines = _edit.insert(
            changed.lines,
            self._scan,
            _edit.additions(added, self.source, self.encoding),
            comment=comment,
            newline=self.newline,
            encoding=self.encoding,
        )
        return self._with(lines)

    def remove(self, names: Iterable[str]) -> "ListFile":
        """Return a copy without the lines of these entries, comments on them included.

        All lines of a repeated entry go. A name that is not there is gone already.
        """
        return self._with(_edit.without(self.lines, self._scan, names))

    def _with(self, lines: tuple[str, ...]) -> "ListFile":
        return dataclasses.replace(self, lines=lines)
