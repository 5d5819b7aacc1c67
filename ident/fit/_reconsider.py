"""Second thoughts where readings agree with each other but not with the table.

A smooth start takes a sharp bend for a handful of wild readings: none of them is believed
there, so none of them can make the table rougher. Where a place lost most of its readings,
a table that begins at their medians is tried as well, and the likelihood decides.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from ._grid import Grid
from ._posterior import Posterior
from ._readings import Readings

_WILD_SHARE, _LOST_SHARE = 1e-2, 1e-4
"""Shares of wild readings and of places with all readings off, expected beforehand."""


def lost_places(
    node: Int[np.ndarray, " t"], wild: Bool[np.ndarray, " t"], size: int
) -> Bool[np.ndarray, " n"]:
    """Return the nodes that lost most of their several nearest readings."""
    return _lost(
        np.bincount(node, minlength=size), np.bincount(node[wild], minlength=size)
    )


def _lost(
    count: Int[np.ndarray, " n"], lost: Int[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    return np.asarray((count > 1) & (lost > 0.5 * count))


def crowded_places(
    node: Int[np.ndarray, " t"], wild: Bool[np.ndarray, " t"], size: int
) -> Bool[np.ndarray, " n"]:
    """Return the nodes with more wild readings side by side than chance puts there."""
    return crowded(
        np.bincount(node, minlength=size), np.bincount(node[wild], minlength=size)
    )


def crowded(
    count: Int[np.ndarray, " n"], lost: Int[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Return the same from the number of readings next to each node, and of wild ones."""
    several = (lost >= 3) & (lost > 0.2 * count)
    return np.asarray(several | _lost(count, lost))


def local_start(
    grid: Grid,
    node: Int[np.ndarray, " t"],
    values: Float[np.ndarray, "l s"],
    residual: Float[np.ndarray, " t"],
) -> Float[np.ndarray, "l s"]:
    """Return the table moved by the median residual of the several readings at each node."""
    moved = _medians(node, residual, grid.size).reshape(values.shape)
    return np.asarray(values + moved)


def _medians(
    node: Int[np.ndarray, " t"], residual: Float[np.ndarray, " t"], size: int
) -> Float[np.ndarray, " n"]:
    """Return the median residual at each node with several readings, else zero."""
    ascending = residual[np.lexsort((residual, node))]
    count = np.bincount(node, minlength=size)
    first, several = (np.cumsum(count) - count)[count > 1], count[count > 1]
    low, high = first + (several - 1) // 2, first + several // 2
    result = np.zeros(size)
    result[count > 1] = 0.5 * (ascending[low] + ascending[high])
    return result


def mixture_cost(
    readings: Readings,
    posterior: Posterior,
    node: Int[np.ndarray, " t"],
    limit: float,
    chosen: bool,
) -> float:
    """Return minus twice the log-likelihood with wild readings anywhere in the seen range.

    The readings of a lost place share one fault, about which they scatter like good ones.

    Args:
        readings: All readings.
        posterior: Table to judge.
        node: Node next to each reading.
        limit: Distance (× √weight) from which on a reading is wild, in mm or °.
        chosen: Whether the smoothness was chosen by the readings: then it must pay for itself.
    """
    residual = readings.residual(posterior.values, posterior.effects)
    root = np.sqrt(readings.weight)
    far = np.abs(residual) * root > limit
    lost = lost_places(node, far, readings.grid.size)
    shift = np.where(lost, _medians(node, residual, readings.grid.size), 0.0)
    apart = np.abs(residual - shift[node]) * root > limit
    used = ~far & ~lost[node]
    problem = posterior.problem
    free = max(int(used.sum()) - problem.prior.null - len(posterior.effects), 1)
    square = float(np.square(residual[used] * root[used]).sum()) + posterior.penalty
    good = float(np.log(2.0 * np.pi * max(square / free, 1e-300))) + 1.0
    span = 2.0 * float(np.log(max(np.ptp(residual), 1e-150)))
    beside = int((~apart & ~used).sum())
    wild, faults = int(apart.sum()), int(lost.sum())
    cost = (free + beside - faults) * good + (wild + faults) * span
    cost -= 2.0 * (wild * np.log(_WILD_SHARE) + faults * np.log(_LOST_SHARE))
    if chosen:
        cost += posterior.logdet - problem.prior.logdet(posterior.smoothness)
    return float(cost)
