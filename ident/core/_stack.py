"""Effects side by side: where the unknowns, the priors and their terms of each one stand."""

import dataclasses
from functools import cached_property
from typing import Any, final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float

from ._effect import KEPT, AbstractEffect, Design, TableEffect, design_of
from ._prior import AbstractPrior, Penalty
from ._readings import Readings

Matrix = Any
"""A design, one row per reading and one column per unknown: whole or sparse (`sp.csr_array`)."""

SMALL = 128
"""Unknowns up to which a stack without a band is penalised by whole matrices."""
_WHOLE = 1 << 17
"""Elements up to which a design is kept with all its zeros: faster than without them."""


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
    def terms(self) -> "tuple[Term, ...]":
        """Terms of the prior, in the order of the weights."""
        return tuple(
            Term(penalty, here, here.start - self.band)
            for prior, here, _ in self.priors
            for penalty in prior.penalties
        )

    @cached_property
    def small(self) -> bool:
        """Whether all unknowns together are few, and none of them form a band."""
        return not self.band and self.size <= SMALL

    @cached_property
    def rows(self) -> Float[np.ndarray, "k r u"]:
        """Rows of each term over all unknowns of a small stack, filled up with zeros."""
        dense = [term.penalty.whole for term in self.terms]
        widest = max((len(rows) for rows in dense), default=0)
        result = np.zeros((len(dense), widest, self.size))
        for block, rows, term in zip(result, dense, self.terms, strict=True):
            block[: len(rows), term.here] = rows
        return result

    @cached_property
    def grams(self) -> Float[np.ndarray, "k u u"]:
        """Matrix of each term over all unknowns of a small stack."""
        return np.asarray(self.rows.transpose(0, 2, 1) @ self.rows)

    @cached_property
    def optional(self) -> Bool[np.ndarray, " k"]:
        """Weights that may be 0: those of fourth differences."""
        return np.concatenate([prior.optional for prior, _, _ in self.priors])

    @cached_property
    def free(self) -> int:
        """Number of unknowns that no prior holds."""
        return sum(prior.free for prior, _, _ in self.priors)

    def design(self, readings: Readings) -> Design:
        """Return the rows of all effects side by side."""
        designs = (design_of(effect, readings) for effect in self.effects)
        nodes, shares = zip(*designs, strict=True)
        placed = zip(nodes, self.starts, strict=False)
        return np.hstack([node + start for node, start in placed]), np.hstack(shares)

    def matrix(self, readings: Readings) -> Matrix:
        """Return the rows of all effects side by side as a matrix, kept as those are."""
        cache = readings.matrices if len(readings) <= KEPT else {}
        if self not in cache:
            nodes, shares = self.design(readings)
            count, width = shares.shape
            if count * self.size <= _WHOLE:
                place = nodes + self.size * np.arange(count)[:, None]
                flat = np.bincount(place.ravel(), shares.ravel(), count * self.size)
                cache[self] = flat.reshape(count, self.size)
            else:
                ends = np.arange(count + 1) * width
                entries = (shares.reshape(-1), nodes.reshape(-1), ends)
                cache[self] = sp.csr_array(entries, shape=(count, self.size))
        return cache[self]


def compact(design: sp.csr_array) -> Matrix:
    """Return a design with all its zeros where it is small."""
    if np.prod(np.asarray(design.shape)) > _WHOLE:
        return design
    return np.asarray(design.toarray())


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Term:
    """A penalty at its place among all unknowns.

    Attributes:
        penalty: Over the unknowns of its effect.
        here: These unknowns.
        shift: First of them counted from the border; negative in the band.
    """

    penalty: Penalty
    here: slice
    shift: int

    @property
    def border(self) -> bool:
        """Whether its effect stands in the border."""
        return self.shift >= 0
