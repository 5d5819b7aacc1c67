"""What the columns of a measurement file mean, as far as their names and units tell."""

import dataclasses
import itertools
import re
from collections.abc import Callable, Mapping, Sequence, Set

import numpy as np
from jaxtyping import Float

from ...data.measurements import (
    KINDS,
    LASER_FORMAT,
    MESH_FORMATS,
    SCOPE_FORMAT,
    WORDS,
    Column,
    ColumnSpec,
    MeasurementError,
    Table,
    all_position,
    direction_of,
    find_role,
    find_unit,
    is_own_reading,
    kinds_in,
    may_be_ms,
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
}
"""Kind of role that a unit alone decides, by dimension."""
_AXIS = re.compile(r"[xyzabcuvw]\d{0,2}", re.IGNORECASE)
_OF_FILE = re.compile(r"[xyzXYZ]\d?|[ABCUVW]")
"""An axis in the name of a file, where ``v5`` is a version."""
_NUMBERED = re.compile(r"(?:axis|achse)[\W_]*(\d+)|\|(\d+)$", re.IGNORECASE)
_OFF = re.compile(r"d([xyz])", re.IGNORECASE)
_LINEAR = ("X", "Y", "Z")
_FINE = 0.5
"""Largest error that rather is one in mm than in µm, or in ° than in m°."""
_TURNED = 3.0
"""Scatters of the runs of a kind from which every second run lies off by its direction."""
_UNSTATED = {"error": ("um", "mm"), "current": ("A", "%", "raw"), "time": ("s", "ms")}
"""Units among which a column without one asks, by kind of role."""
_HUGE = {
    **dict.fromkeys(("position", "actual", "encoder"), ("0.1um", "um", "mm")),
    "velocity": ("um/s", "0.1um/s", "mm/s"),
}
_LONGEST = 2e4
"""Units that values of a drive which are no mm ask among, and mm from which on they are none."""
_INCHES = ("thou", "in")
"""Units among which the error asks beside positions in inches."""
_UNSTATED_ANGLE = ("mdeg", "arcsec", "urad", "deg")
"""Units among which the error of a rotary axis asks."""


@dataclasses.dataclass(frozen=True)
class Unclear:
    """A column whose meaning the file does not tell.

    Attributes:
        column: Its name.
        asks: What there is to say: ``unit``, ``instrument``, ``column`` (which of those that
            name the role), ``role`` (which of those that name none), ``sign``, ``drift``,
            ``probed`` (an error, or a position), ``height`` (with the sign of an error, or of
            the machine's own probe), ``direction`` (of runs), ``positive`` (which of two words
            or numbers is a direction towards +).
        choices: Role and column of each possible answer, the likeliest first.
        largest: Largest absolute value, in the unit of the file.
        apart: How far every second run lies from the others on the mean, and the scatter of
            those of a kind, in the unit of the file; None: nothing is asked of runs.
    """

    column: str
    asks: frozenset[str]
    choices: tuple[tuple[str, ColumnSpec], ...]
    largest: float
    apart: tuple[float, float] | None = None

    @property
    def in_turn(self) -> bool:
        """Whether every second run lies so far off that it is one on the way back."""
        return self.apart is not None and self.apart[0] > _TURNED * self.apart[1]


@dataclasses.dataclass(frozen=True)
class Meaning:
    """What the columns of one file mean.

    Attributes:
        axis: Axis of the roles that the file names without one, or None.
        assumed: Axes that nobody has named, with the column that is theirs.
        columns: Column of each role that is clear; empty where the file says it all.
        unclear: What is left to the user.
        unused: Names of the columns that nothing was made of.
    """

    axis: str | None
    assumed: Mapping[str, str]
    columns: Mapping[str, ColumnSpec]
    unclear: tuple[Unclear, ...]
    unused: tuple[str, ...]

    @property
    def likeliest(self) -> dict[str, ColumnSpec]:
        """Return the column of each role, the likeliest where it is not clear."""
        return dict(self.columns) | dict(each.choices[0] for each in self.unclear)


@dataclasses.dataclass(frozen=True)
class _Named:
    """A column, the kind of role that its name tells, and the axis where it names one."""

    column: Column
    kind: str
    axis: str | None
    own: bool = False


def meaning_of(table: Table, axes: Sequence[str] = ()) -> Meaning:
    """Return what the columns of a file mean.

    Args:
        table: The file as read.
        axes: Axes that the user names; the first is the one whose error was measured.
    """
    letters = {column.name.strip() for column in table.columns}
    named = [each for c in table.columns if (each := _named(c, letters)) is not None]
    taken = {id(each.column) for each in named}
    unused = tuple(c.name for c in table.columns if id(c) not in taken)
    if table.advice:  # it has the error
        named = [each for each in named if each.kind != "error"]
    if table.format in MESH_FORMATS:
        return Meaning(axes[0] if axes else "Z", {}, {}, (), unused)
    if not axes:
        _refuse_tilts(table, named)
    named, outside = _with_encoders(table, named)
    named, drift = _with_drift(named)
    named, probed = _with_probed(named)
    home = _home(table, axes, named)
    owner = _owner(table, axes, named, home)
    angles = _angles(table, named, home[0])
    assumed: dict[str, str] = {}
    for each in sorted(named, key=_telling):
        if each.axis is None and each.kind in _OWNED:
            axis, stated = owner if each.kind == "error" else home
            if not stated:
                assumed.setdefault(axis, each.column.name)
    unnamed = _unnamed(table, named, home[0], owner[0], turns=owner[0] in angles)
    if unnamed and not home[1]:
        assumed.setdefault(home[0], unnamed[0].column)
    undirected = owner[0] == home[0] and _lacks_direction(named)
    if not unnamed and not undirected and _says_it_all(table, named):
        bare = any(each.axis is None and each.kind in _OWNED for each in named)
        return Meaning(owner[0] if bare else None, assumed, {}, (), unused)
    roles: dict[str, list[ColumnSpec]] = {}
    unclear: list[Unclear] = []
    runs = {each.kind for each in named if each.column.run is not None}
    if runs:
        turns = owner[0] in angles
        question = _of_runs(named, owner[0], turns=turns, undirected=undirected)
        if len(question.choices) == 1:
            ((text, spec),) = question.choices
            roles[text] = [spec]
        else:
            unclear.append(question)
        named = [each for each in named if each.kind not in runs]
    places = _places(named)
    for each in _without_commands(named):
        axis = (owner if each.kind == "error" else home)[0]
        turns = (each.axis or axis) in angles
        options, asks = _options(
            each, axis, outside=outside, turns=turns, places=places
        )
        if each.column is drift:
            asks |= {"drift"}
            if each.column.unit is None:
                options += [(options[0][0], _spec(each.column, "inc"))]
        if _is_huge(each) and table.format == SCOPE_FORMAT:
            asks |= {"unit"}
            name = options[0][0]
            options = [(name, _spec(each.column, unit)) for unit in _HUGE[each.kind]]
        if each.column is probed:
            asks |= {"probed", "height"}
            options += [
                (text, dataclasses.replace(spec, sign=-1)) for text, spec in options
            ]
            options += [(f"{each.axis}.position", _spec(each.column, each.column.unit))]
        if asks:
            unclear.append(_unclear(each.column, asks, options))
        else:
            roles.setdefault(options[0][0], []).append(options[0][1])
    unclear = [*_joined(unclear), *unnamed]
    columns = {}
    for text, several in roles.items():
        if len(several) == 1:
            columns[text] = several[0]
        else:
            first = table.column(several[0].column)
            rivals = [(text, each) for each in several]
            unclear.append(_unclear(first, {"column"}, rivals))
    offered = {
        table.column(part.column).name
        for each in unnamed
        for _, spec in each.choices
        for part in (spec.parts or (spec,))
        if part.column
    }
    unused = tuple(name for name in unused if name not in offered)
    return Meaning(None, assumed, columns, tuple(unclear), unused)


def _refuse_tilts(table: Table, named: Sequence[_Named]) -> None:
    """Refuse angles alone over positions in mm, and lengths over angles of no axis.

    As of a level or an autocollimator, and as of a ball bar.

    Raises:
        MeasurementError: If no column of it can be the error that a list corrects.
    """
    units = [(column, find_unit(column.unit or "")) for column in table.columns]
    kinds = {id(c): unit.dimension for c, unit in units if unit is not None}
    tilts = [c.name for c in table.columns if kinds.get(id(c)) == "angle"]
    owned = any(
        each.axis or each.kind in _PLACES
        for each in named
        if kinds.get(id(each.column)) == "angle"
    )
    owned |= any(
        each.kind == "error" for each in named if kinds.get(id(each.column)) == "length"
    )
    lengths = [each for each in kinds.values() if each == "length"]
    counts = {id(e.column) for e in named if e.kind in ("run", "direction")}
    unstated = [
        column
        for column, unit in units
        if unit is None and column.text is None and id(column) not in counts
    ]
    if tilts and len(lengths) == 1 and not owned and not unstated:
        reason = (
            f"found {' and '.join(tilts)} in an angle beside positions in a length, expected the"
            " error of an axis: lists correct positions, and no tilt (pitch, yaw, roll). Of a"
            " straightness, give the deviations that the readings add up to; of a rotary axis,"
            " its name: --axis"
        )
        raise MeasurementError(str(table.path), reason)
    over = [
        each
        for each in named
        if each.kind in _PLACES and kinds.get(id(each.column)) == "angle"
    ]
    nameless = table.axis is None and not any(each.axis for each in named)
    if len(tilts) == len(over) == 1 and lengths and nameless:
        reason = (
            f"found lengths over {tilts[0]}, an angle, expected the axes that moved and erred: of a"
            " ball bar or a roundness no list is made, measure each axis with a laser; of a rotary"
            " axis, names such as 'C [deg]' and 'dZ [um]', or --axis"
        )
        raise MeasurementError(str(table.path), reason)


_OWNED = frozenset(KINDS)
_PLACES = frozenset(("position", "actual", "encoder"))
_WITH_PLACE = _PLACES | {"temperature", "current"}
"""Kinds beside which no column without a name is a position."""
_READ = frozenset(("error", "actual", "encoder", "current"))
"""Kinds of role that were measured."""
_PROBED = 0.02
"""Share of the smallest other travel over which a probed surface deviates at most."""
_TARGETS = WORDS["position"] - {"pos", "position"}
_STRAIGHT = frozenset(
    word for word in WORDS["error"] if word.startswith(("straight", "gerad"))
)
"""Words of what an axis was told to go to, and of errors across the one that moved."""
_FOLLOWING = 0.02
"""Share of its travel by which an axis misses its targets at most."""
_AT_REST = 0.1
"""Share of its position over which an axis at rest drifts at most."""


def _unnamed(
    table: Table, named: Sequence[_Named], home: str, owner: str, *, turns: bool
) -> list[Unclear]:
    """Return the questions for a position and an error that no column names itself.

    A position goes over the largest range, an error over the smallest.

    Args:
        table: The file as read.
        named: Columns that name a role themselves.
        home: Axis of a position that names none.
        owner: Axis of an error that names none.
        turns: The positions of the owner are angles.
    """
    if table.advice:
        placed = any(each.kind == "position" for each in named)
        return _advised(table, home, owner, turns=turns)[placed:]
    kinds, free = {each.kind for each in named}, _free(table, named)
    place, error = not kinds & _WITH_PLACE, not kinds & _READ
    if len(free) < place + error:
        return []
    places = _places(named) or free[:1]
    questions = []
    if place:
        choices = [(f"{home}.position", _spec(each, each.unit)) for each in free]
        questions.append(_unclear(free[0], {"role"}, choices))
    if error:
        fine = sorted(reversed(free), key=lambda each: not says_correction(each.name))
        choices = [
            (f"{owner}.actual", _spec(each, each.unit))
            for each in fine
            if owner == home and any(_follows(each, one) for one in places)
        ]
        surface = owner != home and len(_places(named)) > 1
        signs = (1, -1) if surface else (1,)
        choices += [
            (f"{owner}.error", _spec(each, unit, sign))
            for each in fine
            for unit in _units(each, "error", turns=turns, places=places)
            for sign in ((-1, 1) if says_correction(each.name) else signs)
        ]
        asks = {"role"} if fine[0].unit else {"role", "unit"}
        asks |= {"height"} if surface else set()
        asks |= {"sign"} if says_correction(fine[0].name) else set()
        questions.append(_unclear(fine[0], asks, choices))
    return questions


def _free(table: Table, named: Sequence[_Named]) -> list[Column]:
    """Return the columns that may hold positions or errors and name none, the widest first."""
    taken = {id(each.column) for each in named}
    free = [c for c in table.columns if id(c) not in taken and _is_length(c)]
    return sorted(free, key=lambda each: span(each.values), reverse=True)


def _angles(table: Table, named: Sequence[_Named], home: str) -> set[str]:
    """Return the axes whose positions are angles; those that no column names are of `home`."""
    places = [(each.axis, each.column) for each in named if each.kind in _PLACES]
    if not any(each.kind in _WITH_PLACE for each in named):
        places = [(home, column) for column in _free(table, named)[:1]]
    return {axis or home for axis, column in places if _is_angle(column)}


def _is_angle(column: Column) -> bool:
    unit = find_unit(column.unit or "")
    return unit is not None and unit.dimension == "angle"


def _advised(table: Table, home: str, owner: str, *, turns: bool) -> list[Unclear]:
    """Return the questions that a reader has for its format."""
    place, error = table.advice["position"], table.advice["error"]
    if "inc" in (place.unit, error.unit):
        return []  # without the axis's increment nothing can be looked at
    first, last = table.columns[0], table.columns[-1]
    asks, units = {"role", "sign"}, [error.unit]
    held = table.column((error.parts or (error,))[0].column)
    if held.header and error.unit is None:
        units = [
            *_units(held, "error", turns=turns, places=[table.column(place.column)])
        ]
        asks |= {"unit"} if len(units) > 1 else set()
        last = held
    choices = []
    for unit, sign in itertools.product(units, (-1, 1)):
        parts = tuple(
            dataclasses.replace(each, unit=each.unit or unit, sign=sign)
            for each in error.parts
        )
        spec = dataclasses.replace(
            error, unit=unit, sign=sign if not parts else 1, parts=parts
        )
        choices.append((f"{owner}.error", spec))
    return [
        _unclear(first, {"role"}, [(f"{home}.position", place)]),
        _unclear(last, asks, choices),
    ]


def _of_runs(
    named: Sequence[_Named], home: str, *, turns: bool, undirected: bool
) -> Unclear:
    """Return the question for unit and direction of a role with one column per run.

    Args:
        named: All columns.
        home: Axis of the role where its columns name none.
        turns: The positions of the axis are angles.
        undirected: The direction of the runs is asked for.
    """
    first = next(each for each in named if each.column.run is not None)
    runs = [each.column for each in named if each.column.run is not None]
    units = _units(first.column, first.kind, turns=turns, places=_places(named))
    ways = [[(column.run, column.direction) for column in runs]]
    asks, apart = {"unit"} if len(units) > 1 else set[str](), None
    if undirected:
        asks |= {"direction"}
        apart = _apart(runs)
        place = next(e.column.values for e in named if e.kind == "position")
        there = 1 if place[-1] >= place[0] else -1
        ways.append(
            [(k // 2 + 1, -there if k % 2 else there) for k in range(len(runs))]
        )
    question = Unclear(
        first.column.name, frozenset(asks), (), max(map(_largest, runs)), apart
    )
    choices = []
    for way, unit in itertools.product(ways[:: -1 if question.in_turn else 1], units):
        parts = (
            dataclasses.replace(_spec(column, unit), run=run, direction=direction)
            for column, (run, direction) in zip(runs, way, strict=True)
        )
        spec = ColumnSpec("", unit, parts=tuple(parts))
        choices.append((_text(first, home), spec))
    return dataclasses.replace(question, choices=tuple(choices))


def _apart(runs: Sequence[Column]) -> tuple[float, float]:
    """Return how far every second run lies from the others, and what those of a kind scatter.

    The second is NaN where neither kind has two.
    """
    values = np.stack([column.values for column in runs])
    kinds = values[::2], values[1::2]
    means = [each.mean(axis=0) for each in kinds]
    rest = [each - mean for each, mean in zip(kinds, means, strict=True)]
    free = (len(runs) - 2) * values.shape[1]
    square = sum(float(np.nansum(each**2)) for each in rest)
    scatter = float(np.sqrt(square / free)) if free else float("nan")
    steps = means[0] - means[1]
    known = steps[np.isfinite(steps)]
    return abs(float(known.mean())) if known.size else 0.0, scatter


def _unclear(
    column: Column, asks: set[str], choices: Sequence[tuple[str, ColumnSpec]]
) -> Unclear:
    return Unclear(column.name, frozenset(asks), tuple(choices), _largest(column))


def _is_length(column: Column) -> bool:
    """Whether a column that names no role may hold positions or errors."""
    unit = find_unit(column.unit or "")
    fits = column.unit is None or (unit and unit.dimension in ("length", "angle"))
    if column.text is not None or column.role is not None or not fits:
        return False
    if len(column.values) > 2 and (np.diff(column.values) == 1.0).all():
        return False  # the numbers of the rows
    return not words_in([column.name]) & WORDS["lag"] and span(column.values) > 0.0


def _follows(column: Column, place: Column) -> bool:
    """Whether a column shows where an axis is that was sent to a place."""
    apart = span(column.values - place.values)
    return column is not place and apart < _FOLLOWING * span(place.values)


def span(values: Float[np.ndarray, " t"]) -> float:
    """Return how far the known values lie apart."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if known.size else 0.0


def _with_encoders(table: Table, named: Sequence[_Named]) -> tuple[list[_Named], bool]:
    """Return the columns, and whether an actual position can only be the machine's own.

    Beside what an instrument showed, or the current of a drive, it is the encoder's.
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
        kinds = {each.kind for each in named}
    drive = table.format == SCOPE_FORMAT or "current" in kinds
    seen = any(e.kind == "error" or (e.kind == "actual" and not e.own) for e in named)
    if table.format == LASER_FORMAT and not drive:
        return named, seen  # what it holds beside its errors they were made of
    if not (drive or seen):
        return named, False
    own = _as("encoder", named, lambda each: each.kind == "actual" and each.own)
    return own, True


def _as(
    kind: str, named: Sequence[_Named], which: Callable[[_Named], bool]
) -> list[_Named]:
    """Return columns, some of them of another kind."""
    return [
        dataclasses.replace(each, kind=kind) if which(each) else each for each in named
    ]


def _with_drift(named: Sequence[_Named]) -> tuple[list[_Named], Column | None]:
    """Return the columns, and the one that holds what an axis at rest drifts by.

    Beside temperatures, without any error, that is a position that hardly moves.
    """
    kinds = {each.kind for each in named}
    places = [each for each in named if each.kind == "position"]
    if "temperature" not in kinds or kinds & _READ or len(places) != 1:
        return list(named), None
    (place,) = places
    if span(place.column.values) > _AT_REST * _largest(place.column):
        return list(named), None
    return _as("error", named, lambda each: each is place), place.column


def _with_probed(named: Sequence[_Named]) -> tuple[list[_Named], Column | None]:
    """Return the columns, and the one that holds what a probe or an indicator showed.

    Of several positions, with nothing that was measured, the one that hardly moves.
    """
    places = [each for each in named if each.kind == "position" and each.axis]
    places.sort(key=lambda each: span(each.column.values))
    if {each.kind for each in named} & (_READ | {"time"}) or len(places) < 2:
        return list(named), None  # beside a time an axis that hardly moves stands still
    last, *others = places
    if not 0.0 < span(last.column.values) <= _PROBED * span(others[0].column.values):
        return list(named), None
    return _as("error", named, lambda each: each is last), last.column


def _telling(each: _Named) -> int:
    """Return the rank of a column by how well a person knows it."""
    order = ("error", "actual", "current", "position")
    return order.index(each.kind) if each.kind in order else len(order)


def _home(
    table: Table, axes: Sequence[str], named: Sequence[_Named]
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


def _owner(
    table: Table, axes: Sequence[str], named: Sequence[_Named], home: tuple[str, bool]
) -> tuple[str, bool]:
    """Return the axis of an error whose column names none, and whether anybody has.

    Where other axes moved it is one that did not: what a straightedge or a probe shows. Of a
    single axis that has targets it is the deviation from them, and an angle that of the axis
    that turned.
    """
    known = [each.axis for each in named if each.axis is not None]
    if axes:
        return axes[0], True
    targets = {each.axis for each in named if each.kind == "position"}
    words = words_in(each.column.name for each in named)
    straight = table.across or words & _STRAIGHT
    if len(targets) == 1 and not straight and words & _TARGETS:
        return home
    kinds = {each.kind for each in named if _is_angle(each.column)}
    if len(targets) == 1 and {"position", "error"} <= kinds:
        return home
    if table.across:
        known.append(home[0])
    elif not known or table.axis is not None:
        return home
    others = [axis for axis in ("Y", "Z", "X") if axis not in known]
    return (others[0] if others else known[0]), False


def _without_commands(named: Sequence[_Named]) -> list[_Named]:
    """Return the columns, without commanded velocities beside those that were recorded."""
    own = {(each.kind, each.axis) for each in named if each.own}
    speeds = ("velocity", "acceleration", "current")
    return [
        each
        for each in named
        if each.own or each.kind not in speeds or (each.kind, each.axis) not in own
    ]


def _named(column: Column, letters: Set[str]) -> _Named | None:
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
            return _Named(column, column.role, None, own)
        return _Named(column, role.kind, role.axis, own)
    if column.run is not None:
        return _Named(column, "error", None)
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
    if column.name.strip() in _LETTERS and letters & _PLACE_LETTERS:
        kinds.append(_LETTERS[column.name.strip()])
    unit = find_unit(column.unit or "")
    decided = _DIMENSIONS.get(unit.dimension if unit else "")
    if "lag" in kinds or (decided and "error" in kinds):
        return None  # what an axis lags behind is no error of its own
    off = next((m[1].upper() for p in pieces if (m := _OFF.fullmatch(p))), None)
    if off is not None:
        return _Named(column, "error", off)
    if decided is None and unit is not None and unit.dimension == "time":
        decided = "time"
    if decided is None and column.name.strip().casefold() == "t":
        warm = column.name.strip() == "T" and "t" in letters
        decided = "temperature" if warm else "time"
    if decided is None and unit is None and not axis and pieces[-1:] in (["t"], ["T"]):
        decided = "temperature"  # "frame_t"
    kind = decided or (kinds[0] if kinds else None)
    if kind is None and axis and column.text is None:
        kind = "position"
    if kind is None or (column.text is not None and kind not in _TEXTS):
        return None
    unknown = kind == "direction" and not any(map(direction_of, column.text or "+"))
    if unknown and not _two_ways(column):
        return None
    if kind == "position" and axis is None and not all_position(pieces):
        return None  # the target of something else
    return _Named(column, kind, axis, "encoder" in kinds)


_OWN = WORDS["encoder"] | WORDS["shown"]
_TEXTS = ("time", "run", "direction")


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


def own_roles(table: Table, axis: str | None) -> dict[str, ColumnSpec]:
    """Return the column of each role that the file names itself.

    Args:
        table: The file as read.
        axis: Of the roles that it names without one.
    """
    roles = {}
    for column in table.columns:
        if column.role is not None and column.run is None:
            whole = find_role(column.role) is not None
            text = column.role if whole else f"{axis}.{column.role}"
            roles[text] = _spec(column, column.unit)
    return roles


def _says_it_all(table: Table, named: Sequence[_Named]) -> bool:
    """Whether the file's own roles need no mapping beside them."""
    runs = [each for each in named if each.column.run is not None]
    named = runs or named
    if not any(column.role not in (None, "time") for column in table.columns):
        return False
    complete = all(each.column.role is not None for each in named)
    if any(each.kind == "encoder" and each.own for each in named):
        return False
    if any(each.kind == "direction" and _two_ways(each.column) for each in named):
        return False
    given = [(each, find_role(each.column.role or "")) for each in named]
    if any(role is not None and role.kind != each.kind for each, role in given):
        return False
    places = _places(named)
    stated = all(
        len(_units(e.column, e.kind, turns=False, places=places)) == 1 for e in named
    )
    return complete and stated


def _lacks_direction(named: Sequence[_Named]) -> bool:
    """Whether a file has a column for each of several runs, and no direction of any."""
    runs = [each.column for each in named if each.column.run is not None]
    stated = any(column.direction is not None for column in runs)
    kinds = [each.kind for each in named]
    alone = kinds.count("position") == 1 and "direction" not in kinds
    return len(runs) > 1 and not stated and alone


def _options(
    each: _Named,
    axis: str,
    *,
    outside: bool,
    turns: bool,
    places: Sequence[Column],
) -> tuple[list[tuple[str, ColumnSpec]], set[str]]:
    """Return the roles that a column may have, and what is to be asked of it."""
    column, asks = each.column, set[str]()
    texts = [_text(each, axis)]
    if each.kind == "encoder" and not outside:
        name = each.axis or axis
        texts = [f"{name}.actual", f"{name}.encoder"]
        asks.add("instrument")
    if each.kind == "direction" and (ways := _two_ways(column)):
        specs = [dataclasses.replace(_spec(column, None), positive=way) for way in ways]
        return [(text, spec) for text in texts for spec in specs], {"positive"}
    units = _units(column, each.kind, turns=turns, places=places)
    if len(units) > 1:
        asks.add("unit")
    pairs = itertools.product(texts, units)
    return [(text, _spec(column, unit)) for text, unit in pairs], asks


def _two_ways(column: Column) -> list[str]:
    """Return the two words or numbers of directions that do not say which one is +."""
    cells = column.text or [f"{value:g}" for value in column.values]
    words = sorted({cell.strip() for cell in cells})
    known = column.bad is not None or all(direction_of(word) for word in words)
    known |= set(words) == {"-1", "1"}
    return words[::-1] if len(words) == 2 and not known else []


def _is_huge(each: _Named) -> bool:
    """Whether a column without a unit holds values that no machine has in mm or mm/s."""
    return (
        each.kind in _HUGE
        and each.column.unit is None
        and span(each.column.values) > _LONGEST
    )


def _places(named: Sequence[_Named]) -> list[Column]:
    return [each.column for each in named if each.kind in _PLACES]


def _units(
    column: Column, kind: str, *, turns: bool, places: Sequence[Column] = ()
) -> Sequence[str | None]:
    """Return the units that a column of this kind may have, the likeliest first.

    Args:
        column: Of the file.
        kind: Of its role.
        turns: The positions of its axis are angles.
        places: Positions beside an instant.
    """
    if column.unit is not None or column.text is not None:
        return [column.unit]
    if kind in _PLACES | {"error"} and _may_be_inches(column):
        return ("in", "mm")
    if kind not in _UNSTATED:
        return [None]
    if kind == "time" and not may_be_ms(column, places):
        return [None]
    units = _UNSTATED_ANGLE if turns and kind == "error" else _UNSTATED[kind]
    if kind == "error" and any(place.unit in _INCHES for place in places):
        units = _INCHES
    fine = kind == "error" and _largest(column) < _FINE
    return units[::-1] if fine else units


def _may_be_inches(column: Column) -> bool:
    """Whether a name ends as one in inches does, ``x_in``, or as that of an input."""
    return column.unit is None and column.name.casefold().endswith("_in")


def _spec(column: Column, unit: str | None, sign: int = 1) -> ColumnSpec:
    return ColumnSpec(column.header or column.name, unit, sign=sign)


def _text(each: _Named, home: str) -> str:
    if each.kind == "temperature":
        return f"temperature.{_sensor(each.column)}"
    return f"{each.axis or home}.{each.kind}" if each.kind in _OWNED else each.kind


def _sensor(column: Column) -> str:
    role = None if column.role is None else find_role(column.role)
    if role is not None and role.sensor is not None:
        return role.sensor
    words = WORDS["temperature"] | {"t", "degc", "c", "k"}
    pieces = [p for p in pieces_of(column.name) if p.casefold() not in words]
    return "_".join(pieces).casefold() or "sensor"


def _joined(unclear: Sequence[Unclear]) -> list[Unclear]:
    """Return the questions, those of columns that would have the same role as one."""
    by_role: dict[str, Unclear] = {}
    for each in unclear:
        role = each.choices[0][0]
        if role in by_role:
            first = by_role[role]
            asks = first.asks | each.asks | {"column"}
            choices = (*first.choices, *each.choices)
            each = dataclasses.replace(first, asks=asks, choices=choices)
        by_role[role] = each
    return list(by_role.values())


def _largest(column: Column) -> float:
    known = column.values[np.isfinite(column.values)]
    return float(np.abs(known).max(initial=0.0))
