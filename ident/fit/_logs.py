"""The four smoothness weights as logarithms relative to the density of the readings.

Order of the four: second and fourth differences along the slow axis, then along the fast one.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from ._grid import Grid
from ._posterior import Problem
from ._prior import Smoothness

LOW = float(np.log(1e-4))
"""Below this fourth differences do nothing."""
LEAST = np.log((1e-7, 1e-4, 1e-7, 1e-4))
"""Lower ends: errors may bend a thousand times further from node to node than they scatter."""
FILL = 1e-9
"""Weight relative to the density that fills gaps where no smoothness was asked for."""
HIGH = np.log((1e9, 1e11, 1e9, 1e11))
"""Above these the matrix loses the digits that the readings need."""


def smoothness_of(log: Float[np.ndarray, " 4"], density: float) -> Smoothness:
    """Return weights from logarithms relative to the density.

    Fourth differences at the lower end are left out; second differences never are, since the
    fourth ones alone would leave cubics undetermined.
    """
    weights = np.exp(log) * density
    weights[1::2][log[1::2] <= LOW + 1e-9] = 0.0
    return _smoothness(weights)


def fixed_smoothness(
    smoothness: float | Mapping[str, float], density: float, grid: Grid
) -> Smoothness:
    """Return the weights that the user asked for: one number, or those of an earlier fit."""
    if isinstance(smoothness, Mapping):
        return Smoothness.named(smoothness, grid.slow_column + 1)
    weight = max(smoothness, FILL * density)
    return Smoothness((weight, 0.0), (weight, 0.0) if grid.planar else (0.0, 0.0))


def active_weights(problem: Problem) -> Bool[np.ndarray, " 4"]:
    """Tell which of the four weights have any difference to act on."""
    result = []
    for chain in (problem.prior.slow, problem.prior.fast):
        parts = () if chain is None else (chain.second, chain.fourth)
        rows = [part.count_nonzero() for part in parts] or [0, 0]
        result += [count > 0 for count in rows]
    return np.array(result)


def _smoothness(weights: Float[np.ndarray, " 4"]) -> Smoothness:
    return Smoothness((weights[0], weights[1]), (weights[2], weights[3]))


def spread_logs(
    mask: Bool[np.ndarray, " 4"], reduced: np.ndarray
) -> Float[np.ndarray, " 4"]:
    # No weight at all where there is nothing to weigh.
    log = np.full(4, -np.inf)
    log[mask] = reduced
    return log
