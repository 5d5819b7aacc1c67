"""Elements of the inverse of a band matrix near its diagonal.

A window of the inverse moves up along the diagonal, a block of columns at a time. Of a wide
band two threads share each product and get the next block ready meanwhile; who does what is
fixed, so that the result does not depend on how many processors there are.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import get_lapack_funcs

(_TRTRI,) = get_lapack_funcs(("trtri",), dtype=np.float64)
_BLOCK, _BLOCKS = 64, 6
"""Columns of the inverse that are found at once, and for how many of them there is room."""
_WIDE = 150
"""Half-bandwidth from which on a second thread is worth calling."""

_Result = TypeVar("_Result")
_Submit = Callable[..., "Future[Any]"]


def inverse_diagonals(
    columns: Float[np.ndarray, "n w"], offsets: Sequence[int]
) -> dict[int, Float[np.ndarray, " n"]]:
    """Return diagonals of the inverse: ``result[d][j]`` is element ``(j + d, j)``.

    Block form of the Takahashi recurrence over the band. Entries beyond the end of the matrix
    are zero.

    Args:
        columns: Cholesky factor of the matrix as lower band.
        offsets: Which diagonals; each must lie inside the band.

    Source: K. Takahashi, J. Fagan, M. Chin, PICA Conf., 1973; H. Rue, L. Held, Gaussian
    Markov Random Fields, 2005, section 2.4.
    """
    n, width = columns.shape
    # Narrow bands are widened: small blocks would spend the time on calls.
    band = max(width - 1, _BLOCK)
    if band >= width:
        columns = np.pad(columns, ((0, 0), (0, band + 1 - width)))
    factor = _Factor(np.ascontiguousarray(columns).reshape(-1), n, band)
    if band < _WIDE:
        found = _walk(factor, offsets, band, _at_once)
    else:
        with ThreadPoolExecutor(1) as pool:
            found = _walk(factor, offsets, band // 2, pool.submit)
    inside = np.arange(n)
    return {
        offset: np.where(inside + offset < n, diagonal, 0.0)
        for offset, diagonal in found.items()
    }


def dense_diagonals(
    columns: Float[np.ndarray, "n w"], offsets: Sequence[int]
) -> dict[int, Float[np.ndarray, " n"]]:
    """Return `inverse_diagonals` by way of the inverse of the whole factor."""
    n, width = columns.shape
    lower = np.zeros((n, n))
    for offset in range(min(width, n)):
        np.fill_diagonal(lower[offset:], columns[: n - offset, offset])
    root, info = _TRTRI(lower, lower=1)
    assert info == 0
    return {
        offset: np.pad(
            np.einsum("kj,kj->j", root[:, offset:], root[:, : n - offset]), (0, offset)
        )
        for offset in offsets
    }


@dataclasses.dataclass(frozen=True)
class _Factor:
    """A Cholesky factor: its lower band, column after column."""

    flat: Float[np.ndarray, " e"]
    size: int
    band: int

    @property
    def starts(self) -> range:
        """First columns of the blocks, the last block first."""
        return range((self.size - 1) // _BLOCK * _BLOCK, -1, -_BLOCK)

    def block(
        self, start: int
    ) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, "b m"]]:
        """Return the inverse of a diagonal block, and what stands below it times that."""
        own, band = min(_BLOCK, self.size - start), self.band
        root, info = _TRTRI(np.tril(self._part(start, 0, own, own)), lower=1)
        assert info == 0
        below = self._part(start, own, band, own).copy()
        below[band - own :] = np.triu(below[band - own :])
        return root, below @ root

    def _part(
        self, start: int, down: int, rows: int, own: int
    ) -> Float[np.ndarray, "r m"]:
        # Next to it in a column of the matrix is next to it in memory.
        step = self.flat.itemsize
        return as_strided(
            self.flat[start * (self.band + 1) + down :],
            (rows, own),
            (step, step * self.band),
            writeable=False,
        )


def _walk(
    factor: _Factor, offsets: Sequence[int], share: int, submit: _Submit
) -> dict[int, Float[np.ndarray, " n"]]:
    """Return the diagonals; whoever ``submit`` calls multiplies all but ``share`` rows."""
    band = factor.band
    result = {offset: np.zeros(factor.size) for offset in offsets}
    side = band + _BLOCKS * _BLOCK
    window = np.zeros((side, side))
    place = side - band
    ahead = submit(factor.block, factor.starts[0])
    for start, following in itertools.zip_longest(factor.starts, factor.starts[1:]):
        root, below = ahead.result()
        own = len(root)
        if place < own:
            # Back down to where there is room above.
            kept = window[place : place + band, place : place + band].copy()
            place = side - band
            window[place:, place:] = kept
        before, after = slice(place - own, place), slice(place, place + band)
        known, beside = window[after, after], window[after, before]
        rest = submit(_multiply, known[share:], below, beside[share:])
        if following is not None:
            ahead = submit(factor.block, following)
        _multiply(known[:share], below, beside[:share])
        rest.result()
        window[before, after] = beside.T
        corner = root.T @ root - below.T @ beside
        # What is not symmetric about it is rounding, and would grow from block to block.
        window[before, before] = 0.5 * (corner + corner.T)
        place -= own
        for offset, diagonal in result.items():
            head = (place + offset) * side + place
            # Of a window as a flat buffer every (side + 1)-th element.
            diagonal[start : start + own] = window.reshape(-1)[head :: side + 1][:own]
    return result


def _multiply(
    left: Float[np.ndarray, "r b"],
    right: Float[np.ndarray, "b m"],
    out: Float[np.ndarray, "r m"],
) -> None:
    """Write minus the product."""
    np.matmul(left, right, out=out)
    np.negative(out, out=out)


def _at_once(call: Callable[..., _Result], *arguments: object) -> "Future[_Result]":
    """Do at once what a pool would do meanwhile."""
    result: Future[_Result] = Future()
    result.set_result(call(*arguments))
    return result
