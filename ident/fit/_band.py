"""Symmetric banded systems: Cholesky, solution, log-determinant, selected inverse.

The matrix is stored as LAPACK wants its lower band: ``columns[j, d]`` is element
``(j + d, j)``, so that the transposed buffer is column-major and nothing is copied.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import get_lapack_funcs

from ._selected import dense_diagonals, inverse_diagonals

_PBTRF, _PBTRS = get_lapack_funcs(("pbtrf", "pbtrs"), dtype=np.float64)
_DENSE = 1000
"""Unknowns up to which a stiff matrix is worth its whole inverse, which loses fewer digits."""


@dataclasses.dataclass(frozen=True)
class BandFactor:
    """Cholesky factor of a positive definite band matrix.

    Attributes:
        columns: Its lower band.
        stiff: Solutions want to be refined, since the matrix is ill-conditioned.
    """

    columns: Float[np.ndarray, "n w"]
    stiff: bool = False
    _known: dict[int, Float[np.ndarray, " n"]] = dataclasses.field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    def logdet(self) -> float:
        """Natural logarithm of the determinant of the matrix."""
        return 2.0 * float(np.log(self.columns[:, 0]).sum())

    def solve(self, right: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """Return the solution for one or several right-hand sides."""
        solution, info = _PBTRS(self.columns.T, right, lower=1)
        assert info == 0
        return np.asarray(solution).reshape(right.shape)

    def inverse_diagonals(
        self, offsets: Sequence[int]
    ) -> dict[int, Float[np.ndarray, " n"]]:
        """Return diagonals of the inverse: ``result[d][j]`` is element ``(j + d, j)``.

        Every offset must lie inside the band; what was found once is kept.
        """
        missing = [offset for offset in offsets if offset not in self._known]
        if missing:
            dense = self.stiff and len(self.columns) <= _DENSE
            find = dense_diagonals if dense else inverse_diagonals
            self._known.update(find(self.columns, missing))
        return {offset: self._known[offset] for offset in offsets}


def factorise(
    columns: Float[np.ndarray, "n w"], stiff: bool = False
) -> BandFactor | None:
    """Return the Cholesky factor, or None where the matrix is not positive definite.

    The buffer is overwritten; entries beyond the end of the matrix must be zero.
    """
    factor, info = _PBTRF(columns.T, lower=1, overwrite_ab=1)
    return BandFactor(factor.T, stiff) if info == 0 else None


def band_logdet(columns: Float[np.ndarray, "n w"]) -> float:
    """Return the log-determinant of a positive definite band matrix; NaN where it is not."""
    if not len(columns):
        return 0.0
    factor = factorise(columns)
    return float("nan") if factor is None else factor.logdet
