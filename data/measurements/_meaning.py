"""What the columns of a text table mean: roles, directions, instants."""

import dataclasses
import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from ._dates import is_instant
from ._header import Name, bare_role, is_clock, roles_of
from ._run_layouts import (
    SHORT,
    counts_rows,
    laser_without_header,
    one_column_per_run,
    one_row_per_run,
    triplets,
)
from ._table import LASER_FORMAT, Column, Table
from ._titles import with_titles
from ._units import find_unit
from ._words import direction_of, is_own_reading

_SURE = 0.6
"""Share of the steps by which one of two directions goes up more often than down."""


def with_meaning(table: Table, names: Sequence[Name]) -> Table:
    """Return a text table whose columns have the roles that the file states.

    Args:
        table: As read.
        names: One per column.
    """
    titles = table.titles
    if (runs := _with_runs(table, names)) is not None:
        return with_titles(runs, titles)
    counted = _counted(names)
    if counted != [*names]:
        table, names = _renamed(table, counted), counted
        if (runs := _with_runs(table, names)) is not None:
            return with_titles(runs, titles)
    if (trims := triplets(table, names)) is not None:
        return trims
    roles, laser = roles_of(names)
    roles = _with_time(roles, names)
    columns: Sequence[Column] = [
        column if role is None else dataclasses.replace(column, role=role)
        for column, role in zip(table.columns, roles, strict=True)
    ]
    columns, notes = _as_they_are(columns)
    remarks = (*table.remarks, *notes)
    above = table.form.titles if table.form else ()
    if above and not any(name.header for name in names):
        line = max(above)
        remark = f"Line {line} ('{titles[line][:40]}') is no header for {len(names)}"
        remarks = (*remarks, f"{remark} columns, which are numbered.")
    by_name = [
        f"'{name.name}' as {role}"
        for name, role in zip(names, roles, strict=True)
        if role and role.casefold() != name.stem.casefold()
    ]
    if by_name and not laser:
        remarks = (*remarks, f"Taken by their names: {', '.join(by_name)}.")
    kinds = {column.kind: column.name for column in columns}
    judged = "actual" if not {"error", "current"} & kinds.keys() else ""
    if is_own_reading(kinds.get(judged, "")):
        remark = (
            f"A controller calls its own reading '{kinds[judged]}': as its encoder, and no"
            " instrument, it tells no error of the machine."
        )
        remarks = (*remarks, remark)
    table = dataclasses.replace(
        table,
        columns=tuple(columns),
        remarks=remarks,
        format=LASER_FORMAT if laser else table.format,
    )
    return with_titles(_with_clock(table, names), titles)


def _with_runs(table: Table, names: Sequence[Name]) -> Table | None:
    """Return a table of repeated runs with what its columns are, or None."""
    for layout in (laser_without_header, one_column_per_run, one_row_per_run):
        if (result := layout(table, names)) is not None:
            return result
    return None


def _counted(names: Sequence[Name]) -> list[Name]:
    """Return names of which those that stand above several columns are numbered.

    As they are where a position is among those: that is one table beside another.
    """
    headers = [name.header for name in names]
    again = [name for name in names if name.header and headers.count(name.header) > 1]
    if any(bare_role(name) == "position" for name in again):
        return [*names]
    counts: Counter[str] = Counter()
    result = []
    for name in names:
        if name.header and headers.count(name.header) > 1:
            counts[name.header] += 1
            number = f" {counts[name.header]}"
            text = name.name + number
            name = dataclasses.replace(
                name, name=text, stem=name.stem + number, header=text
            )
        result.append(name)
    return result


def _renamed(table: Table, names: Sequence[Name]) -> Table:
    """Return a table whose columns are called as told, and a remark that says so."""
    pairs = list(zip(table.columns, names, strict=True))
    columns = [
        dataclasses.replace(column, name=name.name, header=name.header)
        if column.header != name.header
        else column
        for column, name in pairs
    ]
    again = ", ".join(f"'{n.name}'" for c, n in pairs if c.header != n.header)
    remark = f"Columns of the same name are numbered: {again}."
    remarks = (*table.remarks, remark)
    return dataclasses.replace(table, columns=tuple(columns), remarks=remarks)


def _as_they_are(columns: Sequence[Column]) -> tuple[list[Column], list[str]]:
    """Return columns with the roles that their cells say, and remarks about these.

    A run of one reading only is a number of the row; words of which each is a direction are
    the directions of the readings beside them, and those of which none is one are not.
    """
    result, remarks = list(columns), []
    kinds = {column.kind for column in columns}
    for at, column in enumerate(columns):
        if column.role == "run" and counts_rows(column):
            result[at] = dataclasses.replace(column, role=None)
            remarks.append(f"'{column.name}' counts the rows, and is no run.")
        words = dict.fromkeys(column.text or ())
        sides = set(map(direction_of, words))
        if column.kind == "direction" and sides == {None}:
            result[at], reason = _by_order(column, columns)
            remarks.append(f"'{column.name}' holds {', '.join(words)[:40]}: {reason}.")
        if (
            column.role is None
            and sides
            and sides <= {1, -1}
            and column.values.size > SHORT
        ):
            place = next((c.role for c in columns if c.kind == "position"), None)
            if place is not None and "direction" not in kinds:
                role = place.replace("position", "direction")
                result[at] = dataclasses.replace(column, role=role)
                listed = ", ".join(words)
                remarks.append(f"'{column.name}' holds directions: {listed}.")
                kinds.add("direction")
    return result, remarks


def _by_order(column: Column, columns: Sequence[Column]) -> tuple[Column, str]:
    """Return a column of words for two directions, such as CW and CCW, and what was seen.

    Which of them is the positive one nobody knows; the order of the targets may tell. It has
    no role where that does not.
    """
    cells = np.array([cell.strip() for cell in column.text or ()])
    place = next((c.values for c in columns if c.kind == "position"), None)
    words = list(dict.fromkeys(cells.tolist()))
    signs = {}
    if place is not None and len(words) == 2:
        step, unchanged = np.diff(place), cells[1:] == cells[:-1]
        for word in words:
            steps = np.sign(step[unchanged & (cells[1:] == word)])
            signs[word] = float(steps.mean()) if steps.size else 0.0
    low, high = (
        end(words, key=lambda word: signs.get(word, 0.0)) for end in (min, max)
    )
    if not signs or signs[low] > -_SURE or signs[high] < _SURE:
        key = f'{{ column = "{column.header}", positive = "{words[0]}" }}'
        reason = f'no known directions; "<axis>.direction" = {key} says which is +'
        return dataclasses.replace(column, role=None), reason
    text = tuple("+" if cell == high else "-" for cell in cells)
    reason = f"'{high}' is the positive one, as the order of the targets shows"
    return dataclasses.replace(column, text=text), reason


def _with_time(roles: Sequence[str | None], names: Sequence[Name]) -> list[str | None]:
    """Return roles with that of the time, where one name and its unit say it."""
    times = [
        bare_role(name) == "time"
        and (unit := find_unit(name.unit or "")) is not None
        and unit.dimension == "time"
        for name in names
    ]
    if "time" in roles or sum(times) != 1:
        return list(roles)
    return ["time" if time else role for role, time in zip(roles, times, strict=True)]


def _with_clock(table: Table, names: Sequence[Name]) -> Table:
    """Return the table with the instants of its rows as the role time."""
    columns = list(table.columns)
    if any(column.role == "time" and column.text is None for column in columns):
        return table
    texts = {
        at: name
        for at, name in enumerate(names)
        if (text := columns[at].text) is not None and is_instant(text[0].strip())
    }
    day, hour, both = (
        next((at for at, name in texts.items() if is_clock(name, kind)), None)
        for kind in ("date", "time", "both")
    )
    bare = [at for at, name in texts.items() if not name.header]
    chosen = next((at for at in (both, hour, day, *bare) if at is not None), None)
    if chosen is None:
        return table
    if both is None and day is not None and hour is not None and day != hour:
        dates, times = columns[day].text, columns[hour].text
        assert dates is not None
        assert times is not None
        if not any(" " in cell.strip() or "T" in cell for cell in times):
            name = f"{columns[day].name} {columns[hour].name}"
            cells = tuple(f"{a} {b}" for a, b in zip(dates, times, strict=True))
            columns[hour] = dataclasses.replace(
                columns[hour], name=name, header=name, text=cells
            )
            chosen = hour
    columns[chosen] = dataclasses.replace(columns[chosen], role="time")
    for at, column in enumerate(columns):
        if column.unit == "degC" and column.role is None and column.text is None:
            sensor = re.sub(r"\W+", "_", names[at].stem.casefold()).strip("_")
            columns[at] = dataclasses.replace(column, role=f"temperature.{sensor}")
    return dataclasses.replace(table, columns=tuple(columns))
