"""Which terms the error (or current) of one axis is made of.

The shape of every term (the coefficients of its functions) is estimated on one half of the
recording; its course over the other half, scaled to an rms of one, is one feature. So a term is
one coefficient, in mm rms, and `pysindy` selects among them by sequentially thresholded least
squares: a shape by chance does not come back in the other half. Halves are drawn many times, in
complementary pairs: N. Meinshausen, P. Bühlmann, J. R. Stat. Soc. B 72(4), 2010; R. D. Shah,
R. J. Samworth, same journal 75(1), 2013. Readings count by Student's distribution.
"""

import dataclasses
import functools
import itertools
import warnings
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.signals import independent
from ._columns import Columns, Design, place_where
from ._evidence import Groups, gram_of, robust_groups, scatter_of, weights_about
from ._terms import HEAT, Kind, Term
from ._view import AxisView, some_of

_MOST = 5_000
"""Rows that a first look takes."""
_FINER = (2.0, 2.0**0.5, 2.0**0.25, 2.0**0.125)
"""Steps of lags about the best of the coarse ones."""
_SOON = 15.0
"""Lag in s that is tried beside none."""
_PAIRS = 12
"""Complementary pairs of halves."""
_FOLLOWS = 0.5
"""Share of its shape that a term must keep in the other half."""
STABLE = 0.8
"""Share of the resamples in which a term must be selected."""
_FREE = 100.0
BEYOND_CHANCE = 50.0
"""Twice the log-likelihood that a temperature must gain over a drift in its place."""
_BEYOND_CHANCE = 15.0
"""The same for any other term, and one more for each of its functions: chance gives the best of
all terms 14 where it has one function, 23 where it has twelve, in a hundred readings."""


def look_at(
    columns: Columns, terms: Sequence[Term]
) -> tuple[Design, Int[np.ndarray, " n"], Groups]:
    """Return all columns, some rows, and the variances there, which show what is plainly absent.

    The weights of all readings about it go to the columns.
    """
    error, design = columns.view.error, columns.design(terms)
    rows = some_of(len(error), _MOST)
    some = design.columns[rows], design.slices, error[rows]
    groups = robust_groups(*some, lambda size: 0.05 * columns.view.least(size))
    left = error - design.columns @ groups.values
    # What neighbours have in common, as noise that remembers has, is told once.
    limit = 6.0 * scatter_of(left)
    parts = [np.clip(left[rows], -limit, limit) for rows in columns.view.sources]
    share = sum(min(independent(part), len(part)) for part in parts) / len(left)
    columns.weight = share * weights_about(left)
    return design, rows, groups


def choose_heat(
    columns: Columns, terms: Sequence[Term], heat: Sequence[Term]
) -> tuple[Term, ...]:
    """Return for offset and coefficient the sensor and lag, of some, that are likeliest.

    What grows about a place off the middle shifts the middle by the same sensor. Where the
    offset follows another one, that shift is a third term.
    """
    evidence, longest = _evidence_of(columns, terms), max(term.lag for term in heat)

    def turned(chosen: tuple[Term, ...]) -> tuple[Term, ...]:
        growth = [term for term in chosen if term.kind is Kind.HEAT_SLOPE]
        shift = [dataclasses.replace(each, kind=Kind.HEAT_OFFSET) for each in growth]
        return (*chosen, *shift)

    def likeliest(
        heat: Sequence[Term], whole: Callable[[tuple[Term, ...]], tuple[Term, ...]]
    ) -> tuple[Term, ...]:
        best = tuple[Term, ...]()
        for factor, kind in itertools.product((None, None, *_FINER), HEAT):
            others = tuple(term for term in best if term.kind is not kind)
            tried = [term for term in heat if term.kind is kind]
            if factor is not None:
                tried = [term for term in best if term.kind is kind]
                for term in tried[:]:
                    lags = term.lag * factor, term.lag / factor, _SOON * (term.lag == 0)
                    allowed = [lag for lag in lags if 0.0 < lag <= longest]
                    tried += [dataclasses.replace(term, lag=lag) for lag in allowed]
            choices = [(*others, term) for term in tried]
            best = max(choices, key=lambda each: evidence(whole(each)), default=best)
        return whole(best)

    best = likeliest(heat, lambda chosen: chosen)
    grows = {term.sensor for term in best if term.kind is Kind.HEAT_SLOPE}
    apart = [t for t in heat if (t.kind is Kind.HEAT_SLOPE) == (t.sensor in grows)]
    if {term.kind for term in apart} != {*HEAT}:
        return best
    three = likeliest(apart, turned)
    gain = 2.0 * (evidence(three) - evidence(best))
    return three if gain >= BEYOND_CHANCE else best


def _evidence_of(
    columns: Columns, terms: Sequence[Term]
) -> Callable[[tuple[Term, ...]], float]:
    """Return a function for the log evidence of few terms beside everything else.

    All other terms are estimated first and taken out, but for the drift.
    """
    design, rows, groups = look_at(columns, terms)
    slow = [len(design.slices) - 1] if columns.drift.shape[1] else []
    index, owner = groups.without(slow).present
    weight = columns.weight[rows]
    root = np.sqrt(weight)[:, None]
    # The terms that are known are taken out, their priors as readings of zero.
    prior = np.diag(groups.noise / np.sqrt(groups.variance[owner]))
    base = np.concatenate([design.columns[np.ix_(rows, index)] * root, prior])
    base = np.linalg.qr(base)[0]

    def projected(values: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "m k"]:
        block = np.zeros((len(base), values.shape[1]))
        block[: len(rows)] = values[rows] * root
        return np.asarray(block - base @ (base.T @ block))

    error, idle = projected(columns.view.error[:, None])[:, 0], projected(columns.drift)
    block = functools.cache(lambda term: projected(columns.of(term)))

    @functools.cache
    def evidence(chosen: tuple[Term, ...]) -> float:
        local = Design.of(chosen, [block(term) for term in chosen], (idle,))
        fitted = Groups.of(local.columns, local.slices, error, np.ones(len(error)))
        fitted = dataclasses.replace(fitted, weight=float(weight.sum()))
        return fitted.estimated(1e-3 * groups.noise).evidence

    return evidence


@dataclasses.dataclass(frozen=True)
class Selection:
    """Terms of the error of one axis.

    Attributes:
        columns: Features of all terms, with the readings.
        design: Columns of the terms that were not plainly absent, and of the nuisance.
        groups: With the values of the chosen terms and the nuisance.
        frequency: How often each term of the design was selected, 0 to 1.
        terms: What the error consists of.
        least: Contribution in mm or ° rms below which a term does not count.
        looked: Every term that was looked at.
    """

    columns: Columns
    design: Design
    groups: Groups
    frequency: Float[np.ndarray, " g"]
    terms: tuple[Term, ...]
    least: float
    looked: tuple[Term, ...]

    @property
    def view(self) -> AxisView:
        """The readings."""
        return self.columns.view

    @cached_property
    def residual(self) -> Float[np.ndarray, " t"]:
        """What the chosen terms and the nuisance leave."""
        return np.asarray(self.view.error - self.design.columns @ self.groups.values)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a reading about all chosen terms."""
        return scatter_of(self.residual)

    @cached_property
    def clean(self) -> Float[np.ndarray, " t"]:
        """The error without the zeros of the instruments and without wild readings."""
        limit = 6.0 * self.noise
        explained = self.view.error - self.residual
        error = explained + np.clip(self.residual, -limit, limit)
        return self.view.centred(error[:, None])[:, 0]

    @property
    def square(self) -> float:
        """Mean square of the error, or of the current."""
        return float(np.mean(self.clean**2)) + self.view.level**2 or 1.0

    def slow(self, runs: bool = False) -> Float[np.ndarray, " t"]:
        """Return what a drift, with it the offsets of runs, contributes to each reading."""
        drift, values = self.columns.drift, self.groups.values
        columns = np.hstack([self.columns.runs, drift]) if runs else drift
        return np.asarray(columns @ values[len(values) - columns.shape[1] :])

    def part(self, term: Term) -> Float[np.ndarray, " t"]:
        """Return what a term contributes to each reading."""
        (group,) = self.index([term])
        values = self.groups.values[self.design.slices[group]]
        return np.asarray(self.columns.of(term) @ values)

    def pivot(self, terms: Sequence[Term]) -> float | None:
        """Return the position in mm that growth leaves in place where two offsets act."""
        offsets = {t.sensor: t for t in terms if t.kind is Kind.HEAT_OFFSET}
        growth = [t for t in terms if t.kind is Kind.HEAT_SLOPE and t.sensor in offsets]
        if len(offsets) < 2 or not growth:
            return None
        pair = self.index([offsets[growth[0].sensor], *growth])
        shift, slope = (self.groups.values[self.design.slices[g]] for g in pair)
        if not slope.any():
            return None
        low, high = self.view.span[growth[0].axis]
        # The features of the growth are those of the shift times that of the place.
        share = place_where(-float(shift @ slope) / float(slope @ slope))
        return round(low + share * (high - low), 1)

    def index(self, terms: Sequence[Term]) -> list[int]:
        """Return the groups of some terms."""
        return [self.design.terms.index(term) for term in terms]

    def size_of(self, terms: Sequence[Term]) -> tuple[float, float]:
        """Return rms and share of the mean square of the error of terms together."""
        course = np.sum([self.part(term) for term in terms], axis=0)
        share = float(np.clip(np.mean(course * self.clean) / self.square, 0.0, 1.0))
        return float(np.sqrt(np.mean(course**2))), share


def select_terms(
    columns: Columns, terms: Sequence[Term], looked: Sequence[Term] | None = None
) -> Selection:
    """Return the terms, of candidates, that the error (or current) of an axis consists of.

    Where others have been looked for already, the weights of readings serve again.
    """
    retained = list(terms)
    if looked is None:
        variance = look_at(columns, terms)[2].variance
        retained = [term for term, var in zip(terms, variance, strict=False) if var > 0]
    view, design = columns.view, columns.design(retained)
    groups = Groups.of(design.columns, design.slices, view.error, columns.weight)
    size = groups.size
    groups = groups.estimated(0.1 * view.least(size))
    least = view.least(size, groups.noise)
    frequency = _selection_frequency(columns, design, groups, least)
    chosen = _without_needless(groups, retained, frequency >= STABLE, least)
    variance = groups.without(np.flatnonzero(~chosen).tolist()).variance
    # A drift is there again where the term that took its place is not.
    variance[len(retained) :] = size**2
    groups = dataclasses.replace(groups, variance=variance).estimated(0.1 * least)
    selected = tuple(term for term, on in zip(retained, chosen, strict=True) if on)
    all_terms = tuple(terms if looked is None else looked)
    return Selection(columns, design, groups, frequency, selected, least, all_terms)


def _selection_frequency(
    columns: Columns, design: Design, groups: Groups, least: float
) -> Float[np.ndarray, " g"]:
    """Return how often each term was selected, 0 to 1, in halves of the recording."""
    error, weight, block = columns.view.error, columns.weight, columns.view.block
    count, terms = int(block.max()) + 1, len(design.terms)
    rows = [np.flatnonzero(block == k) for k in range(count)]
    grams = np.stack([gram_of(design.columns[r], error[r], weight[r]) for r in rows])
    weights = np.bincount(block, weight)

    def half(pieces: Int[np.ndarray, " k"]) -> Groups:
        gram, total = grams[pieces].sum(axis=0), float(weights[pieces].sum())
        return dataclasses.replace(groups, gram=gram, weight=total)

    rng, hits = np.random.default_rng(0), np.zeros(terms)
    for _ in range(_PAIRS):
        order = rng.permutation(count)
        parts = half(order[: count // 2]), half(order[count // 2 :])
        for shape, proof in (parts, parts[::-1]):
            hits += _selected(proof, shape.values, terms, least)
    return hits / (2 * _PAIRS)


def _selected(
    groups: Groups, values: Float[np.ndarray, " p"], terms: int, least: float
) -> Bool[np.ndarray, " g"]:
    """Return which terms one half selects with the shapes of the other."""
    import pysindy

    nuisance = slice(0, groups.slices[terms].start)
    shapes = np.zeros((nuisance.stop, terms))
    for g, part in enumerate(groups.slices[:terms]):
        shapes[part, g] = values[part]
    # Scaled by what a term does in all, not by what the drift leaves of a slow one.
    size = np.sum(shapes * (groups.gram[nuisance, nuisance] @ shapes), axis=0)
    size = np.sqrt(np.maximum(size, 0.0) / groups.weight)
    active = size > 1e-3 * least
    chosen = np.zeros(terms, dtype=bool)
    if not active.any():
        return chosen
    reduced = groups.without(range(terms)).reduced(nuisance)
    shapes, scale = shapes[:, active], size[active] * np.sqrt(groups.weight)
    matrix = shapes.T @ reduced[:-1, :-1] @ shapes / np.outer(scale, scale)
    right = shapes.T @ reduced[:-1, -1] / scale / np.sqrt(groups.weight) / least
    # A square root of the sums gives the same regression as the rows, at any length.
    squares, axes = np.linalg.eigh(matrix)
    root = np.sqrt(np.maximum(squares, 1e-12))
    optimizer = pysindy.STLSQ(threshold=1.0, alpha=1e-6, max_iter=40, unbias=False)
    with warnings.catch_warnings():
        # It warns where nothing is left, which is an answer.
        warnings.filterwarnings("ignore", "Sparsity parameter is too big")
        optimizer.fit((axes * root).T, (axes.T @ right / root)[:, None])
    factors = np.asarray(optimizer.coef_)[0]
    chosen[active] = (factors >= 1.0) & (factors * least > _FOLLOWS * size[active])
    return chosen


def _without_needless(
    groups: Groups, terms: Sequence[Term], chosen: Bool[np.ndarray, " g"], least: float
) -> Bool[np.ndarray, " g"]:
    """Return the terms without those whose part the others take over, simplest first."""
    keep, nuisance = chosen.copy(), len(chosen)
    # Terms that share one effect have a part of its variance: any may take the whole of it.
    variance = groups.variance.copy()
    variance[:nuisance] *= np.where(keep, _FREE, 0.0)
    free = dataclasses.replace(groups, variance=variance)
    while True:
        needless: dict[int, tuple[int, float]] = {}
        rest_of = groups.without(np.flatnonzero(~keep).tolist())
        for g in np.flatnonzero(keep).tolist():
            cost = float(np.sqrt(max(free.gain([g]), 0.0) / free.weight))
            count = groups.slices[g].stop - groups.slices[g].start
            heated = terms[g].kind in HEAT
            idle = cost < least and not heated
            if not idle:
                full, single = rest_of.with_and_without(g, nuisance, 0.1 * least)
                worth = 2.0 * (full.evidence - single.evidence)
                idle = worth < (BEYOND_CHANCE if heated else _BEYOND_CHANCE + count)
            if idle:
                needless[g] = count, -cost
        if not needless:
            return keep
        # Of several that are too many, the one with most functions goes first.
        worst = max(needless, key=lambda g: needless[g])
        keep[worst] = False
        free = free.without([worst])
