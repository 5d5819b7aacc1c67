"""Triangular factors of stacked sparse rows by reflections: no digits are lost by squaring.

Source: A. Björck, Numerical Methods for Least Squares Problems, 1996, section 6.2.
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import get_lapack_funcs

(_GEQRF,) = get_lapack_funcs(("geqrf",), dtype=np.float64)
_BLOCKED = 32
"""Columns that LAPACK reflects at once."""
_NARROW = 24
"""Columns of a block at least: fewer would spend the time on calls."""


@dataclasses.dataclass(frozen=True)
class _Block:
    """Where the entries of some rows go in the matrix that one block of columns reflects."""

    rows: int
    place: Int[np.ndarray, " e"]
    entries: slice


@dataclasses.dataclass(frozen=True)
class Stack:
    """Rows of a sparse matrix sorted by their first column, in blocks.

    Attributes:
        size: Columns.
        band: Largest distance of an entry from the first one of its row.
        step: Columns of a block.
        order: Of the entries, block after block.
        blocks: Of columns.
    """

    size: int
    band: int
    step: int
    order: Int[np.ndarray, " e"]
    blocks: tuple[_Block, ...]

    @classmethod
    def of(
        cls,
        row: Int[np.ndarray, " e"],
        column: Int[np.ndarray, " e"],
        size: int,
        band: int,
    ) -> "Stack":
        """Sort entries; rows are reflected in the order of their numbers, heavy ones first."""
        first = np.full(int(row.max()) + 1, size)
        np.minimum.at(first, row, column)
        step = max(_NARROW, band)
        block = first // step
        # Number of a row within its block.
        ranks = np.argsort(block, kind="stable")
        counts = np.bincount(block, minlength=-(-size // step))
        starts = np.concatenate([[0], np.cumsum(counts)])
        inside = np.empty(len(first), np.int64)
        inside[ranks] = np.arange(len(first)) - starts[block[ranks]]
        order = np.argsort(block[row], kind="stable")
        ends = np.searchsorted(block[row][order], np.arange(len(counts) + 1))
        found = []
        for k, count in enumerate(counts):
            own = order[ends[k] : ends[k + 1]]
            above = 0 if k == 0 else band
            # Column-major, as LAPACK wants it.
            place = (column[own] - k * step) * (above + count) + above
            found.append(
                _Block(
                    int(above + count),
                    place + inside[row[own]],
                    slice(int(ends[k]), int(ends[k + 1])),
                )
            )
        return cls(size, band, step, order, tuple(found))

    def triangle(self, entries: Float[np.ndarray, " e"]) -> Float[np.ndarray, "n w"]:
        """Return the triangular factor, transposed, as lower band with a diagonal ≥ 0."""
        entries = entries[self.order]
        band, step = self.band, self.step
        columns = np.zeros((len(self.blocks) * step, band + 1))
        carried = np.zeros((0, band))
        for k, block in enumerate(self.blocks):
            work = np.zeros((step + band) * block.rows)
            work[block.place] = entries[block.entries]
            matrix = work.reshape(step + band, block.rows).T
            matrix[: len(carried), :band] = carried
            factor = _GEQRF(matrix, lwork=_BLOCKED * (step + band), overwrite_a=1)[0]
            upper = np.zeros((step + band, step + band))
            kept = factor[: step + band]
            upper[: len(kept)] = np.triu(kept)
            flat = np.pad(upper[:step].reshape(-1), (0, band + 1))
            # Along row i the band begins at its diagonal.
            skew = np.lib.stride_tricks.as_strided(
                flat,
                (step, band + 1),
                (flat.itemsize * (step + band + 1), flat.itemsize),
            )
            columns[k * step : (k + 1) * step] = skew
            carried = upper[step:, step:]
        columns = columns[: self.size]
        return np.asarray(columns * np.where(columns[:, :1] < 0, -1.0, 1.0))
