"""Second thoughts where readings agree with each other but not with the table.

A smooth start takes a sharp bend for a handful of wild readings: none of them counts there, so
that none of them can make the table rougher. Where a node lost most of its readings, a table
that begins at their medians is tried as well, and the likelihood decides.
"""

import dataclasses

import numpy as np
import scipy.ndimage
from jaxtyping import Bool, Float, Int, Shaped

from ..core import Estimate, Passes, Readings, Stack, TableEffect
from ._result import nearest_nodes

_LIGHT = 1e-6
"""Weight relative to the density that leaves a start at local medians where it is."""
_ROUNDS = 10
"""Rounds of medians: readings between nodes belong to two of them, so one does not do."""
_WILD, _FAULTY = 1e-2, 1e-4
"""Shares of wild readings and of nodes with all readings off, expected beforehand."""
_FEW, _SHARE = 3, 0.2
"""Wild readings next to one node, and their share there, that chance does not put there."""


def crowded(nodes: Float[np.ndarray, "3 n"]) -> Bool[np.ndarray, " n"]:
    """Return the nodes (of `wild_readings`) with more wild readings than chance puts there."""
    count, _, wild = nodes
    several = (wild >= _FEW) & (wild > _SHARE * count)
    return np.asarray(_mostly(count, wild) | several)


def at_medians(stack: Stack, readings: Readings, estimate: Estimate) -> Estimate:
    """Return an estimate moved to the median reading of each node: where to begin anew."""
    size, design = stack.effects[0].size, stack.matrix(readings)
    node, start = nearest_nodes(stack, readings), estimate.values.copy()
    for _ in range(_ROUNDS):
        start[:size] += _medians(node, readings.value - design @ start, size)
    posterior = dataclasses.replace(estimate.posterior, values=start)
    return dataclasses.replace(estimate, posterior=posterior)


def lost(
    table: TableEffect,
    node: Int[np.ndarray, " t"],
    residual: Float[np.ndarray, " t"],
    wild: Bool[np.ndarray, " t"],
) -> Float[np.ndarray, " n"]:
    """Return by how much a table is off at its nodes if wild readings are right that agree.

    They are a neighbourhood of nodes that lost most of their readings, all to one side: a
    shape that the table does not have, or something that befell the instrument there. Nobody
    can tell these apart but by measuring again. Zero elsewhere.

    Args:
        table: The table.
        node: Nearest node of each reading.
        residual: Reading less table.
        wild: Which readings were left out.
    """
    size = table.size
    if not wild.any():
        return np.zeros(size)
    count = np.bincount(node, minlength=size)
    off = np.bincount(node[wild], minlength=size)
    places = np.unique(node[wild])
    shift = np.zeros(size)
    shift[places] = scipy.ndimage.median(residual[wild], node[wild], places)
    side = table.to_table(np.where(2 * off > count, np.sign(shift), 0.0))
    result = np.zeros(side.shape)
    for sign in (-1.0, 1.0):
        labels = np.zeros(side.shape, np.int64)
        scipy.ndimage.label(side == sign, output=labels)
        at = (labels > 0) & (np.bincount(labels.reshape(-1))[labels] >= _FEW)
        result[at] = table.to_table(shift)[at]
    return np.asarray(table.to_values(result))


def reconsidered(passes: Passes, readings: Readings, estimate: Estimate) -> Estimate:
    """Return the estimate, or one that believes readings which agree with each other.

    Worth its time where nodes of the table, the first effect, are `crowded`.
    """
    stack = passes.stack
    size, design = stack.effects[0].size, stack.matrix(readings)
    node, run = nearest_nodes(stack, readings), readings.inputs.get("run")
    count = np.bincount(node, minlength=size)
    near = at_medians(stack, readings, estimate)
    post = near.posterior
    light = post.weights if estimate.stated else _LIGHT * post.problem.density
    light = np.where(post.weights > 0.0, light, 0.0)
    rough = dataclasses.replace(post, weights=light)
    rival = passes.run(near=dataclasses.replace(near, posterior=rough))

    def judged(candidate: Estimate) -> tuple[np.ndarray, ...]:
        """Return residuals, nodes that lost most of theirs, what is wild, and about these nodes."""
        residual = np.asarray(readings.value - design @ candidate.values)
        limit = candidate.loss.limit * candidate.loss.scale
        wild = np.abs(residual) > limit
        faulty = _mostly(count, np.bincount(node[wild], minlength=size))
        shift = np.where(faulty, _medians(node, residual, size), 0.0)
        return residual, faulty, wild, np.abs(residual - shift[node]) > limit

    def cost(candidate: Estimate) -> float:
        """Return minus twice the log-likelihood with wild readings anywhere in their range.

        Readings of a node that lost most of them share one fault, about which they scatter
        like good ones.
        """
        post = candidate.posterior
        residual, faulty, wild, stray = judged(candidate)
        used = ~wild & ~faulty[node]
        free = max(int(used.sum()) - stack.free, 1)
        square = float(np.square(residual[used]).sum())
        square += post.total - post.residual_square
        good = float(np.log(2.0 * np.pi * max(square / free, 1e-300))) + 1.0
        span = 2.0 * float(np.log(max(np.ptp(residual), 1e-150)))
        shifted, strays = int((~stray & ~used).sum()), int(stray.sum())
        faults = int(faulty.sum())
        result = (free + shifted - faults) * good + (strays + faults) * span
        result -= 2.0 * (strays * np.log(_WILD) + faults * np.log(_FAULTY))
        if not estimate.stated:
            # A smoothness that the readings chose must pay for itself.
            result += post.evidence - post.problem.degrees * np.log(post.total)
        return float(result)

    def unforeseen(candidate: Estimate) -> float:
        """Return what a run held out leaves, about (generalised cross-validation)."""
        left = np.square(judged(candidate)[0]).sum()
        return float(left) / max(len(node) - candidate.posterior.used, 1.0) ** 2

    best = min((estimate, rival), key=cost)
    if best is rival or run is None:
        return best
    # What a node lost and every run shows again is no fault of a run.
    _, faulty, _, stray = judged(estimate)
    lost = [node == one for one in np.flatnonzero(faulty)]
    if any(len(np.unique(run[at])) > 1 and not stray[at].any() for at in lost):
        best = min((estimate, rival), key=unforeseen)
    return best


def _mostly(
    count: Shaped[np.ndarray, " n"], wild: Shaped[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Return which nodes lost most of their several readings."""
    return np.asarray((count > 1) & (wild > 0.5 * count))


def _medians(
    node: Int[np.ndarray, " t"], residual: Float[np.ndarray, " t"], size: int
) -> Float[np.ndarray, " n"]:
    """Return the median residual at each node with several readings, else zero."""
    medians = np.asarray(scipy.ndimage.median(residual, node, np.arange(size)))
    return np.where(np.bincount(node, minlength=size) > 1, medians, 0.0)
