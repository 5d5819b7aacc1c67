"""The readings of one axis, thinned, and every term that they could show."""

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.signals import signs_at_one_place
from ._data import Observed, Rejected
from ._terms import CHANNELS, HEAT, Kind, Term

Channel = Literal["error", "current"]
"""What of an axis is looked at."""
_MOST = 16_000
"""Rows that are looked at; more show nothing new of terms worth compensating."""
_STILL = 1e-6
"""mm or °: a position that changes by less is constant."""
_LIST_UNIT, _OF_NOISE, _OF_SIZE = 5e-5, 0.1, 0.003
"""From which contribution to an error on a term counts: mm or °, shares of noise and rms."""
_OF_CURRENT = 0.01
"""The same for a current: share of its rms."""
_BLOCKS = 40
"""Pieces of a recording that resamples draw from."""
_NEAR = 100
"""Readings shortly after reversals, from which on their course can be seen."""
_CLOSE = 0.05
"""Share of the travel that is shortly after a reversal."""
_LAGS = (0.0, 60.0, 180.0, 600.0, 1800.0)
"""Seconds by which a structure may lag behind its sensor."""


@dataclasses.dataclass(frozen=True)
class AxisView:
    """Rows in which the error (or current) of one axis was measured.

    Attributes:
        axis: Its name.
        channel: What was measured.
        data: Those rows of the recording, thinned.
        distance: mm or ° that the axis has gone since its last reversal; NaN where not known.
    """

    axis: str
    channel: Channel
    data: Observed
    distance: Float[np.ndarray, " t"]

    @cached_property
    def error(self) -> Float[np.ndarray, " t"]:
        """In mm, ° or the unit of the current, without the median of each measurement."""
        result = np.array(getattr(self.data, self.channel)[self.axis])
        for source in self.sources:
            result[source] -= np.median(result[source])
        return result

    @cached_property
    def span(self) -> Mapping[str, tuple[float, float]]:
        """First and last position, by axis that moves; a whole turn of one that goes round."""
        result: dict[str, tuple[float, float]] = {}
        for name, values in self.data.position.items():
            finite = values[np.isfinite(values)]
            if finite.size and float(np.ptp(finite)) > _STILL:
                start, end = self.data.modulo.get(name, (-np.inf, np.inf))
                round_about = float(np.ptp(finite)) > 0.8 * (end - start)
                ends = float(finite.min()), float(finite.max())
                result[name] = (start, end) if round_about else ends
        return result

    def goes_round(self, axis: str) -> bool:
        """Return whether an axis goes round within the range that was measured."""
        return self.span.get(axis) == self.data.modulo.get(axis, ())

    @property
    def unit(self) -> str:
        """Unit of the error; empty for a current."""
        return self.data.unit(self.axis) if self.channel == "error" else ""

    @property
    def level(self) -> float:
        """Mean of a current, which is part of it; the zero of an instrument is not."""
        if self.channel == "error":
            return 0.0
        return float(np.mean(self.data.current[self.axis]))

    def least(self, size: float, noise: float = 0.0) -> float:
        """Return the contribution, by rms and noise of all readings, below which none counts."""
        if self.channel == "current":
            return max(_OF_CURRENT * size, 1e-12)
        return max(_LIST_UNIT, _OF_NOISE * noise, _OF_SIZE * size)

    def scaled(self, axis: str) -> Float[np.ndarray, " t"]:
        """Return the position of an axis from 0 to 1; NaN where it is not known."""
        low, high = self.span[axis]
        return np.asarray((self.data.position[axis] - low) / (high - low))

    def places(self, axis: str) -> int:
        """Return at how many different places of an axis there are readings."""
        values = self.data.position.get(axis, np.zeros(0))
        return len(np.unique(np.round(values[np.isfinite(values)], 4)))

    @cached_property
    def sources(self) -> list[Int[np.ndarray, " n"]]:
        """The rows of each measurement."""
        numbers = np.unique(self.data.source)
        return [np.flatnonzero(self.data.source == number) for number in numbers]

    @cached_property
    def block(self) -> Int[np.ndarray, " t"]:
        """The piece of the recording that each row belongs to."""
        pieces = max(1, min(_BLOCKS, len(self.data) // 4))
        return np.arange(len(self.data)) * pieces // len(self.data)

    def centred(self, columns: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "t k"]:
        """Return columns without their mean in each measurement; 0 where not known.

        Each measurement has a zero of its own; a column that it lacks is as one constant in it.
        """
        finite = np.asarray(np.isfinite(columns).all(axis=1))
        result = np.where(finite[:, None], columns, 0.0)
        for rows in self.sources:
            members = rows[finite[rows]]
            if members.size:
                result[members] -= result[members].mean(axis=0)
        return result


def view_of(
    observed: Observed,
    axis: str,
    kept: Bool[np.ndarray, " t"],
    channel: Channel = "error",
) -> AxisView:
    """Return the kept readings of one axis, in the order of their measuring."""
    indices = np.flatnonzero(kept)
    order = indices[np.lexsort((observed.clock[indices], observed.source[indices]))]
    rows = order[some_of(len(order), _MOST)]
    distance, data = _distance(observed, axis), observed.take(rows)
    # What stands still is no clock.
    time = data.clock if observed.time is not None and np.ptp(data.clock) > 0 else None
    data = dataclasses.replace(data, time=time, clock_number=data.source)
    return AxisView(axis, channel, data, distance[rows])


def some_of(count: int, most: int) -> Int[np.ndarray, " n"]:
    """Return numbers of rows, evenly many of every stretch; drawn, to favour no period."""
    edges = np.linspace(0, count, min(count, most) + 1)
    drawn = np.random.default_rng(count).random(len(edges) - 1)
    return np.unique((edges[:-1] + np.diff(edges) * drawn).astype(np.int64))


def _distance(observed: Observed, axis: str) -> Float[np.ndarray, " t"]:
    """Return the way since the last reversal of an axis, on all rows that there are."""
    result = np.full(len(observed), np.nan)
    if axis not in observed.direction or axis not in observed.position:
        return result
    finite = np.isfinite(observed.position[axis] + observed.direction[axis])
    order = np.lexsort((observed.clock, observed.run, observed.source))
    order = order[finite[order]]
    place, direction = observed.position[axis][order], observed.direction[axis][order]
    run, number = observed.run[order], np.arange(len(order))
    turned = np.ones(len(order), dtype=bool)
    turned[1:] = (direction[1:] != direction[:-1]) | (run[1:] != run[:-1])
    first = np.maximum.accumulate(np.where(turned, number, 0))
    # The reversal itself lies between this row and the one before it.
    start = np.maximum(first - 1, 0)
    start = np.where(run[start] != run[first], first, start)
    result[order] = np.abs(place - place[start])
    return result


def moving(values: Float[np.ndarray, " t"] | None) -> bool:
    """Return whether a channel was recorded and is not the same all the time."""
    if values is None:
        return False
    finite = values[np.isfinite(values)]
    return bool(finite.size > 0 and np.ptp(finite) > 0)


def candidates_of(
    view: AxisView, axes: Sequence[str]
) -> tuple[list[Term], list[Term], list[Rejected]]:
    """Return what the recording of an axis could show, of all axes, moved or not.

    Returns:
        Terms of compensations and of what the controller has none for; temperature terms, of
        which one sensor and lag is chosen each; compensations that cannot be looked for.
    """
    axis, others = view.axis, [name for name in axes if name != view.axis]
    tried = {t: _lacking(view, t) for t in _tried(view, view.channel, others)}
    terms = [term for term, why in tried.items() if not why]
    if view.channel == "current":
        return terms, [], []
    missed = [(t.facts.compensation, t.masters, why) for t, why in tried.items()]
    heat = [] if axis in view.data.rotary else list(_warm(view))
    why = "no temperature changed" if view.data.temperature else ""
    if axis in view.data.rotary:
        why = f"{axis} is rotary, and the unit of its coefficient is not defined"
    if not heat:
        missed.append(("temperature", (), why or "no temperature was recorded"))
    absent = [
        Rejected(name, axis, masters, None, f"could not be looked for: {why}")
        for name, masters, why in missed
        if name is not None and why
    ]
    return terms, heat, absent


def _tried(view: AxisView, part: str, others: Sequence[str]) -> Iterator[Term]:
    """Yield all terms of the kinds of a part, from all other axes and by all sensors."""
    moving = [name for name in others if name in view.span]
    for kind in (kind for kind in Kind if kind.value.part == part):
        owners = {owner for _, owner, _ in kind.value.factors}
        masters: Iterable[tuple[str, ...]] = [()]
        if kind is Kind.SURFACE:
            masters = itertools.combinations(moving, 2)
        elif kind is Kind.PUSH_PLACE:
            masters = itertools.product(others, view.span)
        elif "first" in owners:
            masters = [(name,) for name in others]
        sensors = _changing(view) if "sensor" in owners else [None]
        for master, sensor in itertools.product(masters, sensors):
            yield Term(kind, view.axis, master, sensor)


def _changing(view: AxisView) -> list[str]:
    """Return the sensors whose temperature changed."""
    return [name for name, values in view.data.temperature.items() if moving(values)]


def _lacking(view: AxisView, term: Term) -> str:
    """Return why a recording cannot show a term, or nothing."""
    turning = [name for name in term.masters if name in view.data.modulo]
    if term.kind is Kind.SURFACE and turning:
        return f"{turning[0]} goes round, and planes are fitted over axes with two ends"
    if term.kind is Kind.OWN_REVERSAL and view.places(term.axis) < 3:
        return f"{term.axis} was read at two places only"
    low, high = view.span.get(term.axis, (0.0, 0.0))
    near = (view.distance > 0) & (view.distance < _CLOSE * (high - low))
    if term.kind is Kind.MEMORY and near.sum() < _NEAR:
        return f"{term.axis} was seldom read shortly after a reversal"
    for name, owner, _ in term.facts.factors:
        channel, subject = CHANNELS.get(name), term.owners[owner]
        if channel is None:
            continue
        values = getattr(view.data, channel).get(subject)
        present = subject in view.span if channel == "position" else moving(values)
        if values is None:
            return f"no {channel} of {subject} is known"
        if not present:
            return f"{subject} was read at one {channel} only"
    if term.kind is Kind.PUSH_PLACE:
        mover, place = term.masters
        push = view.data.acceleration[mover]
        if signs_at_one_place(push, view.data.position[place]):
            return f"{mover} always accelerates one way at one position of {place}"
    return ""


def _warm(view: AxisView) -> Iterator[Term]:
    """Yield temperature terms, for lags that the time of the recording could show."""
    time = view.data.time
    longest = 0.0 if time is None else 0.25 * float(time[-1] - time[0])
    kinds = HEAT if view.axis in view.span else HEAT[:1]
    for sensor, lag, kind in itertools.product(_changing(view), _LAGS, kinds):
        if lag <= longest:
            yield Term(kind, view.axis, (), sensor, lag)


def late_terms(
    view: AxisView, axes: Sequence[str], chosen: Sequence[Term]
) -> Iterator[Term]:
    """Yield what makes sense only once other terms are there, such as growth with time."""
    axis, kinds = view.axis, {term.kind for term in chosen}
    if view.channel == "current":
        if Kind.COULOMB in kinds and Kind.COULOMB_HEAT not in kinds:
            yield Term(Kind.COULOMB_TIME, axis)
        return
    adapted = [term.masters[0] for term in chosen if term.kind is Kind.PUSH_PLACE]
    for master in dict.fromkeys(adapted):
        along = [Term(Kind.PUSH_PLACE, axis, (master, place)) for place in view.span]
        places = [term.masters[1] for term in along if not _lacking(view, term)]
        for pair in itertools.combinations(places, 2):
            yield Term(Kind.PUSH_PLACES, axis, (master, *pair))
    if axis in view.span:
        yield Term(Kind.GROWTH, axis)
    for heat in [term for term in chosen if term.kind in HEAT][:1]:
        for name in axes:
            if name != axis and name in view.span:
                yield Term(Kind.HEAT_LINE, axis, (name,), heat.sensor, heat.lag)
