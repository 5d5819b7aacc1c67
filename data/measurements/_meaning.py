"""What the columns of a text table mean: roles, runs and directions, instants, titles."""

import dataclasses
import re
from collections.abc import Mapping, Sequence

import numpy as np

from ._dates import is_instant
from ._errors import LineError
from ._header import (
    CLOCKS,
    DIRECTIONS,
    Heading,
    Name,
    bare_role,
    heading,
    plain,
    roles_of,
)
from ._table import Column, Table
from ._units import find_unit

_PAIR = re.compile(r"\W*(?P<key>[^:=;\t|]+?)\s*[:=;\t|]+\s*(?P<value>[^;\t|]+?)[\s;|]*")
_KEYS = {
    "direction": ("direction", "richtung", "fahrtrichtung", "verfahrrichtung"),
    "unit": ("unit", "units", "einheit", "einheiten", "error unit", "messeinheit"),
}
_AXIS = re.compile(r"(?i:\b(?:axis|achse))\s*[:=;\t ]\s*(?P<axis>[A-Z]\d?)\b")
_FOLLOWS = 0.1
"""Share of the travel by which actual positions miss their targets at most."""


def with_meaning(
    table: Table, names: Sequence[Name], titles: Mapping[int, str]
) -> Table:
    """Return a text table whose columns have the roles that the file states.

    Args:
        table: As read.
        names: One per column.
        titles: Lines above the header.
    """
    if _is_laser_body(table.columns, names):
        return _laser_without_header(table)
    if (wide := _wide(table, names)) is not None:
        return _with_titles(wide, titles)
    if (triplets := _triplets(table, names)) is not None:
        return triplets
    roles, laser = roles_of(names)
    roles = _with_time(roles, names)
    columns = [
        column if role is None else dataclasses.replace(column, role=role)
        for column, role in zip(table.columns, roles, strict=True)
    ]
    remarks = table.remarks
    if titles and not any(name.header for name in names):
        line = max(titles)
        remark = f"Line {line} ('{titles[line][:40]}') is no header for {len(names)}"
        remarks = (*remarks, f"{remark} columns, which are numbered.")
    by_name = [
        f"'{name.name}' as {role}"
        for name, role in zip(names, roles, strict=True)
        if role and role.casefold() != name.stem.casefold()
    ]
    if by_name and not laser:
        remarks = (*remarks, f"Taken by their names: {', '.join(by_name)}.")
    table = dataclasses.replace(
        table,
        columns=tuple(columns),
        remarks=remarks,
        format="laser table" if laser else table.format,
    )
    return _with_titles(_with_clock(table, names), titles)


def _with_time(roles: Sequence[str | None], names: Sequence[Name]) -> list[str | None]:
    """Return roles with that of the time, where one name and its unit say it."""
    times = [bare_role(name) == "time" and name.unit in ("s", "ms") for name in names]
    if "time" in roles or sum(times) != 1:
        return list(roles)
    return ["time" if time else role for role, time in zip(roles, times, strict=True)]


def _is_laser_body(columns: Sequence[Column], names: Sequence[Name]) -> bool:
    if len(columns) != 4 or any(column.text is not None for column in columns):
        return False
    if any(name.header for name in names):
        return False
    run, direction = columns[2].values, columns[3].values
    whole = bool(np.all(run == np.round(run)))
    return whole and bool(np.all(np.abs(direction) == 1.0))


def _laser_without_header(table: Table) -> Table:
    titles = ("target", "error", "run", "direction")
    roles = ("position", "error", "run", "direction")
    named = (
        dataclasses.replace(column, name=title, role=role, header=column.name)
        for column, title, role in zip(table.columns, titles, roles, strict=True)
    )
    remark = (
        "No header: four columns with whole run numbers and directions ±1 are "
        "taken as target, error, run, direction in mm."
    )
    return dataclasses.replace(
        table, format="laser table", columns=tuple(named), remarks=(remark,)
    )


def _triplets(table: Table, names: Sequence[Name]) -> Table | None:
    """Return a LinuxCNC table of nominal, forward and reverse positions, or None."""
    columns = table.columns
    if len(columns) != 3 or table.rows < 2 or any(name.header for name in names):
        return None
    nominal = columns[0].values
    spacing = np.diff(nominal)
    rising = spacing[spacing > 0.0]
    if not rising.size or np.any(spacing < 0.0):
        return None
    misses = np.abs([column.values - nominal for column in columns[1:]])
    if not np.all(misses < 0.5 * rising.min()):
        return None
    if np.any(spacing == 0.0):
        at = int(np.argmin(spacing)) + 1
        line, before = int(table.lines[at]), int(table.lines[at - 1])
        found = f"the nominal position {nominal[at]:g} a second time"
        expected = f"LinuxCNC triplets in ascending order (first in line {before})"
        advice = f"skip = [{line}]"
        raise LineError(str(table.path), line, found, expected, advice)
    titles = ("nominal", "forward", "reverse")
    roles = ("position", "actual", "actual")
    sides = (None, 1, -1)
    named = (
        dataclasses.replace(
            column,
            name=title,
            role=role,
            header=title,
            unit="mm",
            doubtful_unit=True,
            run=None if side is None else 1,
            direction=side,
        )
        for column, title, role, side in zip(columns, titles, roles, sides, strict=True)
    )
    remark = (
        "Three columns without a header, the second and third close to the first, are"
        " taken as LinuxCNC triplets: nominal, forward, reverse (actual positions)."
    )
    return dataclasses.replace(
        table, format="LinuxCNC triplets", columns=tuple(named), remarks=(remark,)
    )


def _wide(table: Table, names: Sequence[Name]) -> Table | None:
    """Return a table of one column per run and direction with its meaning, or None."""
    headings = [heading(name.header) for name in names]
    kinds = [bare_role(name) for name in names]
    roles, _ = roles_of(names)
    target = next(
        (
            at
            for at, kind in enumerate(kinds)
            if kind == "position" or (roles[at] or "").endswith(".position")
        ),
        0 if names and not headings[0] and not kinds[0] else None,
    )
    if target is None or table.columns[target].text is not None:
        return None
    found = {
        at: item
        for at, item in enumerate(headings)
        if item is not None and at != target and table.columns[at].text is None
    }
    named = kinds[target] == "position" and len(found) == len(names) - 1
    if not named:
        found = {at: item for at, item in found.items() if item.named}
    if len(found) < 2 or {"error", "actual"} & set(kinds):
        return None
    return _with_runs(table, target, _numbered(found))


def _numbered(found: Mapping[int, Heading]) -> dict[int, Heading]:
    """Return headings with a run each: those without are counted per direction."""
    seen: dict[int | None, int] = {}
    numbered = {}
    for at, item in found.items():
        seen[item.direction] = seen.get(item.direction, 0) + 1
        run = seen[item.direction] if item.run is None else item.run
        numbered[at] = dataclasses.replace(item, run=run)
    return numbered


def _with_runs(table: Table, target: int, found: Mapping[int, Heading]) -> Table:
    columns = list(table.columns)
    place = columns[target].values
    span = float(np.ptp(place))
    first = next(iter(found))
    stated = next((item.kind for item in found.values() if item.kind), None)
    values = np.concatenate([columns[at].values for at in found])
    misses = np.abs(values - np.tile(place, len(found)))
    follows = bool(np.nanmedian(misses) < _FOLLOWS * span) and columns[first].unit in (
        None,
        columns[target].unit,
    )
    kind = stated or ("actual" if follows else "error")
    columns[target] = dataclasses.replace(columns[target], role="position")
    for at, item in found.items():
        columns[at] = dataclasses.replace(
            columns[at], role=kind, run=item.run, direction=item.direction
        )
    runs = len({item.run for item in found.values()})
    both = len({item.direction for item in found.values()} - {None})
    words = {"actual": "actual positions", "error": "errors"}[kind]
    remark = (
        f"One column per run: {len(found)} columns of {words}, {runs} runs"
        + {0: ", direction not named", 1: " in one direction", 2: ", both directions"}[
            both
        ]
        + ("." if stated else f", taken as {words} by their size.")
    )
    return dataclasses.replace(
        table,
        format="run table (wide)",
        columns=tuple(columns),
        remarks=(*table.remarks, remark),
    )


def _with_clock(table: Table, names: Sequence[Name]) -> Table:
    """Return the table with the instants of its rows as the role time."""
    columns = list(table.columns)
    if any(column.role == "time" and column.text is None for column in columns):
        return table
    texts = {
        at: plain(name.stem)
        for at, name in enumerate(names)
        if (text := columns[at].text) is not None and is_instant(text[0].strip())
    }
    day = next((at for at, text in texts.items() if text in CLOCKS["date"]), None)
    hour = next((at for at, text in texts.items() if text in CLOCKS["time"]), None)
    both = next((at for at, text in texts.items() if text in CLOCKS["both"]), None)
    one = next((at for at in (both, hour, day) if at is not None), None)
    if one is None:
        return table
    if both is None and day is not None and hour is not None and day != hour:
        dates, times = columns[day].text, columns[hour].text
        assert dates is not None
        assert times is not None
        if not any(map(_has_date, times)):
            name = f"{columns[day].name} {columns[hour].name}"
            cells = tuple(f"{a} {b}" for a, b in zip(dates, times, strict=True))
            columns[hour] = dataclasses.replace(
                columns[hour], name=name, header=name, text=cells
            )
            one = hour
    columns[one] = dataclasses.replace(columns[one], role="time")
    for at, column in enumerate(columns):
        if column.unit == "degC" and column.role is None and column.text is None:
            sensor = re.sub(r"\W+", "_", names[at].stem.casefold()).strip("_")
            columns[at] = dataclasses.replace(column, role=f"temperature.{sensor}")
    return dataclasses.replace(table, columns=tuple(columns))


def _has_date(cell: str) -> bool:
    return " " in cell.strip() or "T" in cell


def _with_titles(table: Table, titles: Mapping[int, str]) -> Table:
    """Return the table with what the lines above its header say: axis, unit, direction."""
    said: dict[str, tuple[int, str]] = {}
    for line, text in titles.items():
        if (named := _AXIS.search(text)) is not None:
            said.setdefault("axis", (line, named["axis"]))
        match = _PAIR.fullmatch(text)
        for kind, words in _KEYS.items():
            if match and match["key"].strip().casefold() in words:
                said.setdefault(kind, (line, match["value"].strip()))
    remarks = list(table.remarks)
    columns = list(table.columns)
    axis = table.axis
    if "axis" in said:
        axis = said["axis"][1]
        remarks.append(f"Line {said['axis'][0]} says that the axis is {axis}.")
    kinds = {column.role for column in columns}
    if "unit" in said and (unit := find_unit(said["unit"][1])) is not None:
        for at, column in enumerate(columns):
            if column.role in ("error", "actual") and column.unit is None:
                columns[at] = dataclasses.replace(
                    column, unit=unit.name, doubtful_unit=False
                )
                remarks.append(
                    f"Column '{column.name}' is in {unit.name}, as line"
                    f" {said['unit'][0]} says."
                )
    if "direction" in said and "position" in kinds and "direction" not in kinds:
        side = DIRECTIONS.get(said["direction"][1].casefold())
        if side is not None and all(column.direction is None for column in columns):
            values = np.full(table.rows, float(side))
            columns.append(
                Column("direction", "direction", None, values, header="direction")
            )
            remarks.append(
                f"Line {said['direction'][0]} says '{said['direction'][1]}': direction"
                f" {side:+d} in all rows."
            )
    return dataclasses.replace(
        table, columns=tuple(columns), remarks=tuple(remarks), axis=axis
    )
