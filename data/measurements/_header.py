"""Column names as files write them: units, roles, runs and directions."""

import dataclasses
import functools
import re
from collections.abc import Mapping, Sequence

from ._roles import find_role
from ._units import find_unit

_BRACKETED = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*")
_SLASHED = re.compile(r"(?P<name>[^/]+?)\s+(?:/|in)\s+(?P<unit>\S+)")
_COLON = re.compile(r"(?P<name>[^:]+?)\s*:\s*(?P<unit>[^:\s]+)")
_ENDING = re.compile(r"(?P<name>.+)_(?P<unit>[A-Za-z0-9.%µμ°]+)")
_FORMAT = re.compile(r"(?i)[hmsdytj]{1,4}(?:[:./ -]+[hmsdytj]{1,4})+|±\s?1|-+|1")
# Units that files use and the library does not convert; a default would be wrong.
_FOREIGN = frozenset(
    ("in", "inch", "inches", "zoll", '"', "mil", "thou", "ft", "f", "°f", "degf")
)

# Names that laser software and people give to the columns of a positioning test.
_BARE_ROLES = {
    "position": (
        *("target", "position", "pos", "nominal", "commanded", "command", "soll"),
        *("target position", "position target", "nominal position", "target pos"),
        *("commanded position", "command position", "set position", "setpoint"),
        *("sollposition", "soll position", "sollwert", "sollpos", "zielposition"),
        *("position soll", "messposition", "verfahrweg", "weg"),
    ),
    "actual": (
        *("actual", "measured", "reference", "reading", "ist", "actual position"),
        *("position actual", "measured position", "istposition", "ist position"),
        *("istwert", "istpos", "position ist"),
    ),
    "error": (
        *("error", "deviation", "dev", "err", "fehler", "abweichung", "messabweichung"),
        *("positioning error", "position error", "linear error", "positionsabweichung"),
        *("position deviation", "positionsfehler", "geradheit", "straightness"),
        *("straightness error", "geradheitsabweichung", "straightness deviation"),
    ),
    "run": ("run", "cycle", "lauf", "zyklus", "durchgang", "messreihe", "messlauf"),
    "direction": (
        *("direction", "dir", "richtung", "fahrtrichtung", "anfahrrichtung"),
        *("verfahrrichtung", "approach", "approach direction"),
    ),
    "time": ("time", "zeit", "t", "elapsed", "elapsed time", "laufzeit"),
}
_BY_NAME = {name: role for role, names in _BARE_ROLES.items() for name in names}
CLOCKS = {
    "date": ("date", "datum", "day", "tag"),
    "time": ("time", "zeit", "uhrzeit", "clock", "elapsed", "elapsed time", "laufzeit"),
    "both": ("timestamp", "time stamp", "zeitstempel", "datetime", "date time"),
}
"""Names of columns of instants: the date, the time of day, and both together."""
_FILLERS = frozenset(("nr", "no", "nummer", "number", "num", "axis", "achse", "id"))
_AXIS_WORD = r"[xyzabcuvw]\d?"
_BEFORE = re.compile(rf"(?P<axis>{_AXIS_WORD}) (?P<kind>.+)")
_BEHIND = re.compile(rf"(?P<kind>.+) (?P<axis>{_AXIS_WORD})")
_DELTA = re.compile(rf"[dδΔ∆] ?(?P<axis>{_AXIS_WORD})|e(?P<of>[xyz])[xyz]")

DIRECTIONS = {
    **dict.fromkeys(
        (
            *("+", "up", "fwd", "forward", "forwards", "pos", "positive", "positiv"),
            *("vor", "vorwärts", "vorwaerts", "hin", "auf", "aufwärts", "aufwaerts"),
            *("steigend", "hinweg", "↑", "→", "⇧", "⇑", "⇒", "▲", "►", "->"),
        ),
        1,
    ),
    **dict.fromkeys(
        (
            *("-", "−", "–", "down", "bwd", "backward", "backwards", "back", "rev"),
            *("reverse", "neg", "negative", "negativ", "rück", "rueck", "zurück"),
            *("zurueck", "rückwärts", "rueckwaerts", "ab", "abwärts", "abwaerts"),
            *("fallend", "her", "rückweg", "rueckweg", "↓", "←", "⇩", "⇓", "⇐", "▼"),
            *("◄", "<-"),
        ),
        -1,
    ),
}
"""Direction of approach, +1 or −1, by the words and signs of files."""
_RUN_WORDS = frozenset(
    (
        *("run", "lauf", "cycle", "zyklus", "durchgang", "messung", "messreihe"),
        *("reihe", "messlauf", "pass", "series", "serie", "measurement", "fahrt"),
    )
)
# "pos" is a position above a column, and a positive direction in a cell.
_NO_HEADING = frozenset(("pos", "neg", "–"))
_TOKENS = re.compile(r"->|<-|[^\W\d_]+|\d+|[^\w\s.,;:#|/()\[\]]")


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


@dataclasses.dataclass(frozen=True)
class Heading:
    """What the heading of a column of a wide table says of its readings."""

    run: int | None
    direction: int | None
    kind: str | None
    named: bool


@functools.lru_cache(maxsize=1024)
def parse_name(header: str) -> Name:
    """Return name and unit of ``x [mm]``, ``x (mm)``, ``x / mm`` or ``dz_um``."""
    text = header.strip()
    for pattern in (_BRACKETED, _SLASHED, _COLON):
        match = pattern.fullmatch(text)
        if match is None or not match["name"].strip():
            continue
        name, stated = match["name"].strip(), match["unit"].strip()
        unit = find_unit(stated)
        if unit is not None:
            return Name(name, unit.name, False, name, text)
        if stated.casefold() in _FOREIGN:
            return Name(name, stated, False, name, text)
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


def is_format(cell: str) -> bool:
    """Whether a cell of a row of units says how a time is written, or that there is none."""
    return _FORMAT.fullmatch(cell.strip()) is not None


def unit_in(cell: str) -> str | None:
    """Return the unit that a cell of a row of units names, or None."""
    text = cell.strip().strip("[]() ")
    unit = find_unit(text)
    if unit is not None:
        return unit.name
    return text if text.casefold() in _FOREIGN else None


def plain(text: str) -> str:
    """Return a name in small letters, without signs and words that say nothing."""
    words = re.sub(r"[\s_.:#/=-]+", " ", text.casefold()).split()
    return " ".join(word for word in words if word not in _FILLERS)


def bare_role(name: Name) -> str | None:
    """Return the kind of role that a name without an axis stands for, or None."""
    words = re.sub(r"[\s_.:#/=-]+", " ", name.stem.casefold()).strip()
    kind = _BY_NAME.get(words)
    # "Run No." is a run, and "Pos. No." counts the positions.
    return kind or (
        None if (kind := _BY_NAME.get(plain(words))) == "position" else kind
    )


def is_clock(name: Name, text: str) -> bool:
    """Whether a name says date, time or both, as the text is a key of `CLOCKS`."""
    words = plain(name.stem)
    if text != "both":
        return words in CLOCKS[text]
    parts = set(words.split())
    each = (parts & set(CLOCKS["date"]), parts & set(CLOCKS["time"]))
    return words in CLOCKS["both"] or (all(each) and len(parts) == 2)


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
        return roles, False
    bare = [bare_role(name) for name in names]
    once = {role for role in bare if role and bare.count(role) == 1}
    if "position" not in once or not once & {"error", "actual"}:
        return _with_axes(names, roles), False
    merged = [
        own or (role if role in once else None)
        for own, role in zip(roles, bare, strict=True)
    ]
    return merged, True


def _with_axes(names: Sequence[Name], roles: Sequence[str | None]) -> list[str | None]:
    """Return roles of names that hold an axis; as they were where none is an error."""
    found = [_axis_role(name) for name in names]
    if not any(role and role.endswith((".error", ".actual")) for role in found):
        return list(roles)
    bare = [bare_role(name) for name in names]
    return [
        own or role or (kind if kind == "run" and bare.count(kind) == 1 else None)
        for own, role, kind in zip(
            roles,
            [role if found.count(role) == 1 else None for role in found],
            bare,
            strict=True,
        )
    ]


def _axis_role(name: Name) -> str | None:
    text = plain(name.stem)
    if re.fullmatch(_AXIS_WORD, text):
        return f"{text.upper()}.position"
    if match := _DELTA.fullmatch(text):
        return f"{(match['axis'] or match['of']).upper()}.error"  # EYX: in Y, along X
    for pattern in (_BEFORE, _BEHIND):
        match = pattern.fullmatch(text)
        kind = _BY_NAME.get(match["kind"]) if match else None
        if match and kind not in (None, "time", "run"):
            return f"{match['axis'].upper()}.{kind}"
    return None


def heading(text: str) -> Heading | None:
    """Return the run and the direction that a heading names, with nothing else in it.

    ``Lauf 1 vorwärts``, ``up 2``, ``1 ↑``, ``Run 3 (+)``, ``-2``; None for all others.
    """
    text = re.sub(r"(?<=[^\W\d_])[-_](?=\d)", " ", parse_name(text).stem.casefold())
    run: int | None = None
    words: set[int] = set()
    signs: set[int] = set()
    kind: str | None = None
    named = axis = False
    for token in _TOKENS.findall(text):
        if token in DIRECTIONS and token not in _NO_HEADING:
            (signs if token in "+-−" else words).add(DIRECTIONS[token])
        elif token.isdecimal() and run is None:
            run = int(token)
        elif token in _RUN_WORDS:
            named = True
        elif _BY_NAME.get(token) in ("error", "actual"):
            kind = _BY_NAME[token]
        elif re.fullmatch("[xyzabcuvw]", token):
            axis = True
        elif _BY_NAME.get(token) != "direction" and token not in _FILLERS:
            return None
    directions = words or signs  # "Lauf 1 - hin" holds a dash and no sign
    if len(directions) > 1 or (run is None and not directions):
        return None
    if axis and not (named or words):
        return None  # "B 1" and "X+" are names of axes and of their ends
    return Heading(
        run, next(iter(directions), None), kind, named or bool(directions) or bool(kind)
    )


def numbered(found: Mapping[int, Heading]) -> dict[int, Heading]:
    """Return headings with a run each; those without are counted per direction."""
    seen: dict[int | None, int] = {}
    numbered = {}
    for at, item in found.items():
        seen[item.direction] = seen.get(item.direction, 0) + 1
        run = seen[item.direction] if item.run is None else item.run
        numbered[at] = dataclasses.replace(item, run=run)
    return numbered


def looks_like_names(cells: Sequence[str]) -> bool:
    """Whether words can only be names: each a role, a heading of a run, or with a unit."""
    names = [parse_name(cell) for cell in cells]
    return all(
        name.unit is not None
        or find_role(name.name) is not None
        or bare_role(name) is not None
        or heading(name.header) is not None
        or re.fullmatch(r"[xyzabcuvw]|d[xyz]", name.name.casefold())
        for name in names
    )
