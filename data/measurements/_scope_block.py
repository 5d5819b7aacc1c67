"""Lines of the header of a TwinCAT Scope text export: preamble and block."""

import dataclasses
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from ._errors import LineError, MeasurementError

PREAMBLE = ("Name", "File", "Starttime of export", "Endtime of export")
_BLOCK = (
    "Name",
    "SymbolComment",
    "Data-Type",
    "SampleTime[ms]",
    "VariableSize",
    "SymbolBased",
    "IndexGroup",
    "IndexOffset",
    "SymbolName",
    "NetID",
    "Port",
    "Offset",
    "ScaleFactor",
    "BitMask",
    "Unit",
    "Unit ScaleFactor",
    "Unit Offset",
)
_NEEDED = ("Name", "SampleTime[ms]", "Unit")
_FULL = 12
"""Lines of the block from which on it counts as the full one, chosen in Scope View."""
SEPARATORS = {"\t": "a tab", " ": "a blank", ":": "':'", ";": "';'", ",": "','"}
_SIGN = re.compile(
    r'(?m)^"?(?:(?:Start|End)time of export|SampleTime\[ms\]|SymbolComment|SymbolBased'
    r'|IndexGroup|Unit ScaleFactor)"?[\t :;,]'
)
_BEHIND = re.compile(
    r'"?(?:Starttime of export|Endtime of export|SampleTime\[ms\]|SymbolComment'
    r'|Data-Type|SymbolBased|IndexGroup|Unit ScaleFactor|Name|File)"?([\t :;,])'
)
NUMBER = re.compile(r"[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?")


@dataclasses.dataclass(frozen=True)
class Row:
    """One line of the block: its number and its cells."""

    line: int
    cells: list[str]


@dataclasses.dataclass(frozen=True)
class Rows:
    """Separator, times of the export in ticks, lines by property, line of the body."""

    separator: str
    start: int
    end: int
    rows: dict[str, Row]
    body_line: int


def is_scope(head: str) -> bool:
    """Whether the first part of a text can only be a Scope export."""
    return _SIGN.search(head) is not None


def read_rows(path: Path, text: str) -> Rows:
    """Return the lines of the header, none of the needed ones missing.

    Raises:
        LineError: If a line is missing or stands twice.
        MeasurementError: If the text ends before the samples.
    """
    # The header ends some lines below this one; comments may be long.
    end = max(200_000, 2 * text.find("SampleTime[ms]"))
    lines = text[:end].split("\n")
    marks = [match[1] for line in lines[:200] if (match := _BEHIND.match(line))]
    separator = Counter(marks).most_common(1)[0][0]
    start, end = _times(path, lines, separator)
    rows, body_line = _block(path, lines, separator)
    for key in _NEEDED:  # a full header may have lost a line
        if key not in rows and len(rows) >= _FULL:
            found = f"the end of the header, {len(rows)} lines without '{key}'"
            raise LineError(str(path), body_line, found, _expected_line(key))
    return Rows(separator, start, end, rows, body_line)


def _times(path: Path, lines: Sequence[str], separator: str) -> tuple[int, int]:
    """Return start and end of the export in ticks, from the preamble."""
    ticks = []
    for at, key in enumerate(PREAMBLE):
        line = lines[at] if at < len(lines) else ""
        cells = [cell.strip('" ') for cell in line.removeprefix('"').split(separator)]
        named = line.replace('"', "").startswith(key + separator)
        if not named:
            found = f"'{line.strip()[:40]}'" if line.strip() else "an empty line"
            raise LineError(str(path), at + 1, found, f"a line '{key}' of the preamble")
        if at < 2:
            continue
        value = cells[1] if separator != " " else line.replace('"', "").split(" ")[3]
        if not value.isdigit() or len(value) > 19:
            expected = "a whole number of 100 ns"
            raise LineError(str(path), at + 1, f"{key} '{value[:40]}'", expected)
        ticks.append(int(value))
    if ticks[1] < ticks[0]:
        found = "an end of the export before its start"
        raise LineError(str(path), 4, found, "a later one")
    return ticks[0], ticks[1]


def _block(
    path: Path, lines: Sequence[str], separator: str
) -> tuple[dict[str, Row], int]:
    """Return the lines of the block by property, and the first line below it."""
    rows: dict[str, Row] = {}
    last, blank = "", False
    for at in range(len(PREAMBLE), len(lines)):
        line = lines[at]
        if not line.strip():
            blank = True
            continue
        key = _key(line, separator)
        if key is None and last != "SymbolComment":
            # A comment may run over many lines; nothing else does.
            first = line.split(separator)[0].strip()
            if rows and (blank or NUMBER.fullmatch(first)):
                return rows, at + 1
            if not rows and NUMBER.fullmatch(first):
                found = f"samples ('{line.strip()[:30]}')"
                raise LineError(str(path), at + 1, found, _expected_line("Name"))
        if key is not None:
            if key in rows:
                found = f"a second line '{key}'"
                place = f"one, as in line {rows[key].line}"
                raise LineError(str(path), at + 1, found, place)
            if not rows and key != "Name":
                raise LineError(
                    str(path), at + 1, f"a line '{key}'", _expected_line("Name")
                )
            rows[key] = Row(at + 1, _cells(line, separator))
            last = key
        blank = False
    reason = "found no samples below the header, expected lines of numbers"
    raise MeasurementError(str(path), reason)


def _key(line: str, separator: str) -> str | None:
    """Return the property that a line of the block is about."""
    for key in sorted(_BLOCK, key=len, reverse=True):
        if line.casefold().startswith(key.casefold() + separator):
            return key
    return None


def _cells(line: str, separator: str) -> list[str]:
    """Return the cells; a property such as ``Unit Offset`` is one, even with blanks."""
    if separator == " ":
        for key in _BLOCK:
            if " " in key:
                line = line.replace(key, key.replace(" ", "\0"))
        return [cell.replace("\0", " ") for cell in line.split(" ")]
    return [cell.strip() for cell in line.split(separator)]


def _expected_line(key: str) -> str:
    what = {
        "Name": "the names of the channels",
        "Unit": "their units",
        "SampleTime[ms]": "their sample times",
    }[key]
    return f"a line '{key}' with {what}"
