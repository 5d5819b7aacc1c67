"""Rules of the start-up list, and between it and the other lists."""

from ._check_lists import (
    AXIS_DIFFERS,
    EXTERNAL,
    ListSet,
    axis_number,
    base_name,
    is_fragment,
)
from ._check_view import ListView
from ._entry import Rows
from ._names import full_name


def check_startup(view: ListView, lists: ListSet) -> None:
    """Judge a start-up list: complete, each axis once, numbers as in the lists."""
    names, numbers = view.rows("achs_kw[]"), view.rows("achs_kw_log_ax_nr[]")
    count = view.integer("zahl_kw")
    by_index: dict[int, int | None] = {}
    if numbers is not None:
        by_index = {
            index: numbers.integers[at] for (index,), at in numbers.last.items()
        }
    files: dict[str, int | None] = {}
    if names is not None:
        for (index,), at in names.last.items():
            files[base_name(names.texts[at])] = by_index.get(index)
            if names.texts[at] in names.texts[:at]:
                view.add(
                    "error",
                    f"{names.texts[at]} is named for two axes",
                    "achs_kw[]",
                    place=view.value_place(names, at),
                    number=AXIS_DIFFERS,
                    found=names.texts[at],
                    expected="a list for each axis",
                )
    total = max(len(files), len(by_index))
    complete = not is_fragment(view)
    if complete and (names is not None or numbers is not None) and count != total:
        view.add(
            "warning",
            f"zahl_kw is {count if count is not None else 'missing'}, but {total} "
            "compensation lists are named",
            "zahl_kw",
            found=str(count) if count is not None else "no entry",
            expected=str(total),
        )
    if complete:
        _check_pairs(view, names, numbers, count if count == total else None)
    if numbers is not None:
        for at, number in enumerate(numbers.integers):
            if number is not None and number in numbers.integers[:at]:
                view.add(
                    "error",
                    f"two compensation lists for axis {number}",
                    "achs_kw_log_ax_nr[]",
                    place=view.value_place(numbers, at),
                    number=AXIS_DIFFERS,
                    found=str(number),
                    expected="each axis once",
                )
    for other in lists.compensation:
        name = base_name(other.file.source)
        if name not in files:
            if not complete:
                continue
            view.add(
                "warning",
                f"{other.file.source} is not named: the controller does not load it",
                place=view.place("zahl_kw"),
                found=", ".join(sorted(files)) or "no compensation list",
                expected=name,
            )
        elif files[name] is not None and axis_number(other) not in (None, files[name]):
            other.add(
                "error",
                f"the list says axis {axis_number(other)}, {view.file.source} says "
                f"axis {files[name]}",
                "kopf.achs_nr",
                number=AXIS_DIFFERS,
                found=str(axis_number(other)),
                expected=str(files[name]),
            )
    _check_external(view, lists)


def _check_pairs(
    view: ListView, names: Rows | None, numbers: Rows | None, count: int | None
) -> None:
    """Report a file without axis number or the reverse, and indices beyond the count."""
    columns = [("achs_kw[]", names), ("achs_kw_log_ax_nr[]", numbers)]
    for (key, rows), (other, partner) in (columns, columns[::-1]):
        if rows is None:
            continue
        for (index,), at in rows.last.items():
            name = full_name(key, (index,))
            if partner is None or (index,) not in partner.last:
                missing = full_name(other, (index,))
                view.add(
                    "warning",
                    f"{name} stands without {missing}",
                    place=view.name_place(rows, at),
                    found=name,
                    expected=missing,
                )
            elif count is not None and index >= count:
                view.add(
                    "warning",
                    f"{name} is beyond the {count} compensation lists of zahl_kw",
                    place=view.name_place(rows, at),
                    found=f"index {index}",
                    expected=f"indices 0 to {count - 1}",
                )


_LIMIT, _FASTEST = f"{EXTERNAL}.err_limit", f"{EXTERNAL}.max_a"
_INTERFACE = "configuration.position_controller.enable_external_compensation_ifc"


def _check_external(view: ListView, lists: ListSet) -> None:
    """Report an external compensation without limits, and limits without its interface."""
    taking_part = [axis for axis in lists.axis if EXTERNAL in axis.structures]
    if not view.integer(_INTERFACE):
        if taking_part and not is_fragment(view):
            view.add(
                "warning",
                f"{taking_part[0].file.source} has limits of an external compensation,"
                " whose interface is closed",
                _INTERFACE,
                number=70587,
                found=view.text(_INTERFACE) or "no entry",
                expected=f"{_INTERFACE} 1",
            )
        return
    for axis in taking_part:
        # An acceleration that is left out is that of the axis.
        absent = [] if axis.integer(_LIMIT) else [_LIMIT]
        absent += [_FASTEST] if axis.integer(_FASTEST) == 0 else []
        for limit in absent:
            axis.add(
                "warning",
                f"external compensation is open, but {limit} is 0",
                limit,
                number=70585,
                found=axis.text(limit) or "no entry",
                expected="a limit above 0",
            )
    if not taking_part:
        # The axis lists may well have them; without any nobody can see.
        view.add(
            "warning" if lists.axis else "info",
            "external compensation is open, but no axis list here has limits for it",
            _LIMIT,
            place=view.place(_INTERFACE),
            number=70585,
            found="no entry",
            expected=f"{_LIMIT} of each axis that takes part",
        )
