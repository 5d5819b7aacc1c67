"""The four smoothness weights as logarithms relative to the density of the readings.

Order of the four: second and fourth differences along the slow axis, then along the fast one.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from ._grid import Grid
from ._prior import Smoothness, TablePrior
from ._problem import Problem

LOW = float(np.log(1e-4))
"""Below this fourth differences do nothing."""
LEAST = np.log((1e-7, 1e-4, 1e-7, 1e-4))
"""Lower ends: errors may bend a thousand times further from node to node than they scatter."""
_FOURTH = np.array([False, True, False, True])
FILL = 1e-9
"""Weight relative to the density that fills gaps where no smoothness was asked for."""
HIGH = np.log((1e9, 1e11, 1e9, 1e11))
"""Above these the matrix loses the digits that the readings need."""
_STRAIGHT = 1e4, 1e2
"""Weight × least bend, relative to the density, from which on second differences leave as good
as a straight line, and fourth differences a cubic."""


def smoothness_of(log: Float[np.ndarray, " 4"], density: float) -> Smoothness:
    """Return weights from logarithms relative to the density.

    Fourth differences at the lower end are left out; second differences never are, since the
    fourth ones alone would leave cubics undetermined.
    """
    return weights_of(np.where(_FOURTH & (log <= LOW + 1e-9), -np.inf, log), density)


def weights_of(log: Float[np.ndarray, " 4"], density: float) -> Smoothness:
    """Return weights from logarithms relative to the density; −∞ is no weight."""
    weights = np.exp(log) * density
    return Smoothness((weights[0], weights[1]), (weights[2], weights[3]))


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


def stiffest(prior: TablePrior) -> Float[np.ndarray, " 4"]:
    """Return the upper ends of the logarithms for a prior.

    No higher than a table that is straight needs: what lies above only costs digits.
    """
    weights = [np.inf] * 4
    for k, chain in enumerate((prior.slow, prior.fast)):
        if chain is not None:
            weights[2 * k : 2 * k + 2] = [
                most / bend if bend > 0 else np.inf
                for most, bend in zip(_STRAIGHT, chain.least_bends, strict=True)
            ]
    return np.minimum(np.log(weights), HIGH)


def spread_logs(
    mask: Bool[np.ndarray, " 4"], reduced: np.ndarray
) -> Float[np.ndarray, " 4"]:
    # No weight at all where there is nothing to weigh.
    log = np.full(4, -np.inf)
    log[mask] = reduced
    return log
