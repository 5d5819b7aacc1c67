"""Sums over readings that carry all that a table fit needs; they add up over pieces."""

import dataclasses
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ._grid import MANY, Grid, Located
from ._prior import Smoothness, TablePrior


@dataclasses.dataclass(frozen=True)
class Normal:
    """Normal matrix of the node values, as diagonals over the (slow, fast) grid.

    ``diagonals[dl, ds][l, s]`` couples node ``(l, s)`` to ``(l + dl, s + ds)``.
    """

    grid: Grid
    diagonals: Mapping[tuple[int, int], Float[np.ndarray, "l s"]]

    def __add__(self, other: "Normal") -> "Normal":
        return Normal(
            self.grid,
            {
                key: value + other.diagonals[key]
                for key, value in self.diagonals.items()
            },
        )

    @property
    def density(self) -> float:
        """Mean information per node that any reading reaches, relative to 1/noise²."""
        own = self.diagonals[0, 0]
        reached = own > 0
        return float(own.sum() / max(int(reached.sum()), 1))

    def apply(self, values: Float[np.ndarray, "l s"]) -> Float[np.ndarray, "l s"]:
        """Return matrix × values."""
        result = np.asarray(self.diagonals[0, 0] * values)
        for key, coupling in self.diagonals.items():
            if key == (0, 0):
                continue
            here, there = self._slices(*key)
            # On a ring the step wraps; elsewhere the slices leave nothing to wrap.
            moved = (
                np.roll(values, -key[0], axis=0)
                if self.grid.layout.periodic
                else values
            )
            own = coupling if self.grid.layout.periodic else coupling[here]
            if self.grid.layout.periodic:
                result += own * moved
                result += np.roll(own * values, key[0], axis=0)
            else:
                result[here] += own * values[there]
                result[there] += own * values[here]
        return result

    @staticmethod
    def _slices(dl: int, ds: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        slow = (
            (slice(None), slice(None)) if dl == 0 else (slice(0, -dl), slice(dl, None))
        )
        fast = {
            0: (slice(None), slice(None)),
            1: (slice(0, -1), slice(1, None)),
            -1: (slice(1, None), slice(0, -1)),
        }[ds]
        return (slow[0], fast[0]), (slow[1], fast[1])


def normal_from_moments(grid: Grid, moments: Float[np.ndarray, "p q cl cs"]) -> Normal:
    """Return the normal matrix from the moments Σ w uᵖ vᑫ of every cell.

    A table of branches has no place within the cell along the fast axis: ``q = 0`` only.
    """
    shape = (grid.slow, grid.fast)
    slow = _products(moments)
    if not grid.planar:
        own, beside = np.zeros(shape), np.zeros(shape)
        _add_low(own, slow[0][0])
        _add_high(own, slow[2][0], grid.layout.periodic)
        _add_low(beside, slow[1][0])
        if grid.slow == 1:
            # A ring of one node: both ends of the cell are the same unknown.
            own, beside = own + 2.0 * beside, np.zeros(shape)
        return Normal(grid, {(0, 0): own, (1, 0): beside})
    both = [_products(part) for part in slow]
    diagonals = {
        key: np.zeros(shape) for key in ((0, 0), (0, 1), (1, 0), (1, 1), (1, -1))
    }
    columns = moments.shape[3]
    left, right = slice(0, columns), slice(grid.fast - columns, None)
    for add, part in ((_add_low, both[0]), (_add_high, both[2])):
        add(diagonals[0, 0][:, left], part[0])
        add(diagonals[0, 0][:, right], part[2])
        add(diagonals[0, 1][:, left], part[1])
    _add_low(diagonals[1, 0][:, left], both[1][0])
    _add_low(diagonals[1, 0][:, right], both[1][2])
    _add_low(diagonals[1, 1][:, left], both[1][1])
    _add_low(diagonals[1, -1][:, right], both[1][1])
    return Normal(grid, diagonals)


def vector_from_moments(
    grid: Grid, moments: Float[np.ndarray, "p q cl cs"]
) -> Float[np.ndarray, "l s"]:
    """Return Σ w z x over the (slow, fast) grid from the moments Σ w z uᵖ vᑫ of every cell."""
    result = np.zeros((grid.slow, grid.fast))
    low, high = moments[0] - moments[1], moments[1]
    if not grid.planar:
        _add_low(result, low[0])
        _add_high(result, high[0], grid.layout.periodic)
        return result
    columns = moments.shape[3]
    for add, part in ((_add_low, low), (_add_high, high)):
        add(result[:, :columns], part[0] - part[1])
        add(result[:, grid.fast - columns :], part[1])
    return result


def _products(powers: Float[np.ndarray, "p ..."]) -> list[Float[np.ndarray, "..."]]:
    """Return low·low, low·high, high·high of the weights (1 - u, u) from powers of u."""
    zero, one, two = powers
    return [zero - 2.0 * one + two, one - two, two]


def _add_low(nodes: Float[np.ndarray, "l s"], cells: Float[np.ndarray, "c s"]) -> None:
    """Add what belongs to the lower node of every cell along the slow axis."""
    nodes[: len(cells)] += cells


def _add_high(
    nodes: Float[np.ndarray, "l s"], cells: Float[np.ndarray, "c s"], ring: bool = False
) -> None:
    """Add what belongs to the upper node of every cell along the slow axis."""
    if ring:
        nodes += np.roll(cells, 1, axis=0)
    else:
        nodes[len(nodes) - len(cells) :] += cells


def cells_of(grid: Grid) -> tuple[int, int]:
    """Return the number of cells along the slow and the fast axis (branches count as cells)."""
    slow = max(grid.slow if grid.layout.periodic else grid.slow - 1, 1)
    return slow, max(grid.fast - 1, 1) if grid.planar else grid.fast


def moment_sums(
    grid: Grid, located: Located, weight: Float[np.ndarray, " t"], degree: int
) -> Float[np.ndarray, "p q cl cs"]:
    """Return Σ weight·uᵖ·vᑫ per cell, p and q up to ``degree``."""
    shape = cells_of(grid)
    across = degree if grid.planar else 0
    sums = _moments if len(weight) < MANY else _moments_of_many
    result = sums(
        located.l * shape[1] + located.s, located.u, located.v, weight,
        shape[0] * shape[1], degree, across,
    )  # fmt: skip
    return result.reshape(degree + 1, across + 1, *shape)


def _moments(
    cell: Int[np.ndarray, " t"],
    u: Float[np.ndarray, " t"],
    v: Float[np.ndarray, " t"],
    weight: Float[np.ndarray, " t"],
    cells: int,
    degree: int,
    across: int,
) -> Float[np.ndarray, "p c"]:
    result = []
    for _ in range(degree + 1):
        term = weight
        for _ in range(across + 1):
            result.append(np.bincount(cell, term, cells))
            term = term * v
        weight = weight * u
    return np.stack(result)


def _moments_of_many(
    cell: Int[np.ndarray, " t"],
    u: Float[np.ndarray, " t"],
    v: Float[np.ndarray, " t"],
    weight: Float[np.ndarray, " t"],
    cells: int,
    degree: int,
    across: int,
) -> Float[np.ndarray, "p c"]:
    from . import _compiled

    call = partial(_compiled.moments, cells=cells, degree=degree, across=across)
    blocks = _compiled.blocks_of(cell.astype(np.int32), u, v, weight)
    return add_up(call(*block) for block in blocks)


def add_up(blocks: Iterable[Any]) -> Float[np.ndarray, "..."]:
    """Return the sum of arrays that are still being computed side by side."""
    return np.asarray(sum(np.asarray(block) for block in list(blocks)))


def evaluate(
    grid: Grid, located: Located, values: Float[np.ndarray, "l s"]
) -> np.ndarray:
    """Return the table at every located reading, shape ``(t,)``."""
    above = grid.neighbour(located.l) if grid.slow > 1 else located.l
    parts = (located.l, above, located.s, located.u, located.v)
    if len(located.l) < MANY:
        return _evaluate(grid, values, *parts)
    from . import _compiled

    call = partial(_compiled.table, fast=grid.fast, planar=grid.planar)
    flat = values.reshape(-1)
    blocks = [call(flat, *block) for block in _compiled.blocks_of(*parts)]
    result = np.concatenate([np.asarray(block) for block in blocks])
    return result[: len(located.l)]


def _evaluate(
    grid: Grid,
    values: Float[np.ndarray, "l s"],
    l: Int[np.ndarray, " t"],
    above: Int[np.ndarray, " t"],
    s: Int[np.ndarray, " t"],
    u: Float[np.ndarray, " t"],
    v: Float[np.ndarray, " t"],
) -> Float[np.ndarray, " t"]:
    low, high = values[l, s], values[above, s]
    if grid.planar:
        right = np.minimum(s + 1, grid.fast - 1)
        low = low + v * (values[l, right] - low)
        high = high + v * (values[above, right] - high)
    return np.asarray(low + u * (high - low))


def touched(grid: Grid, located: Located) -> Int[np.ndarray, "l s"]:
    """Count the readings that reach each node with a weight above zero."""
    shape = (grid.slow, grid.fast)
    counts = np.zeros(grid.size, np.int64)
    above = grid.neighbour(located.l) if grid.slow > 1 else located.l
    right = np.minimum(located.s + 1, grid.fast - 1)
    slow = [(located.l, located.u < 1), (above, located.u > 0)]
    fast = [(located.s, located.v < 1)]
    if grid.planar:
        fast.append((right, located.v > 0))
    for l, on in slow:
        for s, also in fast:
            keep = on & also
            counts += np.bincount((l * grid.fast + s)[keep], minlength=grid.size)
    return counts.reshape(shape)


def half_bandwidth(grid: Grid, smoothness: Smoothness) -> int:
    """Return the half-bandwidth of normal matrix plus prior for these weights."""
    reach = 4 if smoothness.slow[1] else 2
    fast_reach = (4 if smoothness.fast[1] else 2) if grid.planar else 0
    data = grid.spread(1) * grid.fast + (1 if grid.planar else 0)
    return min(max(grid.spread(reach) * grid.fast, data, fast_reach), grid.size - 1)


def assemble(
    normal: Normal, prior: TablePrior, smoothness: Smoothness
) -> Float[np.ndarray, "n w"]:
    """Return normal matrix plus prior precision as lower band, fresh memory."""
    grid = normal.grid
    rank = grid.rank
    width = half_bandwidth(grid, smoothness) + 1
    columns = np.zeros((grid.slow, grid.fast, width))
    flat = columns.reshape(grid.size, width)
    for (dl, ds), values in normal.diagonals.items():
        if not grid.layout.periodic:
            here, _ = Normal._slices(dl, ds)
            if values[here].size:
                columns[(*here, dl * grid.fast + ds)] += values[here]
            continue
        own, other = rank, rank[grid.neighbour(np.arange(grid.slow), dl)]
        low, high = np.minimum(own, other), np.maximum(own, other)
        if grid.slow > 1 or dl == 0:
            s = np.arange(grid.fast)
            offset = (high - low) * grid.fast
            np.add.at(columns, (low[:, None], s[None], offset[:, None]), values)
    band = prior.slow.band(smoothness.slow)
    for distance in range(band.shape[1]):
        if distance < grid.slow and distance * grid.fast < width:
            columns[:, :, distance * grid.fast] += band[:, distance, None]
    if prior.fast is not None:
        band = prior.fast.band(smoothness.fast)
        columns[:, :, : band.shape[1]] += band
    return flat
