"""Sums of products of features, by piece of the recording: all that selection needs."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import get_blas_funcs

from ._terms import Term

(_SQUARE,) = get_blas_funcs(["syrk"], dtype=np.float64)


@dataclasses.dataclass(frozen=True)
class Design:
    """Columns of all terms side by side.

    Attributes:
        terms: Candidates; what comes after them is nuisance.
        columns: Features.
        slices: Columns of each term, then those of each group of nuisance.
        absent: Terms that were looked at and are plainly not there.
    """

    terms: tuple[Term, ...]
    columns: Float[np.ndarray, "t p"]
    slices: tuple[slice, ...]
    absent: tuple[Term, ...] = ()

    @property
    def groups(self) -> int:
        """Number of terms and groups of nuisance."""
        return len(self.slices)


def design_of(
    terms: Sequence[Term],
    blocks: Sequence[Float[np.ndarray, "t _"]],
    nuisance: Sequence[Float[np.ndarray, "t _"]],
    absent: Sequence[Term] = (),
) -> Design:
    """Return the columns of terms and nuisance, one behind the other."""
    parts = [*blocks, *(part for part in nuisance if part.shape[1])]
    ends = np.cumsum([0, *(part.shape[1] for part in parts)])
    slices = tuple(
        slice(int(start), int(end)) for start, end in itertools.pairwise(ends)
    )
    return Design(tuple(terms), np.concatenate(parts, axis=1), slices, tuple(absent))


@dataclasses.dataclass(frozen=True)
class Sums:
    """Weighted sums over rows.

    Attributes:
        products: Of every two columns.
        right: Of every column with the error.
        square: Of the error with itself.
        weight: Sum of the weights.
    """

    products: Float[np.ndarray, "p p"]
    right: Float[np.ndarray, " p"]
    square: float
    weight: float


@dataclasses.dataclass(frozen=True)
class BlockSums:
    """The same, by piece of the recording."""

    products: Float[np.ndarray, "b p p"]
    right: Float[np.ndarray, "b p"]
    square: Float[np.ndarray, " b"]
    weight: Float[np.ndarray, " b"]

    def total(self, take: Int[np.ndarray, " k"] | None = None) -> Sums:
        """Return the sums over some of the pieces, or over all."""
        rows = np.arange(len(self.square)) if take is None else take
        return Sums(
            self.products[rows].sum(axis=0),
            self.right[rows].sum(axis=0),
            float(self.square[rows].sum()),
            float(self.weight[rows].sum()),
        )


def block_sums(
    columns: Float[np.ndarray, "t p"],
    error: Float[np.ndarray, " t"],
    weight: Float[np.ndarray, " t"],
    block: Int[np.ndarray, " t"],
) -> BlockSums:
    """Return the sums of each piece."""
    count, size = int(block.max()) + 1, columns.shape[1]
    products = np.zeros((count, size, size))
    right = np.zeros((count, size))
    square, total = np.zeros(count), np.zeros(count)
    root = np.sqrt(weight)
    for number in range(count):
        rows = np.flatnonzero(block == number)
        if not rows.size:
            continue
        own = columns[rows] * root[rows, None]
        read = error[rows] * root[rows]
        # One triangle only: half the work of a full product.
        upper = _SQUARE(1.0, own.T)
        products[number] = np.triu(upper) + np.triu(upper, 1).T
        right[number] = own.T @ read
        square[number] = float(read @ read)
        total[number] = float(weight[rows].sum())
    return BlockSums(products, right, square, total)
