"""Header of a TwinCAT Scope text export: separator, groups, channels, duration.

A preamble of four lines (``Name``, ``File``, ``Starttime of export``, ``Endtime of
export``), a block with one line per property, a blank line, the samples. Channels stand
in groups; the first column of a group holds its times, and in the block the name of the
property stands there: ``Name⇥x⇥Name⇥y⇥z`` are two groups, {x} and {y, z}.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from ._errors import LineError
from ._scope_block import NUMBER, SEPARATORS, Row, read_rows

# What the groups are is read off a line whose cells hold no separator themselves.
_CLEAR = ("Data-Type", "Port", "VariableSize", "IndexGroup", "SymbolBased", "NetID")
_STRICT = "\t:;"
"""Separators that stand inside no cell; a comma may be a decimal, a blank in a name."""
_TICKS_PER_SECOND = 10_000_000


@dataclasses.dataclass(frozen=True)
class Channel:
    """One channel: its name, unit as it stands (None: none), sample time in s."""

    name: str
    unit: str | None
    sample_time: float | None


@dataclasses.dataclass(frozen=True)
class Header:
    """What the lines above the samples say.

    Attributes:
        separator: Between cells.
        groups: Channels that share a time column.
        start: Start of the export in ticks of 100 ns since 1601.
        duration: Of the export, in s.
        body_line: First line (1-based) below the block.
        rescaled: Channels with a scale or an offset other than 1 and 0.
    """

    separator: str
    groups: tuple[tuple[Channel, ...], ...]
    start: int
    duration: float
    body_line: int
    rescaled: tuple[str, ...]

    @property
    def widths(self) -> tuple[int, ...]:
        """Cells of a line that holds the first 1, 2, … groups."""
        widths, width = [], 0
        for group in self.groups:
            width += 1 + len(group)
            widths.append(width)
        return tuple(widths)

    @property
    def between(self) -> str:
        """The separator, in words."""
        return SEPARATORS[self.separator]


def read_header(path: Path, text: str) -> Header:
    """Return the header of a TwinCAT Scope text export.

    Raises:
        LineError: If a line is missing, has a wrong number of cells or names a channel
            twice.
        MeasurementError: If the text ends before the samples.
    """
    block = read_rows(path, text)
    rows, separator = block.rows, block.separator
    sizes = _sizes(path, rows, separator)
    values = {
        key: _by_group(path, key, row, sizes, separator) for key, row in rows.items()
    }
    names = _names(path, rows["Name"], values, sizes)
    return Header(
        separator=separator,
        groups=tuple(
            tuple(_channel(values, name, at, k) for k, name in enumerate(group))
            for at, group in enumerate(names)
        ),
        start=block.start,
        duration=(block.end - block.start) / _TICKS_PER_SECOND,
        body_line=block.body_line,
        rescaled=tuple(_rescaled(values, names)),
    )


def _sizes(path: Path, rows: dict[str, Row], separator: str) -> list[int]:
    """Return the number of channels per group."""
    key = next((key for key in _CLEAR if key in rows), "Name")
    cells = rows[key].cells
    while len(cells) > 1 and cells[-1] == "":
        cells = cells[:-1]  # older versions end each line with a separator
    starts = _starts(key, cells)
    sizes = [b - a - 1 for a, b in zip(starts, [*starts[1:], len(cells)], strict=True)]
    if not sizes or min(sizes) < 1:
        found = f"'{key}' with no channel behind it"
        expected = f"{key}, then one cell per channel, with {SEPARATORS[separator]}"
        raise LineError(str(path), rows[key].line, found, f"{expected} between")
    return sizes


def _starts(key: str, cells: Sequence[str]) -> list[int]:
    name = key.casefold()
    return [at for at, cell in enumerate(cells) if cell.casefold() == name]


def _by_group(
    path: Path, key: str, row: Row, sizes: Sequence[int], separator: str
) -> list[list[str] | None]:
    """Return the values of a line per group; None where they cannot be told apart.

    A cell may hold the separator (``0,2`` between commas, blanks in names): in a group
    of one channel its pieces belong together.
    """
    width = sum(sizes) + len(sizes)
    cells = row.cells
    while len(cells) > width and cells[-1] == "":
        cells = cells[:-1]
    if key == "SymbolComment":
        return [None] * len(sizes)
    starts = [sum(sizes[:at]) + at for at in range(len(sizes))]
    fits = len(cells) == width and all(
        cells[at].casefold() == key.casefold() for at in starts
    )
    if fits:
        return [
            cells[at + 1 : at + 1 + size]
            for at, size in zip(starts, sizes, strict=True)
        ]
    if separator in _STRICT:
        found = f"{len(cells)} cells in the line '{key}'"
        expected = f"{width} with {SEPARATORS[separator]} between, as in the others"
        if len(cells) == width:
            found = f"a line '{key}' without '{key}' above each time column"
            expected = "it there"
        raise LineError(str(path), row.line, found, expected)
    marks = _starts(key, cells)
    if len(marks) != len(sizes):
        return [None] * len(sizes)
    pieces = [
        cells[a + 1 : b] for a, b in zip(marks, [*marks[1:], len(cells)], strict=True)
    ]
    if key == "Unit":
        pieces = [_units_together(piece) for piece in pieces]
    return [
        piece
        if len(piece) == size
        else ([separator.join(piece)] if size == 1 else None)
        for piece, size in zip(pieces, sizes, strict=True)
    ]


def _units_together(cells: Sequence[str]) -> list[str]:
    """Return ``V``, ``(Voltage)`` as one cell."""
    merged: list[str] = []
    for cell in cells:
        if merged and cell.startswith("(") and not merged[-1].endswith(")"):
            merged[-1] += " " + cell
        else:
            merged.append(cell)
    return merged


_Values = dict[str, list[list[str] | None]]


def _names(
    path: Path, row: Row, values: _Values, sizes: Sequence[int]
) -> list[list[str]]:
    """Return the names of the channels, each once."""
    names: list[list[str]] = []
    index: dict[str, int] = {}
    for at, size in enumerate(sizes):
        group = values["Name"][at]
        if group is None:
            found = "names of channels that hold the separator"
            expected = "names without it: export with a tab between the columns"
            raise LineError(str(path), row.line, found, expected)
        names.append([])
        for k in range(size):
            number = len(index) + 1
            name = group[k].strip() or f"channel {number}"
            if name in index:
                found = f"channel '{name}' twice, as number {index[name]} and {number}"
                raise LineError(str(path), row.line, found, "each name once")
            index[name] = number
            names[-1].append(name)
    return names


def _value(values: _Values, key: str, at: int, k: int) -> str | None:
    group = values[key][at] if key in values else None
    return None if group is None else group[k].strip()


def _number(text: str | None) -> float | None:
    """Return a number of the header, which may have either decimal mark."""
    if text is None or not NUMBER.fullmatch(text):
        return None
    return float(text.replace(",", "."))


def _channel(values: _Values, name: str, at: int, k: int) -> Channel:
    """Return a channel; its unit is ``V`` of ``V (Voltage)``, None of ``(None)``."""
    unit = (_value(values, "Unit", at, k) or "").split("(")[0].strip()
    milliseconds = _number(_value(values, "SampleTime[ms]", at, k))
    sample_time = None if milliseconds is None else milliseconds / 1000.0
    return Channel(name, unit or None, sample_time)


def _rescaled(values: _Values, names: Sequence[Sequence[str]]) -> list[str]:
    """Return channels that Scope shows with another scale or offset."""
    neutral = {"Offset": 0, "ScaleFactor": 1, "Unit ScaleFactor": 1, "Unit Offset": 0}
    return [
        name
        for at, group in enumerate(names)
        for k, name in enumerate(group)
        if any(
            _number(_value(values, key, at, k)) not in (None, default)
            for key, default in neutral.items()
        )
    ]
