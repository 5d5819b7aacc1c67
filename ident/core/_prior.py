r"""Priors of the unknowns of an effect: smooth tables, independent values, none at all.

A prior has one weight per term; its precision is $\sum_k w_k D_k^T D_k$, relative to
1/noise². The rows $D_k$ are second and fourth differences of node values along the axes of
a table; a straight line along an axis is left free (on a ring: a constant).
"""

import abc
import dataclasses
import functools
from functools import cached_property
from typing import final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.linalg import eigvals_banded, get_lapack_funcs

from ._readings import Vector

(dpbtrf,) = get_lapack_funcs(("pbtrf",), dtype=np.float64)

_OFF = float(np.log(1e-4))
"""Log weight, relative to the density, at which fourth differences are left out."""
_LEAST = float(np.log(1e-7))
"""Least log weight: values may bend a thousand times further than readings scatter."""
_CAPS = 1e9, 1e11
"""Weights relative to the density that leave the readings their digits."""
_STRAIGHT = 1e4, 1e2
"""Weight × least bend, relative to the density, at which a table is as good as straight."""
_LONG = 400
"""Nodes up to which singular values are worth their time."""
_STEP = 1e-3
"""Step in a log weight for slopes of the determinant, which costs little beside a factor."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Chain:
    r"""Second and fourth differences along one axis; made by `chain`, which keeps them.

    Second differences are per node distance squared (a discretised $\int f''^2$), fourth
    ones are second differences of those.

    Attributes:
        nodes: Node positions, the repeated end of a ring included.
        ring: Whether the last node is the first one again.
    """

    nodes: Vector
    ring: bool = False

    @property
    def size(self) -> int:
        """Number of different nodes."""
        return len(self.nodes) - int(self.ring)

    @property
    def free(self) -> int:
        """Dimension of what the differences leave free."""
        return int(self.straight.shape[1])

    @cached_property
    def _differences(self) -> tuple[sp.csr_array, sp.csr_array]:
        """Second differences, and second differences of those, both weighted."""
        gaps = np.diff(self.nodes)
        mean = float(gaps.mean()) if len(gaps) else 1.0
        first, length = _bends(gaps, mean, self.ring)
        second = sp.csr_array(sp.diags_array(np.sqrt(length)) @ first)
        if len(length) < 3:
            return second, sp.csr_array((0, len(length)))
        # Row i of the differences stands at node i + 1.
        inner = np.roll(gaps, -1) if self.ring else gaps[1:-1]
        outer, spans = _bends(inner, mean, self.ring)
        weighted = sp.diags_array(np.sqrt(spans)) @ outer
        return second, sp.csr_array(weighted @ sp.diags_array(1.0 / np.sqrt(length)))

    @cached_property
    def rows(self) -> tuple[sp.csr_array, sp.csr_array]:
        """Second and fourth differences, weighted by the length that each stands for."""
        second, outer = self._differences
        return second, sp.csr_array(outer @ second)

    @cached_property
    def bounds(self) -> Float[np.ndarray, "2 2"]:
        """Ends of the log weights: no stiffer than a straight table, or a factor, bears."""
        high, each = [], ((1.0, 0.0), (0.0, 1.0))
        for weights, cap, straight in zip(each, _CAPS, _STRAIGHT, strict=True):
            bends = self.eigenvalues(*weights) if self.size <= _LONG else np.zeros(0)
            high.append(min(cap, max(straight / bends[bends > 0.0], default=np.inf)))
        return np.array([[_LEAST, np.log(high[0])], [_OFF, max(np.log(high[1]), _OFF)]])

    @functools.lru_cache(maxsize=64)  # noqa: B019 (`chain` keeps them anyway)
    def eigenvalues(self, second: float, fourth: float = 0.0) -> Vector:
        """Return all eigenvalues for two weights, ascending, those left free exactly 0."""
        weighed = zip((second, fourth), self.rows, strict=True)
        rows = [np.sqrt(w) * block.toarray() for w, block in weighed if w > 0.0]
        result = np.zeros(self.size)
        if rows and self.size > self.free:
            # Squares of singular values: small ones keep their digits beside large ones.
            singular = np.linalg.svd(np.vstack(rows), compute_uv=False)
            shown = singular[: self.size - self.free]
            result[self.size - len(shown) :] = np.square(shown[::-1])
        return result

    @cached_property
    def _factored(self) -> tuple[Vector, float]:
        """Precisions of fourth differences where second ones have weight 1.

        With them the log-determinant at weight 1 of the second differences alone.
        """
        second, outer = self._differences
        if self.ring:
            # The last is 0: that of the one direction which second differences never take.
            sizes = np.linalg.svd(outer.toarray(), compute_uv=False)[:-1]
            return np.square(sizes), float(np.log(self.eigenvalues(1.0)[1:]).sum())
        constant = band_logdet(lower_band(sp.csr_array(second @ second.T)))
        inner = lower_band(sp.csr_array(outer.T @ outer))
        stiffness = np.maximum(eigvals_banded(inner.T, lower=True), 0.0)
        stiffness[: int(np.diff(np.asarray(outer.shape))[0])] = 0.0  # left free
        return stiffness, constant

    def logdet(self, weights: Vector, shift: float = 0.0) -> float:
        """Return the log of the product of the non-zero eigenvalues, a shift added to all."""
        if shift > 0.0:
            pairs = zip(weights, self.rows, strict=True)
            second, fourth = (weight * (rows.T @ rows) for weight, rows in pairs)
            columns = lower_band(sp.csr_array(second + fourth))
            columns[:, 0] += shift
            return band_logdet(columns)
        if self.size == self.free:
            return 0.0
        stiffness, constant = self._factored
        return float(constant + np.log(weights[0] + weights[1] * stiffness).sum())

    @cached_property
    def straight(self) -> Float[np.ndarray, "n z"]:
        """What the differences leave free: a constant and a line."""
        if self.size < 3:
            return np.eye(self.size)
        if self.ring:
            return np.ones((self.size, 1))
        middle = 0.5 * (self.nodes[0] + self.nodes[-1])
        half = 0.5 * (self.nodes[-1] - self.nodes[0])
        return np.column_stack([np.ones(self.size), (self.nodes - middle) / half])


def _bends(
    gaps: Float[np.ndarray, " g"], mean: float, ring: bool
) -> tuple[sp.csr_array, Float[np.ndarray, " r"]]:
    """Return mean²·f'' at inner nodes, and the share of the length each row stands for."""
    points = len(gaps) if ring else len(gaps) + 1
    before = gaps if ring else gaps[:-1]
    after = np.roll(gaps, -1) if ring else gaps[1:]
    rows = len(before)
    if points < 3:
        return sp.csr_array((0, points)), np.zeros(0)
    scale = 2.0 * mean**2 / (before + after)
    index = np.arange(rows)
    columns = np.concatenate([index, (index + 1) % points, (index + 2) % points])
    data = np.concatenate(
        [scale / before, -scale * (1.0 / before + 1.0 / after), scale / after]
    )
    matrix = sp.coo_array((data, (np.tile(index, 3), columns)), shape=(rows, points))
    return sp.csr_array(matrix), (before + after) / (2.0 * mean)


def chain(nodes: Vector, ring: bool = False) -> Chain:
    """Return the differences along one axis, the same object for the same nodes."""
    return _chain(np.asarray(nodes, np.float64).tobytes(), ring)


@functools.lru_cache(maxsize=256)
def _chain(nodes: bytes, ring: bool) -> Chain:
    return Chain(np.frombuffer(nodes, np.float64), ring)


def lower_band(matrix: sp.csr_array) -> Float[np.ndarray, "n w"]:
    """Return the lower band of a symmetric matrix: ``[j, d]`` is element ``(j + d, j)``."""
    entries = matrix.tocoo()
    row, column = entries.coords
    keep = (row >= column) & (entries.data != 0.0)
    offset = (row - column)[keep]
    size = int(np.asarray(matrix.shape)[0])
    columns = np.zeros((size, int(offset.max(initial=0)) + 1))
    columns[column[keep], offset] = entries.data[keep]
    return columns


def band_logdet(columns: Float[np.ndarray, "n w"]) -> float:
    """Return the log-determinant of a positive definite band; −∞ where it is singular."""
    factor, info = dpbtrf(columns.T, lower=1)
    return 2.0 * float(np.log(factor[0]).sum()) if info == 0 else float("-inf")


class AbstractPrior(abc.ABC):
    """A Gaussian prior of the unknowns of one effect, with one weight per term."""

    @cached_property
    @abc.abstractmethod
    def rows(self) -> tuple[sp.csr_array, ...]:
        """Rows $D_k$ of each term over the unknowns of the effect."""

    @property
    @abc.abstractmethod
    def straight(self) -> Float[np.ndarray, "n z"]:
        """What no term holds, one column per dimension."""

    @abc.abstractmethod
    def logdet(self, weights: Vector) -> float:
        """Return the log of the product of the non-zero eigenvalues, up to a constant."""

    def slopes(self, weights: Vector) -> Vector:
        """Return the slope of `logdet` over the logarithm of each weight; 0 for a weight of 0."""
        result = np.zeros(len(weights))
        for k in np.flatnonzero(weights):
            step = np.zeros(len(weights))
            step[k] = _STEP
            ends = [self.logdet(weights * np.exp(sign * step)) for sign in (1.0, -1.0)]
            result[k] = (ends[0] - ends[1]) / (2.0 * _STEP)
        return result

    @property
    def bounds(self) -> Float[np.ndarray, "k 2"]:
        """Least and largest log weight of each term, relative to the density."""
        return np.tile([[_LEAST, np.log(_CAPS[0])]], (len(self.rows), 1))

    @property
    def optional(self) -> Bool[np.ndarray, " k"]:
        """Terms that may be left out: fourth differences."""
        return np.zeros(len(self.rows), bool)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the weights as results carry them."""
        return tuple(f"term {k + 1}" for k in range(len(self.rows)))


@final
@dataclasses.dataclass(frozen=True)
class NoPrior(AbstractPrior):
    """No prior at all: each value rests on its own readings."""

    size: int

    @cached_property
    def rows(self) -> tuple[sp.csr_array, ...]:
        return ()

    @property
    def straight(self) -> Float[np.ndarray, "n z"]:
        return np.eye(self.size)

    def logdet(self, weights: Vector) -> float:
        return 0.0


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Independent(AbstractPrior):
    """Values of one variance about zero, as precision rows of full rank.

    Attributes:
        matrix: Rows whose square is the precision at weight 1; the unit matrix for
            independent values, first differences for a random walk that starts at zero.
    """

    matrix: sp.csr_array

    @cached_property
    def rows(self) -> tuple[sp.csr_array, ...]:
        return (self.matrix,)

    @property
    def straight(self) -> Float[np.ndarray, "n z"]:
        return np.zeros((int(np.asarray(self.matrix.shape)[1]), 0))

    def logdet(self, weights: Vector) -> float:
        return float(np.asarray(self.matrix.shape)[1] * np.log(weights[0]))


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Smooth(AbstractPrior):
    """Prior of a table: differences along its axes, whose precisions add up.

    Values are ordered with the last axis fastest; ``order`` says which value stands at each
    place of that grid.

    Attributes:
        chains: Along each axis, one or two.
        branches: Tables side by side (directions of motion), each smooth by itself.
        order: Unknown at each place of the (branch, slow, fast) grid, flattened.
        axes: Numbers of the axes in the names of the weights, from 1.
    """

    chains: tuple[Chain, ...]
    branches: int
    order: Int[np.ndarray, " n"]
    axes: tuple[int, ...] = (1, 2)

    @cached_property
    def rows(self) -> tuple[sp.csr_array, ...]:
        # From places of the grid to the unknowns that stand there.
        unit = sp.csr_array(sp.eye_array(len(self.order)))[self.order]
        blocks, outer = [], self.branches
        for chain in self.chains:
            inner = len(self.order) // (outer * chain.size)
            left, right = sp.eye_array(outer), sp.eye_array(inner)
            blocks += [sp.kron(left, sp.kron(rows, right)) for rows in chain.rows]
            outer *= chain.size
        return tuple(sp.csr_array(block @ unit) for block in blocks)

    def logdet(self, weights: Vector) -> float:
        if len(self.chains) == 1:
            return self.branches * self.chains[0].logdet(weights)
        slow, fast = self.chains
        across = fast.eigenvalues(*weights[2:].tolist())
        if slow.size <= _LONG:
            grid = slow.eigenvalues(*weights[:2].tolist())[:, None] + across
            return float(np.log(grid[grid > 0.0]).sum())
        return sum(slow.logdet(weights[:2], value) for value in across)

    @property
    def bounds(self) -> Float[np.ndarray, "k 2"]:
        return np.concatenate([chain.bounds for chain in self.chains])

    @property
    def optional(self) -> Bool[np.ndarray, " k"]:
        return np.resize([False, True], 2 * len(self.chains))

    @property
    def names(self) -> tuple[str, ...]:
        axes = self.axes[: len(self.chains)]
        return tuple(f"order {n}, axis {axis}" for axis in axes for n in (2, 4))

    @property
    def straight(self) -> Float[np.ndarray, "n z"]:
        parts = [np.eye(self.branches), *(chain.straight for chain in self.chains)]
        grid = functools.reduce(np.kron, parts)
        result = np.zeros(grid.shape)
        result[self.order] = grid
        return result
