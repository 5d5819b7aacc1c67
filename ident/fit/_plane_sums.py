"""Sums over many readings of a plane: one record per cell, to which readings are added."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float, Int

from ..core._threads import cores
from ._checks import Extent
from ._grid import MANY, Grid, spacing_of
from ._information import (
    Normal,
    cells_of,
    moment_sums,
    normal_from_moments,
    vector_from_moments,
)
from ._types import Samples

_RECORD = 16
_COUNT = 5
_SQUARES = [0, 1, 2, 8, 9, 10, 13, 14, 15]
_PRODUCTS = [3, 4, 11, 12]
"""Where a record of `_kernel` holds what: the number of readings, the moments uᵖ·vᑫ, p slowest,
and those of the readings."""
_LINE = 8
"""Numbers of a line of the processor's cache."""
_SHARE, _PER_CELL = 400_000, 40
"""Readings, and readings per cell, that make a share of their own: fewer are added before
another thread has fetched the memory for its records."""
_SHARES = 8
"""Shares at most; their number must not depend on that of the threads."""
_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)
"""What a reading may miss a node by and still lies on it, as for `EquidistantNodes`."""
_FINE = 8
"""Buckets per node in which nodes are looked for."""

Axis = tuple[
    int, int, Float[np.ndarray, " 3"], Float[np.ndarray, " p"], Int[np.ndarray, " b"]
]
"""Nodes along one axis as `_kernel` takes them: their number, and −1 where they are
equidistant, with start, 1/interval and slack; else the steps of a search within a bucket, with
start and buckets per length, the nodes, and the cell in which each bucket begins."""


class Tally:
    """Sums over readings of a plane, to which more can be added; tallies add up as well.

    Attributes:
        grid: Nodes, two at least along either axis.
        count: Number of readings.
    """

    def __init__(self, grid: Grid) -> None:
        """Begin with no readings."""
        self.grid, self.count = grid, 0
        size = int(np.prod(cells_of(grid))) * _RECORD
        # A record that begins with a line of the cache is added in half the time.
        table = np.zeros(size + _LINE)
        start = -(table.ctypes.data // table.itemsize) % _LINE
        self._table = table[start : start + size]
        self._lack = np.zeros(grid.size, np.int64)
        self._found = np.array([np.inf, -np.inf, np.inf, -np.inf, 0.0, 0.0])

    def add(self, samples: Samples, centre: float = 0.0) -> bool:
        """Add readings less a centre, in their order; tell whether all are numbers.

        Positions, readings and weights are meant; a reading of weight 0 touches no node.
        """
        from ._kernel import sum_plane

        grid = self.grid
        weight = np.zeros(0) if samples.weight is None else samples.weight
        positions = np.asarray(samples.positions, float)
        sum_plane(
            positions[:, grid.slow_column],
            positions[:, 1 - grid.slow_column],
            np.asarray(samples.error, float),
            np.asarray(weight, float),
            centre,
            _axis(grid.slow_nodes),
            _axis(grid.fast_nodes),
            self._table,
            self._lack,
            self._found,
        )
        self.count += len(samples.error)
        return bool(np.isfinite(self._found[:5]).all()) or not self.count

    def __add__(self, other: "Tally") -> "Tally":
        result = Tally(self.grid)
        np.add(self._table, other._table, out=result._table)
        result._lack += self._lack
        result._lack += other._lack
        result.count = self.count + other.count
        both = np.stack([self._found, other._found])
        result._found = both.sum(axis=0)
        result._found[0:4:2] = both[:, 0:4:2].min(axis=0)
        result._found[1:4:2] = both[:, 1:4:2].max(axis=0)
        return result

    def sums(self) -> tuple[Normal, Float[np.ndarray, "l s"]]:
        """Return normal matrix and right-hand side of the readings."""
        shape, records = cells_of(self.grid), self._table.reshape(-1, _RECORD)
        squares = records[:, _SQUARES].T.reshape(3, 3, *shape)
        products = records[:, _PRODUCTS].T.reshape(2, 2, *shape)
        return (
            normal_from_moments(self.grid, squares),
            vector_from_moments(self.grid, products),
        )

    @property
    def square(self) -> float:
        """Σ w e² of the readings less their centre."""
        return float(self._found[5])

    @property
    def support(self) -> Int[np.ndarray, "l s"]:
        """How many readings touch each node."""
        shape = (self.grid.slow, self.grid.fast)
        counts = self._table.reshape(*cells_of(self.grid), _RECORD)[:, :, _COUNT]
        result = -self._lack.reshape(shape)
        for slow in (slice(0, -1), slice(1, None)):
            for fast in (slice(0, -1), slice(1, None)):
                result[slow, fast] += counts.astype(np.int64)
        return result

    @property
    def extent(self) -> Extent:
        """How many readings there are, and where they lie."""
        order = [self.grid.slow_column, 1 - self.grid.slow_column]
        ends = np.empty((2, 2))
        ends[order] = self._found[:4].reshape(2, 2)
        return Extent(np.array([self.count]), ends[:, 0], ends[:, 1])


def has_cells(grid: Grid) -> bool:
    """Return whether a grid is a plane that a `Tally` can hold."""
    return grid.planar and min(grid.slow, grid.fast) >= 2


def sums_of(grid: Grid, samples: Samples) -> tuple[Normal, Float[np.ndarray, "l s"]]:
    """Return normal matrix and right-hand side of the readings, in one pass where it pays."""
    count = len(samples.error)
    if has_cells(grid) and count >= MANY:
        return tally_of(grid, samples).sums()
    place = grid.locate(samples)
    weight = np.ones(count) if samples.weight is None else samples.weight
    return (
        normal_from_moments(grid, moment_sums(grid, place, weight, 2)),
        vector_from_moments(grid, moment_sums(grid, place, weight * samples.error, 1)),
    )


def plane_residual(
    grid: Grid, samples: Samples, values: Float[np.ndarray, "l s"]
) -> Float[np.ndarray, " t"]:
    """Return reading − table for a grid that `has_cells`."""
    from ._kernel import take_off

    positions = np.asarray(samples.positions, float)
    result = np.empty(len(samples.error))
    take_off(
        positions[:, grid.slow_column],
        positions[:, 1 - grid.slow_column],
        np.asarray(samples.error, float),
        _axis(grid.slow_nodes),
        _axis(grid.fast_nodes),
        np.ascontiguousarray(values, float).reshape(-1),
        result,
    )
    return result


def tally_of(grid: Grid, samples: Samples) -> Tally:
    """Return the tally of readings; their number alone tells in which order they are added."""
    count, cells = len(samples.error), int(np.prod(cells_of(grid)))
    shares = min(_SHARES, count // max(_SHARE, _PER_CELL * cells))
    ends = np.linspace(0, count, max(shares, 1) + 1).astype(int)

    def share(k: int) -> Tally:
        part = slice(ends[k], ends[k + 1])
        weight = None if samples.weight is None else samples.weight[part]
        own = Samples(samples.positions[part], samples.error[part], weight=weight)
        result = Tally(grid)
        result.add(own)
        return result

    if shares < 2:
        return share(0)
    with ThreadPoolExecutor(min(shares, cores())) as pool:
        first, *others = pool.map(share, range(shares))
    for other in others:
        first = first + other
    return first


def _axis(nodes: Float[np.ndarray, " n"]) -> Axis:
    count, interval = len(nodes), spacing_of(nodes)
    if interval is not None:
        slack = _ROUNDING * (abs(nodes[0] / interval) + count)
        numbers = np.array([nodes[0], 1.0 / interval, slack])
        return count, -1, numbers, np.zeros(0), np.zeros(0, np.int32)
    # Relative to the first node: roundings of a position are far below the slack.
    inner, reach, buckets = nodes[1:-1] - nodes[0], nodes[-1] - nodes[0], _FINE * count
    edges, slack = np.arange(buckets + 1) * (reach / buckets), 1e-9 * reach
    low = np.searchsorted(inner, edges[:-1] - slack)
    high = np.searchsorted(inner, edges[1:] + slack, side="right")
    steps = 1 << (int((high - low).max()).bit_length() - 1) if (high > low).any() else 0
    numbers = np.array([nodes[0], buckets / reach, 0.0])
    return count, steps, numbers, np.ascontiguousarray(nodes), low.astype(np.int32)
