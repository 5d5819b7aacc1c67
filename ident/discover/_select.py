"""Which terms the error of one axis is made of."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ._evidence import Variances, estimate_variances, posterior
from ._heat import choose_heat
from ._library import Library, adapted_twice, late_terms
from ._rough import Columns, least_of, rough_of, scatter_of
from ._stability import selection_frequency
from ._sums import BlockSums, Design, Sums, block_sums, design_of
from ._terms import HEAT, Kind, Term
from ._view import AxisView

_BEYOND_CHANCE = 50.0
"""Twice the log-likelihood that a temperature must gain over a drift in its place."""
_FREE = 100.0
_STABLE = 0.8
"""Share of the resamples in which a term must be selected."""


@dataclasses.dataclass(frozen=True)
class Selection:
    """Terms of the error of one axis.

    Attributes:
        view: The readings.
        design: Columns of all terms that were looked at, and of the nuisance.
        blocks: Their sums.
        sums: The same over all pieces.
        weight: Of each reading.
        variances: Of every group.
        frequency: How often each term was selected, 0 to 1.
        chosen: Terms that the error consists of.
        least: Contribution in mm or ° rms below which a term does not count.
        noise: Standard deviation of a reading about all chosen terms.
        values: Coefficients of the chosen terms and the nuisance.
        looked: Every term that was looked at.
        drifting: Temperature terms that a drift explains as well, with their rms.
    """

    view: AxisView
    design: Design
    blocks: BlockSums
    sums: Sums
    weight: Float[np.ndarray, " t"]
    variances: Variances
    frequency: Float[np.ndarray, " g"]
    chosen: Bool[np.ndarray, " g"]
    least: float
    noise: float
    values: Float[np.ndarray, " p"]
    looked: tuple[Term, ...] = ()
    drifting: tuple[tuple[Term, float], ...] = ()

    def part(self, group: int) -> Float[np.ndarray, " t"]:
        """Return what a group contributes to each reading."""
        mine = self.design.slices[group]
        return np.asarray(self.design.columns[:, mine] @ self.values[mine])

    @property
    def residual(self) -> Float[np.ndarray, " t"]:
        """What the chosen terms and the nuisance leave."""
        return np.asarray(self.view.error - self.design.columns @ self.values)


def select_terms(view: AxisView, library: Library, axes: tuple[str, ...]) -> Selection:
    """Return the terms that the error of an axis consists of."""
    terms = list(library.terms)
    columns = Columns(view)
    if library.heat:
        terms += choose_heat(columns, terms, library.heat)
    found = _select(columns, terms)
    chosen = [t for t, on in zip(found.design.terms, found.chosen, strict=True) if on]
    # What needs another term to make sense is looked for once that one is there.
    more: list[Term] = []
    for term in chosen:
        if term.kind is Kind.PUSH_PLACE:
            twice = adapted_twice(view, term.masters[0])
            more += [each for each in twice if each not in more]
    warm = next((term for term in chosen if term.kind in HEAT), None)
    more += list(late_terms(view, axes, warm))
    if more:
        second = _select(columns, [*chosen, *more])
        pairs = zip(second.design.terms, second.chosen, strict=True)
        if any(on and term in more for term, on in pairs):
            found = second
    return dataclasses.replace(found, looked=tuple(terms))


def _select(columns: Columns, terms: Sequence[Term]) -> Selection:
    view = columns.view
    rough = rough_of(columns, terms)
    kept = [g for g in range(len(terms)) if rough.variances.group[g] > 0]
    nowhere = [term for g, term in enumerate(terms) if g not in kept]
    terms = [terms[g] for g in kept]
    design = design_of(terms, [columns.of(t) for t in terms], rough.beside, nowhere)
    weight = rough.weight
    sums = block_sums(design.columns, view.error, weight, view.block)
    total = sums.total()
    least = least_of(total, rough.noise)
    variances = estimate_variances(total, design.slices, 0.1 * least)
    frequency = selection_frequency(sums, design.slices, variances, len(terms), least)
    stable = frequency >= _STABLE
    chosen = _without_needless(total, design, variances, stable, least)
    drifting = tuple(
        (term, float(variances.rms[g]))
        for g, term in enumerate(design.terms)
        if term.kind is Kind.HEAT_OFFSET and stable[g] and not chosen[g]
    )
    keep = np.ones(design.groups, dtype=bool)
    keep[: len(chosen)] = chosen
    alone = dataclasses.replace(variances, group=np.where(keep, variances.group, 0.0))
    settled = estimate_variances(total, design.slices, 0.1 * least, alone)
    noise = scatter_of(view.error - design.columns @ settled.values)
    return Selection(
        view, design, sums, total, weight, settled, frequency, chosen, least,
        noise, settled.values, drifting=drifting,
    )  # fmt: skip


def _without_needless(
    sums: Sums,
    design: Design,
    variances: Variances,
    chosen: Bool[np.ndarray, " g"],
    least: float,
) -> Bool[np.ndarray, " g"]:
    """Return the terms without those whose part the others take over, simplest first."""
    keep = np.ones(design.groups, dtype=bool)
    keep[: len(chosen)] = chosen
    sizes = np.array([s.stop - s.start for s in design.slices])
    # Terms that share one effect each have a part of its variance: set free, any of them
    # can take the whole of it.
    group = variances.group.copy()
    group[: len(chosen)] *= _FREE
    free = dataclasses.replace(variances, group=group)
    by_chance = variances.noise**2 * sizes
    while True:
        _, whole = posterior(sums, design.slices, free, keep)
        costs = {}
        for g in np.flatnonzero(keep[: len(chosen)]):
            without = keep.copy()
            without[g] = False
            _, left = posterior(sums, design.slices, free, without)
            more = left - whole - by_chance[g]
            costs[int(g)] = np.sqrt(max(more, 0.0) / sums.weight)
        # A slow term stands beside a drift that follows it at little cost: what counts
        # is whether chance would do so.
        chance = np.sqrt(_BEYOND_CHANCE / sums.weight) * variances.noise
        needless = [
            g
            for g, cost in costs.items()
            if cost < (min(least, chance) if design.terms[g].kind in HEAT else least)
        ]
        if not needless:
            return keep[: len(chosen)]
        # Of several that are too many, the one with most functions goes first.
        worst = max(needless, key=lambda g: (sizes[g], -costs[g]))
        keep[worst] = False
