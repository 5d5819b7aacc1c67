"""A column in the unit of the file becomes values of its role in the library's unit."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ._errors import MeasurementError, UnitError
from ._roles import Role
from ._table import BadCell, Column, Table
from ._units import LIBRARY_UNIT, Unit, find_unit, unit as named_unit
from ._words import direction_of

_LINEAR = ("length", "velocity", "acceleration")
_FEWEST, _SURE = 3, 0.9
"""Steps from row to row in a direction, and by how much more of them go against it than with
it, that contradict it."""
_ANGULAR = ("angle", "angular velocity", "angular acceleration")


def unit_of(
    table: Table, role: Role, column: Column, asked: str | None, *, angle: bool
) -> Unit:
    """Return the unit of a column: the job's, else the file's, else the default."""
    source = str(table.path)
    what = f"{role} in column '{column.name}'"
    dimensions = _dimensions(role, angle=angle)
    recorded = find_unit(column.unit) if column.unit else None
    given = find_unit(asked) if asked is not None else recorded
    if given is not None and given.dimension.startswith("angular") and not angle:
        reason = (
            f"{what}: found {given.name}, as of a motor, expected a {role.kind} of {role.axis}, an"
            " axis in mm: leave the column out, and it is derived from the position; or convert it"
            f" by the mm that {role.axis} goes in a turn of the motor (rpm times mm is mm/min). Of"
            ' an axis that turns, say type = "rotary"'
        )
        raise MeasurementError(source, reason)
    if asked is not None:
        unit = named_unit(asked, dimensions, source, what)
        if recorded is not None and not column.doubtful_unit and recorded != unit:
            # A job that says mm where the file says µm would be wrong by 1000 without a
            # word.
            what = f"{what} (the file says {recorded.name})"
            raise UnitError(source, what, unit.name, [recorded.name], recorded.name)
        return unit
    if recorded is not None and recorded.dimension in dimensions:
        if column.doubtful_unit and recorded.name == "m":
            accepted = ["m", "mm", "um"]
            what = f"{what} (metres, or 'measured'? state the unit)"
            raise UnitError(source, what, "_m", accepted, "mm")
        return recorded
    if recorded is None and column.unit is not None:
        # Scope names a unit that the library lacks: its default would be wrong.
        return named_unit(column.unit, dimensions, source, what)  # raises
    if recorded is not None and not column.doubtful_unit:
        return named_unit(recorded.name, dimensions, source, what)  # raises
    default = LIBRARY_UNIT[dimensions[0]]
    return named_unit(default, dimensions, source, what)


def _dimensions(role: Role, *, angle: bool) -> tuple[str, ...]:
    """Return dimensions that a role may have: of an axis, lengths or angles."""
    if role.axis is None:
        return role.dimensions
    other = _LINEAR if angle else _ANGULAR
    return tuple(item for item in role.dimensions if item not in other)


def library_unit(unit: Unit, *, angle: bool) -> str:
    """Return the library unit that values of a unit become."""
    dimension = unit.dimension
    if dimension.startswith("increments"):
        tail = dimension.removeprefix("increments").replace(" per ", "/")
        return ("deg" if angle else "mm") + tail
    return LIBRARY_UNIT[dimension]


def as_run(table: Table, column: Column) -> Int[np.ndarray, " t"]:
    """Return whole run numbers; names of runs are numbered in order of appearance."""
    if column.text is not None:
        order = {
            text: at for at, text in enumerate(dict.fromkeys(column.text), start=1)
        }
        return np.array([order[text] for text in column.text], dtype=np.int64)
    values = table.numbers(column)
    broken = np.flatnonzero(values != np.round(values))
    if broken.size:
        at = int(broken[0])
        cell = BadCell(int(table.lines[at]), f"{values[at]:g}")
        raise table.cell_error(column, cell, "a whole number")
    return values.astype(np.int64)


def as_direction(
    table: Table, column: Column, positive: str | None = None
) -> Int[np.ndarray, " t"]:
    """Return ±1; words such as ``up`` and ``bwd`` are understood.

    Args:
        table: Of the column.
        column: Numbers or words.
        positive: Word for +1, and any one other is -1; None: as words say.
    """
    expected = (
        "+1 or -1, a word such as up, vorwärts, rück, or its word in the job: positive"
    )
    if positive is not None:
        cells = column.text or [f"{value:g}" for value in column.values]
        words = dict.fromkeys(cell.strip() for cell in cells)
        if len({*words} - {positive}) > 1 or not {*words} - {"", "nan"} == {*words}:
            cell = BadCell(int(table.lines[0]), ", ".join(words)[:40])
            raise table.cell_error(column, cell, f"'{positive}' and one other word")
        signs = [1 if cell.strip() == positive else -1 for cell in cells]
        values = np.array(signs, dtype=np.float64)
    elif column.text is not None:
        signs = [direction_of(cell) or 0 for cell in column.text]
        values = np.array(signs, dtype=np.float64)
    elif column.bad is not None and _is_all_minus(column):
        values = np.full(column.values.size, -1.0)
    else:
        values = table.numbers(column)
    invalid = np.flatnonzero(np.abs(values) != 1.0)
    if invalid.size:
        at = int(invalid[0])
        found = column.text[at] if column.text is not None else f"{values[at]:g}"
        cell = BadCell(int(table.lines[at]), found)
        raise table.cell_error(column, cell, expected)
    return values.astype(np.int64)


def runs_against(
    place: Float[np.ndarray, " t"],
    direction: Int[np.ndarray, " t"],
    run: Int[np.ndarray, " t"] | None = None,
    time: Float[np.ndarray, " t"] | None = None,
) -> tuple[int, ...]:
    """Return the runs in which positions, as they follow each other, go against both directions.

    Args:
        place: Positions in the order of the file.
        direction: ±1 of each.
        run: Of each; between runs nothing is compared. Where their numbers only fall, the
            newest reading comes first. None: all are of run 0.
        time: Of each: their order.
    """
    order = np.arange(len(place))
    if time is not None:
        order = np.argsort(time, kind="stable")
    elif run is not None and run[0] > run[-1] and np.all(np.diff(run) <= 0):
        order = order[::-1]
    numbers = np.zeros(len(place), np.int64) if run is None else run
    place, direction, numbers = place[order], direction[order], numbers[order]
    step = np.sign(np.diff(place))
    kept = (direction[1:] == direction[:-1]) & np.isfinite(step) & (step != 0)
    kept &= numbers[1:] == numbers[:-1]
    along, ways, numbers = (
        (direction[1:] * step)[kept],
        direction[1:][kept],
        numbers[1:][kept],
    )

    def is_against(rows: Bool[np.ndarray, " n"]) -> bool:
        own = [rows & (ways == way) for way in (1, -1)]
        return all(np.sum(o) >= _FEWEST and np.mean(along[o]) <= -_SURE for o in own)

    runs = np.unique(numbers)
    if not is_against(np.ones(len(along), bool)):
        runs = np.array([each for each in runs if is_against(numbers == each)], int)
    return tuple(runs.tolist())


def _is_all_minus(column: Column) -> bool:
    """Whether a column holds no number, and a minus where it should."""
    found = "" if column.bad is None else column.bad.found.strip()
    return found in ("-", "−") and not np.isfinite(column.values).any()
