"""Roles: what a column of a measurement means, independent of how the file calls it."""

import dataclasses
import json
import re
from typing import Any

from ._errors import RoleError
from ._units import find_unit, nearest

_PLACE = ("length", "angle", "increments")
KINDS: dict[str, tuple[str, ...]] = {
    "position": _PLACE,
    "actual": _PLACE,
    "encoder": _PLACE,
    "error": _PLACE,
    "direction": (),
    "velocity": ("velocity", "angular velocity", "increments per s"),
    "acceleration": ("acceleration", "angular acceleration", "increments per s2"),
    "current": ("current", "ratio", "torque", "force", "voltage", "drive units"),
    "drive_position": _PLACE,
}
"""Kinds of role that an axis has, with the dimensions that their units may have."""

AXIS_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*")
"""What a role begins with: the name of an axis."""
_EXPECTED = "time, run, temperature.<sensor> or <axis>.<kind> with kind " + ", ".join(
    KINDS
)


@dataclasses.dataclass(frozen=True)
class Role:
    """One role: ``time``, ``run``, ``temperature.<sensor>`` or ``<axis>.<kind>``.

    Attributes:
        kind: ``time``, ``run``, ``temperature`` or a key of `KINDS`.
        axis: Axis, or None for the first three.
        sensor: Of a temperature.
    """

    kind: str
    axis: str | None = None
    sensor: str | None = None

    def __str__(self) -> str:
        if self.axis is not None:
            return f"{self.axis}.{self.kind}"
        return self.kind if self.sensor is None else f"{self.kind}.{self.sensor}"

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Dimensions that the unit may have; empty for a count or a direction."""
        if self.kind == "time":
            return ("time",)
        if self.kind == "temperature":
            return ("temperature",)
        return KINDS.get(self.kind, ())


@dataclasses.dataclass(frozen=True)
class ColumnSpec:
    """Where the values of a role are.

    Attributes:
        column: Name of the column; empty where there is none or there are several.
        unit: Its unit, where the file does not state it.
        value: One value for all rows, in place of a column.
        interval: What `value` grows by from row to row, where rows are evenly spaced.
        sign: -1: the values are the negative of those of the column, as corrections are
            the negative of errors. None: nobody said so; 1.
        positive: Word of a column of directions that stands for +1.
        parts: Columns of a table with one column per run; `column` is empty.
        run: Run of all readings of the column, as one of `parts`.
        direction: Direction ±1 of all its readings, as one of `parts`.
    """

    column: str
    unit: str | None = None
    value: float | None = None
    interval: float = 0.0
    sign: int | None = None
    positive: str | None = None
    parts: tuple["ColumnSpec", ...] = ()
    run: int | None = None
    direction: int | None = None

    @property
    def factor(self) -> int:
        """What the values of the column are times."""
        return self.sign or 1

    def of_job(self) -> Any:
        """Return what a job says: a name, a table, or a list of one table per run."""
        if self.parts:
            return [part.of_job() for part in self.parts]
        default = ColumnSpec("")
        stated = {
            field.name: getattr(self, field.name)
            for field in dataclasses.fields(self)
            if getattr(self, field.name) != getattr(default, field.name)
        }
        if "unit" in stated and find_unit(stated["unit"]) is None:
            del stated["unit"]
        return self.column if stated.keys() == {"column"} else stated

    def words(self) -> str:
        """Return what a job says, as it is written there."""
        return _inline(self.of_job())


def _inline(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_inline, value))}]"
    if isinstance(value, dict):
        pairs = ", ".join(f"{key} = {_inline(item)}" for key, item in value.items())
        return f"{{ {pairs} }}"
    return json.dumps(value, ensure_ascii=False)


def find_role(text: str) -> Role | None:
    """Return the role that a text names, or None."""
    if text in ("time", "run"):
        return Role(text)
    head, dot, tail = text.partition(".")
    if not dot or not tail or not AXIS_NAME.fullmatch(head):
        return None
    if head == "temperature":
        return Role("temperature", sensor=tail)
    return Role(tail, axis=head) if tail in KINDS else None


def role(text: str, source: str) -> Role:
    """Return the role that a text names.

    Raises:
        RoleError: If there is none; names the nearest.
    """
    result = find_role(text)
    if result is not None:
        return result
    head, dot, tail = text.partition(".")
    if dot and AXIS_NAME.fullmatch(head) and head != "temperature":
        close = f"{head}.{nearest(tail, KINDS)}"
    else:
        close = nearest(
            text, ("time", "run", "temperature.<sensor>", "<axis>.position")
        )
    raise RoleError(source, text, close, _EXPECTED)
