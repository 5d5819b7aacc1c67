"""The readings of one axis, thinned and prepared for the features of every term."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from ._observed import Observed

_MOST = 16_000
"""Rows that are looked at; more would tell nothing new of terms worth compensating."""
_STILL = 1e-6
"""mm or °: a position that changes by less is constant."""
_BLOCKS = 40
"""Pieces of a recording that resamples draw from."""


@dataclasses.dataclass(frozen=True)
class AxisView:
    """Rows in which the error of one axis was measured.

    Attributes:
        axis: Its name.
        data: Those rows of the recording, thinned.
        error: In mm or °, without the mean of each measurement.
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

    def centred(self, columns: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "t k"]:
        """Return columns without their mean in each measurement; 0 where not known.

        Each measurement has a zero of its own, so a mean tells nothing; and a column
        that a measurement lacks is the same as one that is constant in it.
        """
        known = np.asarray(np.isfinite(columns).all(axis=1))
        result = np.where(known[:, None], columns, 0.0)
        for number in np.unique(self.data.source):
            rows = np.flatnonzero((self.data.source == number) & known)
            if rows.size:
                result[rows] -= result[rows].mean(axis=0)
        return result


def view_of(observed: Observed, axis: str) -> AxisView:
    """Return the readings of the error of an axis, in the order of their measuring."""
    distance = _distance(observed, axis)
    known = np.flatnonzero(np.isfinite(observed.error[axis]))
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
    view = AxisView(
        axis=axis,
        data=data,
        error=data.error[axis],
        block=_blocks(data),
        span=span,
        distance=None if distance is None else distance[rows],
        modulo=frozenset(round_about),
    )
    error = data.error[axis].copy()
    for number in np.unique(data.source):
        own = data.source == number
        error[own] -= np.median(error[own])
    return dataclasses.replace(view, error=error)


def _thinned(rows: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """Return evenly many rows of every stretch, drawn so that no period is favoured."""
    if len(rows) <= _MOST:
        return rows
    edges = np.linspace(0, len(rows), _MOST + 1)
    start, width = edges[:-1], np.diff(edges)
    rng = np.random.default_rng(len(rows))
    at = np.floor(start + width * rng.random(_MOST)).astype(np.int64)
    return np.asarray(rows[np.unique(np.minimum(at, len(rows) - 1))])


def _blocks(data: Observed) -> Int[np.ndarray, " t"]:
    """Return the piece of each row: runs where there are many, else stretches of them."""
    runs = np.unique(np.stack([data.source, data.run]), axis=1, return_inverse=True)[1]
    runs = runs.reshape(-1)
    count = int(runs.max(initial=0)) + 1
    if count >= _BLOCKS // 2:
        return (runs * min(_BLOCKS, count) // count).astype(np.int64)
    each = -(-_BLOCKS // count)
    block = np.zeros(len(runs), dtype=np.int64)
    for number in range(count):
        rows = np.flatnonzero(runs == number)
        pieces = max(1, min(each, len(rows) // 4))
        block[rows] = number * each + np.arange(len(rows)) * pieces // len(rows)
    return np.unique(block, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _distance(observed: Observed, axis: str) -> Float[np.ndarray, " t"] | None:
    """Return the way since the last reversal of an axis, on all rows that there are."""
    if axis not in observed.direction or axis not in observed.position:
        return None
    result = np.full(len(observed), np.nan)
    order = np.lexsort((observed.clock, observed.run, observed.source))
    place = observed.position[axis][order]
    way = observed.direction[axis][order]
    own = observed.run[order]
    known = np.isfinite(place) & np.isfinite(way)
    order, place, way, own = (each[known] for each in (order, place, way, own))
    if not len(order):
        return None
    turned = np.ones(len(order), dtype=bool)
    turned[1:] = (way[1:] != way[:-1]) | (own[1:] != own[:-1])
    first = np.maximum.accumulate(np.where(turned, np.arange(len(order)), 0))
    # The reversal itself lies between this row and the one before it.
    start = np.maximum(first - 1, 0)
    fresh = (own[start] != own[first]) | (first == 0)
    start = np.where(fresh, first, start)
    result[order] = np.abs(place - place[start])
    return result


def moving(values: Float[np.ndarray, " t"] | None) -> bool:
    """Return whether a channel was recorded and is not the same all the time."""
    if values is None:
        return False
    finite = values[np.isfinite(values)]
    return bool(finite.size > 0 and np.ptp(finite) > 0)
