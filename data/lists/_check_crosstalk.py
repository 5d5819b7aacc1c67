"""Rules of the crosstalk list, in its present and in its older form."""

from ._check_columns import (
    absent_indices,
    check_ascending,
    check_complete,
    check_size,
    column_values,
    usable,
)
from ._check_structure import crosstalk_forms
from ._check_view import ListView
from ._registry import registry

_STEM = "kw.crosstalk"
_ORDER = 70660
"""Controller: positions of an adaptation axis in invalid order."""


def check_crosstalk(view: ListView) -> None:
    """Judge the crosstalk list of a view."""
    if _STEM not in view.in_use:
        return
    new, old = crosstalk_forms(view)
    if old:
        _report_old(view, mixed=new)
    if new:
        _check_tests(view)
    elif old:
        _check_old_table(view)


def _report_old(view: ListView, *, mixed: bool) -> None:
    rows = [
        view.columns[key]
        for key, row in registry().by_key.items()
        if row.generation == "old" and row.structure == _STEM and key in view.columns
    ]
    first = min(rows, key=lambda column: column.lines[0])
    if mixed:
        view.add(
            "error",
            "the list mixes the older and the present form of crosstalk compensation",
            first.key,
            place=view.name_place(first, 0),
            found=f"{first.key} beside entries of the present form",
            expected="one form",
        )
    else:
        view.add(
            "info",
            "crosstalk compensation in the form of an older manual generation",
            first.key,
            place=view.name_place(first, 0),
            found=first.key,
            expected="kw.crosstalk.mode, acceleration, position[i]",
        )


def _check_old_table(view: ListView) -> None:
    sizer = registry().by_key[f"{_STEM}.last_index"]
    last = view.integer(sizer.key)
    if last is None or not usable(last):
        return
    acceleration = f"{_STEM}.table[].acceleration"
    correction = f"{_STEM}.table[].correction"
    for key in (acceleration, correction):
        check_size(view, key, last + 1, sizer)
    if last:
        check_ascending(view, acceleration, last + 1, "accelerations")
    check_complete(view, correction, last + 1)


def _check_tests(view: ListView) -> None:
    """Judge the acceleration tests of the present form."""
    sizer = registry().by_key[f"{_STEM}.max_points"]
    mode = view.integer(f"{_STEM}.mode")
    count = 1 if mode == 1 else view.integer(sizer.key)
    if mode not in (1, 2, 3) or count is None or not usable(count):
        return
    values = [
        key
        for key, row in registry().by_key.items()
        if row.structure == _STEM and key.startswith(f"{_STEM}.position[].correction")
    ]
    positions = [f"{_STEM}.position[].ax_{axis}" for axis in (1, 2)][: mode - 1]
    if mode == 1:
        _report_further_tests(view, values)
    elif sizer.key in view.columns:
        for key in values + positions:
            check_size(view, key, count, sizer)
    else:
        return  # the missing size is a finding already
    directed = bool(view.integer(f"{_STEM}.velocity_dependent"))
    for key in values:
        if directed or key.endswith("_pos"):
            check_complete(view, key, count)
        elif (rows := view.rows(key)) is not None:
            view.add(
                "info",
                f"{key} is not used without velocity_dependent",
                key,
                place=view.name_place(rows, 0),
                found=f"{len(rows.lines)} entries",
                expected="velocity_dependent 1, or no entry",
            )
    if mode == 2 and count > 1:
        check_ascending(
            view, positions[0], count, "positions of the adaptation axis", _ORDER
        )
    elif mode == 3:
        _check_places(view, positions, count)


def _report_further_tests(view: ListView, values: list[str]) -> None:
    """Mode 1 has one set of values; further tests are stored and not used."""
    for key in values:
        rows = view.rows(key)
        if rows is not None and max(rows.last)[0] > 0:
            view.add(
                "info",
                f"{key} has more than one test, mode 1 uses the first",
                key,
                place=view.name_place(rows, 0),
                found=f"index {max(rows.last)[0]}",
                expected="index 0",
            )


def _check_places(view: ListView, positions: list[str], count: int) -> None:
    """Judge the places of mode 3: complete, all different, ordered along an axis."""
    columns = [view.rows(key) for key in positions]
    complete = True
    for key, rows in zip(positions, columns, strict=True):
        if absent_indices(rows, count)[0]:
            check_complete(view, key, count)
            complete = False
    first, second = columns
    if not complete or first is None or second is None or not count:
        return
    if None in first.integers or None in second.integers:
        return  # values that cannot be read have findings of their own
    pairs = list(
        zip(column_values(first, count), column_values(second, count), strict=True)
    )
    if len(set(pairs)) < count:
        at = next(i for i in range(count) if pairs[i] in pairs[:i])
        place = f"{pairs[at][0]}, {pairs[at][1]}"
        view.add(
            "error",
            f"two tests at one place: position[{at}] is {place} again",
            positions[0],
            place=view.value_place(first, first.last[(at,)]),
            number=_ORDER,
            found=place,
            expected="each place once",
        )
        return
    (a0, b0), (a1, b1) = pairs[0], pairs[-1]
    if all((a - a0) * (b1 - b0) == (b - b0) * (a1 - a0) for a, b in pairs):
        view.add(
            "warning",
            "the places of the tests lie on one line: what holds beside it, no test says",
            positions[0],
            place=view.value_place(first, 0),
            found=f"{count} test{'s' * (count > 1)} on one line",
            expected="three tests or more that span a surface, or mode 2 along one axis",
        )
    turned = [(b, a) for a, b in pairs]
    if pairs != sorted(pairs) and turned != sorted(turned):
        view.add(
            "warning",
            "the places of the tests are not ordered along either adaptation axis",
            positions[0],
            place=view.value_place(first, 0),
            number=_ORDER,
            found="no order",
            expected="ax_1 or ax_2 ascending, the other ascending within each",
        )
