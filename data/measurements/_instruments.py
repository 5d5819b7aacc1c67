"""Text files of instruments and controllers that are no plain tables."""

import dataclasses
import re
from pathlib import Path

import numpy as np

from ._csv import read_body
from ._errors import CellError, LineError, MeasurementError
from ._header import parse_name, unit_of_title
from ._layout import find_layout
from ._mesh import PROBED_HEIGHTS
from ._roles import ColumnSpec
from ._table import Column, Skipped, Table, number_columns
from ._titles import with_titles
from ._units import find_unit

_SECTION = re.compile(r"\s*(?P<name>[A-Z][A-Z0-9 -]*)::\s*")
_SETTING = re.compile(r"\s*(?P<key>[A-Za-z][\w -]*?)\s*:\s*(?P<value>.*?)\s*")
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
_WHOLE = re.compile(r"[+-]?\d+")
_ADDRESS = r"([A-Za-z]{1,3})\s*[=:]?\s*([+-]?\d+(?:[.,]\d+)?)"
_ADDRESSES = re.compile(rf"\s*{_ADDRESS}(?:[\s;]+{_ADDRESS})+\s*;?\s*")
_ROTARY = re.compile(
    r"(?i)[ABC]\d?|.*(?:rotary|rotation|rundachse|rundtisch|drehachse|drehtisch|xr20|rx10).*"
)
"""Names of axes, and titles, of which the targets are angles."""
_TILT = re.compile(
    r"(?i)\b(?:yaw|roll|angular|tilt|gieren|gierwinkel|nicken|nickwinkel|rollen|rollwinkel"
    r"|pitch(?!\W*(?:error|comp\w*|fehler|of)\b))\b"
)
"""Titles of angles by which a linear axis tilts; the pitch error is that of its screw."""
_LOOK = 60
"""Lines that tell whether a text consists of addresses."""


def is_renishaw(head: str) -> bool:
    """Whether a text has the sections of Renishaw's laser software."""
    return "TARGET DATA::" in head or "DEVIATIONS::" in head


def read_renishaw(path: Path, text: str) -> Table:
    """Return target, error, run and direction of a Renishaw laser file (``.rtl``, ``.rtx``).

    Targets are numbered; every pass over them is a run of the file. Passes of the same
    direction are counted, so that the way there and back have the same run number.

    Raises:
        CellError: If a target or deviation is no number.
        LineError: If there are fewer targets, runs or readings than announced, or more.
        MeasurementError: If a section is missing.
    """
    sections, settings = _sections(text)
    targets = [
        (float(cell.replace(",", ".")), line)
        for line, cells in sections.get("targets", [])
        for cell in _numbers(path, line, "target", cells)
    ]
    rows = sections.get("run target data", [])
    if not targets or not rows:
        missing = "TARGET DATA with Targets" if not targets else "DEVIATIONS"
        reason = f"found a Renishaw file without {missing}, expected it"
        raise MeasurementError(str(path), reason)
    _announced(path, settings, "target-count", len(targets), "targets")
    visited: dict[tuple[int, int], int] = {}
    passes: dict[int, list[tuple[int, float, int]]] = {}
    for line, cells in rows:
        numbers = _numbers(path, line, "deviation", cells)
        valid = len(numbers) == 3 and all(map(_WHOLE.fullmatch, numbers[:2]))
        if not valid or not 1 <= int(numbers[1]) <= len(targets):
            expected = f"run, target from 1 to {len(targets)}, deviation"
            raise LineError(str(path), line, f"'{' '.join(cells)[:40]}'", expected)
        spot = (int(numbers[0]), int(numbers[1]))
        if spot in visited:
            found = f"run {spot[0]}, target {spot[1]} a second time"
            raise LineError(str(path), line, found, f"it once (line {visited[spot]})")
        visited[spot] = line
        value = float(numbers[2].replace(",", "."))
        passes.setdefault(spot[0], []).append((spot[1] - 1, value, line))
    count = _announced(path, settings, "run-count", len(passes), "runs")
    if len(visited) != count * len(targets):
        found = f"{len(visited)} readings, the last one here"
        expected = f"{count} runs of {len(targets)} targets"
        raise LineError(str(path), rows[-1][0], found, expected)
    body = _readings(passes, [target for target, _ in targets])
    return _with_kind(path, body, settings)


def _with_kind(
    path: Path, body: np.ndarray, settings: dict[str, tuple[str, int]]
) -> Table:
    """Return the readings with what axis and title say that was measured.

    Positions of a linear axis are in mm and deviations in µm, also those of a straightness.
    Those of a rotary axis are in °, and the file does not state the unit of the deviations;
    tilts of a linear axis are angles.
    """
    axis, axis_line = settings.get("axis", ("", 0))
    title, line = settings.get("title", ("", 0))
    stated = find_unit(unit_of_title(title) or "")
    angle = stated.name if stated and stated.dimension == "angle" else None
    turns = bool(_ROTARY.fullmatch(axis) or _ROTARY.fullmatch(title))
    tilt = None if turns else _TILT.search(title)
    place, unit = "mm", "um" if not turns else angle
    if turns:
        place = "deg"
        remark = f"Targets of {axis or 'the axis'}, a rotary one, are taken in °."
        if unit is None:
            remark += (
                " The file does not state the unit of its deviations: the job's columns say"
                ' it, unit = "arcsec", "urad" or another.'
            )
    elif tilt or angle:
        unit = angle or "arcsec"
        remark = (
            f"Line {line} says '{tilt[0] if tilt else title}': the deviations are taken for"
            " angles by which the axis tilts, and those are no errors of its position."
        )
    else:
        remark = (
            "Targets are taken in mm and deviations in µm, as the files of linear and"
            " straightness measurements have them; the file does not state units."
        )
    names = (
        ("target", "position", place),
        ("error", "error", unit),
        ("run", "run", None),
        ("direction", "direction", None),
    )
    details = [f"{key}: {value}" for key, (value, _) in settings.items() if value]
    form = "Renishaw laser file"
    target, error, *others = number_columns(body, names)
    target = dataclasses.replace(target, doubtful_unit=turns)
    error = dataclasses.replace(error, role="error" if unit else None)
    table = Table(
        path=path,
        format=form,
        columns=(target, error, *others),
        rows=len(body),
        lines=body[:, 4].astype(np.int64),
        remarks=(remark, f"The file says: {'; '.join(details)[:300]}."),
    )
    if not (turns or tilt or angle):
        titles = {axis_line: f"Axis: {axis}", line: title}
        table = with_titles(table, {at: text for at, text in titles.items() if at})
    if not table.across and re.fullmatch(r"[A-Za-z]\w*", axis):
        table = dataclasses.replace(table, axis=axis)
    return dataclasses.replace(table, format=form)


_Lines = dict[str, list[tuple[int, list[str]]]]


def _sections(text: str) -> tuple[_Lines, dict[str, tuple[str, int]]]:
    """Return the lines of numbers by the key above them, and the settings with lines."""
    numbers: _Lines = {}
    settings: dict[str, tuple[str, int]] = {}
    key = ""
    for number, line in enumerate(text.split("\n"), start=1):
        if not line.strip() or _SECTION.fullmatch(line):
            key = "" if line.strip() else key
        elif match := _SETTING.fullmatch(line):
            key = match["key"].casefold()
            if match["value"]:
                settings.setdefault(key, (match["value"], number))
        elif key:
            numbers.setdefault(key, []).append((number, line.split()))
    return numbers, settings


def _numbers(path: Path, line: int, name: str, cells: list[str]) -> list[str]:
    for cell in cells:
        if not _NUMBER.fullmatch(cell):
            raise CellError(str(path), line, name, cell, "a finite number")
    return cells


def _announced(
    path: Path, settings: dict[str, tuple[str, int]], key: str, count: int, what: str
) -> int:
    """Return the number that the file announces, which must be that of its contents."""
    announced, line = settings.get(key, (str(count), 0))
    if announced.strip() != str(count):
        found = f"{key}: {announced} and {count} {what} in the file"
        raise LineError(str(path), line, found, "as many as announced")
    return count


def _readings(
    passes: dict[int, list[tuple[int, float, int]]], targets: list[float]
) -> np.ndarray:
    """Return rows of target, error, run, direction and line, in the order of the file."""
    counts = {1: 0, -1: 0}
    rows = []
    for readings in passes.values():
        travel = targets[readings[-1][0]] - targets[readings[0][0]]
        side = 1 if travel >= 0 else -1
        counts[side] += 1
        for at, value, line in readings:
            rows.append((targets[at], value, counts[side], side, line))
    return np.array(rows, dtype=np.float64)


def is_centroid(head: str) -> bool:
    """Whether a text is a count and a number, and below as many lines of numbers."""
    top = head.lstrip().partition("\n")[0].split()
    if len(top) != 2 or not _WHOLE.fullmatch(top[0]):
        return False
    lines = [line.split() for line in head.split("\n") if line.strip()]
    if not _WHOLE.fullmatch(top[1]) or int(top[0]) < 2:
        return False
    below = lines[1:]
    integers = sum(len(line) == 1 and bool(_WHOLE.fullmatch(line[0])) for line in below)
    return integers >= 2 and 3 * integers >= 2 * len(below)


def read_centroid(path: Path, text: str) -> Table:
    """Return the corrections of a Centroid ballscrew table in encoder counts.

    Raises:
        LineError: If there are not as many points as the first line announces.
    """
    lines = [
        (number, line.split())
        for number, line in enumerate(text.split("\n"), start=1)
        if line.strip()
    ]
    (top, head), rows = lines[0], lines[1:]
    odd = next(((line, cells) for line, cells in rows if len(cells) != 1), None)
    if odd is not None or len(rows) != int(head[0]):
        line = top if odd is None else odd[0]
        found = f"{len(rows)} points" if odd is None else f"{len(odd[1])} numbers"
        expected = f"{head[0]} lines of one correction, as line {top} announces"
        raise LineError(str(path), line, found, expected)
    for line, cells in rows:
        _numbers(path, line, "correction", cells)
    values = np.array([float(cells[0]) for _, cells in rows])
    points = np.arange(1.0, len(rows) + 1.0)
    step = float(head[1]) / max(len(rows) - 1, 1)
    remark = (
        "A Centroid table holds corrections (the negative of errors) in encoder counts"
        " at points whose distance it does not state: the job says it. Where the second"
        f" number of its header is the travel, that is {step:.2f} counts."
    )
    return Table(
        path=path,
        format="Centroid table",
        columns=(
            Column("point", None, None, points, header="point"),
            Column("correction", None, "inc", values, header="correction"),
        ),
        rows=len(rows),
        lines=np.array([line for line, _ in rows], dtype=np.int64),
        skipped=(
            Skipped(top, "number of points, and the second number of the header"),
        ),
        remarks=(remark,),
        advice={
            "position": ColumnSpec("", "inc", value=0.0, interval=round(step, 2)),
            "error": ColumnSpec("correction", "inc", sign=-1),
        },
        scalars=(("second number of the header", float(head[1])),),
    )


def is_addresses(head: str) -> bool:
    """Whether most lines are like ``X100.000 Y20.000 Z-0.012``, with the same letters."""
    return _keys_of(head) is not None


def _keys_of(head: str) -> tuple[str, ...] | None:
    lines = [line for line in head.split("\n", _LOOK)[:_LOOK] if line.strip()]
    if 2 * sum(line.lstrip()[0].isalpha() for line in lines) <= len(lines):
        return None
    shapes = [_address_keys(line) for line in lines]
    keys = max(set(shapes), key=shapes.count, default=None)
    if keys is None or shapes.count(keys) < 2 or 2 * shapes.count(keys) <= len(lines):
        return None
    return keys


def _address_keys(line: str) -> tuple[str, ...] | None:
    if not _ADDRESSES.fullmatch(line):
        return None
    keys = tuple(key.upper() for key, _ in re.findall(_ADDRESS, line))
    return keys if len(set(keys)) == len(keys) else None


def read_addresses(path: Path, text: str, encoding: str) -> Table:
    """Return the numbers behind each letter, as columns that have its name.

    Raises:
        LineError: If a line below the first ones is not like them.
    """
    keys = _keys_of(text)
    assert keys is not None
    lines = text.split("\n")
    for at, line in enumerate(lines):
        if _address_keys(line) == keys:
            lines[at] = " ".join(number for _, number in re.findall(_ADDRESS, line))
        elif line.strip().upper().startswith(keys[0]) and re.search(r"\d", line):
            expected = f"numbers behind {', '.join(keys)} as in the other lines"
            found, advice = f"'{line.strip()[:40]}'", f"skip = [{at + 1}]"
            raise LineError(str(path), at + 1, found, expected, advice)
    body = "\n".join(lines)
    layout = find_layout(path, body)
    layout = dataclasses.replace(layout, names=tuple(map(parse_name, keys)))
    table = read_body(path, layout, body, encoding)
    remarks = table.remarks
    if "Z" in keys:
        probed = "A probed Z is an error only where the job's columns say so."
        remarks = (*remarks, f"{probed} {PROBED_HEIGHTS}")
    form = "lines of letters with numbers"
    return dataclasses.replace(table, format=form, remarks=remarks)
