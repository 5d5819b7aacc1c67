"""A first look on a part of the readings: what is plainly absent, which are wild."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve

from ._evidence import Variances, estimate_variances
from ._features import Nuisance, columns_of, nuisance_of
from ._sums import Design, Sums, block_sums, design_of
from ._terms import Kind, Term
from ._view import AxisView

_TAIL = 4.0
"""Degrees of freedom of Student's distribution of the noise."""
_PASSES = 3
_MOST = 5_000
"""Rows that a first look takes."""
_PLACED = 0.9
"""Share of a drift that positions explain, from which on it cannot be told from them."""
_UNIT = 5e-5
"""mm or °: half a unit of a list, which nothing smaller can be written in."""
_OF_NOISE = 0.1
_OF_ERROR = 0.003


class Columns:
    """Features of terms of one axis, each computed once."""

    def __init__(self, view: AxisView) -> None:
        self.view = view
        self.nuisance = nuisance_of(view)
        self._known: dict[Term, np.ndarray] = {}

    def of(self, term: Term) -> Float[np.ndarray, "t k"]:
        """Return the columns of a term."""
        if term not in self._known:
            self._known[term] = columns_of(self.view, term)
        return self._known[term]


@dataclasses.dataclass(frozen=True)
class Rough:
    """A first look.

    Attributes:
        design: Columns of all terms and of the nuisance.
        beside: Columns of the nuisance: zeros, runs, drifts.
        rows: Readings that were looked at.
        sums: Of these.
        weight: Of every reading.
        variances: Of every group.
        noise: Robust standard deviation of a reading in mm or °.
    """

    design: Design
    beside: tuple[Float[np.ndarray, "t _"], ...]
    rows: Int[np.ndarray, " n"]
    sums: Sums
    weight: Float[np.ndarray, " t"]
    variances: Variances
    noise: float


def rough_of(columns: Columns, terms: Sequence[Term]) -> Rough:
    """Return weights and variances from a part of the readings."""
    view = columns.view
    blocks = [columns.of(term) for term in terms]
    nuisance = columns.nuisance
    drift = _free_drift(view, terms, blocks, nuisance)
    beside = (nuisance.zeros, nuisance.runs, drift)
    design = design_of(terms, blocks, beside)
    rows = np.sort(np.random.default_rng(1).permutation(len(view.error))[:_MOST])
    few, error = design.columns[rows], view.error[rows]
    weight = np.ones(len(rows))
    one = np.zeros(len(rows), dtype=np.int64)
    noise = scatter_of(error)
    variances: Variances | None = None
    sums = block_sums(few, error, weight, one).total()
    for step in range(_PASSES):
        if step:
            sums = block_sums(few, error, weight, one).total()
        least = 0.05 * least_of(sums, 0.0)
        variances = estimate_variances(sums, design.slices, least, variances)
        left = error - few @ variances.values
        noise = scatter_of(left)
        weight = (_TAIL + 1.0) / (_TAIL + (left / noise) ** 2)
    assert variances is not None  # there is at least one pass
    left = view.error - design.columns @ variances.values
    every = (_TAIL + 1.0) / (_TAIL + (left / noise) ** 2)
    return Rough(design, beside, rows, sums, every, variances, noise)


def scatter_of(residual: Float[np.ndarray, " t"]) -> float:
    """Return the standard deviation that the middle half of residuals has."""
    middle = float(np.median(residual))
    return 1.4826 * float(np.median(np.abs(residual - middle))) or 1e-12


def least_of(sums: Sums, noise: float) -> float:
    """Return the rms in mm or ° below which a term is not worth a compensation."""
    size = np.sqrt(sums.square / max(sums.weight, 1.0))
    return float(max(_UNIT, _OF_NOISE * noise, _OF_ERROR * size))


def _free_drift(
    view: AxisView,
    terms: Sequence[Term],
    blocks: Sequence[Float[np.ndarray, "t _"]],
    nuisance: Nuisance,
) -> Float[np.ndarray, "t d"]:
    """Return the drifts of those measurements in which positions do not explain them.

    Where each place is visited once, a drift cannot be told from an error of position:
    what there is, is taken for the latter.
    """
    places = [
        block
        for term, block in zip(terms, blocks, strict=True)
        if term.kind in (Kind.OWN, Kind.LINE, Kind.REVERSAL)
    ]
    if not nuisance.drift.shape[1] or not places:
        return nuisance.drift
    free = np.ones(len(nuisance.owner), dtype=bool)
    for source in np.unique(nuisance.owner):
        mine = nuisance.owner == source
        rows = np.flatnonzero(view.data.source == source)
        rows = np.random.default_rng(3).permutation(rows)[:_MOST]
        design = np.concatenate([block[rows] for block in places], axis=1)
        slow = nuisance.drift[np.ix_(rows, np.flatnonzero(mine)[:2])]
        matrix = design.T @ design
        matrix[np.diag_indices(len(matrix))] += 1e-6 * len(design)
        cross = design.T @ slow
        explained = np.einsum("pd,pd->d", cross, cho_solve(cho_factor(matrix), cross))
        whole = np.einsum("td,td->d", slow, slow)
        free[mine] = not np.any(explained > _PLACED * whole)
    return nuisance.drift[:, free]
