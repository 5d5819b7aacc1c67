"""Rules between lists: compensation, axis and start-up lists of one machine."""

from collections.abc import Iterable, Sequence

from ._check_axis import check_axis, check_axis_list, largest_backlash
from ._check_lists import (
    AXIS_DIFFERS,
    EXTERNAL_LIMITS,
    ListSet,
    axis_number,
    base_name,
    file_number,
    in_force,
    is_fragment,
)
from ._check_startup import check_startup
from ._check_view import ListView
from ._registry import registry

_MODE = "frict_comp.mode"
"""Switch of the friction compensation in its own list; 0, the default, is off."""


def check_set(
    views: Sequence[ListView], gantry: Iterable[tuple[int, int]] = ()
) -> None:
    """Judge the lists of one machine against each other.

    Args:
        views: All lists.
        gantry: Pairs of master and partner axis, by logical number.
    """
    lists = ListSet(
        [view for view in views if view.file.kind == "compensation"],
        [view for view in views if view.file.kind == "axis"],
        [view for view in views if view.file.kind == "startup"],
    )
    _check_doubles(lists.compensation, "compensation lists")
    _check_doubles(lists.axis, "axis lists")
    for view in lists.compensation:
        _check_numbers(view, lists)
        _check_against_axis(view, lists)
        _check_known_masters(view, lists)
    for view in lists.axis:
        _check_activated(view, lists)
        check_axis_list(view)
    for number in dict.fromkeys(map(axis_number, lists.axis)):
        members = lists.axis if number is None else lists.axis_of(number)
        check_axis([view for view in members if axis_number(view) == number])
    for view in lists.startup:
        check_startup(view, lists)
    for master, partner in gantry:
        _check_gantry(master, partner, lists)
        _check_gantry(partner, master, lists)


def _check_doubles(views: list[ListView], title: str) -> None:
    """Report a second list for an axis that has one already."""
    first: dict[int, ListView] = {}
    for view in views:
        number = axis_number(view)
        if number is None or is_fragment(view):
            continue
        other = first.setdefault(number, view)
        if other is not view:
            view.add(
                "error",
                f"two {title} for axis {number}: the other is {other.file.source}",
                "kopf.achs_nr",
                found=str(number),
                expected="a number of its own for each list",
            )
            _check_two_masters(view, other)


def _check_two_masters(view: ListView, other: ListView) -> None:
    """Report two lists of one axis that give its cross table different masters."""
    key = "kw.crosscomp.master_ax_nr"
    masters = view.integer(key), other.integer(key)
    if key in view.columns and key in other.columns and masters[0] != masters[1]:
        view.add(
            "error",
            f"two masters for one cross table: axis {masters[0]}, and axis "
            f"{masters[1]} in {other.file.source}",
            key,
            number=registry().by_key[key].number,
            found=str(masters[0]),
            expected=str(masters[1]),
        )


def _check_numbers(view: ListView, lists: ListSet) -> None:
    """Report an ``achskw3.lis`` whose axis has another number in ``achsmds3.lis``."""
    number, file_axis = axis_number(view), file_number(view)
    # A number in a name of the user's own, such as y2.lis, need not be that of an axis.
    is_numbered = base_name(view.file.source).startswith("achskw")
    if number is None or file_axis is None or not is_numbered:
        return
    for other in lists.compensation if number != file_axis else ():
        if (axis_number(other), file_number(other)) == (file_axis, number):
            view.add(
                "warning",
                f"the list says axis {number}, and {other.file.source} axis {file_axis}: are"
                " the files, or the numbers in them, exchanged?",
                "kopf.achs_nr",
                found=str(number),
                expected=str(file_axis),
            )
    if lists.axis_of(number):
        return
    for other in [other for other in lists.axis if file_number(other) == file_axis][:1]:
        view.add(
            "error",
            f"the list says axis {number}, {other.file.source} says axis "
            f"{axis_number(other)}",
            "kopf.achs_nr",
            number=AXIS_DIFFERS,
            found=str(number),
            expected=str(axis_number(other)),
        )


def _check_against_axis(view: ListView, lists: ListSet) -> None:
    """Report functions that one of both lists leaves off, and doubled backlash."""
    number = axis_number(view)
    partners = [] if number is None else lists.axis_of(number)
    if not partners:
        return
    for function in registry().functions:
        key = function.activation
        axis = in_force(partners, key)
        if function.structure not in view.in_use:
            continue
        # Friction has a mode that is off.
        if function.structure == "frict_comp" and not view.integer(_MODE):
            if axis.integer(key) and view.integer(_MODE) == 0:
                view.add(
                    "warning",
                    f"{axis.file.source} switches the {function.name} on, but {_MODE}"
                    " does not: its table does nothing",
                    _MODE,
                    found=view.text(_MODE) or "no entry",
                    expected=f"{_MODE} 3, or {key} 0",
                )
        elif axis.integer(key) == 0:
            if is_fragment(axis) and key not in axis.columns:
                continue  # The list that it adds to may well switch it on.
            # It may hold tables over positions: those that have a unit.
            external = function.unit and any(
                EXTERNAL_LIMITS in partner.structures for partner in partners
            )
            axis.add(
                "info" if external else "warning",
                f"{view.file.source} holds a {function.name}, but {key} does "
                "not switch it on",
                key,
                found=axis.text(key) or "no entry",
                expected=f"0 if the external compensation ({EXTERNAL_LIMITS}) holds it too"
                " (both would correct twice), else 1"
                if external
                else "1",
            )
    if "kw.ssfk" in view.in_use and view.integer("kw.ssfk.bilateral"):
        key = "lr_param.anwahl_losekomp"
        axis = in_force(partners, key)
        gear = in_force(partners, "getriebe[].lose")
        size = largest_backlash(gear)
        has_size = gear.rows("getriebe[].lose") is not None
        if axis.integer(key) and (size or not has_size):
            axis.add(
                "warning",
                f"backlash is compensated twice: by {key} and by the bilateral "
                f"leadscrew table of {view.file.source}",
                key,
                found=f"{axis.text(key)}, "
                + (f"lose = {size}" if has_size else "lose not in the list"),
                expected="0 beside a bilateral table",
            )


def _check_known_masters(view: ListView, lists: ListSet) -> None:
    """Report masters that no list knows, where axis lists are there to know them.

    An info only: who checks the lists of one axis seldom has all others at hand.
    """
    if not lists.axis:
        return
    numbers = {axis_number(other) for other in lists.axis + lists.compensation}
    for startup in lists.startup:
        rows = startup.rows("achs_kw_log_ax_nr[]")
        numbers.update(rows.integers if rows is not None else ())
    for function in registry().functions:
        if function.structure not in view.in_use:
            continue
        for name in function.masters + function.adaptations:
            key = f"{function.structure}.{name}"
            master = view.integer(key)
            if key in view.columns and master and master not in numbers:
                view.add(
                    "info",
                    f"none of the lists belongs to axis {master}, a master of the "
                    f"{function.name}",
                    key,
                    number=registry().by_key[key].number,
                    found=str(master),
                    expected="the number of an axis of the machine",
                )


def _check_activated(axis: ListView, lists: ListSet) -> None:
    """Report functions that are switched on although their list or table is missing."""
    number = axis_number(axis)
    if number is None or not lists.compensation:
        return
    members = lists.compensation_of(number)
    for function in registry().functions:
        key = function.activation
        if not axis.integer(key):
            continue
        if not members:
            axis.add(
                "warning",
                f"{key} switches the {function.name} of axis {number} on, but no "
                "compensation list of this axis is there (a gantry partner needs its "
                "own)",
                key,
                number=function.absent,
                found="no list",
                expected=f"a compensation list with kopf.achs_nr {number}",
            )
        elif not any(function.structure in view.in_use for view in members):
            axis.add(
                "error",
                f"{key} switches the {function.name} on, but "
                f"{members[0].file.source} has no table for it",
                key,
                number=function.absent,
                found="no table",
                expected=f"entries {function.structure}.*",
            )


def _check_gantry(axis: int, partner: int, lists: ListSet) -> None:
    """Report compensations of one gantry axis that its partner lacks."""
    members = lists.compensation_of(partner)
    for view in lists.compensation_of(axis):
        for function in registry().functions:
            if function.structure not in view.in_use or not function.masters:
                continue
            if not any(function.structure in other.in_use for other in members):
                view.add(
                    "warning",
                    f"axis {partner}, gantry partner of axis {axis}, has no list with "
                    f"a {function.name}",
                    "kopf.achs_nr",
                    number=function.absent,
                    found="no list" if not members else "no table",
                    expected="a table for each axis of the gantry",
                )
