"""Two lists compared: entry by entry, as offset curves, and what loading takes."""

import dataclasses
from collections.abc import Callable, Iterator
from typing import Literal, TypeAlias

from ._check import check
from ._curves import DEFAULT_RULES, CurveRules, OffsetCurve, offset_curves
from ._entry import Rows
from ._listfile import ListFile
from ._names import full_name, meaning
from ._registry import registry
from ._values import parse_bits, parse_boolean, parse_integer, parse_real

Action: TypeAlias = Literal["none", "reload", "restart"]
"""What the controller needs: nothing, the lists loaded again, or a restart."""

_PARSERS: dict[str, tuple[Callable[[str], float | None], ...]] = {
    "REAL64": (parse_real,),
    "BITS": (parse_bits,),
}
"""How the values of a type read, beside as whole numbers."""


@dataclasses.dataclass(frozen=True)
class Change:
    """One entry that differs; None where the entry is missing."""

    name: str
    old: int | str | None
    new: int | str | None

    def __str__(self) -> str:
        if self.old is None:
            return f"+ {self.name}: {self.new}"
        if self.new is None:
            return f"- {self.name}: {self.old}"
        return f"~ {self.name}: {self.old} -> {self.new}"


@dataclasses.dataclass(frozen=True)
class CurveChange:
    """How much a table changes what the controller adds."""

    compensation: str
    branch: str
    largest: float | None
    """Change of the offset, new − old, of largest size; None if not comparable."""
    unit: str
    """µm, or increments."""
    at: tuple[float, ...]
    """Where: position of the master, or of both, in mm (or increments)."""
    note: str = ""
    """Why the two cannot be compared, or what else to know."""

    def __str__(self) -> str:
        branch = "" if self.branch == "both" else f", {self.branch} direction"
        name = f"{self.compensation}{branch}"
        if self.largest is None:
            return f"{name}: the offset curves cannot be compared: {self.note}"
        note = f" ({self.note})" if self.note else ""
        if self.largest == 0:
            return f"{name}: the controller adds the same as before{note}"
        unit = "mm" if self.unit == "µm" else "increments"
        place = ", ".join(f"{position:g}" for position in self.at)
        return (
            f"{name}: the offset changes by at most {self.largest:+g} {self.unit}, "
            f"at {place} {unit}{note}"
        )


@dataclasses.dataclass(frozen=True)
class Comparison:
    """What changed between two lists."""

    changed: tuple[Change, ...]
    curves: tuple[CurveChange, ...]
    action: Action
    reasons: tuple[str, ...]
    """Why a restart is needed, one sentence each."""
    faults: tuple[str, ...] = ()
    """Errors of the new list that `check` finds, one sentence each: it is not to be loaded."""


def compare(
    old: ListFile, new: ListFile, rules: CurveRules = DEFAULT_RULES
) -> Comparison:
    """Return what changed from one list to the other.

    Entries are compared by what they say: another spelling of a number, a comment or
    the order of the lines is no change. The rules are those of `offset_curves`.
    """
    changed = tuple(_changes(old, new))
    reasons = tuple(_restart_reasons(old, new, changed))
    action: Action = "none"
    if changed:
        action = "restart" if reasons else "reload"
    curves = tuple(_curve_changes(*(offset_curves(one, rules) for one in (old, new))))
    index = str(rules.get("plane_index", "ji"))
    findings = check([new], plane_index=index) if changed else []
    faults = tuple(str(one) for one in findings if one.level == "error")
    return Comparison(changed, curves, action, reasons, faults)


def _changes(old: ListFile, new: ListFile) -> Iterator[Change]:
    empty = Rows("", [], [], [], True)
    keys = [*new.columns, *(key for key in old.columns if key not in new.columns)]
    for key in keys:
        before, after = old.columns.get(key, empty), new.columns.get(key, empty)
        if before.indices == after.indices and before.texts == after.texts:
            continue
        places = [*after.last, *(at for at in before.last if at not in after.last)]
        for indices in places:
            texts = [_text(rows, indices) for rows in (before, after)]
            if not _equal(key, texts[0], texts[1]):
                values = [_readable(text) for text in texts]
                yield Change(full_name(key, indices), values[0], values[1])


def _text(rows: Rows, indices: tuple[int, ...]) -> str | None:
    row = rows.last.get(indices)
    return None if row is None else rows.texts[row]


def _readable(text: str | None) -> int | str | None:
    number = None if text is None else parse_integer(text)
    return text if number is None else number


def _equal(key: str, old: str | None, new: str | None) -> bool:
    if old is None or new is None or old == new:
        return old == new
    if meaning(key).boolean and (truth := parse_boolean(old)) is not None:
        return truth == parse_boolean(new)
    row = registry().by_key.get(key)
    for parse in (parse_integer, *_PARSERS.get("" if row is None else row.type, ())):
        number = parse(old)
        if number is not None and number == parse(new):
            return True
    return row is not None and bool(row.words) and old.upper() == new.upper()


def _restart_reasons(
    old: ListFile, new: ListFile, changed: tuple[Change, ...]
) -> Iterator[str]:
    """Return why loading the list again is not enough.

    The manuals promise an update at run time for compensation lists alone ([001]
    p. 27), and there not for the memory that a table reserves; for axis and start-up
    lists the strict reading is a restart.
    """
    if not changed:
        return
    for kind, sort in (("axis", "an axis list"), ("startup", "a start-up list")):
        if kind in (old.kind, new.kind):
            yield f"{sort}: only compensation lists are updated at run time"
            return
    for change in changed:
        row = registry().by_key.get(change.name)
        if row is None:
            continue
        if change.name.endswith(".max_points"):
            default = row.default if row.zero_is_default else None
            sizes = [value or default or 0 for value in (change.old, change.new)]
            if sizes[0] != sizes[1]:
                effect = f" (controller error {row.changed} on loading)"
                yield (
                    f"{change.name} changes from {sizes[0]} to {sizes[1]}"
                    f"{'' if row.changed is None else effect}"
                )
        elif change.name == "kopf.achs_nr":
            yield "kopf.achs_nr changes: the start-up list ties the file to its axis"


def _curve_changes(
    old: tuple[OffsetCurve, ...], new: tuple[OffsetCurve, ...]
) -> Iterator[CurveChange]:
    for compensation in dict.fromkeys(curve.compensation for curve in (*new, *old)):
        before: dict[str, OffsetCurve] = {}
        after: dict[str, OffsetCurve] = {}
        for curves, side in ((old, before), (new, after)):
            for curve in curves:
                if curve.compensation == compensation:
                    side[curve.branch] = curve
        sides = [s for s in ("positive", "negative") if s in before or s in after]
        for branch in sides or ("both",):
            # A table for both directions stands for each of them.
            pair = (
                before.get(branch, before.get("both")),
                after.get(branch, after.get("both")),
            )
            if pair[0] != pair[1]:
                yield _curve_change(compensation, branch, *pair)


def _curve_change(
    compensation: str,
    branch: str,
    old: OffsetCurve | None,
    new: OffsetCurve | None,
) -> CurveChange:
    """Return the largest change, which stands at a node of one of the two tables."""
    if old is not None and new is not None and old.masters != new.masters:
        # The same plane with its masters exchanged is the same.
        new = new.turned if old.masters == new.masters[::-1] else new
    curves = [curve for curve in (old, new) if curve is not None]
    axes = {curve.axis for curve in curves} - {None}
    unit = "µm" if all(curve.metric for curve in curves) else "increments"
    note = ""
    if len({curve.metric for curve in curves}) > 1:
        note = "one list counts in 0.1 µm, the other in increments"
    elif not all(curve.ascending and all(curve.nodes) for curve in curves):
        note = "the positions of a table do not ascend"
    elif len(axes) > 1:
        note = "another axis is compensated"
    elif len({curve.masters for curve in curves}) > 1:
        note = "the position of another axis enters the table"
    if note:
        return CurveChange(compensation, branch, None, unit, (), note)
    if len(curves) == 1:
        note = "new table" if old is None else "table removed"
    grid = tuple(
        tuple(sorted({at for curve in curves for at in curve.nodes[axis]}))
        for axis in range(len(curves[0].nodes))
    )
    zeros = [(0.0,) * len(grid[0])] * (len(grid[1]) if len(grid) > 1 else 1)
    first = zeros if old is None else old.sample(grid)
    second = zeros if new is None else new.sample(grid)
    largest = 0.0
    at: tuple[float, ...] = tuple(axis[0] for axis in grid)
    for j, (before, after) in enumerate(zip(first, second, strict=True)):
        for i, (a, b) in enumerate(zip(before, after, strict=True)):
            if abs(b - a) > abs(largest):
                largest = b - a
                at = tuple(axis[k] for axis, k in zip(grid, (i, j), strict=False))
    return CurveChange(compensation, branch, round(largest, 6), unit, at, note)
