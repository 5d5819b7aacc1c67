"""Rules that the entries of one axis list, and of what is added to it, show together."""

from collections.abc import Sequence

from ._check_lists import in_force, is_fragment
from ._check_view import ListView
from ._registry import registry
from ._values import BITS

_ABRUPT = 1000
"""Backlash in list units (0.1 mm) from which a jump within one cycle is a likely mistake."""


def check_axis(lists: Sequence[ListView]) -> None:
    """Judge what the lists of one axis say together: the list, then its fragments."""
    _check_demands(lists)
    _check_abrupt(lists)


def _check_demands(lists: Sequence[ListView]) -> None:
    """Report a compensation that automatic mode demands and that is switched off.

    The kernel demands only what is switched on ([001] p. 97): the axis would move without it
    and without a word.
    """
    demand = registry().by_key["lr_param.prog_movement_requires_compensations"]
    axis = in_force(lists, demand.key)
    bits = axis.integer(demand.key) or 0
    for row in registry().rows:
        if row.demanded is None or not bits & BITS[row.demanded]:
            continue
        switch = in_force(lists, row.key)
        if switch.integer(row.key) != 0 or _may_stand_elsewhere(switch, row.key):
            continue
        axis.add(
            "warning",
            f"{demand.key} demands {row.demanded}, but {row.key} does not switch it on:"
            " the axis moves without it, and nothing is reported",
            demand.key,
            found=f"{row.key} = {switch.text(row.key) or 'no entry'}",
            expected=f"{row.key} 1, or no {row.demanded}",
        )


def _check_abrupt(lists: Sequence[ListView]) -> None:
    """Report a large backlash that comes within one cycle."""
    cycles_key = "lr_param.n_backlash_cyc"
    gear, selected, spread = (
        in_force(lists, key)
        for key in ("getriebe[].lose", "lr_param.anwahl_losekomp", cycles_key)
    )
    size, cycles = largest_backlash(gear), spread.integer(cycles_key)
    if abs(size) <= _ABRUPT or not selected.integer("lr_param.anwahl_losekomp"):
        return
    if cycles in (0, 1) and not _may_stand_elsewhere(spread, cycles_key):
        gear.add(
            "warning",
            f"a backlash of {abs(size)} (0.1 µm or 0.0001°) comes within one cycle:"
            f" {cycles_key} is {cycles}",
            cycles_key,
            place=gear.place("getriebe[].lose"),
            found=f"{cycles_key} = {spread.text(cycles_key) or 'no entry'}",
            expected=f"{cycles_key} from 2 to 19",
        )


def _may_stand_elsewhere(view: ListView, key: str) -> bool:
    """Return whether only a fragment is there, and the entry may be in the whole list."""
    return is_fragment(view) and key not in view.columns


def check_axis_list(view: ListView) -> None:
    """Judge what only the entries of one axis list together can show."""
    selected = view.integer("lr_param.anwahl_losekomp")
    if selected and not largest_backlash(view):
        view.add(
            "warning",
            "backlash compensation is on, but the backlash is 0",
            "getriebe[].lose",
            place=view.place("lr_param.anwahl_losekomp"),
            found="0",
            expected="the size of the backlash",
        )
    heated = [
        key
        for key in ("lr_param.temp_comp_offset_0", "lr_param.temp_comp_coefficient")
        if view.given(key)
    ]
    switch = "lr_param.temp_comp"
    if heated and view.integer(switch) == 0:
        view.add(
            "warning",
            f"{heated[0]} is set, but {switch} does not switch the temperature "
            "compensation on",
            switch,
            place=view.place(switch if switch in view.columns else heated[0]),
            found=view.text(switch) or "no entry",
            expected="1",
        )


def largest_backlash(axis: ListView) -> int:
    """Return the backlash of the largest size among the gears, in list units."""
    rows = axis.rows("getriebe[].lose")
    values = [] if rows is None else [value or 0 for value in rows.integers]
    return max(values, key=abs, default=0)
