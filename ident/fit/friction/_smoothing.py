"""How smooth a free table should be: the weight with the largest evidence."""

import numpy as np

from ._covariance import _lag
from ._problem import Problem
from ._separable import scout

_WEIGHTS = np.geomspace(1e-2, 1e8, 31)
_NULL = 1e-12
"""Share of the largest eigenvalue below which no sample moves a direction."""


def choose_weight(problem: Problem, loss: str) -> float:
    """Return the weight of the smoothness prior that makes the recording most likely.

    Restricted likelihood of a linear model with Gaussian noise of unknown size. Residuals
    that resemble their neighbours carry less than their number says: they are thinned to
    the distance at which they stop doing so.
    """
    penalty = problem.penalty()
    assert penalty is not None
    share = scout(problem, loss)
    design = problem.design(np.zeros(0))
    root = np.sqrt(share)[:, None]
    x, y = design * root, problem.target * root[:, 0]
    size = np.sqrt((x**2).mean(axis=0))
    # A knot that no sample touches has only its neighbours to hold on to.
    size = np.where(size > 1e-6 * size.max(), size, size.max())
    x, prior = x / size, penalty / size / size[:, None]
    gram, moment = x.T @ x, x.T @ y
    spectrum, vectors = np.linalg.eigh(gram)
    seen = spectrum > _NULL * spectrum[-1]
    inner = vectors[:, seen].T @ moment
    free = y - x @ (vectors[:, seen] @ (inner / spectrum[seen]))
    every = 1 + _lag(free[:, None], problem.piece, len(free))
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
        seen = spectrum > 1e-12 * spectrum[-1]
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
