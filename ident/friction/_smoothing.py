"""How smooth a free table should be: the weight of its prior with the largest evidence."""

import numpy as np
from jaxtyping import Float

from ._covariance import lag_of
from ._equation import Equation

_WEIGHTS = np.geomspace(1e-2, 1e8, 31)
_NULL = 1e-12
"""Share of the largest eigenvalue below which no row tells a direction."""


def choose_smoothness(
    equation: Equation,
    share: Float[np.ndarray, " s"],
    sums: Float[np.ndarray, "k k1"] | None = None,
) -> float:
    """Return the weight of the smoothness prior that makes the rows most likely.

    Restricted likelihood of a linear model with Gaussian noise of unknown size. Residuals
    that resemble their neighbours carry less than their number says: they count as many as
    lie at the distance at which they stop doing so. The factors are parted into bends, on
    which the prior is the identity, and what has none: inertia, offset and straight lines.
    The latter are eliminated, and one eigendecomposition serves all weights.

    Args:
        equation: Of a law with a prior.
        share: Weight of each row.
        sums: XᵀW [X, target], where they are known.
    """
    penalty = equation.penalty
    assert penalty is not None
    change, flats = _bends(penalty, len(equation.fixed_names), equation.structure.ways)
    design = equation.design(np.zeros(0))
    if sums is None:
        right = np.column_stack([design, equation.target])
        sums = (share[:, None] * design).T @ right
    square = float(share @ equation.target**2)
    sums = np.column_stack([change.T @ sums[:, :-1] @ change, change.T @ sums[:, -1]])
    size = np.sqrt(np.diag(sums)[:flats])
    size = np.where(size > 0, size, 1.0)
    inner = sums[:flats, :flats] / np.outer(size, size)
    inverse = np.linalg.pinv(inner, rcond=1e-10, hermitian=True) / np.outer(size, size)
    reach = sums[:flats, flats:]
    rest = sums[flats:, flats:] - reach[:, :-1].T @ inverse @ reach
    square -= float(reach[:, -1] @ inverse @ reach[:, -1])
    spectrum, vectors = np.linalg.eigh(rest[:, :-1])
    spectrum = np.maximum(spectrum, 0.0)
    along = vectors.T @ rest[:, -1]
    seen = spectrum > _NULL * spectrum[-1]
    bent = vectors[:, seen] @ (along[seen] / spectrum[seen])
    straight = inverse @ (reach[:, -1] - reach[:, :-1] @ bent)
    left = equation.target - design @ (change @ np.concatenate([straight, bent]))
    lag = lag_of((np.sqrt(share) * left)[:, None], equation.piece)
    rows = int((share > 0).sum()) // (1 + lag)
    count = max(rows, design.shape[1] + 2)
    raised = spectrum + _WEIGHTS[:, None]
    remaining = np.maximum(square - (along**2 / raised).sum(axis=1), 1e-300)
    score = (count - flats) * np.log(remaining)
    score += np.log(raised).sum(axis=1) - len(spectrum) * np.log(_WEIGHTS)
    return float(_WEIGHTS[np.argmin(score)])


def _bends(
    penalty: Float[np.ndarray, "b k"], fixed: int, ways: int
) -> tuple[Float[np.ndarray, "k k"], int]:
    """Return factors per straight part and bends, and how many the straight part has."""
    width = (penalty.shape[1] - fixed) // ways
    flats = fixed + 2 * ways
    chosen = np.zeros((flats, penalty.shape[1]))
    chosen[:fixed, :fixed] = np.eye(fixed)
    ends = [fixed + way * width + end for way in range(ways) for end in (0, width - 1)]
    chosen[np.arange(fixed, flats), ends] = 1.0
    return np.linalg.inv(np.concatenate([chosen, penalty])), flats
