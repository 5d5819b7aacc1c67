r"""The smoothness prior: differences of node values along one axis of the table.

Along an axis the penalty is $a\,|D_2\theta|^2 + b\,|D_4\theta|^2$ with second differences per
node distance (a discretised $\int f''^2$) and differences of those. Both leave a straight
line alone (on a ring: a constant).
"""

import dataclasses
import functools
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from ._band import band_logdet
from ._bands import Weights, dense, lower_band, mix, second_differences
from ._triangle import Stack

_BEARS = 1e8
"""Condition of a long chain that a band factor bears."""
LONG = 200
"""Nodes up to which singular values are worth their time."""


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
        first, own = second_differences(gaps, mean, self.ring)
        if len(own) < 3:
            return first, own, sp.csr_array((0, len(own))), np.zeros(0)
        # Row i of the differences stands at node i + 1.
        inner = np.roll(gaps, -1) if self.ring else gaps[1:-1]
        second, own2 = second_differences(inner, mean, self.ring)
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
        return _eigenvalues(self, weights)

    @cached_property
    def least_bends(self) -> tuple[float, float]:
        """Least eigenvalues of both penalties but the null ones; 0 on a long chain."""
        if self.size > LONG:
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
        return mix(weights, self._bands)

    def stiffness(self, weights: Weights) -> float:
        """Return the largest element of the penalty matrix."""
        second, fourth = self._stiffest
        return weights[0] * second + weights[1] * fourth

    @cached_property
    def _stiffest(self) -> tuple[float, float]:
        second, fourth = (
            float(gram.diagonal().max(initial=0.0)) for gram in self.grams
        )
        return second, fourth

    @cached_property
    def _bends(self) -> tuple[np.ndarray, np.ndarray, float]:
        """What the log-determinant rests on, for any weights and free of cancellation.

        With unit weight on the second differences the fourth ones have these precisions; then
        the share of the left null vector of a ring in each (empty elsewhere), and a constant.
        """
        first, own, second, own2 = self._curvature
        root = np.sqrt(own)
        rows = np.sqrt(own2)[:, None] * second.toarray() / root
        bends = np.zeros(len(own))
        _, values, modes = np.linalg.svd(rows)
        bends[: len(values)] = np.square(values)
        constant = 2.0 * float(np.log(root).sum())
        if not self.ring:
            gram = lower_band(sp.csr_array(first @ first.T))
            return bends, np.zeros(0), band_logdet(gram) + constant
        left, sizes, _ = np.linalg.svd(first.toarray())
        share = np.square(modes @ (left[:, -1] / root))
        return bends, share, 2.0 * float(np.log(sizes[:-1]).sum()) + constant

    def logdet_shifted(self, weights: Weights, shift: float) -> float:
        """Return log|K + shift·I|, or for ``shift = 0`` the log of the non-zero eigenvalues."""
        if self.size == self.null:
            return self.size * float(np.log(shift)) if shift > 0 else 0.0
        bound = shift if shift > 0 else weights[0] * self._stiffest[0]
        if self.size > LONG and not self.ring and weights[1] > 0:
            if self.stiffness(weights) > _BEARS * bound:
                return self._logdet_closely(weights, shift)
        if shift > 0:
            columns = self.band(weights)
            columns[:, 0] += shift
            return band_logdet(columns)
        if self.size <= LONG and weights[0] > 0:
            bends, share, constant = self._bends
            stiff = weights[0] + weights[1] * bends
            result = constant + float(np.log(stiff).sum())
            return result + (
                float(np.log((share / stiff).sum())) if len(share) else 0.0
            )
        inner, constant = self._reduced
        return band_logdet(mix(weights, inner)) + constant

    def _logdet_closely(self, weights: Weights, shift: float) -> float:
        """Return `logdet_shifted` where a band factor would have lost its digits."""
        stack, parts = self._rows_shifted if shift > 0 else self._rows_reduced
        roots = np.sqrt((*weights, shift))
        entries = [root * part for root, part in zip(roots, parts, strict=False)]
        columns = stack.triangle(np.concatenate(entries))
        constant = 0.0 if shift > 0 else self._reduced[1]
        return constant + 2.0 * float(np.log(columns[:, 0]).sum())

    @cached_property
    def _rows_shifted(self) -> tuple[Stack, list[np.ndarray]]:
        """Both differences and a shift for weight 1, and where their entries go."""
        unit = sp.csr_array(sp.eye_array(self.size))
        return _stacked([self.second, self.fourth, unit], self.size, 4)

    @cached_property
    def _rows_reduced(self) -> tuple[Stack, list[np.ndarray]]:
        """The same for the curvatures of the chain, which nothing leaves alone."""
        _, own, second, own2 = self._curvature
        rows = sp.csr_array(sp.diags_array(np.sqrt(own2)) @ second)
        straight = sp.csr_array(sp.diags_array(np.sqrt(own)))
        return _stacked([straight, rows], len(own), 2)

    @property
    def reduced(self) -> tuple[tuple[np.ndarray, np.ndarray], float]:
        """Dense definite matrices of both penalties, and what their log-determinant lacks."""
        (second, fourth), constant = self._reduced
        count = len(second)
        return (dense(second, count), dense(fourth, count)), constant

    @cached_property
    def _bands(self) -> tuple[np.ndarray, np.ndarray]:
        second, fourth = self.grams
        return lower_band(second, self.ring), lower_band(fourth, self.ring)

    @cached_property
    def _reduced(self) -> tuple[tuple[np.ndarray, np.ndarray], float]:
        """A definite matrix for each penalty, and what its log-determinant lacks."""
        if self.ring:
            # All cofactors of a matrix with constant null vector are equal.
            second, fourth = (
                lower_band(sp.csr_array(gram)[1:, 1:], ring=True) for gram in self.grams
            )
            return (second, fourth), float(np.log(self.size))
        first, own, second, own2 = self._curvature
        inner = sp.csr_array(second.T @ sp.diags_array(own2) @ second)
        bands = (own[:, None], lower_band(inner))
        return bands, band_logdet(lower_band(sp.csr_array(first @ first.T)))


@functools.lru_cache(maxsize=64)
def _eigenvalues(chain: ChainPrior, weights: Weights) -> Float[np.ndarray, " n"]:
    rows = [
        np.sqrt(weight) * part.toarray()
        for weight, part in zip(weights, (chain.second, chain.fourth), strict=True)
        if weight
    ]
    result = np.zeros(chain.size)
    if rows and chain.size > chain.null:
        values = np.linalg.svd(np.vstack(rows), compute_uv=False)
        result[chain.null :] = np.square(values[: chain.size - chain.null][::-1])
    return result


def _stacked(
    parts: list[sp.csr_array], size: int, band: int
) -> tuple[Stack, list[np.ndarray]]:
    row, column = sp.csr_array(sp.vstack(parts)).tocoo().coords
    return Stack.of(row, column, size, band), [part.data for part in parts]


def chain_prior(nodes: Float[np.ndarray, " n"], ring: bool = False) -> ChainPrior:
    """Return the differences along one axis, the same object for the same nodes."""
    return _chain_prior(np.asarray(nodes, np.float64).tobytes(), ring)


@functools.lru_cache(maxsize=256)
def _chain_prior(nodes: bytes, ring: bool) -> ChainPrior:
    return ChainPrior(np.frombuffer(nodes, np.float64), ring)
