"""Many small table fits at once, grouped by shape and fitted in lockstep."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .._checks import check_samples
from .._errors import FitError
from .._grid import Grid
from .._logs import FILL
from .._prior import Smoothness
from .._reconsider import crowded_places
from .._runs import run_design
from .._suspects import nearest, suspect_nodes, suspect_runs
from .._threads import one_blas_thread
from .._types import RunEffect, TableFit
from .._verdict import fit_message, too_many_wild, uncertain
from ._passes import State, estimate_lanes, start_of
from ._request import TableRequest
from ._stack import Lane, stacked

_MOST = 256
"""Lanes in a stack; more would not stay in the cache."""


def fit_small(requests: Sequence[TableRequest]) -> list[TableFit | None]:
    """Fit small tables together; None where a fit needs a closer look (`fit_table` has it).

    Args:
        requests: Small ones, of any shapes.
    """
    results: list[TableFit | None] = [None] * len(requests)
    apart: dict[int, tuple[int, ...]] = dict.fromkeys(range(len(requests)), ())
    with one_blas_thread():
        _fit_groups(requests, apart, results)
        # A run that contradicts the others must not pull their mean.
        again = {
            k: fit.suspect_runs
            for k, fit in enumerate(results)
            if fit is not None and fit.suspect_runs
        }
        _fit_groups(requests, again, results)
    return results


def _fit_groups(
    requests: Sequence[TableRequest],
    apart: Mapping[int, tuple[int, ...]],
    results: list[TableFit | None],
) -> None:
    """Fit some of the requests, runs that contradict the others named beforehand."""
    groups: dict[tuple[Any, ...], list[tuple[int, Lane]]] = {}
    for k, runs in apart.items():
        request = requests[k]
        results[k] = None
        try:
            lane = _lane(request, runs)
        except FitError:
            continue  # `fit_table` meets it again and says it
        kind = request.smoothness if isinstance(request.smoothness, str) else "fixed"
        groups.setdefault((*lane.shape, kind, request.loss), []).append((k, lane))
    for group in groups.values():
        for start in range(0, len(group), _MOST):
            part = group[start : start + _MOST]
            own = [requests[k] for k, _ in part]
            found = _fit(own, [lane for _, lane in part])
            for (k, _), fit in zip(part, found, strict=True):
                results[k] = fit


def _lane(request: TableRequest, apart: tuple[int, ...]) -> Lane:
    samples = request.samples
    check_samples(request.layout, samples, request.smoothness, request.allow_gaps)
    if request.loss not in ("student", "huber", "gauss"):
        msg = f"loss: found {request.loss!r}"
        raise FitError(msg)
    grid = Grid(request.layout)
    design = run_design(samples, request.run_effects, apart)
    count = len(samples.error)
    lane = Lane(
        grid=grid,
        located=grid.locate(samples),
        error=np.asarray(samples.error, float),
        weight=np.ones(count)
        if samples.weight is None
        else np.asarray(samples.weight, float),
        design=design,
        apart=apart,
    )
    null = grid.fast * (1 if request.layout.periodic else 2)
    if count - null - (0 if design is None else design.count) < 1:
        msg = f"{count} readings leave nothing to judge the noise by"
        raise FitError(msg)
    return lane


def _fit(
    requests: Sequence[TableRequest], lanes: Sequence[Lane]
) -> Iterator[TableFit | None]:
    stack = stacked(lanes)
    effects = np.zeros((len(lanes), stack.effects))
    for k, lane in enumerate(lanes):
        if lane.design is not None:
            effects[k] = lane.design.start(lane.error)
    weights = None
    if not isinstance(requests[0].smoothness, str):
        density = stack.density(stack.normal(np.ones(stack.error.shape, bool)))
        given = [_given(request.smoothness) for request in requests]
        weights = np.array(
            [
                pair if scaled else (max(pair[0], FILL * own), 0.0)
                for (pair, scaled), own in zip(given, density, strict=True)
            ]
        )
    state = estimate_lanes(stack, requests[0].loss, weights, start_of(stack, effects))
    yield from _results(requests, state)


def _given(
    smoothness: float | str | Mapping[str, float],
) -> tuple[tuple[float, float], bool]:
    """Return weights that were asked for, and whether they are to be taken as they are."""
    if isinstance(smoothness, Mapping):
        return Smoothness.named(smoothness, 1).slow, True
    return (float(smoothness), 0.0), False


@dataclasses.dataclass(frozen=True)
class _Sums:
    """What the results of all lanes share, computed side by side."""

    residual: Float[np.ndarray, "k t"]
    share: Float[np.ndarray, "k t"]
    inner: Float[np.ndarray, " k"]
    free: Float[np.ndarray, " k"]
    variance: Float[np.ndarray, " k"]
    deviation: Float[np.ndarray, "k s n"]


def _results(
    requests: Sequence[TableRequest], state: State
) -> Iterator[TableFit | None]:
    problems, stack = state.problems, state.problems.stack
    found = state.solutions
    residual = stack.residual(found.unknowns)
    ratio = residual * np.sqrt(stack.weight) / state.scale.scale
    share = np.where(state.active, state.scale.share(ratio), 0.0)
    inner = np.where(state.active, stack.weight * np.square(residual), 0.0).sum(axis=1)
    free = problems.count - state.factors.used
    fixed = not isinstance(requests[0].smoothness, str)
    variance = found.residual_square / free if fixed else found.variance
    own = np.diagonal(state.factors.inverse, axis1=1, axis2=2)
    deviation = np.sqrt(np.maximum(variance[:, None] * own, 0.0))
    sums = _Sums(residual, share, inner, free, variance, stack.tables(deviation))
    for k, request in enumerate(requests):
        usable = state.sound[k] and np.isfinite(variance[k]) and np.isfinite(free[k])
        if fixed and free[k] < max(3.0, 0.02 * problems.count[k]):
            usable = False  # the evidence must judge the noise
        yield _result(request, stack.lanes[k], state, sums, k) if usable else None


def _result(
    request: TableRequest, lane: Lane, state: State, sums: _Sums, k: int
) -> TableFit | None:
    """Return one lane's fit, or None where it must be looked at more closely."""
    grid, stack = lane.grid, state.problems.stack
    active, share, residual = state.active[k], sums.share[k], sums.residual[k]
    wild = ~active
    if wild.any():
        node = nearest(grid, lane.located)
        if crowded_places(node, wild, grid.size).any():
            return None
    inverse = state.factors.inverse[k]
    effects: tuple[RunEffect, ...] = ()
    variance = float(sums.variance[k])
    if lane.design is not None:
        block = inverse[stack.size :, stack.size :]
        effects = lane.design.effects(
            state.solutions.unknowns[k, stack.size :], variance * block
        )
    apart = lane.apart or suspect_runs(lane.design, residual, share, effects)
    if request.loss == "student" and too_many_wild(wild, request.samples, apart):
        return None
    noise = float(np.sqrt(sums.inner[k] / max(sums.free[k], 1e-9)))
    touching = (stack.columns[k, :, : stack.size] > 0) & active[:, None]
    counts = touching.sum(axis=0).reshape(stack.branches, stack.nodes).T
    deviation = np.ascontiguousarray(sums.deviation[k].T)
    spread = float(np.ptp(lane.error))
    if not request.allow_gaps and uncertain(deviation, counts, spread, noise):
        return None
    used = float(state.factors.used[k])
    values = stack.tables(state.solutions.unknowns[k : k + 1])[0].T
    weights = state.weights[k]
    return TableFit(
        layout=grid.layout,
        values=grid.to_table(values),
        standard_deviation=grid.to_table(deviation),
        support=grid.to_table(counts),
        noise=noise,
        smoothness=Smoothness((float(weights[0]), float(weights[1]))).names(1),
        loss=request.loss,
        residual=residual,
        share=share,
        wild=wild,
        runs=effects,
        suspect_nodes=suspect_nodes(grid, lane.located, share),
        suspect_runs=apart,
        covariance={
            (0, 0): variance * _steps(stack.size, inverse, grid, 0),
            (1, 0): variance * _steps(stack.size, inverse, grid, 1),
        },
        converged=bool(state.converged[k]),
        message=fit_message(
            len(residual), used, int(wild.sum()), bool(state.converged[k])
        ),
    )


def _steps(
    size: int, inverse: Float[np.ndarray, "m m"], grid: Grid, step: int
) -> Float[np.ndarray, "l s"]:
    """Return the inverse between each node and the one ``step`` further, 0 past the end."""
    node = np.arange(size)
    place = node % grid.slow
    other = node - place + (place + step) % grid.slow
    found = inverse[node, other]
    if step and not grid.layout.periodic:
        found = np.where(place + step < grid.slow, found, 0.0)
    return np.ascontiguousarray(found.reshape(grid.fast, grid.slow).T)
