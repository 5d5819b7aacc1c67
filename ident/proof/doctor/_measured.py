"""Two external measurements of an axis, brought to the same places."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

_PLACE = 0.01
"""mm or °: readings that near to each other are of one place."""

_SEVERAL = 2
"""Readings of a place from which on, one more, their median counts and not the mean."""

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
    """

    axis: int
    positions: Mapping[int, Float[np.ndarray, " t"]]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None
    active: frozenset[str] | None = None
    line: bool = False


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
        free: Columns that may be in the change: zero and slope of the instrument.
    """

    positions: Mapping[int, Float[np.ndarray, " g"]]
    direction: Int[np.ndarray, " g"] | None
    change: Float[np.ndarray, " g"]
    variance: Float[np.ndarray, " g"]
    readings: Float[np.ndarray, " g"]
    free: Float[np.ndarray, "g f"]


def difference(before: Sequence[Measured], after: Sequence[Measured]) -> Difference:
    """Return what changed between measurements of one axis.

    Readings of one place and direction are averaged. Where the second measurement has
    places of its own, the first is interpolated between its own, never beyond.
    """
    measurements = [*before, *after]
    # Only axes whose positions every measurement has.
    axes = sorted(
        set.intersection(*(set(measurement.positions) for measurement in measurements))
    )
    directed = all(measurement.direction is not None for measurement in measurements)
    earlier, later = _places(before, axes, directed), _places(after, axes, directed)
    number = {tuple(key): k for k, key in enumerate(earlier.keys.tolist())}
    match = np.array([number.get(tuple(key), -1) for key in later.keys.tolist()])
    if matched := np.sum(match >= 0) >= _MATCHED * len(match):
        early = np.where(match >= 0, earlier.level[match], np.nan)
        counts = earlier.count[match]
    else:
        early = _interpolated(earlier, later.keys)
        counts = np.full(len(match), float(np.mean(earlier.count)))
    finite = np.isfinite(early)
    keys = later.keys[finite]
    positions = {axis: keys[:, k] * _PLACE for k, axis in enumerate(axes)}
    nuisance = [np.ones(len(keys))]
    if any(measurement.line for measurement in measurements):
        nuisance += list(positions.values())
    variance = 1.0 / counts[finite] + 1.0 / later.count[finite]
    return Difference(
        positions=positions,
        direction=keys[:, -1] if directed else None,
        change=later.level[finite] - early[finite],
        variance=variance,
        readings=matched * 2.0 / variance,
        free=np.stack(nuisance, axis=1),
    )


@dataclasses.dataclass(frozen=True)
class _Places:
    """Readings by place and direction: the place in units of `_PLACE`, the direction last."""

    keys: Int[np.ndarray, "g k"]
    level: Float[np.ndarray, " g"]
    count: Int[np.ndarray, " g"]


def _places(
    measured: Sequence[Measured], axes: Sequence[int], directed: bool
) -> _Places:
    from scipy.ndimage import median

    rows = []
    for measurement in measured:
        columns = [np.rint(measurement.positions[axis] / _PLACE) for axis in axes]
        directions = measurement.direction if directed else None
        columns.append(
            np.zeros(len(measurement.error)) if directions is None else directions
        )
        rows.append(np.stack(columns, axis=1).astype(np.int64))
    keys, values = (
        np.concatenate(rows),
        np.concatenate([measurement.error for measurement in measured]),
    )
    places, at, counts = np.unique(
        keys, axis=0, return_inverse=True, return_counts=True
    )
    # One wild reading among several must not count.
    middle = median(values, at.ravel(), np.arange(len(counts)))
    mean = np.bincount(at.ravel(), values) / counts
    return _Places(places, np.where(counts > _SEVERAL, middle, mean), counts)


def _interpolated(
    source: _Places, keys: Int[np.ndarray, "g k"]
) -> Float[np.ndarray, " g"]:
    """Return the error at places between those that are known; NaN beyond them."""
    error = np.full(len(keys), np.nan)
    for direction in np.unique(source.keys[:, -1]):
        in_direction, rows = source.keys[:, -1] == direction, keys[:, -1] == direction
        places, level = (
            source.keys[in_direction, :-1].astype(float),
            source.level[in_direction],
        )
        varied = np.flatnonzero(np.ptp(places, axis=0) > 0)
        at, targets = places[:, varied], keys[rows][:, varied].astype(float)
        if varied.size == 1:
            rank = np.argsort(at[:, 0])
            error[rows] = np.interp(
                targets[:, 0], at[rank, 0], level[rank], left=np.nan, right=np.nan
            )
        elif varied.size > 1 and rows.any():
            from scipy.interpolate import LinearNDInterpolator

            error[rows] = LinearNDInterpolator(at, level)(targets)
    return error
