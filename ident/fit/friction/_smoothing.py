"""How smooth a free table should be: the weight with the largest evidence."""

import functools

import numpy as np
from jaxtyping import Float, Int

from ._covariance import lag_of, lags_of
from ._equation import AbstractEquation
from ._lanes import Shares
from ._structure import AbstractStructure

_WEIGHTS = np.geomspace(1e-2, 1e8, 31)
_NULL = 1e-12
"""Share of the largest eigenvalue below which no sample moves a direction."""
_SURE = 1e10
"""Condition up to which the straight part of the law is simply eliminated."""


def choose_weights(
    equation: AbstractEquation, shares: Shares
) -> Float[np.ndarray, " w"]:
    """Return the weight of the smoothness prior that makes each fit's rows most likely.

    Restricted likelihood of a linear model with Gaussian noise of unknown size. Residuals
    that resemble their neighbours carry less than their number says: they are thinned to
    the distance at which they stop doing so.

    The factors are told apart into bends, on which the prior is the identity, and what has
    none: inertia, offset and a straight line. The latter are eliminated, and one
    eigendecomposition of what is left serves all weights.
    """
    stack, of = equation.stack, equation.lanes.of
    sums = equation.sums(shares)
    total = np.einsum("ws,ws->w", shares.full, np.square(stack.target)[of])
    fixed = len(stack.one.fixed_names)
    bends = [_bends(each.structure, fixed) for each in stack.problems]
    change, flats = np.stack([one for one, _ in bends])[of], bends[0][1]
    sums = np.concatenate([sums[:, :, :-1] @ change, sums[:, :, -1:]], axis=2)
    sums = np.swapaxes(change, 1, 2) @ sums
    inner, reach = sums[:, :flats, :flats], sums[:, :flats, flats:]
    size = np.sqrt(np.maximum(np.einsum("wkk->wk", inner), 1e-300))
    area = size[:, :, None] * size[:, None]
    scaled = inner / area
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        return np.array([_weight_of(equation, shares, k) for k in range(len(sums))])
    with np.errstate(invalid="ignore"):
        condition = np.square(scaled).sum(axis=(1, 2)) * np.square(inverse).sum((1, 2))
        sure = condition < _SURE**2
    solved = (inverse / area) @ reach
    rest = sums[:, flats:, flats:] - np.swapaxes(reach[:, :, :-1], 1, 2) @ solved
    total = total - np.einsum("wk,wk->w", reach[:, :, -1], solved[:, :, -1])
    spectrum, vectors = np.linalg.eigh(rest[:, :, :-1])
    spectrum = np.maximum(spectrum, 0.0)
    along = np.einsum("wks,wk->ws", vectors, rest[:, :, -1])
    seen = spectrum > _NULL * spectrum[:, -1:]
    bent = np.where(seen, along / np.where(seen, spectrum, 1.0), 0.0)
    bent = np.einsum("wks,ws->wk", vectors, bent)
    straight = solved[:, :, -1] - np.einsum("wkb,wb->wk", solved[:, :, :-1], bent)
    factors = change @ np.concatenate([straight, bent], axis=1)[:, :, None]
    count = _independent(equation, shares, factors[:, :, 0])
    weights = _WEIGHTS[:, None]
    both = spectrum[:, None] + weights
    left = total[:, None] - np.einsum("ws,wgs->wg", along**2, 1.0 / both)
    score = (count - flats)[:, None] * np.log(np.maximum(left, 1e-300))
    score += np.log(both).sum(axis=2) - spectrum.shape[1] * np.log(_WEIGHTS)
    chosen = _WEIGHTS[np.argmin(score, axis=1)]
    for lane in np.flatnonzero(~sure):
        chosen[lane] = _weight_of(equation, shares, int(lane))
    return np.asarray(chosen)


@functools.lru_cache(maxsize=256)
def _bends(
    structure: AbstractStructure, fixed: int
) -> tuple[Float[np.ndarray, "k k"], int]:
    """Return factors per straight part and bends, and how many the straight part has.

    Bends are in the measure of the prior.
    """
    bend = structure.bends()
    assert bend is not None
    width = bend.shape[1]
    ends = np.zeros((2, width))
    ends[0, 0] = ends[1, -1] = 1.0
    back = np.linalg.inv(np.concatenate([ends, bend]))
    ways = structure.ways
    flats = fixed + 2 * ways
    change = np.zeros((fixed + ways * width, fixed + ways * width))
    change[:fixed, :fixed] = np.eye(fixed)
    for way in range(ways):
        rows = slice(fixed + way * width, fixed + (way + 1) * width)
        change[rows, fixed + 2 * way : fixed + 2 * way + 2] = back[:, :2]
        own = flats + way * (width - 2)
        change[rows, own : own + width - 2] = back[:, 2:]
    return change, flats


def _independent(
    equation: AbstractEquation,
    shares: Shares,
    factors: Float[np.ndarray, "w k"],
) -> Int[np.ndarray, " w"]:
    """Return how many rows each fit has that do not resemble their neighbours."""
    stack, of = equation.stack, equation.lanes.of
    left = equation.left(factors, None)
    left *= shares.full if shares.plain else np.sqrt(shares.full)
    seen = (shares.full > 0).sum(axis=1)
    pieces = [np.ascontiguousarray(each.piece) for each in stack.problems]
    own = [pieces[k] for k in of]
    rows = [each[: len(piece), None] for each, piece in zip(left, own, strict=True)]
    every = 1 + lags_of(rows, own)
    return np.asarray(np.maximum(seen // every, factors.shape[1] + 2))


def _weight_of(equation: AbstractEquation, shares: Shares, lane: int) -> float:
    """Return the weight for a fit whose straight part its rows do not tell."""
    problem = equation.stack.problems[equation.of(lane)]
    penalty = problem.penalty()
    assert penalty is not None
    share = shares.full[lane, : len(problem.target)]
    root = np.sqrt(share)[:, None]
    x, y = problem.still * root, problem.target * root[:, 0]
    size = np.sqrt((x**2).mean(axis=0))
    # A knot that no sample touches has only its neighbours to hold on to.
    size = np.where(size > 1e-6 * size.max(), size, size.max())
    x, prior = x / size, penalty / size / size[:, None]
    gram, moment = x.T @ x, x.T @ y
    spectrum, vectors = np.linalg.eigh(gram)
    seen = spectrum > _NULL * spectrum[-1]
    inner = vectors[:, seen].T @ moment
    free = y - x @ (vectors[:, seen] @ (inner / spectrum[seen]))
    every = 1 + lag_of(free, problem.piece)
    count = max(int((share > 0).sum()) // every, len(penalty) + 2)
    thin = count / max(int((share > 0).sum()), 1)
    gram, moment, total = thin * gram, thin * moment, thin * (y @ y)
    values = np.linalg.eigvalsh(prior)
    rank = int((values > 1e-10 * values.max()).sum())
    flat = len(prior) - rank
    best, chosen = np.inf, float(_WEIGHTS[0])
    weights = _WEIGHTS * thin
    both = np.linalg.eigh(gram + weights[:, None, None] * prior)
    for weight, spectrum, vectors in zip(weights, *both, strict=True):
        seen = spectrum > _NULL * spectrum[-1]
        inner = vectors[:, seen].T @ moment
        rest = max(total - float(inner**2 @ (1 / spectrum[seen])), 1e-300)
        score = (
            (count - flat) * np.log(rest)
            + float(np.log(spectrum[seen]).sum())
            - rank * np.log(weight)
        )
        if score < best:
            best, chosen = float(score), float(weight / thin)
    return chosen
