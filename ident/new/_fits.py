"""Which compensation suits readings, by what was measured over what."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ...data.signals import signs_at_one_place
from ..discover import Observed
from ..job import Job, Trend, nodes_for, trend_through
from ..readings import Observation, without_zero
from ._names import span

_WARM = 1.0
"""K: less tells nothing of warmth."""
_PLACES = 12
"""Different places up to which readings over a changing temperature tell of warmth."""
_BOTH = 0.2
"""Share of the readings that each direction has where both were measured."""
_MOVED = 1e-3
"""mm or °: what stays within has not moved."""
_FOLLOWS, _MAINLY = 0.1, 0.5
"""Shares of the variance of an error that an acceleration explains: from which on it is
offered as a crosstalk, and from which on before what lies over a position."""
_ADAPTED = 0.2
"""Share of what is left from which on that it changes with a position is said."""
_PUSHED = 1000
"""Readings of a log that tell of accelerations: nobody reads them from place to place."""
_WILD = 8.0
"""Deviations from the line through the errors from which a reading says nothing of it."""
_FEW = 12
"""Readings up to which all count: a robust line goes through some of few exactly."""
_MANY = 20_000
"""Readings that judge a line."""


@dataclasses.dataclass(frozen=True)
class Suggestion:
    """A fit that readings would bear.

    Attributes:
        compensation: As the job calls it.
        axis: Axis to compensate.
        over: Axes over whose positions its table lies; empty: it has no table.
        keys: What the job says of it beyond measurement and nodes.
        nodes: Keys of the nodes that suit the readings.
        sources: Names of the measurements.
        plain: It is the plain one for these readings; others stand beside it.
        why: What speaks for it, as the end of "… since".
    """

    compensation: str
    axis: str
    over: tuple[str, ...]
    keys: dict[str, Any]
    sources: tuple[str, ...]
    plain: bool
    why: str
    nodes: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def of_job(self) -> dict[str, Any]:
        """Return the keys of the fit in a job."""
        names: dict[str, Any] = {"measurements": list(self.sources)}
        if len(self.sources) == 1:
            names = {"measurement": self.sources[0]}
        own = {"compensation": self.compensation, "axis": self.axis}
        return own | names | self.keys | dict(self.nodes)


def suggestions(job: Job, observation: Observation) -> list[Suggestion]:
    """Return the fits that measurements would bear, those of one kind and axis joined.

    An axis has one compensation of each kind: of several plain ones the first is.
    """
    fits: dict[tuple[object, ...], Suggestion] = {}
    for number, name in enumerate(observation.names):
        rows = observation.data.source == number
        for fit in _of_one(observation.data, rows, name):
            key = (fit.compensation, fit.axis, fit.over, str(fit.keys))
            if key in fits:
                sources = (*fits[key].sources, name)
                fit = dataclasses.replace(fits[key], sources=sources)
            elif any(fit.compensation == k[0] and fit.axis == k[1] for k in fits):
                fit = dataclasses.replace(fit, plain=False)
            fits[key] = fit
    return [
        dataclasses.replace(
            fit, nodes=nodes_for(job, observation, fit.axis, fit.over, fit.sources)
        )
        for fit in fits.values()
    ]


def _of_one(
    data: Observed, rows: Bool[np.ndarray, " t"], name: str
) -> Iterator[Suggestion]:
    """Yield what the readings of one measurement would bear, the plain ones first."""
    for axis, current in data.current.items():
        if np.isfinite(current[rows]).any():
            why = "its current was recorded"
            yield Suggestion("friction", axis, (), {}, (name,), True, why)
    for axis, error in data.error.items():
        known = rows & np.isfinite(error)
        if known.any():
            yield from _of_error(data, axis, known, name)


def _of_error(
    data: Observed, axis: str, rows: Bool[np.ndarray, " t"], name: str
) -> Iterator[Suggestion]:
    moved = [each for each in data.position if span(data.position[each][rows]) > _MOVED]
    others = tuple(each for each in moved if each != axis)
    warm = [s for s in data.temperature if span(data.temperature[s][rows]) > _WARM]
    few = not moved or all(
        len(np.unique(np.round(data.position[each][rows], 3))) <= _PLACES
        for each in moved
    )
    heat = [_of_heat(axis, warm, axis in moved, name, plain=few)] if warm else []
    push = _of_push(data, axis, rows, moved, name)
    plain = not (few and warm)
    if few:
        yield from heat
    if push is not None:
        plain = plain and not push.plain
        yield push
    if axis in moved:
        bilateral = _both(data, axis)
        why = f"the error of {axis} was measured along {axis}"
        why += ", in both directions" if bilateral else ", in one direction"
        keys: dict[str, Any] = {"bilateral": True} if bilateral else {}
        yield Suggestion("leadscrew", axis, (axis,), keys, (name,), plain, why)
    if not moved and _both(data, axis):
        why = f"the error of {axis} was measured at one place, from both sides"
        yield Suggestion("backlash", axis, (), {}, (name,), plain, why)
    others_plain = plain and axis not in moved
    # A surface holds what a line over one of its axes would.
    for master in others if axis in moved or len(others) == 1 else ():
        why = f"the error of {axis} was measured while {master} moved"
        keys = {"master": master}
        yield Suggestion("cross", axis, (master,), keys, (name,), others_plain, why)
    if len(others) >= 2:
        pair = others[:2]
        why = f"the error of {axis} was measured while {' and '.join(pair)} moved"
        keys = {"masters": list(pair)}
        yield Suggestion("plane", axis, pair, keys, (name,), others_plain, why)
    if not few:
        yield from heat


def _of_heat(
    axis: str, warm: Sequence[str], along: bool, name: str, *, plain: bool
) -> Suggestion:
    """Return the thermal line; measured at one position, only its offset can be told."""
    keys: dict[str, Any] = {"sensor": warm[0]}
    if not along:
        keys = {"sensors": {"offset": warm[0]}}
    why = f"the error of {axis} was measured while {' and '.join(warm)} changed"
    return Suggestion("temperature", axis, (), keys, (name,), plain, why)


def _of_push(
    data: Observed,
    axis: str,
    rows: Bool[np.ndarray, " t"],
    moved: Sequence[str],
    name: str,
) -> Suggestion | None:
    """Return the crosstalk of the axis whose acceleration the error follows most."""
    shares = {
        each: _share(data, axis, rows, data.acceleration[each])
        for each in moved
        if each != axis and each in data.acceleration
    }
    master = max(shares, key=lambda each: shares[each], default=axis)
    if shares.get(master, 0.0) < _FOLLOWS:
        return None
    push, alike = data.acceleration[master], shares[master]
    keys: dict[str, Any] = {"master": master}
    why = f"the error of {axis} follows the acceleration of {master}"
    adapted = {
        place: _share(data, axis, rows, push, push * data.position[place])
        for place in moved
        if not signs_at_one_place(push[rows], data.position[place][rows])
    }
    place = max(adapted, key=lambda each: adapted[each], default=master)
    if adapted.get(place, 0.0) - alike > _ADAPTED * (1.0 - alike):
        keys["adaptation"] = place
        why += f", and how much changes with the position of {place}"
    return Suggestion("crosstalk", axis, (), keys, (name,), alike > _MAINLY, why)


def _share(
    data: Observed,
    axis: str,
    rows: Bool[np.ndarray, " t"],
    *columns: Float[np.ndarray, " t"],
) -> float:
    """Return which share of the variance of the error of an axis columns explain."""
    known = np.flatnonzero(rows & np.isfinite(columns).all(axis=0))
    known = known[:: max(1, len(known) // _MANY)]
    if len(known) < _PUSHED:
        return 0.0
    error = data.error[axis][known]
    error = np.clip(error, *np.percentile(error, [1.0, 99.0]))  # the wild ones
    design = np.column_stack([np.ones(len(known)), *(each[known] for each in columns)])
    left = error - design @ np.linalg.lstsq(design, error)[0]
    return float(1.0 - np.var(left) / max(np.var(error), np.finfo(float).tiny))


def _both(data: Observed, axis: str) -> bool:
    """Whether an axis was measured in both directions, be it in a file for each."""
    way, place = data.direction.get(axis), data.position.get(axis)
    if way is None or place is None:
        return False
    known = way[np.isfinite(way) & np.isfinite(place) & np.isfinite(data.error[axis])]
    return bool(known.size) and _BOTH < float(np.mean(known > 0)) < 1.0 - _BOTH


def trend_in(
    job: Job, observation: Observation, one: Suggestion, source: str
) -> Trend | None:
    """Return the line through the error that a table would take over, None without one.

    Judged at the means about each node, as the table would show it; a wild reading tells
    nothing of it.
    """
    if not one.over:
        return None
    data = observation.data
    rows = (data.source == observation.names.index(source)) & np.isfinite(
        data.error[one.axis]
    )
    at = np.stack([data.position[axis] for axis in one.over], axis=1)
    rows &= np.isfinite(at).all(axis=1)
    at, error = at[rows], data.error[one.axis][rows]
    step = max(1, len(error) // _MANY)
    at, error = at[::step], error[::step]
    start, interval = (np.atleast_1d(one.nodes[key]) for key in ("start", "interval"))
    keys = np.round((at - start) / interval)
    way = data.direction.get(one.axis)
    if "bilateral" in one.keys and way is not None:
        keys = np.column_stack([keys, way[rows][::step]])
    left = without_zero(error, [*at.T], "line")
    scale = 1.4826 * float(np.median(np.abs(left)))
    judged = scale > 0 and len(left) > _FEW
    kept = np.abs(left) <= _WILD * scale if judged else np.full(len(left), True)
    at, error, keys = at[kept], error[kept], keys[kept]
    _, group, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    means = np.bincount(group, error) / count
    where = np.stack([np.bincount(group, each) / count for each in at.T], axis=1)
    free = max(len(error) - len(count), 1)
    noise = float(np.sqrt(np.sum((error - means[group]) ** 2) / free))
    periodic = job.spec.axes[one.over[0]].modulo is not None
    return trend_through(where, means, noise=noise, periodic=periodic)
