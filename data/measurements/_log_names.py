"""What the columns of a controller log are called: CNC objects, variables, roles."""

import dataclasses
import re
from collections.abc import Collection

from ._cnc_objects import CNC_OBJECTS

COMPENSATIONS = (
    "backlash",
    "temperature",
    "cross",
    "plane",
    "leadscrew",
    "crosstalk",
    "friction",
)
"""Compensations of the kernel, as jobs and logs name them."""

TOTAL = "offset"
"""Name of the sum of all position offsets of an axis."""


EXTERNAL_LOG = "external"
"""Name of what an external compensation adds, the object ``EXTC[0].actual_offset``."""


def _plain(text: str) -> str:
    """Return letters and digits only: exports spell the names of objects differently."""
    return re.sub(r"[^a-z0-9]", "", text.lower())


_OBJECTS = {
    _plain(one.name): (one.compensation, one.reports == "filtered")
    for one in CNC_OBJECTS
    if one.reports is not None
} | {_plain("EXTC[0].actual_offset"): (EXTERNAL_LOG, True)}
"""CNC object, letters and digits only: compensation, and whether filters have acted."""
_STATES = {_plain(one.name): one.compensation for one in CNC_OBJECTS if one.tells_state}
_VARIABLES = {
    "BACKLASH": "backlash",
    "TEMP": "temperature",
    "CROSS": "cross",
    "PLANE": "plane",
    "LEAD": "leadscrew",
    "CROSSTALK": "crosstalk",
    "FRICT": "friction",
}
_VARIABLE = re.compile(
    r"(?:V\s*\.\s*A\s*\.\s*)?(?P<name>[A-Z]+)_COMP_CURR"
    r"\s*(?:\.\s*(?P<axis>\w+)|\[\s*\d+\s*\])?",
    re.IGNORECASE,
)
_OBJECT = re.compile(
    r"(?:(?P<before>\w+)\s*(?:\.|::|\s|/)\s*)?"
    r"(?P<object>(?:BC|TEMPC|CROSSC|CC2|LSEC|CROSSTALK)\s*::\s*[A-Za-z_0-9]+(?:[ _][a-z]+)?"
    r"|EXTC\s*\[\s*0\s*\]\s*(?:\.|::)\s*actual_offset)"
    r"\s*(?:\.\s*(?P<after>\w+)|\[\s*(?P<index>\d+)\s*\])?",
    re.IGNORECASE,
)
_ROLE = re.compile(r"(?P<axis>[A-Za-z_][A-Za-z0-9_-]*)\.(?P<what>[a-z]+)")
_NUMBERED = re.compile(r"(?:A|axis|achse)[ _-]?0*(?P<number>[0-9]+)", re.IGNORECASE)


@dataclasses.dataclass(frozen=True)
class LogName:
    """What a column of a log holds.

    Attributes:
        axis: ``A3`` for a logical number, else the name of an axis; None where the
            column does not say.
        compensation: One of `COMPENSATIONS`, `TOTAL` or `EXTERNAL_LOG`.
        filtered: Filters over cycles have acted on it.
        increments: In encoder increments where the header states no unit.
        is_state: It tells no offset, but whether the compensation acts.
    """

    axis: str | None
    compensation: str
    filtered: bool = True
    increments: bool = False
    is_state: bool = False


def log_name(text: str, names: Collection[str] = COMPENSATIONS) -> LogName | None:
    """Return what a column name of a log means; None: neither offset nor state of one.

    Known are the roles of ``simulate`` (``A3.cross``, ``A3.offset``), variables such as
    ``V.A.CROSS_COMP_CURR.Z`` (mm) and CNC objects such as ``CROSSC::actual_offset``
    (increments) with the axis before it, behind it, or not at all.

    Args:
        text: Name of the column.
        names: Compensations that a role may name.
    """
    text = text.strip()
    match = _ROLE.fullmatch(text)
    if match and match["what"] in (*names, TOTAL):
        return LogName(plain_axis(match["axis"]), match["what"])
    match = _VARIABLE.fullmatch(text)
    if match and match["name"].upper() in _VARIABLES:
        # A bare index counts the axes of the channel, which are no logical numbers.
        axis = match["axis"]
        return LogName(axis and plain_axis(axis), _VARIABLES[match["name"].upper()])
    match = _OBJECT.fullmatch(text)
    if match is None:
        return None
    axis = match["before"] or match["after"]
    if match["index"] is not None:
        axis = f"A{int(match['index'])}"
    axis, name = axis and plain_axis(axis), _plain(match["object"])
    if name in _STATES:
        return LogName(axis, _STATES[name], is_state=True)
    return LogName(axis, *_OBJECTS[name], increments=True) if name in _OBJECTS else None


def plain_axis(text: str) -> str:
    """Return ``A3`` for ``A3``, ``Axis_3`` or ``ACHSE 3``; other names as they stand."""
    match = _NUMBERED.fullmatch(text)
    return f"A{int(match['number'])}" if match else text
