"""Factors of positive definite matrices: a band with a dense border, or all dense.

The unknowns of one large table come first and couple to their neighbours only (the band);
everything else stands beside them (the border). With an empty band the matrix is dense,
with an empty border it is a band. Elements of the inverse come from the same factor.
"""

import contextlib
import dataclasses
import math
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import cache, cached_property
from itertools import pairwise
from typing import Any, final

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import get_blas_funcs, get_lapack_funcs
from threadpoolctl import OpenBLASController, ThreadpoolController

dsyrk, dtrsm = get_blas_funcs(("syrk", "trsm"), dtype=np.float64)
dpbtrf, dtbtrs, dpotrf, dpotri, dpotrs, dtrtri = get_lapack_funcs(
    ("pbtrf", "tbtrs", "potrf", "potri", "potrs", "trtri"), dtype=np.float64
)

_controller = cache(ThreadpoolController)

_DENSE = 500
"""Unknowns from which on it pays to look for blocks that nothing couples."""
_BLOCK = 64
"""Columns of the inverse that are found at once."""

Columns = Float[np.ndarray, "n w"]
"""Lower band of a matrix: ``[j, d]`` is element ``(j + d, j)``."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class ArrowFactor:
    """Cholesky factor of a positive definite matrix: a band with a dense border.

    Attributes:
        band: Factor of the band, by columns; shape ``(0, 1)`` where there is none.
        cross: Border rows of the factor over the band, transposed.
        schur: Lower factor of what the border has left beside the band.
    """

    band: Columns
    cross: Float[np.ndarray, "n m"]
    schur: Float[np.ndarray, "m m"]

    @classmethod
    def of(
        cls,
        columns: Columns,
        cross: Float[np.ndarray, "m n"],
        border: Float[np.ndarray, "m m"],
    ) -> "ArrowFactor | None":
        """Factorise; None where the matrix is not numerically positive definite.

        Args:
            columns: Lower band; overwritten.
            cross: Border rows over the band.
            border: Border over itself; the lower triangle is used.
        """
        band = columns
        if len(columns):
            factor, info = dpbtrf(columns.T, lower=1, overwrite_ab=1)
            if info != 0:
                return None
            band = factor.T
        solved = np.zeros((len(columns), len(border)))
        if len(columns) and len(border):
            solved = _half_solved(band, np.ascontiguousarray(cross.T))
            border = dsyrk(-1.0, solved.T, 1.0, border, lower=1)
        schur = _by_block(border, lambda block: dpotrf(block, lower=1, clean=1))
        arrow = None if schur is None else cls(band, solved, schur)
        return arrow if arrow is not None and math.isfinite(arrow.logdet) else None

    @cached_property
    def logdet(self) -> float:
        """Natural logarithm of the determinant of the matrix."""
        logs = np.log(self.schur.diagonal()).sum() + np.log(self.band[:, 0]).sum()
        return 2.0 * float(logs)

    def solve(self, right: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """Return the solution for one or several right-hand sides."""
        n = len(self.band)
        top = _half_solved(self.band, right[:n])
        base = right[n:] - self.cross.T @ top
        if base.size:
            base = np.asarray(dpotrs(self.schur, base, lower=1)[0]).reshape(base.shape)
        top = _half_solved(self.band, top - self.cross @ base, back=True)
        return np.concatenate([top, base])

    @cached_property
    def border_inverse(self) -> Float[np.ndarray, "m m"]:
        """Inverse over the border."""
        lower = _by_block(self.schur, lambda block: dpotri(block, lower=1))
        assert lower is not None
        # The factor is clean: above the diagonal stands nothing.
        whole = lower + lower.T
        whole.reshape(-1)[:: len(whole) + 1] *= 0.5
        return np.asarray(whole)

    def selected(self, offsets: Sequence[int]) -> Float[np.ndarray, "n s"]:
        """Return diagonals of the inverse over the band.

        Args:
            offsets: Distances from the diagonal, each within the width of the band.

        Returns:
            ``[j, s]`` is element ``(j + offsets[s], j)``; 0 beyond the end.
        """
        n = len(self.band)
        inverse = band_inverse(self.band, offsets)
        if len(self.schur) and n:
            solved = _half_solved(self.band, self.cross, back=True)
            whitened = dtrsm(1.0, self.schur, solved.T, lower=1)
            for slot, k in enumerate(offsets):
                later, sooner = whitened[:, k:], whitened[:, : n - k]
                inverse[: n - k, slot] += np.einsum("mj,mj->j", later, sooner)
        return inverse


def _by_block(
    lower: Float[np.ndarray, "m m"],
    apply: Callable[[Float[np.ndarray, "_k _k"]], tuple[np.ndarray, int]],
) -> Float[np.ndarray, "m m"] | None:
    """Apply a routine of LAPACK to a lower triangle; None where it fails.

    In a large one to each block along the diagonal that nothing couples: three tables of equal
    size side by side take a ninth of the work of one matrix.
    """
    size = len(lower)
    if not size:
        return lower
    if size <= _DENSE:
        result, info = apply(lower)
        return result if info == 0 else None
    last = size - 1 - np.argmax(lower[::-1] != 0.0, axis=0)
    ends = np.flatnonzero(np.maximum.accumulate(last) <= np.arange(size)) + 1
    whole = np.zeros(lower.shape, order="F")
    for a, b in pairwise([0, *ends.tolist()]):
        whole[a:b, a:b], info = apply(lower[a:b, a:b])
        if info != 0:
            return None
    return whole


def _half_solved(
    band: Columns, right: Float[np.ndarray, "n *k"], back: bool = False
) -> Float[np.ndarray, "n *k"]:
    """Solve with the factor of a band, or with its transpose (``back``)."""
    if not right.size:
        return np.zeros(right.shape)  # LAPACK would write beyond the end of nothing
    columns = right.reshape(len(right), -1)
    solution, info = dtbtrs(band.T, columns, uplo="L", trans="T" if back else "N")
    assert info == 0
    return np.asarray(solution).reshape(right.shape)


def band_inverse(band: Columns, offsets: Sequence[int]) -> Float[np.ndarray, "n s"]:
    """Return diagonals of the inverse from a band Cholesky factor.

    Block form of the Takahashi recurrence: a window of the inverse moves up along the
    diagonal, a block of columns at a time.

    Source: K. Takahashi, J. Fagan, M. Chin, PICA Conf., 1973; H. Rue, L. Held, Gaussian
    Markov Random Fields, 2005, section 2.4.
    """
    n, width = band.shape
    result = np.zeros((n, len(offsets)))
    reach = max(width - 1, _BLOCK)
    flat = np.zeros((n + reach, reach + 1))  # rows beyond the end are those of a unit
    flat[:n, :width] = band
    flat[n:, 0] = 1.0
    window = np.eye(reach)
    step = flat.itemsize
    for start in range((n - 1) // _BLOCK * _BLOCK, -1, -_BLOCK):
        size = min(_BLOCK, n - start)
        # Next to it in a column of the matrix is next to it in memory.
        block = as_strided(flat[start], (reach + size, size), (step, step * reach))
        root, info = dtrtri(np.tril(block[:size]), lower=1)
        assert info == 0
        below = block[size : reach + size].copy()
        below[reach - size :] = np.triu(below[reach - size :])
        below = below @ root
        cross = window @ below
        corner = root.T @ root + below.T @ cross
        whole = np.empty((reach + size, reach + size))
        whole[size:, size:] = window
        whole[size:, :size] = -cross
        whole[:size, size:] = -cross.T
        # Rounding must stay symmetric, or it grows from block to block.
        whole[:size, :size] = 0.5 * (corner + corner.T)
        rows = np.arange(size)
        for slot, k in enumerate(offsets):
            result[start : start + size, slot] = whole[rows + k, rows]
        window = whole[:reach, :reach]
    for slot, k in enumerate(offsets):
        result[n - k :, slot] = 0.0
    return result


class _Limit:
    """The limit on BLAS threads, shared by all fits that overlap in time.

    The first fit sets it and the last one lifts it: a fit that restored what it found
    would leave the limit of another one behind for ever. threadpoolctl listens to the
    thread that set a limit only; the last fit may run in another one.
    """

    lock = threading.Lock()
    users = 0
    limiter: Any = None


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread inside the block, in whatever threads blocks overlap.

    The band matrices here are too narrow to share well, and the threads of BLAS and of XLA
    fight for the same cores: one BLAS thread is faster, and much faster on a busy machine.
    """
    with _Limit.lock:
        if _Limit.users == 0:
            OpenBLASController.clear_controlling_thread(force=True)
            _Limit.limiter = _controller().limit(limits=1, user_api="blas")
        _Limit.users += 1
    try:
        yield
    finally:
        with _Limit.lock:
            _Limit.users -= 1
            if _Limit.users == 0:
                OpenBLASController.clear_controlling_thread(force=True)
                _Limit.limiter.restore_original_limits()
                OpenBLASController.clear_controlling_thread(force=True)
