"""Values that the kernel takes and that no sound machine needs: likely a slip.

The limits stand in the registry, in units of 0.1 µm or 0.0001° where a list may also count in
increments; those are judged where their length is known.
"""

from collections.abc import Callable, Mapping

from ._check_values import surely_allowed
from ._check_view import ListView, read_value
from ._entry import Rows
from ._names import full_name
from ._parameter import Change, Interval, Parameter
from ._registry import registry

_LIST_UNIT = 1e-4
"""mm or degrees of one unit of a metric list."""

_SMALL = 500
"""List units by which neighbours may differ however close they are: the leadscrew example of
the manuals has 15 µm between points that are 64 µm apart."""

Values = Mapping[tuple[int, ...], tuple[int, int | float]]
"""Row and value by index, of the entries that count and are allowed."""
_Limit = Callable[[tuple[int, ...], int], int]
"""Largest plausible step to an entry from its neighbour before it along an index."""


def check_plausible(view: ListView) -> None:
    """Report values, steps along a column and jumps between columns that are too large."""
    parameters = registry().by_key
    for key, rows in view.columns.items():
        row = parameters.get(key)
        if row is None or not (row.plausible or row.step or row.jump):
            continue
        unit = _unit(view, row)
        if unit is None or _is_narrow(row, rows, unit):
            continue
        values = _values(row, rows)
        if not values:
            continue
        if row.plausible is not None:
            _check_sizes(view, rows, row, row.plausible, values, unit)
        if row.step is not None:
            _check_steps(view, rows, row, row.step, values, unit)
        if row.jump is not None:
            _check_jumps(view, rows, row, row.jump, values, unit)


def _unit(view: ListView, row: Parameter) -> float | None:
    """Return how many metric list units an entry's unit is worth; None: not known."""
    if "increments" not in row.unit[0]:
        return 1.0
    functions = registry().functions
    unit = next(owner.unit for owner in functions if owner.structure == row.structure)
    if unit is None or view.integer(unit) == 1:
        return 1.0
    return None if view.increment is None else view.increment / _LIST_UNIT


def _step_limit(view: ListView, structure: str, step: Change) -> _Limit:
    """Return the largest plausible step: in all, and over the distance of two points.

    Distances count where they are in the unit of the values: not in increments.
    """
    spacing = _spacing(view, structure) if step.slope else None

    def limit(index: tuple[int, ...], place: int) -> int:
        distance = None if spacing is None else spacing(index, place)
        if step.slope is None or distance is None or distance <= 0:
            return step.largest
        return min(step.largest, max(step.slope * distance // 1000, _SMALL))

    return limit


def _spacing(
    view: ListView, structure: str
) -> Callable[[tuple[int, ...], int], int | None] | None:
    """Return the distance of an entry from its neighbour along an index; None: unknown."""
    if view.integer(f"{structure}.unit") != 1:
        return None
    if structure == "kw.crosscomp2":
        square = view.value(f"{structure}.grid") != "RECTANGULAR"
        order = "21" if view.plane_index == "ji" else "12"
        names = ("interval", "interval") if square else map("interval".__add__, order)
        intervals = [view.integer(f"{structure}.{name}") for name in names]
        return lambda _, place: intervals[place]
    interval = view.integer(f"{structure}.interval") if structure == "kw.ssfk" else 0
    if interval:
        return lambda *_: interval
    rows = view.rows(f"{structure}.table[].setpoint")
    if rows is None:
        return None
    points = {index: rows.integers[row] for index, row in rows.last.items()}

    def distance(index: tuple[int, ...], _: int) -> int | None:
        first, second = points.get((index[0] - 1,)), points.get(index)
        return None if first is None or second is None else second - first

    return distance


def _is_narrow(row: Parameter, rows: Rows, unit: float) -> bool:
    """Return whether a whole column is plausible at a glance: most are, and are long."""
    numbers = [value for value in rows.integers if value is not None]
    if row.jump is not None or not row.is_integer or not numbers:
        return False
    low, high = min(numbers) * unit, max(numbers) * unit
    is_inside = row.plausible is None or row.plausible.holds(low, high)
    if row.step is None or row.step.least:
        return is_inside and row.step is None
    return is_inside and high - low <= (_SMALL if row.step.slope else row.step.largest)


def _values(row: Parameter, rows: Rows) -> Values:
    """Return what counts and has no finding of its own."""
    parsed = [read_value(row, text) for text in rows.texts]
    return {
        index: (at, value)
        for index, at in rows.last.items()
        if isinstance(value := parsed[at], int | float) and surely_allowed(row, value)
    }


def _check_sizes(
    view: ListView,
    rows: Rows,
    row: Parameter,
    plausible: Interval,
    values: Values,
    unit: float,
) -> None:
    beyond = sorted(
        at
        for at, value in values.values()
        if value != row.default and not plausible.holds(value * unit, value * unit)
    )
    words = "{name} = {text} is allowed, and beyond what a sound machine needs"
    expected = f"{plausible} {_unit_text(row)}".rstrip()
    view.add_rows("warning", rows, beyond, words, expected)


def _check_steps(
    view: ListView,
    rows: Rows,
    row: Parameter,
    step: Change,
    values: Values,
    unit: float,
) -> None:
    """Report neighbours of a column that differ too much, in each direction of it."""
    limit = _step_limit(view, row.structure, step)
    for index, (at, value) in values.items():
        for place in range(len(index)):
            before = (*index[:place], index[place] - 1, *index[place + 1 :])
            if before not in values:
                continue
            other = values[before][1]
            gap, bound = abs(value - other) * unit, max(limit(index, place), _SMALL)
            # What does not ascend has a finding of its own.
            close = other < value and gap < step.least
            if close or gap > bound:
                pair = full_name(row.key, before), full_name(row.key, index)
                change = step._replace(largest=bound, least=step.least if close else 0)
                _report(view, rows, row, change, at, pair, (other, value))
                return


def _check_jumps(
    view: ListView,
    rows: Rows,
    row: Parameter,
    jump: Change,
    values: Values,
    unit: float,
) -> None:
    """Report an entry that differs too much from its partner in another column."""
    other_rows = view.rows(jump.against or "")
    flag = f"{row.structure}.{jump.when}"
    if other_rows is None or (jump.when and not view.integer(flag)):
        return
    partner = registry().by_key[other_rows.key]
    others = _values(partner, other_rows)
    for index, (at, value) in values.items():
        if index not in others:
            continue
        other = others[index][1]
        if abs(value - other) * unit > jump.largest:
            pair = full_name(row.key, index), full_name(partner.key, index)
            _report(view, rows, row, jump, at, pair, (value, other))
            return


def _report(
    view: ListView,
    rows: Rows,
    row: Parameter,
    change: Change,
    at: int,
    names: tuple[str, str],
    values: tuple[int | float, int | float],
) -> None:
    words = f"{names[0]} = {values[0]}, {names[1]} = {values[1]}"
    view.add(
        "warning",
        f"{words}: {abs(values[1] - values[0])} apart,"
        f" {'less' if change.least else 'more'} than a sound machine needs",
        row.key,
        place=view.value_place(rows, at),
        number=None if change.least else change.number,
        found=words,
        expected=(
            f"at least {change.least} {_unit_text(row)}"
            if change.least
            else f"at most {change.largest} {_unit_text(row)}"
        ).rstrip(),
    )


def _unit_text(row: Parameter) -> str:
    """Return the unit that a plausible limit stands in."""
    return row.unit[0].removesuffix(" or increments")
