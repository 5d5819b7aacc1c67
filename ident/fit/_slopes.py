"""How the evidence changes with its weights, from the inverse that the deviations need, too."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ._chain import ChainPrior
from ._posterior import Posterior
from ._prior import Smoothness

_STEP = 1e-3
"""Step in a logarithm for the slope of what costs nothing."""

Elements = dict[tuple[int, int], Float[np.ndarray, "l s"]]


def slopes(posterior: Posterior) -> Float[np.ndarray, " 4"]:
    """Return the slope of the evidence of a plane over the logarithms of its four weights.

    The table itself is where the evidence does not change with it: what is left are the
    penalties of the table and traces of inverse × penalty.
    """
    problem, smoothness = posterior.problem, posterior.smoothness
    prior = problem.prior
    assert prior.fast is not None
    # All elements at once: each walk over the factor costs the same.
    steps = dict.fromkeys(problem.normal.diagonals)
    steps |= dict.fromkeys((k, 0) for k in _reach(prior.slow, smoothness.slow))
    steps |= dict.fromkeys((0, k) for k in _reach(prior.fast, smoothness.fast))
    inverse = posterior.elements(steps)
    total = posterior.residual_square + posterior.penalty
    axes = (
        (prior.slow, posterior.values, {k: inverse[k, 0] for k, s in steps if not s}),
        (
            prior.fast,
            posterior.values.T,
            {s: inverse[0, s].T for k, s in steps if not k},
        ),
    )
    result = [
        problem.free * pull / total + spread
        for chain, values, own in axes
        for pull, spread in _terms(chain, values, own)
    ]
    weights = np.array([*smoothness.slow, *smoothness.fast])
    return np.asarray(weights * np.array(result) - _prior_slopes(posterior))


def _reach(chain: ChainPrior, weights: tuple[float, float]) -> range:
    return range(min(4 if weights[1] else 2, chain.size - 1) + 1)


def _terms(
    chain: ChainPrior,
    values: Float[np.ndarray, "n m"],
    inverse: dict[int, Float[np.ndarray, "n m"]],
) -> Iterator[tuple[float, float]]:
    """Yield the penalty for weight 1 and the trace of inverse × penalty, for both orders."""
    for gram, rows in zip(chain.grams, (chain.second, chain.fourth), strict=True):
        trace = 0.0
        for distance, own in inverse.items():
            twice = 2.0 if distance else 1.0
            pairs = gram.diagonal(distance) @ own[: chain.size - distance]
            trace += twice * float(pairs.sum())
        yield float(np.square(rows @ values).sum()), trace


def _prior_slopes(posterior: Posterior) -> Float[np.ndarray, " 4"]:
    """Return the slope of the log-determinant of the prior."""
    smoothness, prior = posterior.smoothness, posterior.problem.prior
    weights = np.array([*smoothness.slow, *smoothness.fast])
    result = np.zeros(4)
    for k in np.flatnonzero(weights):
        ends = []
        for factor in (np.exp(_STEP), np.exp(-_STEP)):
            moved = weights.copy()
            moved[k] *= factor
            ends.append(
                prior.logdet(Smoothness((moved[0], moved[1]), (moved[2], moved[3])))
            )
        result[k] = (ends[0] - ends[1]) / (2.0 * _STEP)
    return result
