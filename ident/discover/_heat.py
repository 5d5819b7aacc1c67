"""Which sensor, with which lag, an error follows; each effect may have its own."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve

from ._evidence import estimate_variances, log_evidence
from ._rough import Columns, rough_of
from ._sums import Sums, block_sums
from ._terms import HEAT, Term

_FINER = 8
"""Lags that are tried about the best of the coarse ones, each time twice as fine."""


def choose_heat(
    columns: Columns, terms: Sequence[Term], heat: Sequence[Term]
) -> tuple[Term, ...]:
    """Return for offset and coefficient the sensor and lag that are likeliest.

    Everything else is estimated first and taken out; what is left are a few slow terms
    and the drift, which have their variances by evidence.

    Args:
        columns: Features of the axis.
        terms: All other candidates.
        heat: Offset and coefficient for every sensor and some lags.
    """
    search = _Search(columns, terms)
    kinds = [kind for kind in HEAT if any(term.kind is kind for term in heat)]
    places = {(term.sensor, term.lag) for term in heat}
    pairs = [
        tuple(t for t in heat if (t.sensor, t.lag) == place) for place in sorted(places)
    ]
    best = max(pairs, key=search.evidence)
    for _ in range(2):
        for kind in kinds:
            others = tuple(term for term in best if term.kind is not kind)
            mine = [term for term in heat if term.kind is kind]
            best = max(((*others, term) for term in mine), key=search.evidence)
    return _refined(search, best, max(term.lag for term in heat))


def _refined(
    search: "_Search", terms: tuple[Term, ...], longest: float
) -> tuple[Term, ...]:
    """Return the terms with their lags between the coarse ones."""
    if longest <= 0:
        return terms
    best = terms
    factor = 2.0
    for _ in range(_FINER // 2):
        for sensor in dict.fromkeys(term.sensor for term in terms):
            lag = max(term.lag for term in best if term.sensor == sensor)
            for other in (lag * factor, lag / factor, 15.0 * (lag == 0)):
                moved = tuple(
                    dataclasses.replace(term, lag=other)
                    if term.sensor == sensor
                    else term
                    for term in best
                )
                if 0 < other <= longest:
                    best = max((best, moved), key=search.evidence)
        factor = np.sqrt(factor)
    return best


class _Search:
    """Evidence of temperature terms beside everything else."""

    def __init__(self, columns: Columns, terms: Sequence[Term]) -> None:
        self._columns = columns
        rough = rough_of(columns, terms)
        self._rows, self._noise = rough.rows, rough.noise
        self._weight = rough.weight[rough.rows]
        slow = len(rough.design.slices) - 1 if rough.beside[-1].shape[1] else None
        group = rough.variances.group
        owner = np.repeat(
            np.arange(len(group)), [s.stop - s.start for s in rough.design.slices]
        )
        fast = (group[owner] > 0) & (owner != -1 if slow is None else owner != slow)
        self._base = rough.design.columns[rough.rows][:, fast]
        self._prior = self._noise**2 / group[owner[fast]]
        self._drift = rough.beside[-1][rough.rows]
        matrix = self._base.T @ (self._weight[:, None] * self._base)
        matrix[np.diag_indices(len(matrix))] += self._prior
        self._factor = cho_factor(matrix, lower=True) if len(matrix) else None
        self._error = columns.view.error[rough.rows]
        self._known: dict[frozenset[Term], float] = {}
        self._reduced: dict[Term, np.ndarray] = {}

    def evidence(self, terms: tuple[Term, ...]) -> float:
        """Return the logarithm of the evidence of some terms."""
        key = frozenset(terms)
        if key not in self._known:
            blocks = [self._columns.of(term)[self._rows] for term in terms]
            blocks += [self._drift] * bool(self._drift.shape[1])
            sums = self._without_base(np.concatenate(blocks, axis=1))
            ends = np.cumsum([0, *(block.shape[1] for block in blocks)])
            slices = [
                slice(int(start), int(end)) for start, end in itertools.pairwise(ends)
            ]
            found = estimate_variances(sums, slices, 1e-3 * self._noise)
            self._known[key] = log_evidence(sums, slices, found)
        return self._known[key]

    def _without_base(self, design: Float[np.ndarray, "n k"]) -> Sums:
        """Return the sums with all that does not change slowly taken out."""
        one = np.zeros(len(design), dtype=np.int64)
        sums = block_sums(design, self._error, self._weight, one).total()
        if self._factor is None:
            return sums
        light = self._weight[:, None]
        cross = self._base.T @ (light * np.column_stack([design, self._error]))
        taken = cross.T @ cho_solve(self._factor, cross)
        return Sums(
            sums.products - taken[:-1, :-1],
            sums.right - taken[:-1, -1],
            sums.square - float(taken[-1, -1]),
            sums.weight,
        )
