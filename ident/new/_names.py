"""Which kind of role the columns of a file name, and of which axis: by name, unit and values."""

import dataclasses
import re
from collections.abc import Callable, Sequence, Set

import numpy as np
from jaxtyping import Float

from ...data.measurements import (
    KINDS,
    LASER_FORMAT,
    SCOPE_FORMAT,
    WORDS,
    Column,
    Table,
    all_position,
    direction_of,
    find_role,
    find_unit,
    is_own_reading,
    kinds_in,
    pieces as pieces_of,
    says_correction,
    words_in,
)

_LETTERS = {"v": "velocity", "a": "acceleration", "i": "current", "e": "error"}
"""Single letters beside the name of an axis, ``v_x``, or beside its column, ``x``."""
_PLACE_LETTERS = frozenset("xyzXYZ")
_DIMENSIONS = {
    "temperature": "temperature",
    "current": "current",
    "torque": "current",
    "force": "current",
    "velocity": "velocity",
    "angular velocity": "velocity",
    "acceleration": "acceleration",
    "angular acceleration": "acceleration",
    "time": "time",
}
"""Kind of role that a unit alone decides, by dimension."""
_AXIS = re.compile(r"[xyzabcuvw]\d{0,2}", re.IGNORECASE)
_OF_FILE = re.compile(r"[xyzXYZ]\d?|[ABCUVW]")
"""An axis in the name of a file, where ``v5`` is a version."""
_NUMBERED = re.compile(r"(?:axis|achse)[\W_]*(\d+)|\|(\d+)$", re.IGNORECASE)
_OFF = re.compile(r"d([xyz])", re.IGNORECASE)
_LINEAR = ("X", "Y", "Z")
_OWN = WORDS["encoder"] | WORDS["shown"]
_TEXTS = ("time", "run", "direction")
OWNED = frozenset(KINDS)
"""Kinds of role that belong to an axis."""
PLACES = frozenset(("position", "actual", "encoder"))
READ = frozenset(("error", "actual", "encoder", "current"))
"""Kinds of role that were measured."""
_PROBED = 0.02
"""Share of the smallest other travel over which a probed surface deviates at most."""
_STATES = frozenset(
    "active inactive on off with without after before loaded enabled disabled yes no"
    " aktiv aktiviert inaktiv ein aus an mit ohne nach vor geladen eingeschaltet"
    " ausgeschaltet ja nein".split()
)
"""Words by which a title says whether something was on."""
_AMBIENT = re.compile(
    r"temp|umwelt|umgebung|environment|ambient|air|luft|material|wellenl|wavelength|refract"
    r"|brech|weather|wetter|deadpath|abbe",
    re.IGNORECASE,
)
"""What an instrument compensates itself."""
_TARGETS = WORDS["position"] - {"pos", "position"}
_STRAIGHT = frozenset(
    word for word in WORDS["error"] if word.startswith(("straight", "gerad"))
)
"""Words of what an axis was told to go to, and of errors across the one that moved."""
_AT_REST = 0.1
"""Share of its position over which an axis at rest drifts at most."""


@dataclasses.dataclass(frozen=True)
class Named:
    """A column and what it names.

    Attributes:
        column: Of the file.
        kind: Of its role.
        axis: Of its role, None where it names none.
        own: It is the machine's own reading.
        asks: What the columns beside it leave open of it, as in `Unclear`.
    """

    column: Column
    kind: str
    axis: str | None
    own: bool = False
    asks: frozenset[str] = frozenset()


def named_in(table: Table) -> list[Named]:
    """Return the columns of a file that name a role, each by itself."""
    letters = {column.name.strip() for column in table.columns}
    every = (_named(column, letters) for column in table.columns)
    return [each for each in every if each is not None]


def _named(column: Column, letters: Set[str]) -> Named | None:
    """Return what a column is by its role, its unit or its name, or None.

    Args:
        column: Of the file.
        letters: Names of all columns: beside ``x`` a ``v`` alone is a velocity, beside ``t``
            a ``T`` a temperature.
    """
    if column.role is not None:
        role = find_role(column.role)
        own = column.name != column.role and bool(words_in([column.name]) & _OWN)
        if role is None:
            return Named(column, column.role, None, own)
        return Named(column, role.kind, role.axis, own)
    if column.run is not None:
        return Named(column, "error", None)
    if says_correction(column.name):
        return None  # errors of which sign, the user says
    pieces = pieces_of(column.name)
    if column.unit is not None and len(pieces) > 1:
        unit = find_unit(pieces[-1])  # "dz_um": the unit stays part of the name
        if unit is not None and unit.name == column.unit:
            pieces = pieces[:-1]
    axis = _axis_in(column.name, pieces)
    words = words_in(piece for piece in pieces if piece.upper() != axis)
    kinds = ["encoder" if kind == "shown" else kind for kind in kinds_in(words)]
    kinds += [_LETTERS[word] for word in words if axis and word in _LETTERS]
    name = column.name.strip()
    if name in _LETTERS and letters & _PLACE_LETTERS:
        kinds.append(_LETTERS[name])
    decided = _DIMENSIONS.get(dimension_of(column))
    if "lag" in kinds or (decided not in (None, "time") and "error" in kinds):
        return None  # what an axis lags behind is no error of its own
    off = next((m[1].upper() for p in pieces if (m := _OFF.fullmatch(p))), None)
    if off is not None:
        return Named(column, "error", off)
    if decided is None and name.casefold() == "t":
        decided = "temperature" if name == "T" and "t" in letters else "time"
    bare = not (axis or dimension_of(column))
    if decided is None and bare and pieces[-1:] in (["t"], ["T"]):
        decided = "temperature"  # "frame_t"
    kind = decided or (kinds[0] if kinds else None)
    if kind is None and axis and column.text is None:
        kind = "position"
    if kind is None or (column.text is not None and kind not in _TEXTS):
        return None
    unknown = kind == "direction" and not any(map(direction_of, column.text or "+"))
    if unknown and not two_ways(column):
        return None
    if kind == "position" and axis is None and not all_position(pieces):
        return None  # the target of something else
    return Named(column, kind, axis, "encoder" in kinds)


def _axis_in(name: str, pieces: Sequence[str]) -> str | None:
    """Return the axis that a column names, X, Y and Z before letters of other meaning."""
    numbered = _NUMBERED.search(name)
    if numbered is not None:
        return f"A{numbered[1] or numbered[2]}"
    axes = [piece.upper() for piece in pieces if _AXIS.fullmatch(piece)]
    linear = [piece for piece in axes if piece[0] in _LINEAR]
    if not linear and len(pieces) == 1 and pieces[0].islower():
        return None  # "a", "v", "b" alone may be anything
    return next(iter(linear or axes), None)


def dimension_of(column: Column) -> str:
    """Return the dimension of the unit of a column, empty where it has none."""
    unit = find_unit(column.unit or "")
    return "" if unit is None else unit.dimension


def two_ways(column: Column) -> list[str]:
    """Return the two words or numbers of directions that do not say which one is +."""
    cells = column.text or [f"{value:g}" for value in column.values]
    words = sorted({cell.strip() for cell in cells})
    known = column.bad is not None or all(direction_of(word) for word in words)
    known |= set(words) == {"-1", "1"}
    return words[::-1] if len(words) == 2 and not known else []


def span(values: Float[np.ndarray, " t"]) -> float:
    """Return how far the known values lie apart."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if known.size else 0.0


def largest(column: Column) -> float:
    """Return the largest absolute value of a column, in the unit of the file."""
    known = column.values[np.isfinite(column.values)]
    return float(np.abs(known).max(initial=0.0))


def seen_together(table: Table, named: Sequence[Named]) -> list[Named]:
    """Return the columns with the kinds that they have beside each other."""
    return _with_probed(_with_drift(_with_encoders(table, named)))


def _with_encoders(table: Table, named: Sequence[Named]) -> list[Named]:
    """Return the columns, actual positions that are the machine's own as its encoder's.

    They can be nothing else beside what an instrument showed, or the current of a drive.
    """
    named = _as(
        "encoder",
        named,
        lambda each: each.kind == "actual" and is_own_reading(each.column.name),
    )
    kinds = {each.kind for each in named}
    if "error" in kinds and not kinds & {"position", "actual"}:
        # There is no other place that the error could be of.
        named = _as("position", named, lambda each: each.kind == "encoder")
    drive = table.format == SCOPE_FORMAT or "current" in kinds
    seen = any(e.kind == "error" or (e.kind == "actual" and not e.own) for e in named)
    if drive or (seen and table.format != LASER_FORMAT):
        # What a laser's file holds beside its errors they were made of.
        named = _as("encoder", named, lambda each: each.kind == "actual" and each.own)
    if drive or seen:
        return named
    return _as("encoder", named, lambda each: each.kind == "encoder", "instrument")


def _as(
    kind: str, named: Sequence[Named], which: Callable[[Named], bool], *asks: str
) -> list[Named]:
    """Return columns, some of them of another kind, with what is to be asked of these."""
    return [
        dataclasses.replace(each, kind=kind, asks=frozenset(asks))
        if which(each)
        else each
        for each in named
    ]


def _with_drift(named: Sequence[Named]) -> list[Named]:
    """Return the columns, the one that holds what an axis at rest drifts by as an error.

    Beside temperatures, without any error, that is a position that hardly moves.
    """
    kinds = {each.kind for each in named}
    places = [each for each in named if each.kind == "position"]
    if "temperature" not in kinds or kinds & READ or len(places) != 1:
        return list(named)
    (place,) = places
    if span(place.column.values) > _AT_REST * largest(place.column):
        return list(named)
    return _as("error", named, lambda each: each is place, "drift")


def _with_probed(named: Sequence[Named]) -> list[Named]:
    """Return the columns, the one that holds what a probe or an indicator showed as an error.

    Of several positions, with nothing that was measured, the one that hardly moves.
    """
    places = [each for each in named if each.kind == "position" and each.axis]
    places.sort(key=lambda each: span(each.column.values))
    if {each.kind for each in named} & (READ | {"time"}) or len(places) < 2:
        return list(named)  # beside a time an axis that hardly moves stands still
    last, *others = places
    if not 0.0 < span(last.column.values) <= _PROBED * span(others[0].column.values):
        return list(named)
    return _as("error", named, lambda each: each is last, "probed", "height")


def home_of(
    table: Table, axes: Sequence[str], named: Sequence[Named]
) -> tuple[str, bool]:
    """Return the axis of columns that name none, and whether anybody has named it."""
    known = [each.axis for each in named if each.axis is not None]
    if mine := axes[table.across :]:  # the first one is the one that deviates
        return mine[0], True
    if table.axis is not None or known:
        return table.axis or str(known[0]), True
    stem = table.path.stem
    axis = _axis_in(
        stem, [piece for piece in pieces_of(stem) if _OF_FILE.fullmatch(piece)]
    )
    return ("X", False) if axis is None else (axis, True)


def owner_of(
    table: Table, axes: Sequence[str], named: Sequence[Named], home: tuple[str, bool]
) -> tuple[str, bool]:
    """Return the axis of an error whose column names none, and whether anybody has.

    Where other axes moved it is one that did not: what a straightedge or a probe shows. Of a
    single axis that has targets, or directions of approach, it is the deviation from them, and
    an angle that of the axis that turned.
    """
    known = [each.axis for each in named if each.axis is not None]
    if axes:
        return axes[0], True
    targets = {each.axis for each in named if each.kind == "position"}
    words = words_in(each.column.name for each in named)
    straight = table.across or words & _STRAIGHT
    approached = any(each.kind == "direction" for each in named)
    if len(targets) == 1 and not straight and (words & _TARGETS or approached):
        return home
    turned = {e.kind for e in named if dimension_of(e.column) == "angle"}
    if len(targets) == 1 and {"position", "error"} <= turned:
        return home
    if table.across:
        known.append(home[0])
    elif not known or table.axis is not None:
        return home
    others = [axis for axis in ("Y", "Z", "X") if axis not in known]
    return (others[0] if others else known[0]), False


def says_compensated(title: str) -> bool:
    """Whether a title speaks of a compensation of the machine as on or off while measuring.

    ``Kompensation aktiv: ja``, ``Measured with compensation``, ``nach Korrektur``.
    """
    state = bool(words_in([title]) & _STATES)
    return state and says_correction(title) and not _AMBIENT.search(title)
