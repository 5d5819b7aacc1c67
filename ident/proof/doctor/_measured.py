"""Two external measurements of an axis, brought to the same places."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.signals import (
    CLOSER,
    MANY,
    MOST_WILD,
    repeatability,
    resolution,
    wild_readings,
)

_PLACE = 0.01
"""mm or °: readings that near to each other are of one place."""

_SEVERAL = 2
"""Readings of a place from which on, one more, their median counts and not the mean."""

_FAR = 3.0
"""Times as far from each other as most neighbours are readings that tell nothing of what lies
between them: those of far legs of a path."""

_FINER, _REPEATS = 0.1, 3
"""Part of the scatter of first readings below which no second ones vary, and how many repeats
tell it."""

_ENOUGH = 0.1
"""Share of the readings that is left where no other axis accelerates, so that it alone counts."""

_MATCHED = 0.5
"""Share of the places of the second measurement that the first must have, too."""


@dataclasses.dataclass(frozen=True)
class Measured:
    """Errors of one axis, from an instrument outside of the controller.

    Attributes:
        axis: Logical number.
        positions: Commanded, by logical axis number, in mm or °.
        error: Actual − commanded in mm or °.
        direction: ±1 of the axis, where it is known.
        active: Compensations that were on; None where nobody said so.
        line: A straight line was removed from the error: its slope is unknown.
        late: What one standard deviation of the instrument's delay makes of the error, where
            the axis was in motion.
        time: In s, or None.
        own_zero: The zero of its instrument is arbitrary, another one in each such measurement.
        driven: Readings in which an axis accelerates whose acceleration moves this one by a
            list (`driving_axes`), or None.
    """

    axis: int
    positions: Mapping[int, Float[np.ndarray, " t"]]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None
    active: frozenset[str] | None = None
    line: bool = False
    late: Float[np.ndarray, " t"] | None = None
    time: Float[np.ndarray, " t"] | None = None
    own_zero: bool = False
    driven: Bool[np.ndarray, " t"] | None = None

    @property
    def undriven(self) -> "Measured":
        """The readings in which no such axis accelerates; all where hardly any is left."""
        if self.driven is None or np.mean(~self.driven) < _ENOUGH:
            return self
        kept: dict[str, Any] = {
            name: values[~self.driven]
            for name, values in vars(self).items()
            if isinstance(values, np.ndarray)
        }
        places = {axis: at[~self.driven] for axis, at in self.positions.items()}
        return dataclasses.replace(self, **kept | {"positions": places, "driven": None})


@dataclasses.dataclass(frozen=True)
class Difference:
    """What the lists changed: error after − error before, at the same places.

    Attributes:
        positions: By logical axis number, in mm or °, shape ``(g,)`` each.
        direction: ±1 per place, or None.
        change: In mm or °.
        variance: Of each change, in units of that of a single reading.
        readings: Before and after, that each change is the mean of; 0 where the first
            measurement was interpolated: one wild reading of it is in several changes.
        free: Columns that may be in the change: zeros and slope of the instruments, and what
            their delay leaves of the speed in each measurement.
    """

    positions: Mapping[int, Float[np.ndarray, " g"]]
    direction: Int[np.ndarray, " g"] | None
    change: Float[np.ndarray, " g"]
    variance: Float[np.ndarray, " g"]
    readings: Float[np.ndarray, " g"]
    free: Float[np.ndarray, "g f"]


def difference(
    before: Sequence[Measured], after: Sequence[Measured], followed: Collection[int]
) -> Difference:
    """Return what changed between measurements of one axis.

    Readings of one place and direction are averaged. Where the second measurement has
    places of its own, the first is interpolated between its own, never beyond, and over the
    axes alone that the lists of the axis follow: what others do is scatter then.
    """
    both = [*before, *after]
    # Only axes whose positions every measurement has.
    every = sorted(set.intersection(*({*one.positions} for one in both)))
    directed = all(one.direction is not None for one in both)
    for axes in (every, sorted({*followed} & {*every}) or every):
        earlier, later = (_places(each, axes, directed) for each in (before, after))
        # The place before of each after, −1 for none; most are to be one.
        number = {tuple(key): k for k, key in enumerate(earlier.keys.tolist())}
        match = np.array([number.get(tuple(key), -1) for key in later.keys.tolist()])
        if matched := bool(np.sum(match >= 0) >= _MATCHED * len(match)):
            break
    if matched:
        early = np.where(match[:, None] >= 0, earlier.levels[match], np.nan)
        counts = earlier.count[match]
    else:
        early = _interpolated(earlier, later.keys)
        counts = np.full(len(match), float(np.mean(earlier.count)))
    finite = np.isfinite(early[:, 0])
    keys = later.keys[finite]
    positions = {axis: keys[:, k] * _PLACE for k, axis in enumerate(axes)}
    nuisance = [np.ones(len(keys))]
    if any(one.line for one in both):
        nuisance += list(positions.values())
    beside = np.hstack([early[finite, 1:], later.levels[finite, 1:]]).T
    nuisance += [column for column in beside if column.any()]
    variance = 1.0 / counts[finite] + 1.0 / later.count[finite]
    return Difference(
        positions=positions,
        direction=keys[:, -1] if directed else None,
        change=later.levels[finite, 0] - early[finite, 0],
        variance=variance,
        readings=matched * 2.0 / variance,
        free=np.stack(nuisance, axis=1),
    )


def too_good(before: Sequence[Measured], after: Sequence[Measured]) -> bool:
    """Return whether second errors vary, or repeat, far closer than the first ones repeat.

    Then they are none of the machine: of another unit, or of another column.
    """
    errors, repeats = [], []
    for measured in (before, after):
        axes = sorted(set.intersection(*({*one.positions} for one in measured)))
        directed = all(one.direction is not None for one in measured)
        errors.append(np.concatenate([one.error for one in measured]))
        places = _places(measured, axes, directed)
        repeats.append(repeatability(places.at, errors[-1]))
    (scatter, count), (again, number) = repeats
    # What is smaller than a step of the display shows as nothing.
    if count < _REPEATS or scatter <= max(map(resolution, errors)):
        return False
    # A recording stands still for many readings.
    known = min(count, number) >= MANY and all(one.time is None for one in after)
    finer = known and again < CLOSER * scatter
    return bool(finer or np.std(errors[1]) < _FINER * scatter)


@dataclasses.dataclass(frozen=True)
class _Places:
    """Readings by place and direction: the place in units of `_PLACE`, the direction last.

    Levels are the error, what the delay of its instrument makes of it, and the share in it of
    each zero that is arbitrary; ``at`` is the place of each reading, another one for each zero.
    """

    keys: Int[np.ndarray, "g k"]
    levels: Float[np.ndarray, "g l"]
    count: Float[np.ndarray, " g"]
    at: Int[np.ndarray, " t"]


def _places(
    measured: Sequence[Measured], axes: Sequence[int], directed: bool
) -> _Places:
    from scipy.ndimage import median

    rows, late, zeros = [], [], []
    for number, one in enumerate(measured, start=1):
        blank = np.zeros(len(one.error))
        columns = [np.rint(one.positions[axis] / _PLACE) for axis in axes]
        directions = one.direction if directed else None
        columns.append(blank if directions is None else directions)
        rows.append(np.stack(columns, axis=1).astype(np.int64))
        late.append(blank if one.late is None else one.late)
        zeros.append(np.full(len(blank), number * one.own_zero))
    values = np.concatenate([one.error for one in measured])
    places, at = np.unique(np.concatenate(rows), axis=0, return_inverse=True)
    several = len(measured) + 1
    levels, at = np.unique(
        at.ravel() * several + np.concatenate(zeros), return_inverse=True
    )
    # A wild reading does not count beside another one of its place; alone it may be the list.
    wild = wild_readings(values)
    sound = ~wild if wild.mean() <= MOST_WILD else np.ones(len(values), bool)
    sound |= np.bincount(at, sound)[at] == 0
    counts = np.bincount(at, sound)
    middle = median(values[sound], at[sound], np.arange(len(counts)))
    mean, drawn = (
        np.bincount(at, column * sound) / counts
        for column in (values, np.concatenate(late))
    )
    level = np.where(counts > _SEVERAL, middle, mean)
    place, zero = np.divmod(levels, several)
    shares = (level, drawn, *(zero == k for k in range(1, several)))
    count = np.bincount(place, counts)
    shared = np.stack([np.bincount(place, counts * c) / count for c in shares], axis=1)
    return _Places(places, shared, count, at)


def _interpolated(
    source: _Places, keys: Int[np.ndarray, "g k"]
) -> Float[np.ndarray, "g l"]:
    """Return the levels at places between those that are known; NaN beyond them."""
    levels = np.full((len(keys), source.levels.shape[1]), np.nan)
    for direction in np.unique(source.keys[:, -1]):
        in_direction, rows = source.keys[:, -1] == direction, keys[:, -1] == direction
        places = source.keys[in_direction, :-1].astype(float)
        known = source.levels[in_direction]
        varied = np.flatnonzero(np.ptp(places, axis=0) > 0)
        at, targets = places[:, varied], keys[rows][:, varied].astype(float)
        if varied.size == 1:
            from scipy.interpolate import interp1d

            between = interp1d(at[:, 0], known, axis=0, bounds_error=False)
            levels[rows] = between(targets[:, 0])
        elif varied.size > 1 and rows.any():
            from scipy.interpolate import LinearNDInterpolator
            from scipy.spatial import Delaunay

            mesh = Delaunay(at)
            extent = np.ptp(at[mesh.simplices], axis=1)
            far = (extent > _FAR * np.median(extent, axis=0)).any(axis=1)
            found = LinearNDInterpolator(mesh, known)(targets)
            found[far[mesh.find_simplex(targets)]] = np.nan
            levels[rows] = found
    return levels
