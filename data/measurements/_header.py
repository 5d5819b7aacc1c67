"""Column names as files write them: units and roles."""

import dataclasses
import functools
import re
from collections.abc import Sequence

from ._roles import find_role
from ._units import find_unit, is_foreign
from ._words import (
    AXIS,
    CLOCKS,
    is_difference,
    is_warm,
    kind_said,
    pieces,
    says_nothing,
)

_BRACKETED = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*")
_SLASHED = re.compile(r"(?P<name>[^/]+?)(?:\s*/\s*|\s+in\s+)(?P<unit>\S+)")
_BEHIND = re.compile(r"(?P<name>.+?)\s+(?P<unit>\S{2,}|°)")
_COLON = re.compile(r"(?P<name>[^:]+?)\s*:\s*(?P<unit>[^:\s]+)")
_MULTIPLE = re.compile(
    r"(?P<name>.+?)(?:\s+(?:x|×|\*|in)\s*|\s+(?=1/10|0[.,]0*1\b))(?P<times>\d+(?:[./,]\d+)?)"
)
_ENDING = re.compile(r"(?P<name>.+)_(?P<unit>[A-Za-z0-9.%µμ°]+)")
_IN = re.compile(r"\bin\s+(\S+)|[\[(]([^\])]+)[\])]")
_FORMAT = re.compile(r"(?i)[hmsdytj]{1,4}(?:[:./ -]+[hmsdytj]{1,4})+|±\s?1|-+|1")
_DELTA = re.compile(rf"[dδΔ∆] ?(?P<axis>{AXIS})|e(?P<of>[xyz])(?P<along>[xyz])")
_FINE = ("um", "0.1um")


@dataclasses.dataclass(frozen=True)
class Name:
    """A column name taken apart.

    Attributes:
        name: Without a bracketed unit; an ending such as ``_um`` stays part of the
            name.
        unit: In the library's spelling, or as it stands where the library lacks it; or
            None.
        doubtful: The unit is a one-letter ending and may mean something else.
        stem: Name without any unit, for recognising roles.
        header: As it stands.
    """

    name: str
    unit: str | None
    doubtful: bool
    stem: str
    header: str


@functools.lru_cache(maxsize=1024)
def parse_name(header: str) -> Name:
    """Return name and unit of ``x [mm]``, ``x (mm)``, ``x / mm`` or ``dz_um``."""
    text = header.strip()
    for pattern in (_BRACKETED, _SLASHED, _COLON, _BEHIND):
        match = pattern.fullmatch(text)
        if match is None or not match["name"].strip():
            continue
        name, stated = match["name"].strip(), match["unit"].strip()
        if multiple := _MULTIPLE.fullmatch(name):  # "Error x 0.1 um"
            name, stated = multiple["name"], f"{multiple['times']} {stated}"
            found = find_unit(stated)
            return Name(name, found.name if found else stated, False, name, text)
        if pattern is not _BRACKETED and find_unit(name) is not None:
            continue  # "mm/s" is a unit, and no name
        unit = find_unit(stated)
        sure = pattern is _BRACKETED or (
            pattern is _SLASHED and unit and unit.name == "in"
        )
        if unit is not None and (sure or _is_unit_of(name, stated)):
            return Name(name, unit.name, False, name, text)
        if is_foreign(stated):
            return Name(name, stated, False, name, text)
    match = _ENDING.fullmatch(text)
    unit = find_unit(match["unit"]) if match else None
    if match is None or unit is None:
        return _in_or_input(text)
    if len(match["unit"]) > 1:
        if match["unit"].casefold() in ("in", "min"):
            return _in_or_input(text)
        return Name(text, unit.name, False, match["name"], text)
    if match["unit"] == "C" and is_warm(match["name"]):
        return Name(text, unit.name, False, match["name"], text)
    # "t_s" is seconds, but "x_m" may be metres or "measured": only the exact letter
    # counts, and the unit is used only where it fits the role.
    exact = unit.name if unit.name == match["unit"] else None
    return Name(text, exact, exact is not None, match["name"] if exact else text, text)


def _in_or_input(text: str) -> Name:
    """Return a name without a unit; "error in" may be one in inches, which has to be stated."""
    match = re.fullmatch(r"(?i)(?P<name>.+)[ _]in", text)
    if match is None or kind_said(match["name"]) not in ("position", "actual", "error"):
        return Name(text, None, False, text, text)
    return Name(text, "in?", False, match["name"], text)


def _is_unit_of(name: str, stated: str) -> bool:
    """Whether a word behind a name is its unit: "Zeit min" is a time, "Temp min" is not."""
    if stated.casefold() in ("min", "h"):
        return kind_said(name) == "time"
    return stated.casefold() not in ("raw", "in")


def is_format(cell: str) -> bool:
    """Whether a cell of a row of units says how a time is written, or that there is none."""
    return _FORMAT.fullmatch(cell.strip()) is not None


def unit_in(cell: str) -> str | None:
    """Return the unit that a cell of a row of units names, or None."""
    text = cell.strip().strip("[]() ")
    unit = find_unit(text)
    if unit is not None:
        return unit.name
    return text if is_foreign(text) else None


def unit_of_title(title: str) -> str | None:
    """Return the one unit that a title names: ``deviation in µm``, ``dz [µm]``."""
    units = {parse_name(title.strip(' ";,\t')).unit}
    units |= {unit_in((a or b).rstrip(",;.:")) for a, b in _IN.findall(title)}
    units -= {None}
    return units.pop() if len(units) == 1 else None


def _plain(text: str) -> str:
    """Return a name in small letters, without the signs between its words."""
    return re.sub(r"[\s_.:#/=-]+", " ", text.casefold()).strip()


def bare_role(name: Name) -> str | None:
    """Return the kind of role that a name without an axis stands for, or None."""
    kind = kind_said(name.stem)
    return None if kind in ("run", "direction") and name.unit else kind


def is_clock(name: Name, text: str) -> bool:
    """Whether a name says date, time or both, as the text is a key of `CLOCKS`."""
    words = _plain(name.stem)
    if text != "both":
        return words in CLOCKS[text]
    parts = set(words.split())
    matched = (parts & set(CLOCKS["date"]), parts & set(CLOCKS["time"]))
    return words in CLOCKS["both"] or (all(matched) and len(parts) == 2)


def roles_of(names: Sequence[Name]) -> tuple[list[str | None], bool]:
    """Return the role per column as the file names it; whether it is a laser table.

    Axis-qualified roles (``X.position``) count as they are. Without any, a table with a
    target and an error or an actual position is a laser table: its roles lack the axis,
    or the names have it (``X``, ``X Soll``, ``dZ``).
    """
    roles: list[str | None] = []
    for name in names:
        role = find_role(name.name) or find_role(name.stem)
        roles.append(str(role) if role else None)
    if any(
        role and "." in role and not role.startswith("temperature.") for role in roles
    ):
        return _with_direction(names, roles), False
    bare = [bare_role(name) for name in names]
    once = {role for role in bare if role and bare.count(role) == 1}
    if "position" not in once or not once & {"error", "actual"}:
        return _with_direction(names, _with_axes(names, roles)), False
    merged = [
        stated or (role if role in once else None)
        for stated, role in zip(roles, bare, strict=True)
    ]
    return merged, True


def _with_direction(
    names: Sequence[Name], roles: Sequence[str | None]
) -> list[str | None]:
    """Return roles with that of a column of directions, where the file has one position."""
    places = [role for role in roles if role and role.endswith(".position")]
    sides = [at for at, name in enumerate(names) if bare_role(name) == "direction"]
    result = list(roles)
    if len(places) == len(sides) == 1 and roles[sides[0]] is None:
        result[sides[0]] = places[0].replace("position", "direction")
    return result


def _with_axes(names: Sequence[Name], roles: Sequence[str | None]) -> list[str | None]:
    """Return roles of names that hold an axis; as they were where none is an error."""
    found = [_axis_role(name) for name in names]
    bare = [bare_role(name) for name in names]
    matches = (_DELTA.fullmatch(_plain(name.stem)) for name in names)
    along = {match["along"] for match in matches if match is not None}
    if len(along) == 1 and None not in along and bare.count("position") == 1:
        found[bare.index("position")] = f"{along.pop().upper()}.position"
    single = [at for at, name in enumerate(names) if found[at] and _is_alone(name)]
    fine = [at for at in single if names[at].unit in _FINE]
    errors = any(role and role.endswith(".error") for role in (*found, *bare))
    if len(fine) < len(single) or (len(single) == 1 and not errors):
        for at in fine:  # "Y [µm]" beside "X [mm]" is no place
            found[at] = (found[at] or "").replace(".position", ".error")
    if not any(role and role.endswith((".error", ".actual")) for role in found):
        return list(roles)
    return [
        stated or role or (kind if kind == "run" and bare.count(kind) == 1 else None)
        for stated, role, kind in zip(
            roles,
            [role if found.count(role) == 1 else None for role in found],
            bare,
            strict=True,
        )
    ]


def axis_of(name: Name) -> str | None:
    """Return the one axis that a name holds: ``X``, ``X Soll``, ``Z-Achse``."""
    axes = [word for word in pieces(name.stem) if re.fullmatch(AXIS, word.casefold())]
    return axes[0].upper() if len(axes) == 1 else None


def _axis_role(name: Name) -> str | None:
    if match := _DELTA.fullmatch(_plain(name.stem)):
        return f"{(match['axis'] or match['of']).upper()}.error"  # EYX: in Y, along X
    words = pieces(name.stem)
    axes = [word for word in words if re.fullmatch(AXIS, word.casefold())]
    if len(axes) != 1:
        return None
    others = [word for word in words if word != axes[0]]
    # Of a difference the sign between the two says which is taken off.
    said = name.stem if is_difference(map(str.casefold, others)) else " ".join(others)
    kind = "position" if says_nothing(others) else kind_said(said)
    return None if kind in (None, "time", "run") else f"{axes[0].upper()}.{kind}"


def _is_alone(name: Name) -> bool:
    """Whether a name is that of an axis, and says nothing of what is measured."""
    words = pieces(name.stem)
    return says_nothing([w for w in words if not re.fullmatch(AXIS, w.casefold())])
