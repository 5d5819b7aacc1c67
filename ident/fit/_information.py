"""Sums over readings that carry all that a table fit needs; they add up over pieces."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from ._grid import BLOCK, MANY, Grid, Located
from ._prior import Smoothness, TablePrior

# Products of the two weights (1 - u, u) as polynomials in u: rows 00, 01, 11.
_PRODUCTS = np.array([[1.0, -2.0, 1.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]])
# The weights themselves.
_WEIGHTS = np.array([[1.0, -1.0], [0.0, 1.0]])


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


def normal_from_moments(grid: Grid, moments: Float[np.ndarray, "cl cs p q"]) -> Normal:
    """Return the normal matrix from the moments Σ w uᵖ vᑫ of every cell.

    A table of branches has no place within the cell along the fast axis: ``q = 0`` only.
    """
    slow, fast = grid.slow, grid.fast
    if grid.planar:
        pairs = np.einsum("ap,bq,lspq->lsab", _PRODUCTS, _PRODUCTS, moments)
    else:
        pairs = np.einsum("ap,lspq->lsaq", _PRODUCTS, moments)
    diagonals = {(0, 0): np.zeros((slow, fast)), (1, 0): np.zeros((slow, fast))}
    if grid.planar:
        diagonals |= {key: np.zeros((slow, fast)) for key in ((0, 1), (1, 1), (1, -1))}
    cells = pairs.shape[0]
    low = np.arange(cells)
    high = low + 1 if not grid.layout.periodic else (low + 1) % slow
    high = np.minimum(high, slow - 1)
    for a, index in ((0, low), (2, high)):
        if not grid.planar:
            np.add.at(diagonals[0, 0], index, pairs[:, :, a, 0])
            continue
        columns = pairs.shape[1]
        left, right = slice(0, columns), slice(grid.fast - columns, None)
        np.add.at(diagonals[0, 0][:, left], index, pairs[:, :, a, 0])
        np.add.at(diagonals[0, 0][:, right], index, pairs[:, :, a, 2])
        np.add.at(diagonals[0, 1][:, left], index, pairs[:, :, a, 1])
    if not grid.planar:
        np.add.at(diagonals[1, 0], low, pairs[:, :, 1, 0])
    else:
        np.add.at(diagonals[1, 0][:, left], low, pairs[:, :, 1, 0])
        np.add.at(diagonals[1, 0][:, right], low, pairs[:, :, 1, 2])
        np.add.at(diagonals[1, 1][:, left], low, pairs[:, :, 1, 1])
        np.add.at(diagonals[1, -1][:, right], low, pairs[:, :, 1, 1])
    return Normal(grid, diagonals)


def vector_from_moments(
    grid: Grid, moments: Float[np.ndarray, "cl cs p q"]
) -> np.ndarray:
    """Return Σ w z x over the (slow, fast) grid from the moments Σ w z uᵖ vᑫ of every cell."""
    result = np.zeros((grid.slow, grid.fast))
    if grid.planar:
        corners = np.einsum("ap,bq,lspq->lsab", _WEIGHTS, _WEIGHTS, moments)
    else:
        corners = np.einsum("ap,lspq->lsaq", _WEIGHTS, moments)
    low = np.arange(corners.shape[0])
    high = (
        (low + 1) % grid.slow
        if grid.layout.periodic
        else np.minimum(low + 1, grid.slow - 1)
    )
    columns = corners.shape[1]
    for a, index in ((0, low), (1, high)):
        np.add.at(result[:, :columns], index, corners[:, :, a, 0])
        if grid.planar:
            np.add.at(result[:, grid.fast - columns :], index, corners[:, :, a, 1])
    return result


def cells_of(grid: Grid) -> tuple[int, int]:
    """Return the number of cells along the slow and the fast axis (branches count as cells)."""
    slow = max(grid.slow if grid.layout.periodic else grid.slow - 1, 1)
    return slow, max(grid.fast - 1, 1) if grid.planar else grid.fast


def moment_sums(
    grid: Grid, located: Located, weight: Float[np.ndarray, " t"], degree: int
) -> Float[np.ndarray, "cl cs p q"]:
    """Return Σ weight·uᵖ·vᑫ per cell, p and q up to ``degree``."""
    shape = cells_of(grid)
    count = len(weight)
    powers = degree + 1 if grid.planar else 1
    cell = located.l * shape[1] + located.s
    full = count - count % BLOCK if count >= MANY else 0
    rest = slice(full, None)
    result = _moments(
        cell[rest],
        located.u[rest],
        located.v[rest],
        weight[rest],
        shape,
        degree,
        powers,
    )
    if full:
        from . import _compiled

        block = _compiled.moment_block(shape[0] * shape[1], degree, grid.planar)
        parts = (cell.astype(np.int32), located.u, located.v, weight)
        blocks = _compiled.over_blocks(block, count, parts)
        sums = np.sum([np.asarray(sums) for sums in blocks], axis=0)
        result += sums.reshape(degree + 1, powers, *shape).transpose(2, 3, 0, 1)
    return result


def _moments(
    cell: Int[np.ndarray, " t"],
    u: Float[np.ndarray, " t"],
    v: Float[np.ndarray, " t"],
    weight: Float[np.ndarray, " t"],
    shape: tuple[int, int],
    degree: int,
    powers: int,
) -> Float[np.ndarray, "cl cs p q"]:
    count = shape[0] * shape[1]
    result = np.empty((*shape, degree + 1, powers))
    along = weight
    for p in range(degree + 1):
        term = along
        for q in range(powers):
            result[:, :, p, q] = np.bincount(cell, term, count).reshape(shape)
            if q + 1 < powers:
                term = term * v
        if p < degree:
            along = along * u
    return result


def evaluate(
    grid: Grid, located: Located, values: Float[np.ndarray, "l s"]
) -> np.ndarray:
    """Return the table at every located reading, shape ``(t,)``."""
    above = grid.neighbour(located.l) if grid.slow > 1 else located.l
    parts = (located.l, above, located.s, located.u, located.v)
    count = len(located.l)
    full = count - count % BLOCK if count >= MANY else 0
    rest = _evaluate(grid, values, *(part[full:] for part in parts))
    if not full:
        return rest
    from . import _compiled

    flat = values.reshape(-1)
    table = _compiled.evaluate_block(grid.fast, grid.planar)
    blocks = _compiled.over_blocks(lambda *part: table(flat, *part), count, parts)
    return np.concatenate([*(np.asarray(block) for block in blocks), rest])


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
