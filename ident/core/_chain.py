"""Second and fourth differences of node values along one axis: what makes a table smooth."""

import dataclasses
import functools
from functools import cached_property
from typing import final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy.linalg import eigvals_banded, get_lapack_funcs

(dpbtrf,) = get_lapack_funcs(("pbtrf",), dtype=np.float64)

OFF = float(np.log(1e-4))
"""Log weight, relative to the density, at which fourth differences are left out."""
LEAST = float(np.log(1e-7))
"""Least log weight: values may bend a thousand times further than readings scatter."""
CAPS = 1e9, 1e11
"""Weights relative to the density that leave the readings their digits."""
_STRAIGHT = 1e4, 1e2
"""Weight × least bend, relative to the density, at which a table is as good as straight."""
LONG = 400
"""Nodes up to which singular values are worth their time."""

Vector = Float[np.ndarray, " _n"]


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
    def grams(self) -> tuple[sp.csr_array, sp.csr_array]:
        """The penalty matrices $D_k^T D_k$."""
        second, fourth = self.rows
        return sp.csr_array(second.T @ second), sp.csr_array(fourth.T @ fourth)

    @cached_property
    def least(self) -> tuple[float, float]:
        """Least non-zero eigenvalue of both penalties; 0 on a long chain."""
        if self.size > LONG:
            return 0.0, 0.0
        smallest = []
        for block in self.rows:
            values = np.square(np.linalg.svd(block.toarray(), compute_uv=False))
            # All rows are independent but for one on a ring, where they sum to zero.
            values = values[: len(values) - int(self.ring)]
            smallest.append(float(values[-1]) if len(values) else 0.0)
        return smallest[0], smallest[1]

    @property
    def bounds(self) -> Float[np.ndarray, "2 2"]:
        """Ends of the log weights: no stiffer than a straight table, or a factor, bears."""
        high = [
            min(cap, most / least) if least > 0.0 else cap
            for cap, most, least in zip(CAPS, _STRAIGHT, self.least, strict=True)
        ]
        return np.array([[LEAST, np.log(high[0])], [OFF, max(np.log(high[1]), OFF)]])

    def eigenvalues(self, weights: Vector) -> Vector:
        """Return all eigenvalues of the penalty, ascending, those left free exactly 0."""
        rows = [
            np.sqrt(w) * block.toarray()
            for w, block in zip(weights, self.rows, strict=True)
            if w > 0.0
        ]
        result = np.zeros(self.size)
        if rows and self.size > self.free:
            # Squares of singular values: small ones keep their digits beside large ones.
            singular = np.linalg.svd(np.vstack(rows), compute_uv=False)
            count = self.size - self.free
            result[self.free :] = np.square(singular[:count][::-1])
        return result

    @cached_property
    def _factored(self) -> tuple[Vector, Vector, float]:
        """Precisions of fourth differences where second ones have weight 1.

        With them the shares of the left null vector of a ring (empty elsewhere), and the
        log-determinant at weight 1 of the second differences alone.
        """
        second, outer = self._differences
        if not self.ring:
            constant = band_logdet(lower_band(sp.csr_array(second @ second.T)))
            inner = lower_band(sp.csr_array(outer.T @ outer))
            stiffness = np.maximum(eigvals_banded(inner.T, lower=True), 0.0)
            stiffness[: int(np.diff(np.asarray(outer.shape))[0])] = 0.0  # left free
            return stiffness, np.zeros(0), constant
        left, singular, _ = np.linalg.svd(second.toarray(), full_matrices=True)
        constant = 2.0 * float(np.log(singular[: self.size - self.free]).sum())
        _, values, modes = np.linalg.svd(outer.toarray(), full_matrices=True)
        stiffness = np.square(values)
        stiffness[stiffness < 1e-12 * stiffness.max(initial=0.0)] = 0.0
        return stiffness, np.square(modes @ left[:, -1]), constant

    def logdet(self, weights: Vector, shift: float = 0.0) -> float:
        """Return the log of the product of the non-zero eigenvalues, a shift added to all."""
        if shift > 0.0:
            second, fourth = self.grams
            total = weights[0] * second + weights[1] * fourth
            columns = lower_band(sp.csr_array(total))
            columns[:, 0] += shift
            return band_logdet(columns)
        if self.size == self.free:
            return 0.0
        stiffness, share, constant = self._factored
        precision = weights[0] + weights[1] * stiffness
        value = constant + np.log(precision).sum()
        return float(value + np.log((share / precision).sum()) if len(share) else value)

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
    if not len(columns):
        return 0.0
    factor, info = dpbtrf(columns.T, lower=1)
    return 2.0 * float(np.log(factor[0]).sum()) if info == 0 else float("-inf")
