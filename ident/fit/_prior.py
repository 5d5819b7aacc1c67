r"""The smoothness prior: differences of node values along one axis of the table.

Along an axis the penalty is $a\,|D_2\theta|^2 + b\,|D_4\theta|^2$ with second differences per
node distance (a discretised $\int f''^2$) and differences of those. Both leave a straight
line alone (on a ring: a constant). Along two axes the penalties add up, so that the prior
precision is a Kronecker sum and its determinant follows from those of the axes.
"""

import dataclasses
import functools
from collections.abc import Mapping
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from ._band import band_logdet

_LONG = 200
"""Nodes up to which singular values are worth their time."""

Weights = tuple[float, float]
"""Weights ``(a, b)`` of the second and of the fourth differences, relative to 1/noise²."""


@dataclasses.dataclass(frozen=True, eq=False)
class ChainPrior:
    """Differences along one axis; made by `chain_prior`, which keeps what was derived.

    Attributes:
        nodes: Node positions, the repeated end of a ring included.
        ring: Whether the last node is the first one again.
    """

    nodes: Float[np.ndarray, " n"]
    ring: bool = False

    @property
    def size(self) -> int:
        """Number of different nodes."""
        return len(self.nodes) - int(self.ring)

    @property
    def null(self) -> int:
        """Dimension of what the prior leaves alone."""
        if self.size < 3:
            return self.size
        return 1 if self.ring else 2

    @cached_property
    def _curvature(self) -> tuple[sp.csr_array, np.ndarray, sp.csr_array, np.ndarray]:
        """Second differences, their weights, second differences of those, their weights."""
        gaps = np.diff(self.nodes)
        mean = gaps.mean() if len(gaps) else 1.0
        first, own = _second_differences(gaps, mean, self.ring)
        if len(own) < 3:
            return first, own, sp.csr_array((0, len(own))), np.zeros(0)
        # Row i of the differences stands at node i + 1.
        inner = np.roll(gaps, -1) if self.ring else gaps[1:-1]
        second, own2 = _second_differences(inner, mean, self.ring)
        return first, own, second, own2

    @cached_property
    def second(self) -> sp.csr_array:
        """Second differences per node distance, weighted by the length that they stand for."""
        first, own, _, _ = self._curvature
        return sp.csr_array(sp.diags_array(np.sqrt(own)) @ first)

    @cached_property
    def fourth(self) -> sp.csr_array:
        """Second differences of the second differences."""
        first, _, second, own2 = self._curvature
        return sp.csr_array(sp.diags_array(np.sqrt(own2)) @ second @ first)

    @cached_property
    def grams(self) -> tuple[sp.csr_array, sp.csr_array]:
        """The two penalty matrices."""
        return (
            sp.csr_array(self.second.T @ self.second),
            sp.csr_array(self.fourth.T @ self.fourth),
        )

    def matrix(self, weights: Weights) -> sp.csr_array:
        """Return the penalty matrix for the given weights."""
        k2, k4 = self.grams
        return sp.csr_array(weights[0] * k2 + weights[1] * k4)

    def penalty(self, weights: Weights, values: Float[np.ndarray, "n m"]) -> float:
        """Return the penalty of columns of values, free of cancellation."""
        result = weights[0] * float(np.square(self.second @ values).sum())
        if weights[1]:
            result += weights[1] * float(np.square(self.fourth @ values).sum())
        return result

    def eigenvalues(self, weights: Weights) -> Float[np.ndarray, " n"]:
        """Return the eigenvalues of the penalty matrix, the null ones exactly zero.

        As squared singular values of the differences: the small ones keep their digits beside
        large ones.
        """
        rows = [
            np.sqrt(weight) * part.toarray()
            for weight, part in zip(weights, (self.second, self.fourth), strict=True)
            if weight
        ]
        result = np.zeros(self.size)
        if rows and self.size > self.null:
            values = np.linalg.svd(np.vstack(rows), compute_uv=False)
            result[self.null :] = np.square(values[: self.size - self.null][::-1])
        return result

    @cached_property
    def least_bends(self) -> tuple[float, float]:
        """Least eigenvalues of both penalties but the null ones; 0 on a long chain."""
        if self.size > _LONG:
            return 0.0, 0.0
        found = []
        for part in (self.second, self.fourth):
            bends = np.square(np.linalg.svd(part.toarray(), compute_uv=False))
            # All rows are independent but for one on a ring, where they sum to zero.
            bends = bends[: len(bends) - int(self.ring)]
            found.append(float(bends[-1]) if len(bends) else 0.0)
        return found[0], found[1]

    def band(self, weights: Weights) -> Float[np.ndarray, "n w"]:
        """Return the penalty matrix as lower band, the indices of a ring folded."""
        return _mix(weights, self._bands)

    def logdet_shifted(self, weights: Weights, shift: float) -> float:
        """Return log|K + shift·I|, or for ``shift = 0`` the log of the non-zero eigenvalues."""
        if self.size == self.null:
            return self.size * float(np.log(shift)) if shift > 0 else 0.0
        if shift > 0:
            columns = self.band(weights)
            columns[:, 0] += shift
            return band_logdet(columns)
        inner, constant = self._reduced
        return band_logdet(_mix(weights, inner)) + constant

    @property
    def reduced(self) -> tuple[tuple[np.ndarray, np.ndarray], float]:
        """Dense definite matrices of both penalties, and what their log-determinant lacks."""
        (second, fourth), constant = self._reduced
        count = len(second)
        return (_dense(second, count), _dense(fourth, count)), constant

    @cached_property
    def _bands(self) -> tuple[np.ndarray, np.ndarray]:
        second, fourth = self.grams
        return _lower_band(second, self.ring), _lower_band(fourth, self.ring)

    @cached_property
    def _reduced(self) -> tuple[tuple[np.ndarray, np.ndarray], float]:
        """A definite matrix for each penalty, and what its log-determinant lacks."""
        if self.ring:
            # All cofactors of a matrix with constant null vector are equal.
            second, fourth = (
                _lower_band(sp.csr_array(gram)[1:, 1:], ring=True)
                for gram in self.grams
            )
            return (second, fourth), float(np.log(self.size))
        first, own, second, own2 = self._curvature
        inner = sp.csr_array(second.T @ sp.diags_array(own2) @ second)
        bands = (own[:, None], _lower_band(inner))
        return bands, band_logdet(_lower_band(sp.csr_array(first @ first.T)))


def chain_prior(nodes: Float[np.ndarray, " n"], ring: bool = False) -> ChainPrior:
    """Return the differences along one axis, the same object for the same nodes."""
    return _chain_prior(np.asarray(nodes, np.float64).tobytes(), ring)


@functools.lru_cache(maxsize=256)
def _chain_prior(nodes: bytes, ring: bool) -> ChainPrior:
    return ChainPrior(np.frombuffer(nodes, np.float64), ring)


def _second_differences(
    gaps: Float[np.ndarray, " g"], mean: float, ring: bool
) -> tuple[sp.csr_array, Float[np.ndarray, " r"]]:
    """Rows mean²·f'' at inner nodes, and the share of the length that each row stands for."""
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


def _lower_band(matrix: sp.csr_array, ring: bool = False) -> Float[np.ndarray, "n w"]:
    """Return the lower band of a symmetric matrix, the indices of a ring folded."""
    entries = matrix.tocoo()
    n = len(matrix.indptr) - 1
    row, column = entries.coords
    if ring:
        index = np.arange(n)
        place = np.where(2 * index < n, 2 * index, 2 * (n - index) - 1)
        row, column = place[row], place[column]
    keep = row >= column
    offset = (row - column)[keep]
    columns = np.zeros((n, int(offset.max(initial=0)) + 1))
    np.add.at(columns, (column[keep], offset), entries.data[keep])
    return columns


def _dense(columns: Float[np.ndarray, "_ w"], count: int) -> Float[np.ndarray, "n n"]:
    """Return a symmetric matrix from its lower band."""
    result = np.zeros((count, count))
    for offset in range(min(columns.shape[1], count) if len(columns) else 0):
        index = np.arange(count - offset)
        own = columns[: count - offset, offset]
        result[index + offset, index] = result[index, index + offset] = own
    return result


def _mix(
    weights: Weights, bands: tuple[np.ndarray, np.ndarray]
) -> Float[np.ndarray, "n w"]:
    """Return the weighted sum of two lower bands, fresh memory; a zero weight costs no width."""
    second, fourth = bands
    if not weights[1]:
        return weights[0] * second
    result = weights[1] * fourth
    if second.shape[1] > fourth.shape[1]:
        result = np.pad(result, ((0, 0), (0, second.shape[1] - fourth.shape[1])))
    result[:, : second.shape[1]] += weights[0] * second
    return result


@dataclasses.dataclass(frozen=True)
class Smoothness:
    """Weights of the differences along the slow and along the fast axis."""

    slow: Weights
    fast: Weights = (0.0, 0.0)

    def names(self, slow_axis: int) -> dict[str, float]:
        """Return the weights under the names that results carry; axes count from 1."""
        fast_axis = 3 - slow_axis
        parts = {slow_axis: self.slow}
        if any(self.fast):
            parts[fast_axis] = self.fast
        return {
            f"order {order}, axis {axis}": float(weight)
            for axis in sorted(parts)
            for order, weight in zip((2, 4), parts[axis], strict=True)
        }

    @classmethod
    def named(cls, weights: Mapping[str, float], slow_axis: int) -> "Smoothness":
        """Return the weights from the names that results carry."""
        slow, fast = (
            tuple(weights.get(f"order {order}, axis {axis}", 0.0) for order in (2, 4))
            for axis in (slow_axis, 3 - slow_axis)
        )
        return cls((slow[0], slow[1]), (fast[0], fast[1]))


@dataclasses.dataclass(frozen=True)
class TablePrior:
    """Prior of a whole table: the Kronecker sum of its axes.

    Attributes:
        slow: Along the slow axis.
        fast: Along the fast axis; None where that counts branches, which share only the weights.
        branches: Length of the fast axis where there is no prior along it.
    """

    slow: ChainPrior
    fast: ChainPrior | None
    branches: int = 1

    @property
    def null(self) -> int:
        """Dimension of what the prior leaves alone."""
        return self.slow.null * (self.branches if self.fast is None else self.fast.null)

    def penalty(
        self, smoothness: Smoothness, values: Float[np.ndarray, "l s"]
    ) -> float:
        """Return the penalty of a table of node values over (slow, fast)."""
        result = self.slow.penalty(smoothness.slow, values)
        if self.fast is not None:
            result += self.fast.penalty(smoothness.fast, values.T)
        return result

    def apply(
        self, smoothness: Smoothness, values: Float[np.ndarray, "l s"]
    ) -> Float[np.ndarray, "l s"]:
        """Return precision × values."""
        result = np.zeros_like(values)
        axes = [(self.slow, smoothness.slow, values, result)]
        if self.fast is not None:
            axes.append((self.fast, smoothness.fast, values.T, result.T))
        for chain, weights, columns, out in axes:
            for weight, rows in zip(weights, (chain.second, chain.fourth), strict=True):
                if weight:
                    out += weight * (rows.T @ (rows @ columns))
        return result

    def logdet(self, smoothness: Smoothness) -> float:
        """Return the log of the product of the non-zero eigenvalues of the precision."""
        if self.fast is None:
            return self.branches * self.slow.logdet_shifted(smoothness.slow, 0.0)
        shifts = self.fast.eigenvalues(smoothness.fast)
        if self.slow.size <= _LONG:
            # Of stiff chains a band factor of the shifted matrix has lost the small ones.
            both = self.slow.eigenvalues(smoothness.slow)[:, None] + shifts
            return float(np.log(both[both > 0]).sum())
        return sum(self.slow.logdet_shifted(smoothness.slow, shift) for shift in shifts)
