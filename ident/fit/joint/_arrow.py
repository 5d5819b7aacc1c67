"""Solution of one axis: a band for the largest plane, all else dense beside it."""

import dataclasses
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_solve, get_blas_funcs, get_lapack_funcs

from .._band import BandFactor, factorise
from .._bands import lower_band
from ._blocks import BandBlocks
from ._sums import Sums
from ._weights import Weight, Weights

_SYRK, _TRSM = get_blas_funcs(("syrk", "trsm"), dtype=np.float64)
_POTRF, _POTRI = get_lapack_funcs(("potrf", "potri"), dtype=np.float64)
_MANY = 8
"""Right-hand sides from which on they go through matrix products."""


@dataclasses.dataclass(frozen=True)
class Arrow:
    """Factor of information + prior + pins.

    Attributes:
        band: Factor of the leading block; None without one.
        blocks: The same for very many right-hand sides.
        beside: Coupling of the leading block to the others, shape ``(b, d)``.
        half: Inverse of the band's factor × that coupling.
        schur: Cholesky factor (lower) of the others after the leading block is eliminated.
        logdet: Of the whole matrix.
    """

    band: BandFactor | None
    blocks: BandBlocks | None
    beside: Float[np.ndarray, "b d"]
    half: Float[np.ndarray, "b d"]
    schur: Float[np.ndarray, "d d"]
    logdet: float

    def solve(self, right: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """Return the solution for one or several right-hand sides."""
        count = len(self.beside)
        if self.band is None:
            return np.asarray(cho_solve((self.schur, True), right, check_finite=False))
        many = right.ndim > 1 and right.shape[1] > _MANY
        first = self._leading(right[:count], many)
        rest = cho_solve(
            (self.schur, True),
            right[count:] - self.beside.T @ first,
            check_finite=False,
        )
        if many:
            return np.concatenate([first - self.gain @ rest, rest])
        first = self._leading(right[:count] - self.beside @ rest, many)
        return np.concatenate([first, rest])

    def _leading(
        self, right: Float[np.ndarray, "b *k"], many: bool
    ) -> Float[np.ndarray, "b *k"]:
        """Return the solution of the leading block alone."""
        assert self.band is not None
        assert self.blocks is not None
        if many:
            return self.blocks.backward(self.blocks.forward(right))
        return self.band.solve(right)

    @cached_property
    def inverse(self) -> Float[np.ndarray, "d d"]:
        """Inverse over the dense unknowns."""
        if not len(self.schur):
            return self.schur
        # Of the transpose, whose memory is in LAPACK's order.
        found, info = _POTRI(np.asfortranarray(self.schur), lower=1)
        assert info == 0
        return np.asarray(np.tril(found) + np.tril(found, -1).T)

    @cached_property
    def gain(self) -> Float[np.ndarray, "b d"]:
        """Response of the leading block to the others."""
        if self.blocks is None:
            return self.beside
        return self.blocks.backward(self.half)

    @cached_property
    def shaped(self) -> Float[np.ndarray, "b d"]:
        """Gain × root of the inverse of the dense unknowns: its square is their share."""
        return np.asarray(_TRSM(1.0, self.schur, self.gain.T, lower=1)).T

    @cached_property
    def variances(self) -> Float[np.ndarray, " n"]:
        """Diagonal of the inverse."""
        rest = np.diag(self.inverse)
        if self.band is None:
            return rest
        own = self._diagonals([0])[0]
        return np.concatenate([own + np.square(self.shaped).sum(axis=1), rest])

    def traces(self, weights: Weights) -> Float[np.ndarray, " k"]:
        """Return the trace of inverse × penalty matrix of each weight 1."""
        count = len(self.beside)
        result = np.zeros(len(weights.parts))
        leading = [
            part
            for part in weights.parts
            if count and int(weights.tables[part.table].places.min()) < count
        ]
        chosen = self._selected(leading)
        for k, part in enumerate(weights.parts):
            where = weights.tables[part.table].grid_places
            if part in leading:
                own = part.band
                for offset, diagonal in chosen.items():
                    if offset < own.shape[1]:
                        twice = 1.0 if offset == 0 else 2.0
                        result[k] += twice * float((own[:, offset] * diagonal).sum())
                result[k] += float((self.shaped * (part.gram @ self.shaped)).sum())
                continue
            entries = part.gram.tocoo()
            row, column = (where[index] - count for index in entries.coords)
            result[k] = float((entries.data * self.inverse[row, column]).sum())
        return result

    def _selected(self, leading: list[Weight]) -> dict[int, Float[np.ndarray, " b"]]:
        if self.band is None:
            return {}
        width = self.band.columns.shape[1]
        offsets = {0}
        for part in leading:
            used = np.flatnonzero(np.abs(part.band).sum(axis=0) > 0)
            offsets |= {int(offset) for offset in used if offset < width}
        return self._diagonals(sorted(offsets))

    @cached_property
    def _known(self) -> dict[int, Float[np.ndarray, " b"]]:
        """Diagonals of the band's inverse that were asked for."""
        return {}

    def _diagonals(self, offsets: list[int]) -> dict[int, Float[np.ndarray, " b"]]:
        assert self.band is not None
        if any(offset not in self._known for offset in offsets):
            self._known.update(self.band.inverse_diagonals(offsets))
        return {offset: self._known[offset] for offset in offsets}


def arrow_of(
    sums: Sums,
    weights: Weights,
    values: Float[np.ndarray, " k"],
    pins: Float[np.ndarray, " n"],
) -> Arrow | None:
    """Return the factor, or None where the matrix is not positive definite.

    Args:
        sums: Information of the readings.
        weights: Smoothness weights.
        values: Of the weights.
        pins: What is added to the diagonal to hold unknowns that nothing else holds.
    """
    count = sums.design.banded
    dense = sums.dense.copy()
    dense[np.diag_indices(len(dense))] += pins[count:]
    leading: list[tuple[float, Weight]] = []
    for value, part in zip(values, weights.parts, strict=True):
        if not value:
            continue
        where = weights.tables[part.table].grid_places
        if count and where.min() < count:
            leading.append((float(value), part))
            continue
        entries = part.gram.tocoo()
        row, column = (where[index] - count for index in entries.coords)
        dense[row, column] += value * entries.data
    band, blocks, logdet = None, None, 0.0
    coupled = half = np.zeros((0, len(dense)))
    if count:
        own = lower_band(sums.band)
        width = max([own.shape[1], *(part.band.shape[1] for _, part in leading)])
        columns = np.zeros((count, width))
        columns[:, : own.shape[1]] = own
        columns[:, 0] += pins[:count]
        for value, part in leading:
            columns[:, : part.band.shape[1]] += value * part.band
        band = factorise(columns)
        if band is None or not np.isfinite(band.logdet):
            return None
        coupled, logdet = sums.beside, band.logdet
        blocks = BandBlocks(band)
        half = blocks.forward(coupled)
        # Only the lower triangle is used.
        dense = _SYRK(-1.0, half.T, beta=1.0, c=dense, trans=0, lower=1)
    factor, info = _POTRF(dense, lower=1, clean=1)
    if info != 0:
        return None
    logdet += 2.0 * float(np.log(np.diag(factor)).sum())
    return Arrow(band, blocks, coupled, half, factor, logdet)
