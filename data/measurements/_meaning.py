"""What the columns of a text table mean: roles, runs and directions, instants, titles."""

import dataclasses
import re
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ._dates import is_instant
from ._dialect import Dialect
from ._errors import LineError
from ._header import (
    Heading,
    Name,
    bare_role,
    heading,
    is_clock,
    numbered,
    roles_of,
    unit_of_title,
)
from ._roles import ColumnSpec
from ._table import LASER_FORMAT, BadCell, Column, Table
from ._units import find_unit
from ._words import WORDS, direction_of, kinds_in, words_in

_PAIR = re.compile(
    r"\W*(?P<key>[^:=;,\t|]+?)\s*[:=;,\t|]+\s*(?P<value>[^;,\t|]+?)[\s;,|]*"
)
_UNIT_WORDS = frozenset(
    ("unit", "units", "einheit", "einheiten", "error unit", "messeinheit")
)
_AXIS = re.compile(
    r"(?i:\b(?:axis|\w*achse))\s*[:=;,\t ]+\s*(?P<axis>[A-Z]\d?)\b"
    r"|\b(?P<before>[XYZABCUVW]\d?)[- ](?i:axis|achse)\b"
)
_STRAIGHT = re.compile(r"(?i)straightness|geradheit")
_DEVIATES = re.compile(
    r"(?i:\b(?:in|of|\w*straightness|geradheit\w*|abweichung|error|deviation)"
    r"(?:\s+(?:direction|richtung))?)\s+(?P<axis>[XYZ])\b"
)
_MOVES = re.compile(
    r"(?i:\b(?:über|ueber|over|along|entlang|axis|achse|vs|against))\.?[\s:=;,]+"
    r"(?P<axis>[XYZ])\b|\b(?P<before>[XYZ])[- ](?i:axis|achse)\b"
)
_ISO = re.compile(r"\bE_?(?P<across>[XYZ])(?P<along>[XYZ])\b")
"""Straightness as ISO 230-1 writes it: EYX deviates in Y while X moves."""
_INCHES = ("in", "thou", "uin")
_KINDS = {"actual": "actual positions", "error": "errors"}
_FEWEST = 3
"""Targets of a table with one row per run."""
_SHORT = 4
"""Rows up to which a column of cells tells nothing of what it is."""
_WORD = re.compile(r"[^\W\d_]")
_TELLING = 1000
"""Rows that tell whether numbers count the rows."""
_SURE = 0.6
"""Share of the steps by which one of two directions goes up more often than down."""
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
        return _with_titles(_laser_without_header(table), titles)
    if (wide := _wide(table, names) or _run_per_row(table, names)) is not None:
        return _with_titles(wide, titles)
    if (triplets := _triplets(table, names)) is not None:
        return triplets
    roles, laser = roles_of(names)
    roles = _with_time(roles, names)
    columns: Sequence[Column] = [
        column if role is None else dataclasses.replace(column, role=role)
        for column, role in zip(table.columns, roles, strict=True)
    ]
    columns, said = _as_they_are(columns)
    remarks = (*table.remarks, *said)
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
    table = dataclasses.replace(
        table,
        columns=tuple(columns),
        remarks=remarks,
        format=LASER_FORMAT if laser else table.format,
    )
    return _with_titles(_with_clock(table, names), titles)


def _as_they_are(columns: Sequence[Column]) -> tuple[list[Column], list[str]]:
    """Return columns with the roles that their cells say, and remarks about these.

    A run of one reading only is a number of the row; words of which each is a direction are
    the directions of the readings beside them, and those of which none is one are not.
    """
    found, remarks = list(columns), []
    kinds = set(map(_kind, columns))
    for at, column in enumerate(columns):
        values = column.values[:_TELLING]
        if column.role == "run" and column.text is None and values.size > _SHORT:
            if np.unique(values).size == values.size:
                found[at] = dataclasses.replace(column, role=None)
                remarks.append(f"'{column.name}' counts the rows, and is no run.")
        words = dict.fromkeys(column.text or ())
        sides = set(map(direction_of, words))
        if _kind(column) == "direction" and sides == {None}:
            found[at], said = _by_order(column, columns)
            remarks.append(f"'{column.name}' holds {', '.join(words)[:40]}: {said}.")
        if column.role is None and sides and sides <= {1, -1} and values.size > _SHORT:
            place = next((c.role for c in columns if _kind(c) == "position"), None)
            if place is not None and "direction" not in kinds:
                role = place.replace("position", "direction")
                found[at] = dataclasses.replace(column, role=role)
                listed = ", ".join(words)
                remarks.append(f"'{column.name}' holds directions: {listed}.")
                kinds.add("direction")
    return found, remarks


def _by_order(column: Column, columns: Sequence[Column]) -> tuple[Column, str]:
    """Return a column of words for two directions, such as CW and CCW, and what was seen.

    Which of them is the positive one nobody knows; the order of the targets may tell. It has
    no role where that does not.
    """
    cells = np.array([cell.strip() for cell in column.text or ()])
    place = next((c.values for c in columns if _kind(c) == "position"), None)
    words = list(dict.fromkeys(cells.tolist()))
    signs = {}
    if place is not None and len(words) == 2:
        step, same = np.diff(place), cells[1:] == cells[:-1]
        for word in words:
            own = np.sign(step[same & (cells[1:] == word)])
            signs[word] = float(own.mean()) if own.size else 0.0
    low, high = (
        end(words, key=lambda word: signs.get(word, 0.0)) for end in (min, max)
    )
    if not signs or signs[low] > -_SURE or signs[high] < _SURE:
        key = f'{{ column = "{column.header}", positive = "{words[0]}" }}'
        said = f'no known directions; "<axis>.direction" = {key} says which is +'
        return dataclasses.replace(column, role=None), said
    text = tuple("+" if cell == high else "-" for cell in cells)
    said = f"'{high}' is the positive one, as the order of the targets shows"
    return dataclasses.replace(column, text=text), said


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
        "taken as target, error, run, direction, in mm where no line says otherwise."
    )
    return dataclasses.replace(
        table, format=LASER_FORMAT, columns=tuple(named), remarks=(remark,)
    )


def _triplets(table: Table, names: Sequence[Name]) -> Table | None:
    """Return a LinuxCNC table of nominal, forward and reverse positions, or None."""
    columns = table.columns
    if len(columns) != 3 or table.rows < 2 or any(name.header for name in names):
        return None
    nominal = columns[0].values
    spacing = np.diff(nominal)
    rising = spacing[spacing > 0.0]
    if 2 * rising.size < spacing.size or not rising.size:
        return None
    values = np.array([column.values for column in columns[1:]])
    near = 0.5 * rising.min()
    if np.all(np.abs(values) < near) and not np.any(spacing <= 0.0):
        parts = tuple(
            ColumnSpec(column, sign=-1, run=1, direction=side)
            for column, side in (("2", 1), ("3", -1))
        )
        advice = {"position": ColumnSpec("1"), "error": ColumnSpec("", parts=parts)}
        remark = (
            "Three columns without a header may be LinuxCNC trims (COMP_FILE_TYPE = 1): sign"
            " = -1 makes errors of them, and is left out where they are errors."
        )
        return dataclasses.replace(
            table, advice=advice, remarks=(*table.remarks, remark)
        )
    if not np.all(np.abs(values - nominal) < near):
        return None
    if np.any(spacing <= 0.0):
        at = int(np.flatnonzero(spacing <= 0.0)[0]) + 1
        line, before = int(table.lines[at]), int(table.lines[at - 1])
        again = " a second time" * (nominal[at] in nominal[:at])
        found = f"the nominal position {nominal[at]:g}{again}"
        expected = f"LinuxCNC triplets in ascending order ({nominal[at - 1]:g} in line {before})"
        alone = spacing[at - 1] == 0.0
        key = f"skip = [{line}]" if alone else f"rows = [{table.lines[0]}, {before}]"
        raise LineError(str(table.path), line, found, expected, key)
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
        " taken as LinuxCNC triplets: nominal, forward, reverse (actual positions), in mm."
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
    return _with_runs(table, target, numbered(found))


def _with_runs(table: Table, target: int, found: Mapping[int, Heading]) -> Table:
    columns = list(table.columns)
    place = columns[target].values
    first = next(iter(found))
    stated = next((item.kind for item in found.values() if item.kind), None)
    values = np.concatenate([columns[at].values for at in found])
    follows = _follow(values, np.tile(place, len(found)), float(np.ptp(place)))
    follows &= columns[first].unit in (None, columns[target].unit)
    kind = stated or ("actual" if follows else "error")
    columns[target] = dataclasses.replace(columns[target], role="position")
    names = [columns[at].name for at in found]
    for at, item in found.items():
        columns[at] = dataclasses.replace(
            columns[at], role=kind, run=item.run, direction=item.direction
        )
        if names.count(columns[at].name) > 1:
            name = f"{columns[at].name} (run {item.run})"
            columns[at] = dataclasses.replace(columns[at], name=name, header=name)
    runs = len({item.run for item in found.values()})
    both = len({item.direction for item in found.values()} - {None})
    words = _KINDS[kind]
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


def _run_per_row(table: Table, names: Sequence[Name]) -> Table | None:
    """Return a table of one row per run, targets along the top, with one row per reading."""
    decimal = table.form.decimal if table.form is not None else "."
    heads = [Dialect(";", decimal).number(name.header) for name in names]
    along = [at for at, target in enumerate(heads) if target is not None]
    labels = [at for at in range(len(names)) if at not in along]
    targets = np.array([heads[at] for at in along], dtype=np.float64)
    steps = np.diff(targets)
    if len(along) < _FEWEST or not labels or not np.all(steps * steps[0] > 0.0):
        return None
    found = _runs_of_rows([table.columns[at] for at in labels], table.rows)
    if found is None or any(table.columns[at].text is not None for at in along):
        return None
    ways = np.array([item.direction or 0 for item in found.values()])
    order = np.argsort(targets)
    rows = [order[::-1] if way < 0 else order for way in ways]
    values = np.array([table.columns[at].values for at in along]).T
    readings = np.concatenate([own[row] for own, row in zip(values, rows, strict=True)])
    place = targets[np.concatenate(rows)]
    lines = np.repeat(table.lines, len(along))
    kind = "actual" if _follow(readings, place, float(np.ptp(targets))) else "error"
    wrong = np.flatnonzero(~np.isfinite(readings))
    bad = BadCell(int(lines[wrong[0]]), "nan") if wrong.size else None
    unit = next((names[at].unit for at in labels if names[at].unit), None)
    runs = np.repeat([float(item.run or 0) for item in found.values()], len(along))
    columns = [
        Column("target", "position", unit, place, header="target"),
        Column(kind, kind, None, readings, bad=bad, header=kind),
        Column("run", "run", None, runs, header="run"),
    ]
    if np.all(ways != 0):
        sides = np.repeat(ways.astype(np.float64), len(along))
        columns.append(
            Column("direction", "direction", None, sides, header="direction")
        )
    remark = (
        f"One row per run: {table.rows} rows of {_KINDS[kind]} at {len(along)} targets along"
        " the top, by their size."
    )
    return dataclasses.replace(
        table,
        format="run table (one row per run)",
        columns=tuple(columns),
        rows=int(lines.size),
        lines=lines,
        remarks=(*table.remarks, remark),
    )


def _runs_of_rows(labels: Sequence[Column], rows: int) -> dict[int, Heading] | None:
    """Return run and direction of each row as the cells in front of it say, or None."""
    cells = [
        column.text or tuple(f"{value:g}" for value in column.values)
        for column in labels
    ]
    found = {row: heading(" ".join(each[row] for each in cells)) for row in range(rows)}
    known = {row: item for row, item in found.items() if item is not None}
    return numbered(known) if len(known) == rows else None


def _follow(
    values: Float[np.ndarray, " t"], place: Float[np.ndarray, " t"], travel: float
) -> bool:
    """Whether readings are the positions themselves, and no errors."""
    return bool(np.nanmedian(np.abs(values - place)) < _FOLLOWS * travel)


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
    one = next((at for at in (both, hour, day, *bare) if at is not None), None)
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
    table = _straight(table, " \n ".join(titles.values()))
    for line, text in titles.items():
        named = _AXIS.search(text)
        if named is not None and table.axis is None and not table.across:
            axis = named["axis"] or named["before"]
            remark = f"Line {line} says that the axis is {axis}."
            table = _noted(table, table.columns, remark, axis)
        pair = _PAIR.fullmatch(text)
        key = pair["key"].strip().casefold() if pair is not None else ""
        if pair is not None and key in _UNIT_WORDS:
            table = _in_unit(table, line, pair["value"])
        elif pair is not None and key in WORDS["direction"]:
            table = _in_direction(table, line, pair["value"])
        elif _WORD.search(text) and (way := heading(text)) and way.direction:
            table = _in_direction(table, line, "+" if way.direction > 0 else "-")
        elif (unit := unit_of_title(text)) is not None and (
            unit in _INCHES or "error" in kinds_in(words_in([text]))
        ):
            table = _in_unit(table, line, unit)
    inches = [f"'{c.name}'" for c in table.columns if c.unit in _INCHES]
    if inches:
        said = f"In inches, of which one is 25.4 mm: {', '.join(inches[:6])}."
        table = _noted(table, table.columns, said)
    return table


def _noted(
    table: Table, columns: Sequence[Column], remark: str, axis: str | None = None
) -> Table:
    return dataclasses.replace(
        table,
        columns=tuple(columns),
        remarks=(*table.remarks, remark),
        axis=axis or table.axis,
    )


def _kind(column: Column) -> str:
    return (column.role or "").rpartition(".")[2]


def _in_unit(table: Table, line: int, text: str) -> Table:
    """Return the table with a unit for readings that state none.

    Positions are in inches where readings are; to a unit that nobody knows no default is
    taken either.
    """
    unit = find_unit(text)
    name = unit.name if unit else text
    units = {"error": name, "actual": name}
    if name in _INCHES:
        units["position"] = "in"
    columns, names = [], []
    for column in table.columns:
        stated = units.get(_kind(column)) if column.unit is None else None
        columns.append(dataclasses.replace(column, unit=stated or column.unit))
        names += [f"'{column.name}' in {stated}"] if stated else []
    if not names:
        return table
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    said = f"{', '.join(names[:4])}{more}, as line {line} says."
    return _noted(table, columns, said)


def _in_direction(table: Table, line: int, text: str) -> Table:
    """Return the table with a direction for all rows, where it has none."""
    kinds = set(map(_kind, table.columns))
    side = direction_of(text)
    if side is None and "direction" not in kinds:
        remark = f"Line {line} says '{text}': no known direction."
        return _noted(table, table.columns, remark)
    stated = any(column.direction is not None for column in table.columns)
    if side is None or stated or "position" not in kinds or "direction" in kinds:
        return table
    values = np.full(table.rows, float(side))
    column = Column("direction", "direction", None, values, header="direction")
    remark = f"Line {line} says '{text}': direction {side:+d} in all rows."
    return _noted(table, (*table.columns, column), remark)


def _straight(table: Table, titles: str) -> Table:
    """Return a table of straightness with the axes that move and deviate, as far as known.

    Its errors are across the motion: those of a laser table would be of the wrong axis.
    """
    across, along = _axes_of_straightness(titles)
    axes = {"position": along, "error": across, "actual": across}
    names = " ".join(column.header for column in table.columns)
    kinds = [_kind_by_name(column) for column in table.columns]
    is_straightness = (across and along) or _STRAIGHT.search(f"{titles} {names}")
    has_both = kinds.count("position") == 1 and bool({"error", "actual"} & set(kinds))
    if not (is_straightness and has_both):
        return table
    table = dataclasses.replace(table, across=True)
    bare = [
        kind in axes and column.role in (None, kind)
        for column, kind in zip(table.columns, kinds, strict=True)
    ]
    if not any(bare):
        return table
    columns = [
        dataclasses.replace(column, role=f"{axes[kind]}.{kind}" if axes[kind] else None)
        if own
        else column
        for column, kind, own in zip(table.columns, kinds, bare, strict=True)
    ]
    if across and along:
        remark = (
            f"Straightness: the titles say that {along} moves and {across} deviates."
        )
    else:
        remark = (
            "Straightness: which axis moves and which deviates is not said; the job's"
            ' columns say it, such as "X.position" and "Y.error".'
        )
    return dataclasses.replace(_noted(table, columns, remark), format="CSV")


def _kind_by_name(column: Column) -> str:
    """Return the kind of role of a column, by its name where it has none."""
    if column.role is not None or column.text is not None:
        return _kind(column)
    return next(iter(kinds_in(words_in([column.name]))), "")


def _axes_of_straightness(titles: str) -> tuple[str | None, str | None]:
    """Return the axis that deviates and the one that moves, as titles say them."""
    if (iso := _ISO.search(titles)) and iso["across"] != iso["along"]:
        return iso["across"], iso["along"]
    moves = _MOVES.search(titles)
    along = (moves["axis"] or moves["before"]) if moves else None
    found = [match["axis"] for match in _DEVIATES.finditer(titles)]
    return next((axis for axis in found if axis != along), None), along
