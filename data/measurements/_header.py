"""Column names as files write them: units, roles, and the plain laser table."""

import dataclasses
import functools
import re
from collections.abc import Sequence

from ._roles import find_role
from ._units import find_unit

_BRACKETED = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*")
_SLASHED = re.compile(r"(?P<name>[^/]+?)\s+(?:/|in)\s+(?P<unit>\S+)")
_ENDING = re.compile(r"(?P<name>.+)_(?P<unit>[A-Za-z0-9.%µμ°]+)")

# Names that laser software and people give to the columns of a positioning test.
_BARE_ROLES = {
    "position": (
        "target",
        "position",
        "pos",
        "nominal",
        "commanded",
        "command",
        "soll",
    ),
    "actual": ("actual", "measured", "reference", "reading", "ist"),
    "error": ("error", "deviation", "dev", "err", "fehler", "abweichung"),
    "run": ("run", "cycle", "lauf"),
    "direction": ("direction", "dir", "richtung"),
    "time": ("time", "zeit", "t"),
}
_BY_NAME = {name: role for role, names in _BARE_ROLES.items() for name in names}


@dataclasses.dataclass(frozen=True)
class Name:
    """A column name taken apart.

    Attributes:
        name: Without a bracketed unit; an ending such as ``_um`` stays part of the
            name.
        unit: In the library's spelling, or None.
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
    for pattern in (_BRACKETED, _SLASHED):
        match = pattern.fullmatch(text)
        unit = find_unit(match["unit"]) if match else None
        if match and unit is not None and match["name"].strip():
            name = match["name"].strip()
            return Name(name, unit.name, False, name, text)
    match = _ENDING.fullmatch(text)
    unit = find_unit(match["unit"]) if match else None
    if match is None or unit is None:
        return Name(text, None, False, text, text)
    if len(match["unit"]) > 1:
        return Name(text, unit.name, False, match["name"], text)
    # "t_s" is seconds, but "x_m" may be metres or "measured": only the exact letter
    # counts, and the unit is used only where it fits the role.
    exact = unit.name if unit.name == match["unit"] else None
    return Name(text, exact, exact is not None, match["name"] if exact else text, text)


def roles_of(names: Sequence[Name]) -> tuple[list[str | None], bool]:
    """Return the role per column as the file names it; whether it is a laser table.

    Axis-qualified roles (``X.position``) count as they are. Without any, a table with a
    target and an error or an actual position is a laser table: its roles lack the axis.
    """
    roles: list[str | None] = []
    for name in names:
        role = find_role(name.name) or find_role(name.stem)
        roles.append(str(role) if role else None)
    if any(
        role and "." in role and not role.startswith("temperature.") for role in roles
    ):
        return roles, False
    bare = [_BY_NAME.get(name.stem.strip().casefold()) for name in names]
    once = {role for role in bare if role and bare.count(role) == 1}
    if "position" not in once or not once & {"error", "actual"}:
        return roles, False
    merged = [
        own or (role if role in once else None)
        for own, role in zip(roles, bare, strict=True)
    ]
    return merged, True


def looks_like_names(cells: Sequence[str]) -> bool:
    """Whether the words of a comment can only be names: each a role or with a unit."""
    names = [parse_name(cell) for cell in cells]
    return all(
        name.unit is not None
        or find_role(name.name) is not None
        or name.name.casefold() in _BY_NAME
        or re.fullmatch(r"[xyzabcuvw]|d[xyz]", name.name.casefold())
        for name in names
    )
