"""Rules between the entries of one structure: what must stand, and what must agree."""

import functools

from ._check_view import ListView
from ._expression import expression
from ._finding import Level
from ._parameter import Condition, Function, Parameter
from ._registry import registry

_OLD_ONLY = ("master_ax_nr", "last_index", "table[].acceleration", "table[].correction")
_OLD_KEYS = frozenset(f"kw.crosstalk.{name}" for name in _OLD_ONLY)
"""Entries that only the older crosstalk list has."""
_SHARED = {"kw.crosstalk.n_cycles", "kw.crosstalk.manual_activation"}
"""Entries that both have."""


def check_structures(view: ListView) -> None:
    """Judge what must stand and what must agree, for the functions that are in use."""
    manual = registry()
    skipped = _other_generation(view)
    for row in manual.ruled.get(view.file.kind, ()):
        if row.key in skipped:
            continue
        active = row.structure in view.in_use or row.structure == "kopf"
        if active and row.needed is not None and row.key not in view.columns:
            if _holds(view, row, row.needed):
                _missing(view, row)
                continue
        if not active and row.kind == "compensation":
            continue
        for condition in row.conditions:
            _judge(view, row, condition)
    for function in manual.functions:
        if function.structure in view.in_use:
            _check_unit(view, function)
            _check_masters(view, function)


def crosstalk_forms(view: ListView) -> tuple[bool, bool]:
    """Return whether the present and the older form of a crosstalk list are there."""
    keys = [key for key in view.columns if key.startswith("kw.crosstalk.")]
    parameters = registry().by_key
    new = any(key in parameters and key not in _OLD_KEYS | _SHARED for key in keys)
    return new, any(key in _OLD_KEYS for key in keys)


def _other_generation(view: ListView) -> frozenset[str]:
    """Return the crosstalk entries that the generation of the list does not have."""
    new, old = crosstalk_forms(view)
    return _present_only() if old and not new else _OLD_KEYS


@functools.cache
def _present_only() -> frozenset[str]:
    keys = (key for key in registry().by_key if key.startswith("kw.crosstalk."))
    return frozenset(keys) - _OLD_KEYS


def _holds(view: ListView, row: Parameter, text: str) -> bool | None:
    stem = row.structure
    return expression(text).holds(
        lambda name: view.value(f"{stem}.{name}"),
        lambda name: view.given(f"{stem}.{name}"),
    )


def _missing(view: ListView, row: Parameter) -> None:
    line = 1 if row.structure == "kopf" else view.first_line(row.structure)
    expected = "an entry" if row.range is None else f"an entry with {row.range}"
    view.add(
        "error",
        f"{row.key} is missing: {row.text.split(';')[0]}",
        row.key,
        place=(line, 1),
        number=row.missing,
        found="no entry",
        expected=expected,
    )


def _judge(view: ListView, row: Parameter, condition: Condition) -> None:
    """Judge one condition, with the level that its readings give."""
    if condition.when is not None and not _holds(view, row, condition.when):
        return
    results = [_holds(view, row, reading) for reading in condition.readings]
    if None in results or all(results):
        return
    level: Level = "warning" if any(results) else condition.level
    # Shown at the owner's place, else at the first of the entries that stand there.
    names = dict.fromkeys(
        name for reading in condition.readings for name in expression(reading).names
    )
    keys = [f"{row.structure}.{name}" for name in names]
    present = [key for key in keys if key in view.columns]
    anchor = row.key if row.key in present else (present[0] if present else row.key)
    parts: list[str] = []
    for key in keys:
        name = key.rpartition(".")[2]
        note = "" if key in view.columns else " (default)"
        parts.append(f"{name} = {view.value(key)}{note}")
    stated = ", ".join(parts)
    caveat = (
        " (only one of two statements of the manuals allows it)" if any(results) else ""
    )
    view.add(
        level,
        f"{row.structure}: {stated}; expected {condition.expected}{caveat}",
        row.key,
        place=view.place(anchor),
        number=condition.number,
        found=stated,
        expected=condition.expected,
    )


def _check_unit(view: ListView, function: Function) -> None:
    """Report a missing unit, increments, and the remark that it is discontinued."""
    if function.unit is None:
        return
    row = registry().by_key[function.unit]
    if row.key not in view.columns:
        view.add(
            "warning",
            f"{row.key} is missing: all lengths of the {function.name} count in "
            "encoder increments",
            row.key,
            found="no entry",
            expected="1, metric in 0.1 µm or 0.0001°",
        )
        return
    if row.discontinued is not None:
        view.add(
            "info",
            f"{row.key} is discontinued in one manual, in use in the others",
            row.key,
            found=view.text(row.key) or "",
            expected="the entry, as long as its default is increments",
        )


def _check_masters(view: ListView, function: Function) -> None:
    """Report two masters for one table, and an axis that is its own master."""
    axis = view.integer("kopf.achs_nr")
    keys = [f"{function.structure}.{name}" for name in function.masters]
    present = [key for key in keys if key in view.columns]
    for key in present:
        rows = view.columns[key]
        masters = dict.fromkeys(value for value in rows.integers if value is not None)
        if len(masters) > 1:
            numbers = " and ".join(str(master) for master in masters)
            view.add(
                "error",
                f"two masters for one table of the {function.name}: axes {numbers}",
                key,
                number=registry().by_key[key].number,
                found=numbers,
                expected="one master axis",
            )
    if axis is not None and (equal := [k for k in present if view.integer(k) == axis]):
        view.add(
            "warning",
            f"axis {axis} is its own master in the {function.name}",
            equal[0],
            found=str(axis),
            expected="another axis",
        )
