"""The readings of one axis, thinned, and every term that they could show."""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping

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
        block: Number of the piece of the recording that a row belongs to.
        span: First and last position, by axis that moves.
        distance: mm or ° that the axis has gone since its last reversal, or None.
        modulo: Axes that go round within the range that was measured.
    """

    axis: str
    data: Observed
    error: Float[np.ndarray, " t"]
    block: Int[np.ndarray, " t"]
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
        known = self.data.position[axis]
        return len(np.unique(np.round(known[np.isfinite(known)], 4)))

    def sources(self) -> list[Int[np.ndarray, " n"]]:
        """Return the rows of each measurement."""
        numbers = np.unique(self.data.source)
        return [np.flatnonzero(self.data.source == number) for number in numbers]

    def centred(self, columns: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "t k"]:
        """Return columns without their mean in each measurement; 0 where not known.

        Each measurement has a zero of its own, so a mean says nothing; and a column that a
        measurement lacks is the same as one that is constant in it.
        """
        known = np.asarray(np.isfinite(columns).all(axis=1))
        result = np.where(known[:, None], columns, 0.0)
        for rows in self.sources():
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
        low, high = float(finite.min()), float(finite.max())
        if name in data.modulo:
            start, end = data.modulo[name]
            if high - low > 0.8 * (end - start):
                low, high = start, end
                round_about.add(name)
        span[name] = (low, high)
    distance = _distance(observed, axis)
    error: Float[np.ndarray, " t"] = getattr(data, channel)[axis].copy()
    view = AxisView(
        axis=axis,
        data=data,
        error=error,
        block=_blocks(data),
        span=span,
        distance=None if distance is None else distance[rows],
        modulo=frozenset(round_about),
    )
    for own in view.sources():
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


def _blocks(data: Observed) -> Int[np.ndarray, " t"]:
    """Return the piece of each row: runs where there are many, else stretches of them."""
    runs = np.unique(np.stack([data.source, data.run]), axis=1, return_inverse=True)[1]
    runs = runs.reshape(-1)
    count = int(runs.max(initial=0)) + 1
    if count >= _BLOCKS // 2:
        return (runs * min(_BLOCKS, count) // count).astype(np.int64)
    pieces = max(1, min(_BLOCKS, len(data) // 4))
    return np.arange(len(data)) * pieces // len(data)


def _distance(observed: Observed, axis: str) -> Float[np.ndarray, " t"] | None:
    """Return the way since the last reversal of an axis, on all rows that there are."""
    if axis not in observed.direction or axis not in observed.position:
        return None
    known = np.isfinite(observed.position[axis] + observed.direction[axis])
    order = np.lexsort((observed.clock, observed.run, observed.source))
    order = order[known[order]]
    if not len(order):
        return None
    place, way = observed.position[axis][order], observed.direction[axis][order]
    own = observed.run[order]
    turned = np.ones(len(order), dtype=bool)
    turned[1:] = (way[1:] != way[:-1]) | (own[1:] != own[:-1])
    first = np.maximum.accumulate(np.where(turned, np.arange(len(order)), 0))
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


def candidates_of(view: AxisView, axes: tuple[str, ...]) -> Candidates:
    """Return what the recording of an axis could show.

    Args:
        view: The readings.
        axes: All axes of the machine, moved or not.
    """
    axis, data = view.axis, view.data
    others = [name for name in axes if name != axis]
    moved = [name for name in others if view.moves(name)]
    terms: list[Term] = []
    absent: list[tuple[str, tuple[str, ...], str]] = []
    turning = moving(data.direction.get(axis))
    if view.moves(axis):
        terms.append(Term(Kind.OWN, axis))
    else:
        absent.append(("leadscrew", (), _unmoved(view, axis)))
    if turning:
        terms.append(Term(Kind.REVERSAL, axis))
        if view.moves(axis) and view.places(axis) > 2:
            terms.append(Term(Kind.OWN_REVERSAL, axis))
    else:
        why = f"{axis} was read from one direction only"
        if axis not in data.direction:
            why = f"the direction of {axis} is not known"
        absent.append(("backlash", (), why))
    terms += [Term(Kind.LINE, axis, (name,)) for name in moved]
    absent += [
        ("cross", (name,), _unmoved(view, name)) for name in others if name not in moved
    ]
    for pair in itertools.combinations(moved, 2):
        turns = [name for name in pair if name in data.modulo]
        if turns:
            why = (
                f"{turns[0]} goes round, and planes are fitted over axes with two ends"
            )
            absent.append(("plane", pair, why))
        else:
            terms.append(Term(Kind.SURFACE, axis, pair))
    for name in others:
        if moving(data.acceleration.get(name)):
            terms.append(Term(Kind.PUSH, axis, (name,)))
            if moving(data.velocity.get(name)):
                terms.append(Term(Kind.PUSH_WAY, axis, (name,)))
            terms += [Term(Kind.PUSH_PLACE, axis, (name, place)) for place in view.span]
        else:
            why = f"no acceleration of {name} was recorded, nor time to derive it from"
            if name in data.acceleration:
                why = f"{name} did not accelerate"
            absent.append(("crosstalk", (name,), why))
    heat = tuple(_heat(view)) if axis not in data.rotary else ()
    if not heat:
        why = (
            "no temperature changed"
            if data.temperature
            else "no temperature was recorded"
        )
        if axis in data.rotary:
            why = f"{axis} is rotary, and the unit of its coefficient is not defined"
        absent.append(("temperature", (), why))
    terms += _beyond_kernel(view, moved)
    return Candidates(tuple(terms), heat, tuple(absent))


def _unmoved(view: AxisView, axis: str) -> str:
    if axis not in view.data.position:
        return f"the position of {axis} was not recorded"
    return f"{axis} did not move"


def _heat(view: AxisView) -> Iterator[Term]:
    time = view.data.time
    longest = 0.0 if time is None else 0.25 * float(time[-1] - time[0])
    kinds = HEAT if view.moves(view.axis) else HEAT[:1]
    for sensor, values in view.data.temperature.items():
        if moving(values):
            for lag in _LAGS:
                if lag <= longest:
                    yield from (
                        Term(kind, view.axis, (), sensor, lag) for kind in kinds
                    )


def _beyond_kernel(view: AxisView, moved: list[str]) -> Iterator[Term]:
    data, axis = view.data, view.axis
    if moving(data.velocity.get(axis)):
        yield Term(Kind.SPEED, axis)
    if moving(data.acceleration.get(axis)):
        yield Term(Kind.PULL, axis)
    if moving(data.direction.get(axis)) and _near_reversals(view) >= _NEAR:
        yield Term(Kind.MEMORY, axis)
    for name in moved:
        if moving(data.velocity.get(name)):
            yield Term(Kind.SPEED_OTHER, axis, (name,))
        if moving(data.direction.get(name)):
            yield Term(Kind.REVERSAL_OTHER, axis, (name,))
        if view.moves(axis):
            yield Term(Kind.OWN_LINE, axis, (name,))


def _near_reversals(view: AxisView) -> int:
    """Return how many readings show how an error builds up after a reversal."""
    if view.distance is None or not view.moves(view.axis):
        return 0
    low, high = view.span[view.axis]
    near = (view.distance > 0) & (view.distance < _CLOSE * (high - low))
    return int(near.sum())


def late_terms(
    view: AxisView, axes: tuple[str, ...], chosen: list[Term]
) -> Iterator[Term]:
    """Yield what makes sense only once other terms are there.

    A crosstalk that two positions adapt, growth with time, and growth with a temperature
    across the axis.
    """
    adapted = [term.masters[0] for term in chosen if term.kind is Kind.PUSH_PLACE]
    for master in dict.fromkeys(adapted):
        for pair in itertools.combinations(view.span, 2):
            yield Term(Kind.PUSH_PLACES, view.axis, (master, *pair))
    if view.moves(view.axis):
        yield Term(Kind.GROWTH, view.axis)
    heat = next((term for term in chosen if term.kind in HEAT), None)
    if heat is not None:
        for name in axes:
            if name != view.axis and view.moves(name):
                yield Term(Kind.HEAT_LINE, view.axis, (name,), heat.sensor, heat.lag)


def friction_terms(view: AxisView) -> tuple[list[Term], list[Term]]:
    """Return what the current of a drive may be made of, and Stribeck laws of some speeds."""
    axis = view.axis
    plain = [Kind.INERTIA, Kind.COULOMB, Kind.VISCOUS, Kind.DRAG, Kind.VISCOUS_WAY]
    if view.moves(axis):
        plain += [Kind.LOAD_PLACE, Kind.COULOMB_PLACE]
    terms = [Term(kind, axis) for kind in plain]
    terms += [
        Term(Kind.COULOMB_HEAT, axis, (), name)
        for name, values in view.data.temperature.items()
        if moving(values)
    ]
    return terms, [Term(Kind.STRIBECK, axis, lag=knee) for knee in _KNEES]
