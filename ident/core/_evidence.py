"""Weights of the prior by restricted maximum likelihood (the evidence): one search.

The logarithms of all weights are searched by L-BFGS-B with exact slopes. With and without
fourth differences are two valleys: the second is descended into from the floor of the first,
and fourth differences must be worth their place. A large plane is searched on a third of its
nodes first.

Source: H. D. Patterson, R. Thompson, Biometrika 58(3), 1971.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import fmin_l_bfgs_b

from ._effect import TableEffect
from ._posterior import Posterior, Problem
from ._readings import Readings, Vector
from ._stack import Stack

_SCALES = (1e-3, 1e-1, 1e1, 1e3, 1e5)
"""Weights of second differences, relative to the density, that are tried first."""
_LIFTS, _EASED = ((1.0, 1.0), (1.0, 10.0), (1.0, 100.0)), 0.1
"""Weights of second differences from which fourth ones are tried, relative to the best ones of
second differences alone; those of fourth ones, relative to their square; and the factor of the
former beside them."""
_FAR, _EVERY = ((1e2, 1.0), (1e3, 1.0)), 0.9
"""Those that are tried as well where second differences alone leave less than a tenth of the
readings to the noise: they follow each of a single run, and do not say how smooth the table is."""
_WORTH = 2.0
"""Gain in evidence below which the simpler of two priors is taken."""
_LOOSER = (1e-3, 1e-2, 1e-1, 1e0, 1e1)
"""Weights of second differences, relative to the density, that predict a ripple, too."""
_CONTRADICTED, _SPARE, _COSTLY = 6.0, 0.25, 1.2
"""Gain in prediction, as of −2 log-likelihood, from which on readings contradict the prior; share
of the readings that must be left to judge it; and readings that an unknown counts for, as
cross-validation by itself follows the noise of one sample in some."""
_NEXT, _FARTHEST, _UNLIKELY = 10.0**0.5, 8, 0.02
"""Factor between weights that are asked how likely they are, how many on each side, and the
likelihood relative to the best ones at which that ends."""
_FINE, _COARSE = 1e-2, 0.3
"""Gain of a step at which the search ends: on small stacks, on large ones."""
_SHARE, _EPSILON = 1e-4, float(np.finfo(np.float64).eps)
"""Share of the evidence that the optimiser sees, and the unit of its limit."""
_LARGE = 2e7
"""Operations of one factor from which on a stack is large."""
_THINNED, _ENOUGH = 3, 8
"""Of so many nodes along each axis of a plane one is kept for the first search, if more than
so many are left: fewer do not show fourth differences."""

Spread = Float[np.ndarray, " _n"] | Float[np.ndarray, "_n _n"]
View = Callable[[Posterior], tuple[Vector, Spread]]
"""Returns some values of a posterior, and their variances, or covariance, for noise 1."""


def choose_weights(problem: Problem, near: Posterior | None = None) -> Posterior | None:
    """Return the posterior with the best evidence; None where no weights give one.

    Less smoothness is taken where readings contradict the prior: see `_loosened`.

    Args:
        problem: Sums about a current estimate.
        near: Of this problem, with weights near the best ones; what is 0 there stays 0.
    """
    best = _likeliest(problem, near)
    return best if best is None or _is_large(problem) else _loosened(problem, best)


def _likeliest(problem: Problem, near: Posterior | None) -> Posterior | None:
    """Return the posterior with the best evidence; arguments as `choose_weights`."""
    if not len(problem.density):
        return problem.at(np.zeros(0))
    gain = _COARSE if _is_large(problem) else _FINE
    if near is not None:
        return _descend(problem, near, gain)
    table = problem.stack.table if _is_large(problem) else None
    nodes = () if table is None else table.nodes
    # A plane with nodes to spare; a border stays as wide as it is.
    if len(nodes) == 2 and min(map(len, nodes)) > _ENOUGH * _THINNED:
        thinned, refine = _thinned(problem)
        coarse = _likeliest(thinned, None)
        start = None if coarse is None else _best_of(problem, [refine(coarse.weights)])
        if start is not None:
            return _descend(problem, start, gain)
    start = _scanned(problem)
    best = None if start is None else _descend(problem, start, gain)
    if best is None or not problem.stack.optional.any():
        return best
    bent = _bent(problem, best)
    other = None if bent is None else _descend(problem, bent, gain)
    if other is None or other.evidence >= best.evidence - _WORTH:
        return best
    return _simplified(problem, other, gain)


def _loosened(problem: Problem, best: Posterior) -> Posterior:
    """Return the posterior, or one of less smoothness that predicts readings far better.

    The evidence believes the prior: a ripple as short as the nodes (the pitch of a screw),
    which no prior of differences expects, is noise to it, however well it comes back in every
    run. Generalised cross-validation does not (G. Wahba, Ann. Statist. 13(4), 1985; with
    dearer unknowns: Y.-J. Kim, C. Gu, J. R. Statist. Soc. B 66(2), 2004).
    """

    def cost(square: float, used: float) -> float:
        spare = problem.count - _COSTLY * used
        if spare < _SPARE * problem.count:
            return np.inf  # a fit through every reading says nothing of the next one
        return problem.count * float(np.log(max(square, 1e-300)) - 2.0 * np.log(spare))

    fewest = best.used
    lowest = cost(best.residual_square, fewest) - _CONTRADICTED
    groups = []
    for prior, _, terms in problem.stack.priors if np.isfinite(lowest) else ():
        if prior.optional.any():
            # All axes of a table at once, then each by itself.
            axes = [slice(k, k + 2) for k in range(terms.start, terms.stop, 2)]
            groups += [terms, *axes] if len(axes) > 1 else [terms]
    second = np.where(problem.stack.optional, 0.0, problem.density)
    for terms in groups:
        for scale in _LOOSER:
            weights = best.weights.copy()
            weights[terms] = scale * second[terms]
            looser = problem.at(weights)
            if looser is None:
                continue
            if cost(looser.residual_square, fewest) >= lowest:
                break  # with more smoothness residuals are larger still
            predicted = cost(looser.residual_square, looser.used)
            if predicted < lowest:
                best, lowest = looser, predicted
    return best


def spread_of(post: Posterior, view: View) -> Spread:
    """Return variances, or a covariance, which know that the smoothness is estimated, too.

    The mean over smoother and rougher tables, each as likely as its evidence says; on a large
    stack, where readings leave little doubt of the weights, that of the best ones alone. The
    posterior is that at the best weights.
    """
    values, within = view(post)
    total, sums = 1.0, post.variance * within
    if _is_large(post.problem) or not post.weights.any():
        return sums
    low, high = np.exp(post.problem.bounds.T)
    for step in (_NEXT, 1.0 / _NEXT):
        weights = post.weights
        for _ in range(_FARTHEST):
            weights = np.where(weights > 0.0, np.clip(step * weights, low, high), 0.0)
            other = post.problem.at(weights)
            if other is None:
                break
            # What the readings contradict is believed by its evidence all the same.
            gain = post.evidence - other.evidence
            share = float(np.exp(0.5 * gain)) if gain < _CONTRADICTED else 0.0
            if share < _UNLIKELY:
                break
            other_values, within = view(other)
            change = other_values - values
            across = np.square(change) if within.ndim == 1 else np.outer(change, change)
            sums = sums + share * (other.variance * within + across)
            total += share
    return np.asarray(sums / total)


def _is_large(problem: Problem) -> bool:
    stack = problem.stack
    width = max(stack.offsets) if stack.band else 0
    dense = stack.size - stack.band
    operations = stack.band * ((2.0 * width) ** 2 + width * dense) + dense**3
    return bool(operations > _LARGE)


def _scanned(problem: Problem) -> Posterior | None:
    """Return the best of a few posteriors without fourth differences."""
    tables = np.zeros(len(problem.density), bool)
    for prior, _, terms in problem.stack.priors:
        tables[terms] = prior.optional.any()
    second = np.where(problem.stack.optional, 0.0, problem.density)
    trials = [np.where(tables, scale, 1.0) * second for scale in _SCALES]
    return _best_of(problem, trials)


def _bent(problem: Problem, plain: Posterior) -> Posterior | None:
    """Return the best of a few posteriors with fourth differences.

    They start where second differences by themselves ended: what those hold in place of
    curvature, fourth ones hold with their square.
    """
    fourth = np.flatnonzero(problem.stack.optional)
    second = fourth - 1
    relative = (plain.weights / problem.density)[second]
    trials, lifts = [], _FAR if plain.used > _EVERY * problem.count else ()
    for stiff, lift in _LIFTS + lifts:
        weights = plain.weights.copy()
        weights[second] *= _EASED * stiff
        weights[fourth] = lift * (stiff * relative) ** 2 * problem.density[fourth]
        trials.append(weights)
    return _best_of(problem, trials)


def _best_of(problem: Problem, trials: Sequence[Vector]) -> Posterior | None:
    low, high = np.exp(problem.bounds.T)
    best, at = None, 0
    for k, trial in enumerate(trials):
        weights = np.where(trial > 0.0, np.minimum(np.maximum(trial, low), high), 0.0)
        post = problem.at(weights)
        lowest = np.inf if best is None else best.evidence
        if post is not None and post.evidence < lowest:
            best, at = post, k
    if best is None or np.isfinite(best.carried).all():
        return best
    # So stiff along a thousand nodes that nobody can go on from there.
    return _best_of(problem, [*trials[:at], *trials[at + 1 :]])


def _descend(problem: Problem, start: Posterior, gain: float) -> Posterior:
    """Return the best posterior near that of a start; weights that are 0 stay 0."""
    active = start.weights > 0.0
    low, high = problem.bounds[active].T
    log = np.clip(np.log(start.weights[active]), low, high)
    # The curvature is about the number of unknowns that a weight leaves to the readings. The
    # optimiser's limit is relative to what was gained, where that is more than 1: it sees
    # a small share of it.
    scale = np.sqrt(_SHARE * np.maximum(0.5 * start.carried[active], 0.25))
    best, pending = start, [start]

    def cost(scaled: Vector) -> tuple[float, Vector]:
        nonlocal best
        post: Posterior | None
        if pending:
            post = pending.pop()  # the optimiser begins at the start
        else:
            weights = np.zeros(len(active))
            weights[active] = np.exp(np.minimum(np.maximum(scaled / scale, low), high))
            post = problem.at(weights)
        if post is None:
            return _SHARE * 1e6, np.zeros(len(scaled))
        value, slopes = post.evidence - start.evidence, post.slopes[active]
        if not np.isfinite([value, *slopes]).all():
            return _SHARE * 1e6, np.zeros(len(scaled))
        if value < best.evidence - start.evidence:
            best = post
        return _SHARE * value, _SHARE * slopes / scale

    fmin_l_bfgs_b(
        cost, log * scale, bounds=np.column_stack([low * scale, high * scale]),
        factr=_SHARE * gain / _EPSILON, pgtol=np.sqrt(_SHARE * gain), maxiter=60,
    )  # fmt: skip
    return best


def _simplified(problem: Problem, best: Posterior, gain: float) -> Posterior:
    """Return the posterior without fourth differences that are not worth their place."""
    for prior, _, terms in problem.stack.priors:
        drop = np.zeros(len(best.weights), bool)
        drop[terms] = prior.optional
        if drop.all() or not best.weights[drop].any():
            continue
        if int((best.weights[problem.stack.optional] > 0).sum()) == int(drop.sum()):
            continue
        start = _best_of(problem, [np.where(drop, 0.0, best.weights)])
        other = None if start is None else _descend(problem, start, gain)
        if other is not None and other.evidence < best.evidence + _WORTH:
            best = other
    return best


def _thinned(problem: Problem) -> tuple[Problem, Callable[[Vector], Vector]]:
    """Return a plane on some of its nodes, and the map from its weights to those on all of them.

    Every third node along each axis is kept: a fine cell lies in one coarse cell. Everything
    beside the plane stays.
    """
    stack, sums = problem.stack, problem.sums
    table = stack.table
    assert isinstance(table, TableEffect)
    grid = tuple(np.append(nodes[:-1:_THINNED], nodes[-1]) for nodes in table.nodes)
    coarse = dataclasses.replace(table, nodes=grid)
    # The fine nodes as readings of the coarse table.
    places = [mesh.reshape(-1) for mesh in np.meshgrid(*table.nodes)]
    fine = Readings(places[0], dict(zip(table.inputs, places, strict=True)))
    interpolation = Stack((coarse,)).matrix(fine)[np.argsort(table.place)]
    slim = Stack((coarse, *stack.effects[1:]))
    n, m = stack.band, slim.band
    # The fine estimate is no coarse table: the sums are taken about zero in its place.
    step = np.concatenate([-problem.theta[:n], np.zeros(stack.size - n)])
    thinned = sums.moved(step, problem.gain).reduced(slim, interpolation)
    theta = np.concatenate([np.zeros(m), problem.theta[n:]])
    order, factor = np.arange(len(problem.density)), np.ones(len(problem.density))
    if coarse.prior.axes != table.prior.axes:
        order[:4] = 2, 3, 0, 1
    pairs = zip(table.nodes, grid, strict=True)
    ratio = [(len(every) - 1) / (len(some) - 1) for every, some in pairs]
    for k, axis in enumerate(table.prior.axes):
        # Sums over nodes of squared differences: ∫f''² dx times distance³ along the
        # axis, ∫f''''² dx times distance⁷, per distance across.
        powers = np.array([ratio[axis - 1] ** 3, ratio[axis - 1] ** 7])
        factor[2 * k : 2 * k + 2] = powers / ratio[2 - axis]
    pins = np.concatenate([np.zeros(m), problem.held[n:]])
    result = Problem.of(thinned, theta, problem.gain, pins)
    result = dataclasses.replace(result, pinned=problem.pinned, times=problem.times)
    return result, lambda weights: weights[order] * factor
