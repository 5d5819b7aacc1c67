"""Triangular solves of a band factor for very many right-hand sides, block by block.

LAPACK solves a band for one right-hand side after the other; in blocks as wide as the band
the factor is block bidiagonal, and all of them go through matrix products.
"""

import dataclasses
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.linalg import get_blas_funcs

from .._band import BandFactor

(_TRSM,) = get_blas_funcs(("trsm",), dtype=np.float64)
_LEAST = 64
"""Smallest block."""


@dataclasses.dataclass(frozen=True)
class BandBlocks:
    """A band factor as blocks."""

    factor: BandFactor

    @cached_property
    def _parts(self) -> list[tuple[slice, np.ndarray, np.ndarray]]:
        """Rows of each block, its lower triangle, and the block below it."""
        columns = self.factor.columns
        n, width = columns.shape
        step = max(width - 1, _LEAST)
        result = []
        for start in range(0, n, step):
            stop, last = min(start + step, n), min(start + 2 * step, n)
            own: Float[np.ndarray, "_ _"] = np.zeros((last - start, stop - start))
            for column in range(start, stop):
                height = min(width, last - column)
                own[column - start : column - start + height, column - start] = columns[
                    column, :height
                ]
            inside = stop - start
            result.append((slice(start, stop), own[:inside], own[inside:]))
        return result

    def forward(self, right: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Return inverse of the factor × right-hand sides."""
        result = np.array(right)
        for rows, own, below in self._parts:
            # Transposed on both sides, so that the memory is in the order of BLAS.
            result[rows] = _TRSM(1.0, own.T, result[rows].T, side=1, lower=0).T
            if len(below):
                following = slice(rows.stop, rows.stop + len(below))
                result[following] -= below @ result[rows]
        return result

    def backward(self, right: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Return inverse of the transposed factor × right-hand sides."""
        result = np.array(right)
        for rows, own, below in reversed(self._parts):
            if len(below):
                following = slice(rows.stop, rows.stop + len(below))
                result[rows] -= below.T @ result[following]
            result[rows] = _TRSM(
                1.0, own.T, result[rows].T, side=1, lower=0, trans_a=1
            ).T
        return result
