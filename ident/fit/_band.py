"""Symmetric banded systems: Cholesky, solution, log-determinant, selected inverse.

The matrix is stored as LAPACK wants its lower band: ``columns[j, d]`` is element
``(j + d, j)``, so that the transposed buffer is column-major and nothing is copied.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import get_blas_funcs, get_lapack_funcs

_PBTRF, _PBTRS, _TRTRI, _LAUUM = get_lapack_funcs(
    ("pbtrf", "pbtrs", "trtri", "lauum"), dtype=np.float64
)
_GEMM, _TRMM = get_blas_funcs(("gemm", "trmm"), dtype=np.float64)


@dataclasses.dataclass(frozen=True)
class BandFactor:
    """Cholesky factor of a positive definite band matrix."""

    columns: Float[np.ndarray, "n w"]

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

        Block form of the Takahashi recurrence over the band; every offset must lie inside the
        band. Entries beyond the end of the matrix are zero.

        Source: K. Takahashi, J. Fagan, M. Chin, PICA Conf., 1973; H. Rue, L. Held, Gaussian
        Markov Random Fields, 2005, section 2.4.
        """
        n, width = self.columns.shape
        band = width - 1
        # Blocks no smaller than the band make the factor block bidiagonal.
        block = max(band, 48)
        count = -(-n // block)
        padded = np.zeros(((count + 1) * block, block + 1))
        padded[:, 0] = 1.0
        padded[:n, :width] = self.columns
        step = padded.strides[1]

        def part(row: int, column: int) -> Float[np.ndarray, "b b"]:
            # Element (i, j) of the factor stands at i + j * block of the flat buffer.
            start = (row * block) + (column * block) * block
            return as_strided(
                padded.reshape(-1)[start:],
                (block, block),
                (step, step * block),
                writeable=False,
            )

        result = {offset: np.zeros(count * block + block) for offset in offsets}
        inside = np.arange(block)
        below = np.zeros((block, block))
        corner = np.eye(block)
        for k in range(count - 1, -1, -1):
            inverse, info = _TRTRI(np.tril(part(k, k)), lower=1)
            assert info == 0
            # Column-major throughout: BLAS would copy everything else.
            own, info = _LAUUM(inverse, lower=1)
            assert info == 0
            own += np.triu(own.T, 1)
            if k < count - 1:
                step_down = _TRMM(
                    1.0, inverse, np.triu(part(k + 1, k)), side=1, lower=1
                )
                below = _GEMM(-1.0, corner, step_down)
                own = _GEMM(-1.0, step_down, below, 1.0, own, trans_a=1)
            for offset, diagonal in result.items():
                same = inside + offset < block
                diagonal[k * block : (k + 1) * block][same] = own[
                    inside[same] + offset, inside[same]
                ]
                if k < count - 1 and offset:
                    other = ~same
                    diagonal[k * block : (k + 1) * block][other] = below[
                        inside[other] + offset - block, inside[other]
                    ]
            corner = own
        return {
            offset: np.where(np.arange(n) + offset < n, diagonal[:n], 0.0)
            for offset, diagonal in result.items()
        }


def factorise(columns: Float[np.ndarray, "n w"]) -> BandFactor | None:
    """Return the Cholesky factor, or None where the matrix is not positive definite.

    The buffer is overwritten; entries beyond the end of the matrix must be zero.
    """
    factor, info = _PBTRF(columns.T, lower=1, overwrite_ab=1)
    return BandFactor(factor.T) if info == 0 else None


def band_logdet(columns: Float[np.ndarray, "n w"]) -> float:
    """Return the log-determinant of a positive definite band matrix; NaN where it is not."""
    if not len(columns):
        return 0.0
    factor = factorise(columns)
    return float("nan") if factor is None else factor.logdet
