"""Text tables of repeated runs whose layout says what their columns are.

One column or one row per run, the trims of LinuxCNC, four bare columns of a laser.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ._dialect import Dialect
from ._errors import LineError
from ._header import Name, axis_of, bare_role, roles_of
from ._headings import (
    Heading,
    heading,
    named_axis,
    numbered,
    spelled,
    with_first,
)
from ._roles import ColumnSpec
from ._table import LASER_FORMAT, Column, Table, first_bad
from ._words import (
    is_leg,
    is_mean,
    kinds_in,
    words_in,
)

_KINDS = {"actual": "actual positions", "error": "errors"}
SHORT = 4
"""Rows up to which a column of cells tells nothing of what it is."""
_TELLING = 1000
"""Rows that tell whether numbers count the rows."""
_FEWEST = 3
"""Targets of a table with one row per run."""
_DOWNWARDS = (
    "the targets are listed downwards, and the way there goes as they are listed."
)
_FOLLOWS = 0.1
"""Share of the travel by which actual positions miss their targets at most."""


def laser_without_header(table: Table, names: Sequence[Name]) -> Table | None:
    """Return four bare columns of a laser with their meaning, or None."""
    columns = table.columns
    if len(columns) != 4 or any(column.text is not None for column in columns):
        return None
    if any(name.header for name in names):
        return None
    run, direction = columns[2].values, columns[3].values
    if np.any(run != np.round(run)) or np.any(np.abs(direction) != 1.0):
        return None
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


def triplets(table: Table, names: Sequence[Name]) -> Table | None:
    """Return a LinuxCNC table of nominal, forward and reverse positions or trims, or None.

    Raises:
        LineError: If nominal positions do not ascend.
    """
    columns = table.columns
    if len(columns) != 3 or table.rows < 2 or any(name.header for name in names):
        return None
    nominal = columns[0].values
    spacing = np.diff(nominal)
    rising = spacing[spacing > 0.0]
    if 2 * rising.size < spacing.size or not rising.size:
        return None
    values = np.array([column.values for column in columns[1:]])
    tolerance = 0.5 * rising.min()
    if np.all(np.abs(values) < tolerance) and not np.any(spacing <= 0.0):
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
    if not np.all(np.abs(values - nominal) < tolerance):
        return None
    if np.any(spacing <= 0.0):
        at = int(np.flatnonzero(spacing <= 0.0)[0]) + 1
        line, before = int(table.lines[at]), int(table.lines[at - 1])
        again = " a second time" * (nominal[at] in nominal[:at])
        found = f"the nominal position {nominal[at]:g}{again}"
        expected = f"LinuxCNC triplets in ascending order ({nominal[at - 1]:g} in line {before})"
        repeated = spacing[at - 1] == 0.0
        key = f"skip = [{line}]" if repeated else f"rows = [{table.lines[0]}, {before}]"
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


def one_column_per_run(table: Table, names: Sequence[Name]) -> Table | None:
    """Return a table of one column per run and direction with its meaning, or None."""
    names, spoken = spelled(names)
    headings = [heading(name.header) for name in names]
    kinds = [bare_role(name) for name in names]
    headings = with_first(headings, kinds)
    roles, _ = roles_of(names)
    targets = [
        at
        for at, kind in enumerate(kinds)
        if kind == "position" or (roles[at] or "").endswith(".position")
    ] or [0] * bool(names and not headings[0] and not kinds[0])
    if not targets or table.columns[targets[0]].text is not None:
        return None
    target = targets[0]
    targets += [  # "Reverse target", beside a "Forward target"
        at
        for at, name in enumerate(names)
        if at > target and headings[at] is None and not kinds[at]
        if kinds_in(words_in([name.header])) == ["position"]
    ]
    runs = {
        at: item
        for at, item in enumerate(headings)
        if item is not None and at not in targets and table.columns[at].text is None
    }
    certain = kinds[target] == "position" and len(runs) == len(names) - len(targets)
    if not certain:
        runs = {at: item for at, item in runs.items() if item.named}
    # A mean of the runs beside them is none; alone it is what there is.
    single = {at: item for at, item in runs.items() if not is_mean(names[at].header)}
    runs = single or runs
    others = {kind for at, kind in enumerate(kinds) if at not in runs}
    if not runs or {"error", "actual"} & others:
        return None
    table = dataclasses.replace(table, remarks=(*table.remarks, *spoken))
    if len(runs) < 2:
        return None
    left = [
        table.columns[at].name
        for at, name in enumerate(names)
        if at not in runs and at not in targets and table.columns[at].text is None
        if kinds[at] in (None, "error", "actual") and not is_mean(name.header)
        if any(map(str.isdigit, name.stem))
    ]
    if len(left) == len(runs):
        remark = (
            f"Not used: {', '.join(left)}, as many columns as there are of runs, whose names say"
            " no direction that is known. Where they are runs, state all of them in columns."
        )
        table = dataclasses.replace(table, remarks=(*table.remarks, remark))
    if len(targets) > 1:
        beside = _at_targets(table, targets, runs)
        if beside is None:
            return None
        table = beside
    place = table.columns[target].values
    sided = [at for at, item in runs.items() if item.direction]
    legs = [at for at in sided if is_leg(names[at].header)]
    numbering = _numbering(table, names, runs)
    steps = np.diff(place)
    if numbering is not None:  # from run to run it goes back
        column = table.columns[numbering]
        cells = np.array(column.text or column.values.tolist())
        steps = steps[cells[1:] == cells[:-1]]
    if legs and np.all(steps < 0.0):
        for at in legs:
            direction = runs[at].direction
            turned = None if direction is None else -direction
            runs[at] = dataclasses.replace(runs[at], direction=turned)
        word = names[legs[0]].header
        way = "+" if runs[legs[0]].direction == 1 else "−"
        remark = f"'{word}' is motion in {way} direction: {_DOWNWARDS}"
        table = dataclasses.replace(table, remarks=(*table.remarks, remark))
    if len({(item.run, item.direction) for item in runs.values()}) < len(runs):
        runs = {at: dataclasses.replace(item, run=None) for at, item in runs.items()}
    along = axis_of(names[target])
    named = [named_axis(item, along) for item in runs.values()]
    axes = {*named} - {None}
    if len(axes) > 1 or (None in named and axes - {None, along}):
        return None  # readings of two axes side by side are no runs of one
    result = _with_runs(table, target, numbered(runs), numbering)
    axis = axes.pop() if axes else None
    if axis is None:
        return dataclasses.replace(result, axis=result.axis or along)
    if along not in (None, axis):
        return straightness(result, axis, along, "names")
    remark = f"The names of the runs say that the axis is {axis}."
    return dataclasses.replace(result, axis=axis, remarks=(*result.remarks, remark))


def _at_targets(
    table: Table, targets: Sequence[int], runs: Iterable[int]
) -> Table | None:
    """Return a table whose runs all stand beside its first targets; None: they cannot.

    Runs behind further targets were read at those, in the order in which they were reached.

    Args:
        table: As read.
        targets: Columns of targets, ascending.
        runs: Columns of readings.
    """
    columns, place = list(table.columns), table.columns[targets[0]].values
    for at in runs:
        own = max((each for each in targets if each < at), default=targets[0])
        there = columns[own].values
        order = np.empty(table.rows, np.int64)
        order[np.argsort(place, kind="stable")] = np.argsort(there, kind="stable")
        if columns[own].text is not None or not np.array_equal(there[order], place):
            return None
        values = columns[at].values[order]
        columns[at] = dataclasses.replace(columns[at], values=values)
    return dataclasses.replace(table, columns=tuple(columns))


def straightness(table: Table, axis: str, along: str, source: str) -> Table:
    """Return a table of runs, whose readings are of one axis and its targets of another.

    Args:
        table: One column per run.
        axis: The one that deviates.
        along: The one that moves.
        source: What says so.
    """
    columns = [
        dataclasses.replace(column, role=f"{axis}.error")
        if column.run is not None
        else dataclasses.replace(column, role=f"{along}.position")
        if column.role == "position"
        else column
        for column in table.columns
    ]
    remark = f"Straightness: the {source} say that {along} moves and {axis} deviates."
    return dataclasses.replace(
        table,
        format="CSV",
        columns=tuple(columns),
        axis=None,
        across=True,
        remarks=(*table.remarks, remark),
    )


def counts_rows(column: Column) -> bool:
    """Whether a column that is named as runs only numbers the rows: each is its own."""
    values = column.values[:_TELLING]
    alone = column.text is None and np.unique(values).size == values.size
    return alone and values.size > SHORT


def _numbering(
    table: Table, names: Sequence[Name], headings: Mapping[int, Heading]
) -> int | None:
    """Return the column that says of which run a row is, beside one column per direction."""
    sides = [item.direction for item in headings.values()]
    if len({*sides}) < len(sides) or any(item.run for item in headings.values()):
        return None
    found = [at for at, name in enumerate(names) if bare_role(name) == "run"]
    certain = len(found) == 1 and not counts_rows(table.columns[found[0]])
    return found[0] if certain else None


def _with_runs(
    table: Table,
    target: int,
    headings: Mapping[int, Heading],
    numbering: int | None,
) -> Table:
    columns = list(table.columns)
    place = columns[target].values
    first = next(iter(headings))
    stated = next((item.kind for item in headings.values() if item.kind), None)
    values = np.concatenate([columns[at].values for at in headings])
    follows = _follow(values, np.tile(place, len(headings)), float(np.ptp(place)))
    follows &= columns[first].unit in (None, columns[target].unit)
    kind = stated or ("actual" if follows else "error")
    columns[target] = dataclasses.replace(columns[target], role="position")
    names = [columns[at].name for at in headings]
    for at, item in headings.items():
        columns[at] = dataclasses.replace(
            columns[at], role=kind, run=item.run, direction=item.direction
        )
        if names.count(columns[at].name) > 1:
            name = f"{columns[at].name} (run {item.run})"
            columns[at] = dataclasses.replace(columns[at], name=name, header=name)
    runs = f"{len({item.run for item in headings.values()})} runs"
    layout = "run"
    if numbering is not None:
        column = columns[numbering]
        columns[numbering] = dataclasses.replace(column, role="run")
        count = len({*(column.text or column.values.tolist())})
        runs, layout = f"{count} runs as '{column.name}' says", "direction"
    sides = len({item.direction for item in headings.values()} - {None})
    words = _KINDS[kind]
    remark = (
        f"One column per {layout}: {len(headings)} columns of {words}, {runs}"
        + {0: ", direction not named", 1: " in one direction", 2: ", both directions"}[
            sides
        ]
        + ("." if stated else f", taken as {words} by their size.")
    )
    return dataclasses.replace(
        table,
        format="run table (wide)",
        columns=tuple(columns),
        remarks=(*table.remarks, remark),
    )


def one_row_per_run(table: Table, names: Sequence[Name]) -> Table | None:
    """Return a table of one row per run, targets along the top, with one row per reading."""
    decimal = table.form.decimal if table.form is not None else "."
    heads = [Dialect(";", decimal).number(name.header) for name in names]
    along = [at for at, target in enumerate(heads) if target is not None]
    labels = [at for at in range(len(names)) if at not in along]
    targets = np.array([heads[at] for at in along], dtype=np.float64)
    steps = np.diff(targets)
    if len(along) < _FEWEST or not labels or not np.all(steps * steps[0] > 0.0):
        return None
    headings = _runs_of_rows([table.columns[at] for at in labels], table.rows)
    if headings is None or any(table.columns[at].text is not None for at in along):
        return None
    directions = np.array([item.direction or 0 for item in headings.values()])
    remarks = table.remarks
    if steps[0] < 0.0:  # the way there goes as they are listed
        texts = [table.columns[at].text or () for at in labels]
        legs = [any(map(is_leg, row)) for row in zip(*filter(None, texts), strict=True)]
        if any(legs):
            directions = np.where(legs, -directions, directions)
            remarks = (*remarks, f"Directions of the runs: {_DOWNWARDS}")
    order = np.argsort(targets)
    rows = [order[::-1] if direction < 0 else order for direction in directions]
    values = np.array([table.columns[at].values for at in along]).T
    readings = np.concatenate([run[row] for run, row in zip(values, rows, strict=True)])
    place = targets[np.concatenate(rows)]
    lines = np.repeat(table.lines, len(along))
    kind = "actual" if _follow(readings, place, float(np.ptp(targets))) else "error"
    unit = next((names[at].unit for at in labels if names[at].unit), None)
    runs = np.repeat([float(item.run or 0) for item in headings.values()], len(along))
    columns = [
        Column("target", "position", unit, place, header="target"),
        Column(kind, kind, None, readings, bad=first_bad(readings, lines), header=kind),
        Column("run", "run", None, runs, header="run"),
    ]
    if np.all(directions != 0):
        sides = np.repeat(directions.astype(np.float64), len(along))
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
        remarks=(*remarks, remark),
    )


def _runs_of_rows(labels: Sequence[Column], rows: int) -> dict[int, Heading] | None:
    """Return run and direction of each row as the cells in front of it say, or None."""
    cells = [
        column.text or tuple(f"{value:g}" for value in column.values)
        for column in labels
    ]
    named = {row: heading(" ".join(text[row] for text in cells)) for row in range(rows)}
    valid = {row: item for row, item in named.items() if item is not None}
    return numbered(valid) if len(valid) == rows else None


def _follow(
    values: Float[np.ndarray, " t"], place: Float[np.ndarray, " t"], travel: float
) -> bool:
    """Whether readings are the positions themselves, and no errors."""
    return bool(np.nanmedian(np.abs(values - place)) < _FOLLOWS * travel)
