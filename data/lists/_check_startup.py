"""Rules of the start-up list, and between it and the other lists."""

import itertools
import ntpath
from collections.abc import Mapping
from typing import TypeAlias

from ._check_lists import (
    AXIS_DIFFERS,
    EXTERNAL_LIMITS,
    ListSet,
    axis_number,
    base_name,
    is_fragment,
)
from ._check_view import ListView
from ._entry import Rows
from ._names import full_name

_Parts: TypeAlias = tuple[str, ...]
"""Folders and name of a file."""


def check_startup(view: ListView, lists: ListSet) -> None:
    """Judge a start-up list: complete, each axis once, numbers as in the lists."""
    names, numbers = view.rows("achs_kw[]"), view.rows("achs_kw_log_ax_nr[]")
    count = view.integer("zahl_kw")
    by_index: dict[int, int | None] = {}
    if numbers is not None:
        by_index = {
            index: numbers.integers[at] for (index,), at in numbers.last.items()
        }
    files: dict[_Parts, int | None] = {}
    if names is not None:
        for (index,), at in names.last.items():
            file = _parts(names.texts[at])
            twice = file in files
            files[file] = by_index.get(index)
            if twice:
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
        source, number = other.file.source, axis_number(other)
        named = _nearest(_parts(source), files)
        if not named:
            if not complete:
                continue
            view.add(
                "warning",
                f"{source} is not named: the controller does not load it",
                place=view.place("zahl_kw"),
                found=", ".join(sorted({file[-1] for file in files}))
                or "no compensation list",
                expected=base_name(source),
            )
        elif number is not None and named.isdisjoint((None, number)):
            stated = " or ".join(str(n) for n in sorted(named - {None}, key=str))
            other.add(
                "error",
                f"the list says axis {number}, {view.file.source} says axis {stated}",
                "kopf.achs_nr",
                number=AXIS_DIFFERS,
                found=str(number),
                expected=stated,
            )
    _check_external(view, lists)


def _parts(path: str) -> _Parts:
    r"""Return folders and name of a file as Windows compares them: ``A/x`` is ``a\X``."""
    return tuple(ntpath.normpath(path.lower()).split("\\"))


def _common(one: _Parts, other: _Parts) -> int:
    """Return how many parts two paths share, counted from the name of the file."""
    pairs = zip(reversed(one), reversed(other), strict=False)
    return sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], pairs))


def _nearest(source: _Parts, files: Mapping[_Parts, int | None]) -> set[int | None]:
    """Return the axis of the named file that a list is: of one name, and most folders.

    A list may lie elsewhere than on the controller. None for no number; several numbers
    where nothing tells the files apart; empty where none has its name.
    """
    alike = {file: _common(source, file) for file in files}
    most = max(alike.values(), default=0)
    return {files[file] for file, count in alike.items() if count == most > 0}


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


_LIMIT, _FASTEST = f"{EXTERNAL_LIMITS}.err_limit", f"{EXTERNAL_LIMITS}.max_a"
_INTERFACE = "configuration.position_controller.enable_external_compensation_ifc"


def _check_external(view: ListView, lists: ListSet) -> None:
    """Report an external compensation without limits, and limits without its interface."""
    taking_part = [axis for axis in lists.axis if EXTERNAL_LIMITS in axis.structures]
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
