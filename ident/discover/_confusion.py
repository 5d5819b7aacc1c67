"""What would explain the same as well: what the data cannot tell apart is said."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ._compose import Need
from ._rough import Columns
from ._select import Selection
from ._sums import block_sums
from ._terms import HEAT, Kind, Term

_AS_WELL = 0.95
"""Share of what a compensation explains, at which a substitute is as good."""
_PARTLY = 0.3
_HIDDEN = 0.05
"""Share of a feature that is left beside all that was found; below it is not seen."""
_ROWS = 6_000
_LOOSE = 10.0
"""Size of a substitute's coefficients, relative to the error: free."""
_CONTAINED = {
    Kind.REVERSAL: (Kind.OWN_REVERSAL, Kind.MEMORY),
    Kind.LINE: (Kind.SURFACE,),
    Kind.PUSH: (Kind.PUSH_WAY, Kind.PUSH_PLACE),
}
"""Terms that a richer one may imitate; the simpler one is taken."""


@dataclasses.dataclass(frozen=True)
class Confused:
    """A compensation that something else would replace.

    Attributes:
        need: What was selected.
        other: What explains the same.
        share: Of what the compensation explains, that the other explains.
    """

    need: Need
    other: Term
    share: float


@dataclasses.dataclass(frozen=True)
class Look:
    """What the data cannot tell.

    Attributes:
        confused: Pairs that explain the same.
        hidden: Terms that could not be seen beside what was found.
    """

    confused: tuple[Confused, ...]
    hidden: tuple[Term, ...]


def look_for_confusion(
    found: Selection, needs: Sequence[Need], candidates: Sequence[Term]
) -> Look:
    """Return which compensations something else would replace.

    Args:
        found: The selection of the axis.
        needs: Compensations made of it.
        candidates: Every term that was looked at.
    """
    if not needs:
        return Look((), ())
    view, design = found.view, found.design
    chosen = [t for t, on in zip(design.terms, found.chosen, strict=True) if on]
    others = [term for term in candidates if term not in chosen]
    if any(term.kind in HEAT for term in chosen):
        others.append(Term(Kind.DRIFT, view.axis))
    rows = np.sort(np.random.default_rng(5).permutation(len(view.error))[:_ROWS])
    fixed = [s for g, s in enumerate(design.slices) if _stays(found, g)]
    columns = Columns(view)
    parts = [design.columns[rows, s] for s in fixed]
    kept = len(parts)
    parts += [columns.of(term)[rows] for term in others]
    whole = np.concatenate(parts, axis=1)
    ends = np.cumsum([0, *(part.shape[1] for part in parts)])
    spans = [np.arange(a, b) for a, b in itertools.pairwise(ends)]
    one = np.zeros(len(rows), dtype=np.int64)
    sums = block_sums(whole, view.error[rows], found.weight[rows], one).total()
    noise = found.noise**2
    prior = np.full(len(sums.right), noise / (_LOOSE * sums.square / sums.weight))
    groups = [g for g in range(design.groups) if _stays(found, g)]
    for k, g in enumerate(groups):
        prior[spans[k]] = noise / found.variances.group[g]
    matrix = sums.products + np.diag(prior)
    owner = {design.terms[g]: k for k, g in enumerate(groups) if g < len(found.chosen)}

    def beside(base: np.ndarray, index: np.ndarray) -> tuple[float, float]:
        """Return what columns explain beside others, and how much of them is left."""
        inner = matrix[np.ix_(index, index)]
        right = sums.right[index]
        plain = np.trace(sums.products[np.ix_(index, index)])
        if base.size:
            cross = matrix[np.ix_(base, index)]
            solved = cho_solve(cho_factor(matrix[np.ix_(base, base)]), cross)
            inner = inner - cross.T @ solved
            right = right - solved.T @ sums.right[base]
        gain = float(right @ np.linalg.solve(inner, right)) - noise * len(index)
        left = float(np.trace(inner) - prior[index].sum()) / max(plain, 1e-300)
        return gain, left

    every = np.concatenate(spans[:kept]) if kept else np.zeros(0, dtype=np.int64)
    hidden = []
    for k, term in enumerate(others):
        if beside(every, spans[kept + k])[1] < _HIDDEN:
            hidden.append(term)
    confused: list[Confused] = []
    for need in needs:
        mine = np.concatenate([spans[owner[term]] for term in need.terms])
        base = np.setdiff1d(every, mine)
        gain, _ = beside(base, mine)
        for k, term in enumerate(others):
            if _contained(need, term):
                continue
            share = beside(base, spans[kept + k])[0] / max(gain, 1e-300)
            if share >= _AS_WELL or (share >= _PARTLY and term in hidden):
                confused.append(Confused(need, term, min(share, 1.0)))
    return Look(tuple(confused), tuple(hidden))


def _stays(found: Selection, group: int) -> bool:
    """Return whether a group takes part: nuisance, and what was chosen."""
    if not found.variances.group[group] > 0:
        return False
    return group >= len(found.chosen) or bool(found.chosen[group])


def _contained(need: Need, other: Term) -> bool:
    """Return whether the other is only a richer form, or another sensor, of the same."""
    if need.compensation == "temperature" and other.kind in HEAT:
        return True
    for term in need.terms:
        # The other may stand in a richer form for what a simpler one explains.
        if other.kind in _CONTAINED.get(term.kind, ()):
            if set(term.masters) <= set(other.masters):
                return True
        if term.kind in (Kind.PUSH_PLACE, Kind.PUSH) and other.kind.name.startswith(
            "PUSH"
        ):
            if term.masters[0] == other.masters[0]:
                return True
    return False
