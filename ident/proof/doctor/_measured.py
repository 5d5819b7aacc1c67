"""Two external measurements of an axis, brought to the same places."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

_PLACE = 0.01
"""mm or °: readings that near to each other are of one place."""

_SEVERAL = 4
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
        active: Compensations that were on.
        line: A straight line was removed from the error: its slope is unknown.
    """

    axis: int
    positions: Mapping[int, Float[np.ndarray, " t"]]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None
    active: frozenset[str] = frozenset()
    line: bool = False


@dataclasses.dataclass(frozen=True)
class Difference:
    """What the lists changed: error after − error before, at the same places.

    Attributes:
        axis: Logical number.
        positions: By logical axis number, in mm or °, shape ``(g,)`` each.
        direction: ±1 per place, or None.
        change: In mm or °.
        variance: Of each change, in units of that of a single reading.
        free: Columns that may be in the change: zero and slope of the instrument.
        before: Root of the mean square of the error before, its mean taken out.
    """

    axis: int
    positions: Mapping[int, Float[np.ndarray, " g"]]
    direction: Int[np.ndarray, " g"] | None
    change: Float[np.ndarray, " g"]
    variance: Float[np.ndarray, " g"]
    free: Float[np.ndarray, "g f"]
    before: float


def difference(before: Sequence[Measured], after: Sequence[Measured]) -> Difference:
    """Return what changed between measurements of one axis.

    Readings of one place and direction are averaged. Where the second measurement has
    places of its own, the first is interpolated between its own, never beyond.
    """
    moved = _moved([*before, *after])
    directed = all(one.direction is not None for one in (*before, *after))
    old, new = _Places(before, moved, directed), _Places(after, moved, directed)
    shared = [key for key in new.groups if key in old.groups]
    if len(shared) >= _MATCHED * len(new.groups):
        values = np.array([old.mean(key) for key in shared])
        counts = np.array([old.count(key) for key in shared], dtype=float)
        keys = shared
    else:
        keys, values = old.interpolated(new)
        counts = np.full(len(keys), float(np.mean([old.count(k) for k in old.groups])))
    late = np.array([new.mean(key) for key in keys])
    number = np.array([new.count(key) for key in keys], dtype=float)
    places = np.array([key[:-1] for key in keys], dtype=float).reshape(len(keys), -1)
    positions = {axis: places[:, k] * _PLACE for k, axis in enumerate(moved)}
    free = [np.ones(len(keys))]
    if any(one.line for one in (*before, *after)):
        free += list(positions.values())
    errors = np.concatenate([one.error for one in before])
    return Difference(
        axis=before[0].axis,
        positions=positions,
        direction=(
            np.array([key[-1] for key in keys], dtype=np.int64) if directed else None
        ),
        change=late - values,
        variance=1.0 / counts + 1.0 / number,
        free=np.stack(free, axis=1),
        before=float(np.std(errors)),
    )


def _moved(measured: Sequence[Measured]) -> tuple[int, ...]:
    """Return the axes whose positions every measurement has."""
    sets = [set(one.positions) for one in measured]
    return tuple(sorted(set.intersection(*sets)))


class _Places:
    """Readings by place and direction."""

    def __init__(
        self, measured: Sequence[Measured], axes: tuple[int, ...], directed: bool
    ) -> None:
        keys, errors = [], []
        for one in measured:
            columns = [np.rint(one.positions[axis] / _PLACE) for axis in axes]
            ways = one.direction if directed else None
            columns.append(np.zeros(len(one.error)) if ways is None else ways)
            keys.append(np.stack(columns, axis=1).astype(np.int64))
            errors.append(one.error)
        rows, values = np.concatenate(keys), np.concatenate(errors)
        order = np.lexsort((values, *rows.T))
        rows, values = rows[order], values[order]
        first = np.any(rows[1:] != rows[:-1], axis=1)
        starts = np.concatenate([[0], np.flatnonzero(first) + 1])
        counts = np.diff(np.append(starts, len(rows)))
        middle = 0.5 * (
            values[starts + (counts - 1) // 2] + values[starts + counts // 2]
        )
        # One wild reading among several must not count.
        means = np.add.reduceat(values, starts) / counts
        level = np.where(counts > _SEVERAL, middle, means)
        self.groups: dict[tuple[int, ...], tuple[float, int]] = {
            tuple(key): (value, count)
            for key, value, count in zip(
                rows[starts].tolist(), level.tolist(), counts.tolist(), strict=True
            )
        }

    def mean(self, key: tuple[int, ...]) -> float:
        return self.groups[key][0]

    def count(self, key: tuple[int, ...]) -> int:
        return self.groups[key][1]

    def interpolated(
        self, other: "_Places"
    ) -> tuple[list[tuple[int, ...]], Float[np.ndarray, " g"]]:
        """Return the places of another measurement that lie inside, with values here."""
        keys: list[tuple[int, ...]] = []
        values: list[np.ndarray] = []
        for way in sorted({key[-1] for key in self.groups}):
            mine = sorted(key for key in self.groups if key[-1] == way)
            theirs = sorted(key for key in other.groups if key[-1] == way)
            if not theirs:
                continue
            known = np.array([key[:-1] for key in mine], dtype=float)
            asked = np.array([key[:-1] for key in theirs], dtype=float)
            level = np.array([self.mean(key) for key in mine])
            varied = np.flatnonzero(np.ptp(known, axis=0) > 0)
            if varied.size == 0:
                continue
            if varied.size == 1:
                at, ask = known[:, varied[0]], asked[:, varied[0]]
                found = np.interp(ask, at, level, left=np.nan, right=np.nan)
            else:
                from scipy.interpolate import LinearNDInterpolator

                found = LinearNDInterpolator(known[:, varied], level)(asked[:, varied])
            inside = np.isfinite(found)
            keys += [key for key, use in zip(theirs, inside, strict=True) if use]
            values.append(found[inside])
        return keys, np.concatenate(values) if values else np.zeros(0)
