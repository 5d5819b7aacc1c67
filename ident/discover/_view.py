"""The readings of one axis, thinned, and every term that they could show."""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from ._data import Observed
from ._terms import HEAT, Kind, Term

_MOST = 16_000
"""Rows that are looked at; more show nothing new of terms worth compensating."""
_STILL = 1e-6
"""mm or °: a position that changes by less is constant."""
_BLOCKS = 40
"""Pieces of a recording that resamples draw from."""
_NEAR = 100
"""Readings shortly after reversals, from which on their course can be seen."""
_CLOSE = 0.05
"""Share of the travel that is shortly after a reversal."""
_LAGS = (0.0, 60.0, 180.0, 600.0, 1800.0)
"""Seconds by which a structure may lag behind its sensor."""
_KNEES = (0.01, 0.03, 0.08, 0.2)
"""Stribeck velocities that are tried, as shares of the fastest speed."""


@dataclasses.dataclass(frozen=True)
class AxisView:
    """Rows in which the error (or current) of one axis was measured.

    Attributes:
        axis: Its name.
        data: Those rows of the recording, thinned.
        error: In mm, ° or the unit of the current, without the median of each measurement.
        span: First and last position, by axis that moves.
        distance: mm or ° that the axis has gone since its last reversal, or None.
        modulo: Axes that go round within the range that was measured.
    """

    axis: str
    data: Observed
    error: Float[np.ndarray, " t"]
    span: Mapping[str, tuple[float, float]]
    distance: Float[np.ndarray, " t"] | None
    modulo: frozenset[str]

    def moves(self, axis: str) -> bool:
        """Return whether the position of an axis was recorded and changed."""
        return axis in self.span

    def scaled(self, axis: str) -> Float[np.ndarray, " t"]:
        """Return the position of an axis from 0 to 1; NaN where it is not known."""
        low, high = self.span[axis]
        return np.asarray((self.data.position[axis] - low) / (high - low))

    def places(self, axis: str) -> int:
        """Return at how many different places of an axis there are readings."""
        known = self.data.position.get(axis, np.zeros(0))
        return len(np.unique(np.round(known[np.isfinite(known)], 4)))

    @cached_property
    def sources(self) -> list[Int[np.ndarray, " n"]]:
        """The rows of each measurement."""
        numbers = np.unique(self.data.source)
        return [np.flatnonzero(self.data.source == number) for number in numbers]

    @cached_property
    def block(self) -> Int[np.ndarray, " t"]:
        """The piece of each row: runs where there are many, else stretches of them."""
        own = np.stack([self.data.source, self.data.run])
        runs = np.unique(own, axis=1, return_inverse=True)[1].reshape(-1)
        count = int(runs.max(initial=0)) + 1
        if count >= _BLOCKS // 2:
            return np.asarray(runs * min(_BLOCKS, count) // count)
        pieces = max(1, min(_BLOCKS, len(self.data) // 4))
        return np.arange(len(self.data)) * pieces // len(self.data)

    @cached_property
    def shows_reversals(self) -> bool:
        """Whether readings show how an error builds up after a reversal."""
        if self.distance is None or not self.moves(self.axis):
            return False
        low, high = self.span[self.axis]
        near = (self.distance > 0) & (self.distance < _CLOSE * (high - low))
        return bool(near.sum() >= _NEAR)

    def centred(self, columns: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "t k"]:
        """Return columns without their mean in each measurement; 0 where not known.

        Each measurement has a zero of its own, so a mean says nothing; and a column that a
        measurement lacks is the same as one that is constant in it.
        """
        known = np.asarray(np.isfinite(columns).all(axis=1))
        result = np.where(known[:, None], columns, 0.0)
        for rows in self.sources:
            mine = rows[known[rows]]
            if mine.size:
                result[mine] -= result[mine].mean(axis=0)
        return result


def view_of(
    observed: Observed, axis: str, kept: Bool[np.ndarray, " t"], channel: str = "error"
) -> AxisView:
    """Return the readings of one axis, in the order of their measuring.

    Args:
        observed: All that was measured.
        axis: Whose readings.
        kept: Rows to look at.
        channel: ``error`` or ``current``.
    """
    known = np.flatnonzero(kept)
    order = known[np.lexsort((observed.clock[known], observed.source[known]))]
    rows = _thinned(order)
    data = observed.take(rows)
    span: dict[str, tuple[float, float]] = {}
    round_about: set[str] = set()
    for name, values in data.position.items():
        finite = values[np.isfinite(values)]
        if not finite.size or float(np.ptp(finite)) <= _STILL:
            continue
        span[name] = float(finite.min()), float(finite.max())
        start, end = data.modulo.get(name, (-np.inf, np.inf))
        if span[name][1] - span[name][0] > 0.8 * (end - start):
            span[name] = start, end
            round_about.add(name)
    distance = _distance(observed, axis)
    error: Float[np.ndarray, " t"] = getattr(data, channel)[axis].copy()
    view = AxisView(
        axis=axis,
        data=data,
        error=error,
        span=span,
        distance=None if distance is None else distance[rows],
        modulo=frozenset(round_about),
    )
    for own in view.sources:
        error[own] -= np.median(error[own])
    return view


def _thinned(rows: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """Return evenly many rows of every stretch, drawn so that no period is favoured."""
    if len(rows) <= _MOST:
        return rows
    edges = np.linspace(0, len(rows), _MOST + 1)
    rng = np.random.default_rng(len(rows))
    at = np.floor(edges[:-1] + np.diff(edges) * rng.random(_MOST)).astype(np.int64)
    return np.asarray(rows[np.unique(np.minimum(at, len(rows) - 1))])


def _distance(observed: Observed, axis: str) -> Float[np.ndarray, " t"] | None:
    """Return the way since the last reversal of an axis, on all rows that there are."""
    if axis not in observed.direction or axis not in observed.position:
        return None
    known = np.isfinite(observed.position[axis] + observed.direction[axis])
    order = np.lexsort((observed.clock, observed.run, observed.source))
    order = order[known[order]]
    place, way = observed.position[axis][order], observed.direction[axis][order]
    own = observed.run[order]
    number = np.arange(len(order))
    turned = np.ones(len(order), dtype=bool)
    turned[1:] = (way[1:] != way[:-1]) | (own[1:] != own[:-1])
    first = np.maximum.accumulate(np.where(turned, number, 0))
    # The reversal itself lies between this row and the one before it.
    start = np.maximum(first - 1, 0)
    start = np.where(own[start] != own[first], first, start)
    result = np.full(len(observed), np.nan)
    result[order] = np.abs(place - place[start])
    return result


def moving(values: Float[np.ndarray, " t"] | None) -> bool:
    """Return whether a channel was recorded and is not the same all the time."""
    if values is None:
        return False
    finite = values[np.isfinite(values)]
    return bool(finite.size > 0 and np.ptp(finite) > 0)


@dataclasses.dataclass(frozen=True)
class Candidates:
    """Terms that are looked for in the error of one axis.

    Attributes:
        terms: Of compensations and of what the controller has none for.
        heat: Temperature terms, of which one sensor and lag is chosen each.
        absent: Compensations that nothing recorded could show: name, masters and reason.
    """

    terms: tuple[Term, ...]
    heat: tuple[Term, ...]
    absent: tuple[tuple[str, tuple[str, ...], str], ...]


def candidates_of(view: AxisView, axes: Sequence[str]) -> Candidates:
    """Return what the recording of an axis could show.

    Args:
        view: The readings.
        axes: All axes of the machine, moved or not.
    """
    axis = view.axis
    others = [name for name in axes if name != axis]
    moved = [name for name in others if view.moves(name)]
    terms: list[Term] = []
    absent: list[tuple[str, tuple[str, ...], str]] = []
    for kind in _kinds("error"):
        masters: list[tuple[str, ...]] = [()]
        if kind is Kind.SURFACE:
            masters = list(itertools.combinations(moved, 2))
        elif kind is Kind.PUSH_PLACE:
            masters = list(itertools.product(others, view.span))
        elif "first" in {owner for _, owner, _ in kind.value.factors}:
            masters = [(name,) for name in others]
        for term in (Term(kind, axis, each) for each in masters):
            why = _lacking(view, term)
            if not why:
                terms.append(term)
            elif term.facts.compensation is not None:
                absent.append((term.facts.compensation, term.masters, why))
    heat = tuple(_warm(view)) if axis not in view.data.rotary else ()
    if not heat:
        why = "no temperature was recorded"
        if view.data.temperature:
            why = "no temperature changed"
        if axis in view.data.rotary:
            why = f"{axis} is rotary, and the unit of its coefficient is not defined"
        absent.append(("temperature", (), why))
    return Candidates(tuple(terms), heat, tuple(absent))


def _kinds(part: str) -> Iterator[Kind]:
    return (kind for kind in Kind if kind.value.part == part)


_CHANNELS = {
    "line": "position",
    "middle": "position",
    "way": "direction",
    "push": "acceleration",
    "pull": "acceleration",
    "sign": "velocity",
    "speed": "velocity",
}
"""What must have been recorded, and have changed, for a factor."""
_LACKING = {
    "position": ("the position of {} was not recorded", "{} did not move"),
    "direction": (
        "the direction of {} is not known",
        "{} was read from one direction only",
    ),
    "velocity": (
        "no velocity of {} was recorded, nor time to derive it from",
        "{} went at one velocity only",
    ),
    "acceleration": (
        "no acceleration of {} was recorded, nor time to derive it from",
        "{} did not accelerate",
    ),
}


def _lacking(view: AxisView, term: Term) -> str:
    """Return why a recording cannot show a term, or nothing."""
    turning = [name for name in term.masters if name in view.data.modulo]
    if term.kind is Kind.SURFACE and turning:
        return f"{turning[0]} goes round, and planes are fitted over axes with two ends"
    if term.kind is Kind.OWN_REVERSAL and view.places(term.axis) < 3:
        return f"{term.axis} was read at two places only"
    if term.kind is Kind.MEMORY and not view.shows_reversals:
        return f"{term.axis} was seldom read shortly after a reversal"
    for name, owner, _ in term.facts.factors:
        channel, whose = _CHANNELS.get(name), term.owners[owner]
        if channel is None:
            continue
        values = getattr(view.data, channel).get(whose)
        there = view.moves(whose) if channel == "position" else moving(values)
        if not there:
            return _LACKING[channel][values is not None].format(whose)
    return ""


def _warm(view: AxisView) -> Iterator[Term]:
    """Yield temperature terms, for lags that the time of the recording could show."""
    time = view.data.time
    longest = 0.0 if time is None else 0.25 * float(time[-1] - time[0])
    kinds = HEAT if view.moves(view.axis) else HEAT[:1]
    sensors = [name for name, each in view.data.temperature.items() if moving(each)]
    for sensor, lag, kind in itertools.product(sensors, _LAGS, kinds):
        if lag <= longest:
            yield Term(kind, view.axis, (), sensor, lag)


def late_terms(
    view: AxisView, axes: Sequence[str], chosen: Sequence[Term]
) -> Iterator[Term]:
    """Yield what makes sense only once other terms are there.

    A crosstalk that two positions adapt, growth with time, and growth with a temperature
    across the axis.
    """
    axis = view.axis
    adapted = [term.masters[0] for term in chosen if term.kind is Kind.PUSH_PLACE]
    for master in dict.fromkeys(adapted):
        for pair in itertools.combinations(view.span, 2):
            yield Term(Kind.PUSH_PLACES, axis, (master, *pair))
    if view.moves(axis):
        yield Term(Kind.GROWTH, axis)
    for heat in [term for term in chosen if term.kind in HEAT][:1]:
        for name in axes:
            if name != axis and view.moves(name):
                yield Term(Kind.HEAT_LINE, axis, (name,), heat.sensor, heat.lag)


def friction_terms(view: AxisView) -> tuple[list[Term], list[Term]]:
    """Return what the current of a drive may be made of, and Stribeck laws of some speeds."""
    axis, warm = view.axis, view.data.temperature
    apart = (Kind.COULOMB_HEAT, Kind.STRIBECK)
    terms = [Term(kind, axis) for kind in _kinds("current") if kind not in apart]
    terms = [term for term in terms if not _lacking(view, term)]
    terms += [
        Term(Kind.COULOMB_HEAT, axis, (), name)
        for name, values in warm.items()
        if moving(values)
    ]
    return terms, [Term(Kind.STRIBECK, axis, lag=knee) for knee in _KNEES]
