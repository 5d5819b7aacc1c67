"""What a stack of small table fits found, as one result per fit.

All that is sums or picks of numbers is done for the whole stack; a lane only takes its part.
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .._prior import Smoothness
from .._reconsider import crowded_places
from .._runs import effects_of, run_medians
from .._suspects import contradicting, doubted, named, nearest
from .._types import RunEffect, TableFit
from .._verdict import fit_message, too_many_wild, uncertain
from ._passes import State
from ._request import TableRequest
from ._stack import Stack, located, with_equal_runs


@dataclasses.dataclass(frozen=True)
class _Found:
    """What the results of all lanes take their parts from.

    Attributes:
        residual: Reading − table − run effects.
        share: Weight that the loss left each reading.
        wild: Readings that were rejected.
        rejected: How many these are.
        noise: Of one reading, wild ones left out.
        spread: Range of the readings.
        deviation: Standard deviations of the nodes over (slow, fast).
        support: Readings that touch each node, over the same.
        tables: Values, deviations and support in the shape of the table.
        nearest: Node next to each reading.
        doubted: Whether the readings next to a node were mostly set aside.
        effects: Of the runs.
        suspects: Runs that contradict the others.
        covariance: Of neighbouring nodes.
    """

    residual: Float[np.ndarray, "k t"]
    share: Float[np.ndarray, "k t"]
    wild: Bool[np.ndarray, "k t"]
    rejected: Int[np.ndarray, " k"]
    noise: Float[np.ndarray, " k"]
    spread: Float[np.ndarray, " k"]
    deviation: Float[np.ndarray, "k n s"]
    support: Int[np.ndarray, "k n s"]
    tables: tuple[np.ndarray, ...]
    nearest: Int[np.ndarray, "k t"]
    doubted: Bool[np.ndarray, "k m"]
    effects: Sequence[tuple[RunEffect, ...]]
    suspects: Sequence[tuple[int, ...]]
    covariance: dict[tuple[int, int], Float[np.ndarray, "k n s"]]


def results_of(
    requests: Sequence[TableRequest], state: State
) -> Iterator[TableFit | None]:
    """Yield each lane's fit, or None where it must be looked at more closely."""
    problems = state.problems
    free = problems.count - state.factors.used
    fixed = not isinstance(requests[0].smoothness, str)
    solutions = state.solutions
    variance = solutions.residual_square / free if fixed else solutions.variance
    usable = state.sound & np.isfinite(variance) & np.isfinite(free)
    if fixed:  # the evidence must judge the noise
        usable &= free >= np.maximum(3.0, 0.02 * problems.count)
    # Nobody asks for the numbers of a lane that broke down.
    with np.errstate(invalid="ignore", over="ignore"):
        found = _found(state, variance, free)
    for k, request in enumerate(requests):
        yield _result(request, state, found, k) if usable[k] else None


def _found(
    state: State, variance: Float[np.ndarray, " k"], free: Float[np.ndarray, " k"]
) -> _Found:
    stack, active = state.problems.stack, state.active
    size = stack.size
    unknowns, inverse = state.solutions.unknowns, state.factors.inverse
    residual = stack.residual(unknowns)
    ratio = residual * np.sqrt(stack.weight) / state.scale.scale
    share = np.where(active, state.scale.share(ratio), 0.0)
    inner = np.where(active, stack.weight * np.square(residual), 0.0).sum(axis=1)
    own = np.diagonal(inverse, axis1=1, axis2=2)
    deviation = np.sqrt(np.maximum(variance[:, None] * own, 0.0))
    touching = (stack.columns[:, :, :size] > 0) & active[:, :, None]
    support = touching.sum(axis=1)
    node = _nearest(stack)
    bins = (node + size * np.arange(len(node))[:, None]).ravel()
    count, kept = (
        np.bincount(bins, weights, size * len(node)).reshape(-1, size)
        for weights in (None, share.ravel())
    )
    block = variance[:, None, None] * inverse[:, size:, size:]
    effects, suspects = _of_runs(stack, residual, unknowns[:, size:], block)
    return _Found(
        residual=residual,
        share=share,
        wild=~active,
        rejected=(~active).sum(axis=1),
        noise=np.sqrt(inner / np.maximum(free, 1e-9)),
        spread=np.ptp(stack.error, axis=1),
        deviation=_by_node(stack, deviation),
        support=_by_node(stack, support),
        tables=tuple(_tables(stack, own) for own in (unknowns, deviation, support)),
        nearest=node,
        doubted=doubted(count, kept),
        effects=effects,
        suspects=suspects,
        covariance={
            (step, 0): variance[:, None, None] * _steps(stack, inverse, step)
            for step in (0, 1)
        },
    )


def _by_node(stack: Stack, values: np.ndarray) -> np.ndarray:
    """Bring numbers over (branch, node), then run effects, to shape ``(k, n, s)``."""
    tables = values[:, : stack.size].reshape(-1, stack.branches, stack.nodes)
    return tables.transpose(0, 2, 1)


def _tables(stack: Stack, values: np.ndarray) -> np.ndarray:
    """Bring numbers over (branch, node), then run effects, to the shape of the tables."""
    tables = values[:, : stack.size].reshape(-1, stack.branches, stack.nodes)
    if stack.lanes[0].grid.layout.periodic:
        tables = np.concatenate([tables, tables[:, :, :1]], axis=2)
    return tables if stack.branches == 2 else tables[:, 0]


def _nearest(stack: Stack) -> Int[np.ndarray, "k t"]:
    """Return the node next to each reading, as flat index over (slow, fast)."""
    # Lanes of a stack differ in where their nodes lie, not in how they are counted.
    own = nearest(stack.lanes[0].grid, located(stack.lanes))
    return own.reshape(len(stack.lanes), -1)


def _of_runs(
    stack: Stack,
    residual: Float[np.ndarray, "k t"],
    values: Float[np.ndarray, "k c"],
    covariance: Float[np.ndarray, "k c c"],
) -> tuple[list[tuple[RunEffect, ...]], list[tuple[int, ...]]]:
    """Return the effects of the runs and those that contradict the others, by lane."""
    effects: list[tuple[RunEffect, ...]] = [() for _ in stack.lanes]
    suspects: list[tuple[int, ...]] = [() for _ in stack.lanes]
    size = np.abs(residual)
    for lanes, designs in with_equal_runs(stack.lanes):
        middle = run_medians(designs, size[lanes])
        found = effects_of(designs, values[lanes], covariance[lanes])
        odd = contradicting(middle, found[:, :, 0], found[:, :, 1])
        for k, design, own in zip(lanes, designs, found, strict=True):
            effects[k] = design.named(own)
        for row in np.flatnonzero(odd.any(axis=1)):
            suspects[lanes[row]] = tuple(designs[row].labels[odd[row]].tolist())
    return effects, suspects


def _steps(
    stack: Stack, inverse: Float[np.ndarray, "k m m"], step: int
) -> Float[np.ndarray, "k n s"]:
    """Return the inverse between each node and the one ``step`` further, 0 past the end."""
    node = np.arange(stack.size)
    place = node % stack.nodes
    other = node - place + (place + step) % stack.nodes
    found = inverse[:, node, other]
    if step and not stack.lanes[0].grid.layout.periodic:
        found = np.where(place + step < stack.nodes, found, 0.0)
    return np.ascontiguousarray(_by_node(stack, found))


def _result(
    request: TableRequest, state: State, found: _Found, k: int
) -> TableFit | None:
    """Return one lane's fit, or None where it must be looked at more closely."""
    lane = state.problems.stack.lanes[k]
    grid, wild = lane.grid, found.wild[k]
    rejected = int(found.rejected[k])
    if rejected and crowded_places(found.nearest[k], wild, grid.size).any():
        return None
    apart = lane.apart or found.suspects[k]
    student = request.loss == "student"
    if rejected and student and too_many_wild(wild, request.fitted, apart):
        return None
    noise = float(found.noise[k])
    deviation, support = found.deviation[k], found.support[k]
    if not request.allow_gaps and uncertain(
        deviation, support, float(found.spread[k]), noise
    ):
        return None
    values, spread, visits = (table[k] for table in found.tables)
    first, second = state.weights[k].tolist()
    converged = bool(state.converged[k])
    used = float(state.factors.used[k])
    return TableFit(
        layout=grid.layout,
        values=values,
        standard_deviation=spread,
        support=visits,
        noise=noise,
        smoothness=Smoothness((first, second)).names(1),
        loss=request.loss,
        residual=found.residual[k],
        share=found.share[k],
        wild=wild,
        runs=found.effects[k],
        suspect_nodes=named(grid, found.doubted[k]),
        suspect_runs=apart,
        covariance={step: own[k] for step, own in found.covariance.items()},
        converged=converged,
        message=fit_message(len(wild), used, rejected, converged),
    )
