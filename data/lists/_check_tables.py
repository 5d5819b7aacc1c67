"""Rules of the tables of cross, plane, leadscrew and friction compensation."""

import operator

from ._check_columns import check_ascending, check_complete, check_size, usable
from ._check_lists import axis_number
from ._check_view import ListView, shorten
from ._entry import Rows
from ._finding import Level
from ._registry import registry

_LOW_SCALE = 200
"""Friction scaling, in 0.1 %, below which a table hardly acts (semantics.md)."""

_PER_DEGREE = 10_000
"""List units in a degree, where `unit` is 1."""


def check_tables(view: ListView) -> None:
    """Judge the tables of cross, plane, leadscrew and friction compensation."""
    if "kw.crosscomp" in view.in_use:
        _check_cross(view)
    if "kw.crosscomp2" in view.in_use:
        _check_plane(view)
    if "kw.ssfk" in view.in_use:
        _check_leadscrew(view)
    if "frict_comp" in view.in_use:
        _check_friction(view)


def _check_cross(view: ListView) -> None:
    sizer = registry().by_key["kw.crosscomp.last_index"]
    last = view.integer(sizer.key)
    if last is None or not usable(last):
        return
    setpoint = "kw.crosscomp.table[].setpoint"
    correction = "kw.crosscomp.table[].correction"
    for key in (setpoint, correction):
        check_size(view, key, last + 1, sizer)
    if last == 0:
        view.add(
            "warning",
            "the cross table has a single point: one constant offset everywhere",
            sizer.key,
            found=f"last_index = 0{'' if sizer.key in view.columns else ' (left out)'}",
            expected="two points or more",
        )
    check_ascending(view, setpoint, last + 1, "cross setpoints")
    check_complete(view, correction, last + 1)


def _check_leadscrew(view: ListView) -> None:
    sizer = registry().by_key["kw.ssfk.kw_nr_max"]
    count = view.integer(sizer.key)
    if count is None or not usable(count) or sizer.key not in view.columns:
        return
    pos, neg = "kw.ssfk.table[].pos", "kw.ssfk.table[].neg"
    setpoint = "kw.ssfk.table[].setpoint"
    for key in (pos, neg, setpoint):
        check_size(view, key, count, sizer, tolerated=True)
    if not count:
        return
    sides, interval = (
        view.integer(f"kw.ssfk.{name}") for name in ("bilateral", "interval")
    )
    bilateral = bool(sides)
    modulo = bool(view.integer("kw.ssfk.modulo"))
    if interval == 0:
        check_ascending(view, setpoint, count, "leadscrew setpoints", 110590)
    elif interval is not None and (rows := view.rows(setpoint)) is not None:
        _unused(view, rows, "interval is not 0: the points are equidistant")
    for key in (pos, neg) if bilateral else (pos,):
        check_complete(
            view, key, count, absent=70083 if key == pos else None, strict=modulo
        )
        _check_closed(view, key, count)
    _check_reached(view, count)
    if sides == 0 and (rows := view.rows(neg)) is not None:
        _unused(view, rows, "the table is unilateral (bilateral 0)")
    option = "kw.ssfk.set_pos_without_comp"
    if bilateral and not view.integer(option):
        view.add(
            "info",
            "other compensations enter the bilateral table and may turn its direction",
            option,
            found=view.text(option) or "no entry",
            expected="set_pos_without_comp 1",
        )


def _unused(view: ListView, rows: Rows, reason: str) -> None:
    view.add(
        "info",
        f"{rows.key} is not used: {reason}",
        rows.key,
        place=view.name_place(rows, 0),
        found=f"{len(rows.lines)} entries",
        expected="no entry",
    )


def _check_closed(view: ListView, key: str, count: int) -> None:
    """Report a table over a turn whose ends differ: the axis jumps where it passes over."""
    rows, turn = view.rows(key), _turn(view, count)
    if rows is None or turn is None:
        return
    first, last = (rows.last.get((index,)) for index in (0, count - 1))
    if first is None or last is None or rows.integers[first] == rows.integers[last]:
        return
    (level, title), flag = turn, "kw.ssfk.modulo"
    ends = f"[0] = {rows.texts[first]}, [{count - 1}] = {rows.texts[last]}"
    also = "" if view.integer(flag) else f", and {flag} 1"
    view.add(
        level,
        f"the ends of the {title} differ: {key} {ends}",
        flag,
        place=view.value_place(rows, last),
        found=ends,
        expected=f"the same value at both ends{also}",
    )


def _turn(view: ListView, count: int) -> tuple[Level, str] | None:
    """Return what a table over a turn of its axis is, and how grave unequal ends are.

    None where it goes over no whole turn. The list itself says so only by `modulo`.
    """
    if view.integer("kw.ssfk.modulo"):
        return "warning", "modulo table"
    ends = _ends(view, count)
    if ends is None:
        return None
    start, end = ends
    if view.modulo is None:
        is_turn = end - start == 360 * _PER_DEGREE
        title = "table over 360 (a whole turn, where the axis goes round)"
        return ("info", title) if is_turn else None
    low, high = _range(view)
    covers = start <= low < high <= end
    return ("warning", "table over the whole turn of its axis") if covers else None


def _ends(view: ListView, count: int) -> tuple[int, int] | None:
    """Return the positions of the first and last node in list units; None if they have others."""
    start, interval = (
        view.integer(f"kw.ssfk.{n}") for n in ("kw_startpos", "interval")
    )
    setpoints = view.rows("kw.ssfk.table[].setpoint")
    end: int | None = None
    if interval and start is not None:
        end = start + (count - 1) * interval
    elif interval == 0 and setpoints is not None:
        ends = (setpoints.last.get((index,)) for index in (0, count - 1))
        start, end = (None if at is None else setpoints.integers[at] for at in ends)
    if start is None or end is None or view.integer("kw.ssfk.unit") != 1:
        return None
    return start, end


def _range(view: ListView) -> tuple[int, int]:
    """Return the modulo range of the axis in list units; (0, 0) where it goes round in none."""
    low, high = (view.modulo or {}).get(axis_number(view) or 0, (0.0, 0.0))
    return round(low * _PER_DEGREE), round(high * _PER_DEGREE)


def _check_reached(view: ListView, count: int) -> None:
    """Report nodes that an axis that goes round never reaches, and a turn without some."""
    ends, (low, high) = _ends(view, count), _range(view)
    if ends is None or low == high:
        return
    flag = "kw.ssfk.modulo"
    first, last, start, end = (at / _PER_DEGREE for at in (*ends, low, high))
    if low <= ends[0] <= ends[1] <= high:
        # An interval in whole units of the list is short by less than one of them.
        lacking = high - low - (ends[1] - ends[0])
        if view.integer(flag) and lacking >= count:
            view.add(
                "warning",
                f"the nodes of the modulo table go from {first:g} to {last:g}, not over the"
                " whole modulo range of their axis: its ends do not meet",
                flag,
                found=f"nodes from {first:g} to {last:g}",
                expected=f"nodes from {start:g} to {end:g}",
            )
        return
    view.add(
        "warning",
        f"the leadscrew nodes from {first:g} to {last:g} lie in part outside the modulo range"
        " of their axis: no position reaches those, and the value of an end is held instead",
        flag,
        found=f"nodes from {first:g} to {last:g}",
        expected=f"nodes within {start:g} to {end:g}",
    )


def _check_friction(view: ListView) -> None:
    sizer = registry().by_key["frict_comp.table_entries"]
    count = view.integer(sizer.key)
    if count is None or not usable(count):
        return
    if sizer.key not in view.columns and view.integer("frict_comp.mode"):
        return
    velocity, current = "frict_comp.table[].in", "frict_comp.table[].out"
    for key in (velocity, current):
        check_size(view, key, count, sizer)
    if count:
        check_ascending(view, velocity, count, "friction velocities")
        check_complete(view, current, count)
    scale = "frict_comp.scaling_factor"
    share = view.integer(scale)
    if share is not None and abs(share) < _LOW_SCALE:
        view.add(
            "info",
            f"only {share / 10:g} % of the table's current is added",
            scale,
            found=str(share),
            expected="1000 for the values as they stand",
        )


def _check_plane(view: ListView) -> None:
    key = "kw.crosscomp2.table[][].correction"
    rows = view.rows(key)
    first, second = (2, 1) if view.plane_index == "ji" else (1, 2)
    ends = [
        view.integer(f"kw.crosscomp2.last_index_master{k}") for k in (first, second)
    ]
    _check_plane_order(view, rows)
    grid_word = view.value("kw.crosscomp2.grid")
    is_square = grid_word != "RECTANGULAR"
    idle = ("interval1", "interval2") if is_square else ("interval",)
    for name in idle if grid_word is not None else ():
        spare = view.rows(f"kw.crosscomp2.{name}")
        if spare is not None:
            grid = "QUADRATIC" if is_square else "RECTANGULAR"
            _unused(view, spare, f"the grid is {grid}")
    if ends[0] is None or ends[1] is None or not all(map(usable, ends)):
        return
    last_j, last_i = ends[0], ends[1]
    count = (last_j + 1) * (last_i + 1)
    present = rows.last if rows is not None else {}
    inside = len(present)
    if rows is not None and present:
        height = max(map(operator.itemgetter(0), present))
        width = max(map(operator.itemgetter(1), present))
        if height > last_j or width > last_i:
            beyond = [
                at for at, (j, i) in enumerate(rows.indices) if j > last_j or i > last_i
            ]
            inside -= len({rows.indices[at] for at in beyond})
            swapped = height <= last_i and width <= last_j
            hint = (
                f"; are the indices swapped? the first one is master {first}"
                if swapped
                else ""
            )
            listed = shorten((_cell(*rows.indices[at]) for at in beyond), len(beyond))
            view.add(
                "error",
                f"{key} goes beyond the table's end: {listed}, but "
                f"last_index_master{first} = {last_j}, last_index_master{second} ="
                f" {last_i}{hint}",
                key,
                place=view.name_place(rows, beyond[0]),
                found=listed,
                expected=f"indices up to [{last_j}][{last_i}]",
            )
    if inside < count:
        cells = (
            _cell(j, i)
            for j in range(last_j + 1)
            for i in range(last_i + 1)
            if (j, i) not in present
        )
        view.add(
            "warning" if inside else "error",
            f"{key} lacks {count - inside} of {count} entries, which count as 0: "
            f"{shorten(cells, count - inside)}",
            key,
            place=view.place(key) if rows is None else view.name_place(rows, 0),
            number=None if inside else 70183,
            found=f"{inside} entries",
            expected=f"{count} entries",
        )


def _cell(j: int, i: int) -> str:
    """Return the indices of a plane entry as a list writes them."""
    return f"[{j}][{i}]"


def _check_plane_order(view: ListView, rows: Rows | None) -> None:
    """Report a table size behind the table: the values above it must be read again."""
    if rows is None:
        return
    for axis in (1, 2):
        key = f"kw.crosscomp2.last_index_master{axis}"
        sizes = view.rows(key)
        if sizes is not None and sizes.lines[-1] > min(rows.lines):
            view.add(
                "warning",
                f"{key} stands behind entries of the table, which the kernel must then "
                "read again",
                key,
                found=f"table from line {min(rows.lines)}",
                expected="the size above the table",
            )
