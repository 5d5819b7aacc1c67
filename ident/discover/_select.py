"""Which terms the error (or current) of one axis is made of.

Sparse selection of whole terms, on one half of the recording with shapes of the other: the
shape of every term (the coefficients of its functions) is estimated on one half of the
pieces; its course over the other half, scaled to an rms of one, is one normalised feature. So
a term is one coefficient, in mm rms, and `pysindy` selects among them by sequentially
thresholded least squares: a term that is not there has a shape by chance, which does not come
back in the other half. Halves are drawn many times over, in complementary pairs: N.
Meinshausen, P. Bühlmann, J. R. Stat. Soc. B 72(4), 2010; R. D. Shah, R. J. Samworth, same
journal 75(1), 2013. Each reading counts by Student's distribution, so that none that is wild
decides what is there.
"""

import dataclasses
import warnings
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import cho_factor, cho_solve

from ..core import choose_loss
from ._evidence import (
    Design,
    Sums,
    Variances,
    design_of,
    estimate_variances,
    evidence_gain,
    posterior,
    sums_of,
    without_groups,
)
from ._features import columns_of, nuisance_of
from ._terms import HEAT, Kind, Term
from ._view import AxisView

_PASSES = 3
_MOST = 5_000
"""Rows that a first look takes."""
_OUTER = 0.95
"""Quantile of the readings that is their scale before anything is known of them."""
_PLACED = 0.9
"""Share of a drift that positions explain, from which on it cannot be told from them."""
_PAIRS = 12
"""Complementary pairs of halves."""
_FOLLOWS = 0.5
"""Share of its shape that a term must keep in the other half."""
_STABLE = 0.8
"""Share of the resamples in which a term must be selected."""
_FREE = 100.0
BEYOND_CHANCE = 50.0
"""Twice the log-likelihood that a temperature must gain over a drift in its place."""


@dataclasses.dataclass(frozen=True)
class Worth:
    """Contribution below which a term does not count: the largest of three.

    Attributes:
        unit: In the unit of the readings: half a unit of a list.
        of_noise: Share of the noise of a reading.
        of_size: Share of the rms of all readings.
    """

    unit: float = 5e-5
    of_noise: float = 0.1
    of_size: float = 0.003

    def least(self, sums: Sums, noise: float = 0.0) -> float:
        """Return it for readings with these sums."""
        size = np.sqrt(float(sums.square) / max(float(sums.weight), 1.0))
        return float(max(self.unit, self.of_noise * noise, self.of_size * size, 1e-12))


class Columns:
    """Features of terms of one axis, each computed once, and the weights of readings.

    Attributes:
        view: The readings.
        worth: From which contribution on a term counts.
        nuisance: What is no compensation's task.
        weight: How much each reading counts, as far as is known.
        weighed: The weights are those about a fit.
    """

    def __init__(self, view: AxisView, worth: Worth, drifting: bool = True) -> None:
        self.view, self.worth = view, worth
        self.nuisance = nuisance_of(view, drifting)
        self._known: dict[Term, np.ndarray] = {}
        # Before anything is known, no reading may decide alone what is there.
        outer = float(np.quantile(np.abs(view.error), _OUTER)) or 1.0
        self.weight = 1.0 / (1.0 + (view.error / outer) ** 2)
        self.weighed = False

    def of(self, term: Term) -> Float[np.ndarray, "t k"]:
        """Return the columns of a term."""
        if term not in self._known:
            self._known[term] = columns_of(self.view, term)
        return self._known[term]

    @cached_property
    def drift(self) -> Float[np.ndarray, "t d"]:
        """Drifts of those measurements in which positions do not explain them.

        Where each place is visited once, a drift cannot be told from an error of position:
        what there is, is taken for the latter.
        """
        slow, owner = self.nuisance.drift, self.nuisance.owner
        kinds = (Kind.OWN, Kind.LINE, Kind.REVERSAL)
        places = [block for term, block in self._known.items() if term.kind in kinds]
        if not slow.shape[1] or not places:
            return slow
        free = np.ones(len(owner), dtype=bool)
        for number, rows in enumerate(self.view.sources()):
            mine = np.flatnonzero(owner == number)
            rows = np.random.default_rng(3).permutation(rows)[:_MOST]
            design = np.concatenate([block[rows] for block in places], axis=1)
            matrix = design.T @ design
            matrix[np.diag_indices(len(matrix))] += 1e-6 * len(design)
            first = slow[np.ix_(rows, mine[:2])]
            cross = design.T @ first
            explained = np.sum(cross * cho_solve(cho_factor(matrix), cross), axis=0)
            free[mine] = not np.any(explained > _PLACED * np.sum(first**2, axis=0))
        return slow[:, free]


@dataclasses.dataclass(frozen=True)
class Look:
    """A first look on a part of the readings: what is plainly absent, which are wild.

    Attributes:
        design: Columns of all terms and of the nuisance: zeros, runs, drifts.
        rows: Readings that were looked at.
        sums: Of these.
        weight: Of every reading.
        variances: Of every group.
    """

    design: Design
    rows: Int[np.ndarray, " n"]
    sums: Sums
    weight: Float[np.ndarray, " t"]
    variances: Variances


def look_at(columns: Columns, terms: Sequence[Term]) -> Look:
    """Return weights and variances from a part of the readings."""
    error, nuisance = columns.view.error, columns.nuisance
    blocks = [columns.of(term) for term in terms]
    design = design_of(terms, blocks, (nuisance.zeros, nuisance.runs, columns.drift))
    rows = np.sort(np.random.default_rng(1).permutation(len(error))[:_MOST])
    few = design.columns[rows]
    weight = columns.weight[rows]
    variances: Variances | None = None
    sums = sums_of(few, error[rows], weight)
    for turn in range(_PASSES):
        sums = sums_of(few, error[rows], weight) if turn else sums
        least = 0.05 * columns.worth.least(sums)
        variances = estimate_variances(sums, design.slices, least, variances)
        weight = weights_of(error[rows] - few @ variances.values)
        if not columns.weighed:
            # What wild readings have hidden so far is looked for anew.
            variances, columns.weighed = None, True
    assert variances is not None  # there is at least one pass
    columns.weight = weights_of(error - design.columns @ variances.values)
    return Look(design, rows, sums, columns.weight, variances)


def weights_of(residual: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    """Return how much each reading counts; 1 in the mean, 0 where it is wild."""
    loss = choose_loss("student", residual, 1.0, 1e-12)
    share = loss.share(residual / loss.scale)
    return np.asarray(share / np.mean(share[share > 0]))


def scatter_of(residual: Float[np.ndarray, " t"]) -> float:
    """Return the standard deviation that the middle half of residuals has."""
    middle = float(np.median(residual))
    return 1.4826 * float(np.median(np.abs(residual - middle))) or 1e-12


@dataclasses.dataclass(frozen=True)
class Selection:
    """Terms of the error of one axis.

    Attributes:
        columns: Features of all terms, with the readings.
        design: Columns of the terms that were not plainly absent, and of the nuisance.
        weight: Of each reading.
        variances: Of every group, with the values of the chosen terms and the nuisance.
        frequency: How often each term was selected, 0 to 1.
        chosen: Terms that the error consists of.
        least: Contribution in mm or ° rms below which a term does not count.
        looked: Every term that was looked at.
    """

    columns: Columns
    design: Design
    weight: Float[np.ndarray, " t"]
    variances: Variances
    frequency: Float[np.ndarray, " g"]
    chosen: Bool[np.ndarray, " g"]
    least: float
    looked: tuple[Term, ...]

    @property
    def view(self) -> AxisView:
        """The readings."""
        return self.columns.view

    @property
    def terms(self) -> list[Term]:
        """The chosen ones."""
        pairs = zip(self.design.terms, self.chosen, strict=True)
        return [term for term, on in pairs if on]

    @cached_property
    def residual(self) -> Float[np.ndarray, " t"]:
        """What the chosen terms and the nuisance leave."""
        return np.asarray(self.view.error - self.design.columns @ self.variances.values)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a reading about all chosen terms."""
        return scatter_of(self.residual)

    @cached_property
    def clean(self) -> Float[np.ndarray, " t"]:
        """The error without the zeros of the instruments and without wild readings."""
        reach = 6.0 * self.noise
        explained = self.view.error - self.residual
        error = explained + np.clip(self.residual, -reach, reach)
        return self.view.centred(error[:, None])[:, 0]

    @property
    def square(self) -> float:
        """Mean square of the error."""
        return float(np.mean(self.clean**2)) or 1.0

    def part(self, group: int) -> Float[np.ndarray, " t"]:
        """Return what a group contributes to each reading."""
        mine = self.design.slices[group]
        return np.asarray(self.design.columns[:, mine] @ self.variances.values[mine])

    def index(self, terms: Sequence[Term]) -> list[int]:
        """Return the groups of some terms."""
        return [self.design.terms.index(term) for term in terms]

    def size_of(self, terms: Sequence[Term]) -> tuple[float, float]:
        """Return rms and share of the mean square of the error of terms together."""
        course = np.sum([self.part(g) for g in self.index(terms)], axis=0)
        share = float(np.clip(np.mean(course * self.clean) / self.square, 0.0, 1.0))
        return float(np.sqrt(np.mean(course**2))), share

    def stability_of(self, terms: Sequence[Term]) -> float:
        """Return the share of resamples in which all of some terms were selected."""
        return float(min(self.frequency[self.index(terms)]))


def select_terms(
    columns: Columns, terms: Sequence[Term], first: Selection | None = None
) -> Selection:
    """Return the terms that the error (or current) of an axis consists of.

    Args:
        columns: Features of the axis.
        terms: Candidates.
        first: An earlier selection, whose weights of readings are good for this one.
    """
    view, kept = columns.view, list(terms)
    if first is None:
        group = look_at(columns, terms).variances.group
        kept = [term for g, term in enumerate(terms) if group[g] > 0]
    nuisance = columns.nuisance
    beside = (nuisance.zeros, nuisance.runs, columns.drift)
    design = design_of(kept, [columns.of(term) for term in kept], beside)
    blocks = sums_of(design.columns, view.error, columns.weight, view.block)
    sums = blocks.total()
    found = estimate_variances(sums, design.slices, 0.1 * columns.worth.least(sums))
    least = columns.worth.least(sums, found.noise)
    frequency = _selection_frequency(blocks, design, found, least)
    chosen = _without_needless(sums, design, found, frequency >= _STABLE, least)
    group = found.without(np.flatnonzero(~chosen).tolist()).group
    # A drift is there again where the term that took its place is not.
    group[len(kept) :] = float(sums.square / sums.weight)
    alone = dataclasses.replace(found, group=group)
    alone = estimate_variances(sums, design.slices, 0.1 * least, alone)
    return Selection(
        columns, design, columns.weight, alone, frequency, chosen, least, tuple(terms)
    )


def _selection_frequency(
    blocks: Sums, design: Design, variances: Variances, least: float
) -> Float[np.ndarray, " g"]:
    """Return how often each term was selected, 0 to 1."""
    count = len(blocks.square)
    rng = np.random.default_rng(0)
    hits = np.zeros(len(design.terms))
    for _ in range(_PAIRS):
        order = rng.permutation(count)
        halves = np.sort(order[: count // 2]), np.sort(order[count // 2 :])
        parts = [blocks.total(half) for half in halves]
        for shape, proof in (parts, parts[::-1]):
            values, _ = posterior(shape, design.slices, variances)
            hits += _selected(proof, values, design, variances, least)
    return hits / (2 * _PAIRS)


def _selected(
    sums: Sums,
    values: Float[np.ndarray, " p"],
    design: Design,
    variances: Variances,
    least: float,
) -> Bool[np.ndarray, " g"]:
    """Return which terms one half selects with the shapes of the other."""
    import pysindy

    terms, slices = len(design.terms), design.slices
    end = slices[terms].start
    own = slice(0, end)
    shapes = np.zeros((end, terms))
    for g in range(terms):
        shapes[slices[g], g] = values[slices[g]]
    weight = float(sums.weight)
    # Scaled by what a term does in all, not by what the drift leaves of a slow one.
    size = np.einsum(
        "pg,pq,qg->g", shapes, sums.products[own, own], shapes, optimize=True
    )
    size = np.sqrt(np.maximum(size, 0.0) / weight)
    known = size > 1e-3 * least
    chosen = np.zeros(terms, dtype=bool)
    if not known.any():
        return chosen
    free = without_groups(sums, slices, variances.without(range(terms)), own)
    shapes, scale = shapes[:, known], size[known] * np.sqrt(weight)
    matrix = shapes.T @ free.products @ shapes / np.outer(scale, scale)
    # A square root of the sums gives the same regression as the rows, at any length.
    squares, axes = np.linalg.eigh(matrix)
    root = np.sqrt(np.maximum(squares, 1e-12))
    target = axes.T @ (shapes.T @ free.right / scale) / root / np.sqrt(weight) / least
    optimizer = pysindy.STLSQ(threshold=1.0, alpha=1e-6, max_iter=40, unbias=False)
    with warnings.catch_warnings():
        # It warns where nothing is left, which is an answer.
        warnings.filterwarnings("ignore", "Sparsity parameter is too big")
        optimizer.fit((axes * root).T, target[:, None])
    found = np.asarray(optimizer.coef_)[0]
    chosen[known] = (found >= 1.0) & (found * least > _FOLLOWS * size[known])
    return chosen


def _without_needless(
    sums: Sums,
    design: Design,
    variances: Variances,
    chosen: Bool[np.ndarray, " g"],
    least: float,
) -> Bool[np.ndarray, " g"]:
    """Return the terms without those whose part the others take over, simplest first."""
    sizes = np.array([each.stop - each.start for each in design.slices])
    keep = chosen.copy()
    # Terms that share one effect each have a part of its variance: set free, any of them can
    # take the whole of it.
    group = variances.group.copy()
    group[: len(keep)] *= np.where(keep, _FREE, 0.0)
    free = dataclasses.replace(variances, group=group)
    while True:
        _, whole = posterior(sums, design.slices, free)
        costs: dict[int, float] = {}
        needless: list[int] = []
        for g in np.flatnonzero(keep).tolist():
            _, left = posterior(sums, design.slices, free.without([g]))
            more = left - whole - variances.noise**2 * sizes[g]
            costs[g] = float(np.sqrt(max(more, 0.0) / sums.weight))
            if design.terms[g].kind in HEAT:
                here = variances.without(np.flatnonzero(~keep).tolist())
                gain = evidence_gain(
                    sums, design.slices, here, [g], len(keep), 0.1 * least
                )
                if gain < BEYOND_CHANCE:
                    needless.append(g)
            elif costs[g] < least:
                needless.append(g)
        if not needless:
            return keep
        # Of several that are too many, the one with most functions goes first.
        worst = max(needless, key=lambda g: (sizes[g], -costs[g]))
        keep[worst] = False
        free = free.without([worst])
