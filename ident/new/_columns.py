"""What the columns of a measurement file mean, and what of it the file leaves to ask."""

import dataclasses
import functools
import itertools
from collections.abc import Mapping, Sequence, Set

import numpy as np
from jaxtyping import Float

from ...data.measurements import (
    MESH_FORMATS,
    SCOPE_FORMAT,
    WORDS,
    Column,
    ColumnSpec,
    MeasurementError,
    Table,
    find_role,
    may_be_ms,
    pieces as pieces_of,
    says_correction,
    words_in,
)
from ._names import (
    OWNED,
    PLACES,
    READ,
    Named,
    dimension_of,
    home_of,
    largest,
    named_in,
    owner_of,
    seen_together,
    span,
    two_ways,
)

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
ROTARY = ("A", "B", "C")
"""Names of rotary axes (ISO 841)."""
_WITH_PLACE = PLACES | {"temperature", "current"}
"""Kinds beside which no column without a name is a position."""
_FOLLOWING = 0.02
"""Share of its travel by which an axis misses its targets at most."""

_Choice = tuple[str, ColumnSpec]
"""A role and its column."""


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
    choices: tuple[_Choice, ...]
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
class _File:
    """A file as a whole.

    Attributes:
        table: As read.
        named: Its columns that name a role.
        home: Axis of those that name none.
        owner: Axis of an error whose column names none.
    """

    table: Table
    named: Sequence[Named]
    home: str
    owner: str

    @functools.cached_property
    def places(self) -> list[Column]:
        """Positions that a column names."""
        return [each.column for each in self.named if each.kind in PLACES]

    @functools.cached_property
    def free(self) -> list[Column]:
        """Columns that may hold positions or errors and name none, the widest first."""
        taken = {id(each.column) for each in self.named}
        free = [c for c in self.table.columns if id(c) not in taken and _is_length(c)]
        return sorted(free, key=lambda each: span(each.values), reverse=True)

    @functools.cached_property
    def kinds(self) -> set[str]:
        """Kinds of role that are named."""
        return {each.kind for each in self.named}

    @functools.cached_property
    def runs(self) -> list[Named]:
        """Columns that hold a run each of one role."""
        return [each for each in self.named if each.column.run is not None]

    @functools.cached_property
    def angles(self) -> set[str]:
        """Axes whose positions are angles; without a unit those of A, B and C."""
        places = [(self.axis_of(e), e.column) for e in self.named if e.kind in PLACES]
        if not self.kinds & _WITH_PLACE:
            places = [(self.home, column) for column in self.free[:1]]
        return {
            axis
            for axis, column in places
            if dimension_of(column) == "angle"
            or (column.unit is None and axis.startswith(ROTARY))
        }

    def axis_of(self, each: Named) -> str:
        """Return the axis of a column."""
        return each.axis or (self.owner if each.kind == "error" else self.home)

    def text(self, each: Named) -> str:
        """Return the role of a column as a job has it."""
        if each.kind == "temperature":
            return f"temperature.{_sensor(each.column)}"
        return f"{self.axis_of(each)}.{each.kind}" if each.kind in OWNED else each.kind

    def units(self, column: Column, kind: str, axis: str) -> Sequence[str | None]:
        """Return the units that a column of this kind may have, the likeliest first."""
        if column.unit is not None or column.text is not None:
            return [column.unit]
        scope = self.table.format == SCOPE_FORMAT
        if scope and kind in _HUGE and span(column.values) > _LONGEST:
            return _HUGE[kind]  # no machine has them in mm or mm/s
        # A name ends as one in inches does, ``x_in``, or as that of an input.
        may_be_inches = column.name.casefold().endswith("_in")
        if kind in PLACES | {"error"} and may_be_inches:
            return ("in", "mm")
        if kind not in _UNSTATED:
            return [None]
        if kind == "time" and not may_be_ms(column, self.places):
            return [None]
        units = _UNSTATED[kind]
        if kind != "error":
            return units
        if axis in self.angles:
            units = _UNSTATED_ANGLE
        if any(place.unit in _INCHES for place in self.places or self.free[:1]):
            units = _INCHES
        return units[::-1] if largest(column) < _FINE else units


def meaning_of(table: Table, axes: Sequence[str] = ()) -> Meaning:
    """Return what the columns of a file mean.

    Args:
        table: The file as read.
        axes: Axes that the user names; the first is the one whose error was measured.

    Raises:
        MeasurementError: If no column of it can be the error that a list corrects.
    """
    named = named_in(table)
    taken = {id(each.column) for each in named}
    spare = [column for column in table.columns if id(column) not in taken]
    unused = tuple(column.name for column in spare)
    if table.advice:  # it has the error
        named = [each for each in named if each.kind != "error"]
    if table.format in MESH_FORMATS:
        # Its heights lie over X and Y: these are no axes whose error it shows.
        others = [axis for axis in axes if axis not in ("X", "Y")]
        heights = others[0] if others and "Z" not in axes else "Z"
        return Meaning(heights, {}, {}, (), unused)
    if not axes:
        _refuse_tilts(table, named)
    named = seen_together(table, named)
    home = home_of(table, axes, named)
    owner = owner_of(table, axes, named, home)
    file = _File(table, named, home[0], owner[0])
    assumed: dict[str, str] = {}
    bare = [each for each in named if each.axis is None and each.kind in OWNED]
    for each in sorted(bare, key=_telling):
        axis, stated = owner if each.kind == "error" else home
        if not stated:
            assumed.setdefault(axis, each.column.name)
    unnamed = _unnamed(file)
    if unnamed and not home[1]:
        assumed.setdefault(home[0], unnamed[0].column)
    undirected = owner[0] == home[0] and _lacks_direction(file)
    if not unnamed and not undirected and _says_it_all(file):
        return Meaning(owner[0] if bare else None, assumed, {}, (), unused)
    in_runs = {each.kind for each in file.runs}
    questions = [_of_runs(file, undirected=undirected)] if file.runs else []
    questions += [_question(file, e) for e in _without_commands(named, in_runs)]
    questions = _joined(questions)
    unclear = [*(each for each in questions if each.asks), *unnamed]
    columns = dict(each.choices[0] for each in questions if not each.asks)
    specs = [spec for each in unnamed for _, spec in each.choices]
    offered = {part.column for spec in specs for part in (spec.parts or (spec,))}
    left = (column for column in spare if not {column.name, column.header} & offered)
    unused = tuple(column.name for column in left)
    return Meaning(None, assumed, columns, tuple(unclear), unused)


def _refuse_tilts(table: Table, named: Sequence[Named]) -> None:
    """Refuse angles alone over positions in mm, and lengths over angles of no axis.

    As of a level or an autocollimator, and as of a ball bar.

    Raises:
        MeasurementError: If no column of it can be the error that a list corrects.
    """
    tilts, lengths = (
        [column.name for column in table.columns if dimension_of(column) == dimension]
        for dimension in ("angle", "length")
    )
    over = [e for e in named if e.kind in PLACES and dimension_of(e.column) == "angle"]
    owned = any(
        (each.axis or each in over) if dimension == "angle" else each.kind == "error"
        for each in named
        if (dimension := dimension_of(each.column)) in ("angle", "length")
    )
    counts = {id(e.column) for e in named if e.kind in ("run", "direction")}
    unstated = any(
        not dimension_of(column) and column.text is None and id(column) not in counts
        for column in table.columns
    )
    if tilts and len(lengths) == 1 and not owned and not unstated:
        reason = (
            f"found {' and '.join(tilts)} in an angle beside positions in a length, expected the"
            " error of an axis: lists correct positions, and no tilt (pitch, yaw, roll). Of a"
            " straightness, give the deviations that the readings add up to; of a rotary axis,"
            " its name: --axis"
        )
        raise MeasurementError(str(table.path), reason)
    nameless = table.axis is None and not any(each.axis for each in named)
    if len(tilts) == len(over) == 1 and lengths and nameless:
        reason = (
            f"found lengths over {tilts[0]}, an angle, expected the axes that moved and erred: of a"
            " ball bar or a roundness no list is made, measure each axis with a laser; of a rotary"
            " axis, names such as 'C [deg]' and 'dZ [um]', or --axis"
        )
        raise MeasurementError(str(table.path), reason)


def _unnamed(file: _File) -> list[Unclear]:
    """Return the questions for a position and an error that no column names itself.

    A position goes over the largest range, an error over the smallest.
    """
    if file.table.advice:
        return _advised(file)["position" in file.kinds :]
    free, home, owner = file.free, file.home, file.owner
    place, error = not file.kinds & _WITH_PLACE, not file.kinds & READ
    if len(free) < place + error:
        return []
    places = file.places or free[:1]
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
        surface = owner != home and len(file.places) > 1
        signs = (None, -1) if surface else (None,)
        choices += [
            (f"{owner}.error", _spec(each, unit, sign))
            for each in fine
            for unit in file.units(each, "error", owner)
            for sign in ((-1, 1) if says_correction(each.name) else signs)
        ]
        asks = {"role"} if fine[0].unit else {"role", "unit"}
        asks |= {"height"} if surface else set()
        asks |= {"sign"} if says_correction(fine[0].name) else set()
        questions.append(_unclear(fine[0], asks, choices))
    return questions


def _advised(file: _File) -> list[Unclear]:
    """Return the questions that a reader has for its format."""
    table = file.table
    place, error = table.advice["position"], table.advice["error"]
    if "inc" in (place.unit, error.unit):
        return []  # without the axis's increment nothing can be looked at
    first, last = table.columns[0], table.columns[-1]
    asks: set[str] = {"role", "sign"}
    units: Sequence[str | None] = [error.unit]
    held = table.column((error.parts or (error,))[0].column)
    if held.header and error.unit is None:
        units = file.units(held, "error", file.owner)
        asks |= {"unit"} if len(units) > 1 else set()
        last = held
    choices = []
    for unit, sign in itertools.product(units, (-1, 1)):
        parts = tuple(
            dataclasses.replace(each, unit=each.unit or unit, sign=sign)
            for each in error.parts
        )
        spec = dataclasses.replace(
            error, unit=unit, sign=None if parts else sign, parts=parts
        )
        choices.append((f"{file.owner}.error", spec))
    return [
        _unclear(first, {"role"}, [(f"{file.home}.position", place)]),
        _unclear(last, asks, choices),
    ]


def _of_runs(file: _File, *, undirected: bool) -> Unclear:
    """Return the question for unit and direction of a role with one column per run.

    Args:
        file: With such a role.
        undirected: The direction of the runs is asked for.
    """
    first, runs = file.runs[0], [each.column for each in file.runs]
    units = file.units(first.column, first.kind, file.axis_of(first))
    ways = [[(file.table.run_of(column), column.direction) for column in runs]]
    asks, apart = {"unit"} if len(units) > 1 else set[str](), None
    if undirected:
        asks |= {"direction"}
        apart = _apart(runs)
        place = file.places[0].values
        there = 1 if place[-1] >= place[0] else -1
        ways.append(
            [(k // 2 + 1, -there if k % 2 else there) for k in range(len(runs))]
        )
    question = Unclear(
        first.column.name, frozenset(asks), (), max(map(largest, runs)), apart
    )
    choices = []
    for way, unit in itertools.product(ways[:: -1 if question.in_turn else 1], units):
        parts = (
            dataclasses.replace(_spec(column, unit), run=run, direction=direction)
            for column, (run, direction) in zip(runs, way, strict=True)
        )
        spec = ColumnSpec("", unit, parts=tuple(parts))
        choices.append((file.text(first), spec))
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


def _falls(column: Column, word: str, place: Float[np.ndarray, " t"]) -> bool:
    """Whether positions that follow each other fall where a column of directions holds a word."""
    cells = column.text or [f"{value:g}" for value in column.values]
    own = np.array([cell.strip() == word for cell in cells])
    steps = np.diff(place)[own[1:] & own[:-1]]
    return bool(np.nansum(np.sign(steps)) < 0.0)


def _question(file: _File, each: Named) -> Unclear:
    """Return the roles that a column may have, and what is to be asked of it, if anything."""
    column, axis, text = each.column, file.axis_of(each), file.text(each)
    if each.kind == "direction" and (ways := two_ways(column)):
        bare, places = _spec(column, None), file.places
        if len(places) == 1 and _falls(column, ways[0], places[0].values):
            ways = ways[::-1]
        choices = [(text, dataclasses.replace(bare, positive=way)) for way in ways]
        return _unclear(column, {"positive"}, choices)
    asks, texts = set(each.asks), [text]
    if "instrument" in asks:
        texts = [f"{axis}.actual", f"{axis}.encoder"]
    units = [*file.units(column, each.kind, axis)]
    asks |= {"unit"} if len(units) > 1 else set()
    if "drift" in asks and column.unit is None:
        units.append("inc")
    choices = [(one, _spec(column, unit)) for one in texts for unit in units]
    if "probed" in asks:
        choices += [(one, dataclasses.replace(spec, sign=-1)) for one, spec in choices]
        choices.append((f"{axis}.position", _spec(column, column.unit)))
    return _unclear(column, asks, choices)


def _unclear(column: Column, asks: Set[str], choices: Sequence[_Choice]) -> Unclear:
    return Unclear(column.name, frozenset(asks), tuple(choices), largest(column))


def _is_length(column: Column) -> bool:
    """Whether a column that names no role may hold positions or errors."""
    fits = column.unit is None or dimension_of(column) in ("length", "angle")
    if column.text is not None or column.role is not None or not fits:
        return False
    if len(column.values) > 2 and (np.diff(column.values) == 1.0).all():
        return False  # the numbers of the rows
    return not words_in([column.name]) & WORDS["lag"] and span(column.values) > 0.0


def _follows(column: Column, place: Column) -> bool:
    """Whether a column shows where an axis is that was sent to a place."""
    apart = span(column.values - place.values)
    return column is not place and apart < _FOLLOWING * span(place.values)


def _telling(each: Named) -> int:
    """Return the rank of a column by how well a person knows it."""
    order = ("error", "actual", "current", "position")
    return order.index(each.kind) if each.kind in order else len(order)


def _without_commands(named: Sequence[Named], in_runs: Set[str]) -> list[Named]:
    """Return the columns, without commanded velocities beside those that were recorded.

    Also without those of kinds that stand in runs.
    """
    own = {(each.kind, each.axis) for each in named if each.own}
    speeds = ("velocity", "acceleration", "current")
    return [
        each
        for each in named
        if each.kind not in in_runs
        and (each.own or each.kind not in speeds or (each.kind, each.axis) not in own)
    ]


def own_roles(table: Table, axis: str | None) -> dict[str, ColumnSpec]:
    """Return the column of each role that the file names itself.

    Args:
        table: The file as read.
        axis: Of the roles that it names without one.
    """
    roles: dict[str, ColumnSpec] = {}
    for column in table.columns:
        if column.role is None:
            continue
        whole = find_role(column.role) is not None
        text = column.role if whole else f"{axis}.{column.role}"
        spec = _spec(column, column.unit)
        if column.run is not None:
            number, side = table.run_of(column), column.direction
            run = dataclasses.replace(spec, run=number, direction=side)
            before = roles.get(text, ColumnSpec("", column.unit))
            spec = dataclasses.replace(before, parts=(*before.parts, run))
        roles[text] = spec
    return roles


def _says_it_all(file: _File) -> bool:
    """Whether the file's own roles need no mapping beside them."""
    if not any(column.role not in (None, "time") for column in file.table.columns):
        return False
    for each in file.runs or file.named:
        column, role = each.column, find_role(each.column.role or "")
        if column.role is None or (role is not None and role.kind != each.kind):
            return False
        if each.own and each.kind == "encoder":
            return False
        if each.kind == "direction" and two_ways(column):
            return False
        if len(file.units(column, each.kind, file.axis_of(each))) > 1:
            return False
    return True


def _lacks_direction(file: _File) -> bool:
    """Whether a file has a column for each of several runs, and no direction of any."""
    stated = any(each.column.direction is not None for each in file.runs)
    kinds = [each.kind for each in file.named]
    alone = kinds.count("position") == 1 and "direction" not in kinds
    return len(file.runs) > 1 and not stated and alone


def _spec(column: Column, unit: str | None, sign: int | None = None) -> ColumnSpec:
    return ColumnSpec(column.header or column.name, unit, sign=sign)


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
