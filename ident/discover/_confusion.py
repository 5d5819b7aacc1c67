"""What would explain the same as well: what the data cannot tell apart is said."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ._evidence import design_of, sums_of
from ._heat import AgainstDrift, against_drift, followed
from ._select import Selection
from ._terms import HEAT, PUSHES, Kind, Need, Term

_AS_WELL = 0.95
"""Share of what a compensation explains, at which a substitute is as good."""
_PARTLY = 0.3
"""The same, where the substitute cannot be seen beside all that was found."""
_HIDDEN = 0.05
"""Share of a feature that is left beside all that was found; below it is not seen."""
_ROWS = 6_000
_LOOSE = 10.0
"""Size of a substitute's coefficients, relative to the error: free."""
_SAME_COURSE = 0.999
"""Correlation of two sensors from which on either does for the other."""
_CONTAINED = {
    Kind.REVERSAL: (Kind.OWN_REVERSAL, Kind.MEMORY),
    Kind.LINE: (Kind.SURFACE,),
    Kind.PUSH: PUSHES,
    Kind.PUSH_PLACE: PUSHES,
}
"""Terms that a richer one may imitate; the simpler one is taken."""


@dataclasses.dataclass(frozen=True)
class Confusion:
    """What the data cannot tell.

    Attributes:
        others: What explains the same as a compensation, by compensation.
        hidden: Terms that could not be seen beside what was found.
        drift: What temperatures are against a drift in their place, by their terms.
    """

    others: dict[Need, list[Term]]
    hidden: tuple[Term, ...]
    drift: dict[tuple[Term, ...], AgainstDrift]


def look_for_confusion(
    found: Selection, needs: Sequence[Need], heat: Sequence[Term]
) -> Confusion:
    """Return which compensations something else would replace.

    Args:
        found: The selection of the axis.
        needs: Compensations made of it.
        heat: Temperature terms of all sensors and some lags.
    """
    drift = {}
    if heat and found.columns.drift.shape[1]:
        warm = [each.terms for each in needs if each.compensation == "temperature"]
        terms = warm[0] if warm else (_likest(found, heat),)
        against = _against_drift(found, terms)
        if against is not None:
            drift[terms] = against
    others, hidden = _substitutes(found, needs) if needs else ({}, [])
    return Confusion(others, tuple(hidden), drift)


def _likest(found: Selection, heat: Sequence[Term]) -> Term:
    """Return the temperature offset that changes most like the drift."""
    course = found.part(len(found.design.slices) - 1)
    shifts = [term for term in heat if term.kind is Kind.HEAT_OFFSET]
    return max(shifts, key=lambda term: followed(course, found.columns.of(term)))


def _against_drift(found: Selection, terms: Sequence[Term]) -> AgainstDrift | None:
    """Return what temperature terms are, beside all else that was found, against a drift."""
    columns, design = found.columns, found.design
    heat = np.concatenate([columns.of(term) for term in terms], axis=1)
    known = [
        g for g, t in enumerate(design.terms) if found.chosen[g] and t not in terms
    ]
    rest = [found.part(g) for g in known]
    nuisance = columns.nuisance
    return against_drift(
        columns.view.data.clock,
        heat,
        np.asarray(columns.view.error - np.sum(rest, axis=0)),
        np.concatenate([nuisance.zeros, nuisance.runs], axis=1),
        columns.drift,
    )


def _substitutes(
    found: Selection, needs: Sequence[Need]
) -> tuple[dict[Need, list[Term]], list[Term]]:
    """Return what explains the same as a compensation, and what cannot be seen."""
    view, design, group = found.view, found.design, found.variances.group
    others = [term for term in found.looked if term not in found.terms]
    rows = np.sort(np.random.default_rng(5).permutation(len(view.error))[:_ROWS])
    present = [g for g in range(len(design.slices)) if group[g] > 0]
    blocks = [design.columns[rows, design.slices[g]] for g in present]
    kept = len(blocks)
    blocks += [found.columns.of(_changing(term))[rows] for term in others]
    whole = design_of((), blocks, ())
    spans = [np.arange(each.start, each.stop) for each in whole.slices]
    sums = sums_of(whole.columns, view.error[rows], found.weight[rows])
    noise = found.noise**2
    prior = np.full(len(sums.right), noise * sums.weight / (_LOOSE * sums.square))
    for k, g in enumerate(present):
        prior[spans[k]] = noise / group[g]
    matrix = sums.products + np.diag(prior)

    def beside(base: np.ndarray, index: np.ndarray) -> tuple[float, float]:
        """Return what columns explain beside others, and how much of them is left."""
        inner, right = matrix[np.ix_(index, index)], sums.right[index]
        plain = float(np.trace(sums.products[np.ix_(index, index)]))
        if base.size:
            factor = cho_factor(matrix[np.ix_(base, base)])
            solved = cho_solve(factor, matrix[np.ix_(base, index)])
            inner = inner - matrix[np.ix_(index, base)] @ solved
            right = right - solved.T @ sums.right[base]
        gain = float(right @ np.linalg.solve(inner, right)) - noise * len(index)
        left = float(np.trace(inner) - prior[index].sum()) / max(plain, 1e-300)
        return gain, left

    every = np.concatenate(spans[:kept]) if kept else np.zeros(0, dtype=np.int64)
    away = zip(others, spans[kept:], strict=True)
    hidden = [term for term, span in away if beside(every, span)[1] < _HIDDEN]
    result: dict[Need, list[Term]] = {}
    for need in needs:
        own = [k for k, g in enumerate(present) if g in found.index(need.terms)]
        mine = np.concatenate([spans[k] for k in own])
        base = np.setdiff1d(every, mine)
        gain, _ = beside(base, mine)
        for term, span in zip(others, spans[kept:], strict=True):
            if not _contained(need, term):
                share = beside(base, span)[0] / max(gain, 1e-300)
                if share >= (_PARTLY if term in hidden else _AS_WELL):
                    result.setdefault(need, []).append(term)
    return result, hidden


def _changing(term: Term) -> Term:
    """Return a term without what is the same at any temperature: that is no sign of heat."""
    if term.kind is Kind.HEAT_SLOPE:
        return dataclasses.replace(term, kind=Kind.HEAT_CHANGE)
    return term


def _contained(need: Need, other: Term) -> bool:
    """Return whether the other is only a richer form, or another sensor, of the same."""
    if need.compensation == "temperature" and other.kind in HEAT:
        return True
    for term in need.terms:
        if other.kind in _CONTAINED.get(term.kind, ()):
            if other.kind in PUSHES:
                if term.masters[0] == other.masters[0]:
                    return True
            elif {*term.masters} <= {*other.masters}:
                return True
    return False


def sensors_alike(found: Selection, need: Need) -> tuple[str, ...]:
    """Return the sensors of a temperature, where others changed in the same way."""
    warm = found.view.data.temperature
    for term in need.terms:
        if term.kind not in HEAT or term.sensor is None:
            continue
        mine, alike = warm[term.sensor], [term.sensor]
        for name, other in warm.items():
            known = np.isfinite(mine) & np.isfinite(other)
            if name == term.sensor or known.sum() < 3:
                continue
            if np.ptp(mine[known]) > 0 and np.ptp(other[known]) > 0:
                if abs(np.corrcoef(mine[known], other[known])[0, 1]) > _SAME_COURSE:
                    alike.append(name)
        if len(alike) > 1:
            return tuple(alike)
    return ()
