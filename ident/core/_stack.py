"""Effects side by side: where the unknowns, the priors and their terms of each one stand."""

import dataclasses
from functools import cached_property
from typing import Any, final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from ._effect import AbstractEffect, TableEffect
from ._prior import AbstractPrior
from ._readings import Readings

Matrix = Any
"""A design, one row per reading and one column per unknown: whole or sparse (`sp.csr_array`)."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Term:
    """One term of the prior of a stack, $K = D^T D$, over all its unknowns.

    Attributes:
        rows: D.
        gram: K.
        row: Of the lower elements of K.
        column: Likewise.
        data: The elements.
        border: Whether its effect stands in the border.
    """

    rows: sp.csr_array
    gram: sp.csr_array
    row: Int[np.ndarray, " e"]
    column: Int[np.ndarray, " e"]
    data: Float[np.ndarray, " e"]
    border: bool

    @classmethod
    def of(cls, rows: sp.csr_array, start: int, size: int, border: bool) -> "Term":
        """Return the term of rows over the unknowns from one on, of so many in all."""
        entries = rows.data, rows.indices + start, rows.indptr
        whole = sp.csr_array(entries, shape=(len(rows.indptr) - 1, size))
        gram = sp.csr_array(whole.T @ whole)
        lower = sp.coo_array(sp.tril(gram))
        keep = lower.data != 0.0
        row, column = (index[keep].astype(np.int64) for index in lower.coords)
        return cls(whole, gram, row, column, lower.data[keep], border)

    @cached_property
    def distances(self) -> frozenset[int]:
        """Of the elements from the diagonal."""
        return frozenset(np.unique(self.row - self.column).tolist())


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Stack:
    """Effects side by side; the unknowns of the first one may form a band.

    Attributes:
        effects: In the order of their unknowns.
        banded: Whether the first effect is a table that is kept as a band.
    """

    effects: tuple[AbstractEffect, ...]
    banded: bool = True

    @cached_property
    def starts(self) -> tuple[int, ...]:
        """First unknown of each effect, then the number of all."""
        return (0, *np.cumsum([effect.size for effect in self.effects]).tolist())

    @cached_property
    def size(self) -> int:
        """Number of unknowns."""
        return self.starts[-1]

    @cached_property
    def band(self) -> int:
        """Number of unknowns of the band."""
        return self.starts[1] if self.banded else 0

    @cached_property
    def table(self) -> TableEffect | None:
        """The effect whose unknowns form the band."""
        first = self.effects[0]
        return first if self.banded and isinstance(first, TableEffect) else None

    @cached_property
    def offsets(self) -> tuple[int, ...]:
        """Diagonals of the band that readings reach."""
        return (0,) if self.table is None else self.table.offsets

    def here(self, number: int) -> slice:
        """Return the unknowns of an effect."""
        number %= len(self.effects)
        return slice(self.starts[number], self.starts[number + 1])

    @cached_property
    def priors(self) -> tuple[tuple[AbstractPrior, slice, slice], ...]:
        """Prior of each effect, its unknowns, its weights."""
        result, first = [], 0
        for number, effect in enumerate(self.effects):
            count = len(effect.prior.rows)
            terms = slice(first, first + count)
            result.append((effect.prior, self.here(number), terms))
            first += count
        return tuple(result)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """Terms of the prior, in the order of the weights."""
        return tuple(
            Term.of(rows, here.start, self.size, here.start >= self.band)
            for prior, here, _ in self.priors
            for rows in prior.rows
        )

    @cached_property
    def optional(self) -> Bool[np.ndarray, " k"]:
        """Weights that may be 0: those of fourth differences."""
        return np.concatenate([prior.optional for prior, _, _ in self.priors])

    @cached_property
    def free(self) -> int:
        """Number of unknowns that no prior holds."""
        return sum(int(prior.straight.shape[1]) for prior, _, _ in self.priors)

    def matrix(self, readings: Readings) -> sp.csr_array:
        """Return the rows of all effects side by side."""
        designs = [effect.design(readings) for effect in self.effects]
        placed = zip(designs, self.starts, strict=False)
        nodes = np.hstack([own + start for (own, _), start in placed])
        shares = np.hstack([own for _, own in designs])
        pointers = np.arange(len(shares) + 1) * shares.shape[1]
        entries = shares.reshape(-1), nodes.reshape(-1), pointers
        return sp.csr_array(entries, shape=(len(shares), self.size))
