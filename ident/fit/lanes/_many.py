"""Many small table fits at once, grouped by shape and fitted in lockstep."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ...core._threads import one_blas_thread
from .._logs import FILL
from .._prior import Smoothness
from .._runs import starts_of
from .._types import TableFit
from ._passes import estimate_lanes, start_of
from ._prepare import Prepared
from ._request import TableRequest
from ._results import results_of
from ._stack import Lane, stacked, with_equal_runs

_MOST = 256
"""Lanes in a stack; more would not stay in the cache."""


def fit_small(requests: Sequence[TableRequest]) -> list[TableFit | None]:
    """Fit small tables together; None where a fit needs a closer look (`fit_table` has it).

    Args:
        requests: Small ones, of any shapes.
    """
    results: list[TableFit | None] = [None] * len(requests)
    apart: dict[int, tuple[int, ...]] = dict.fromkeys(range(len(requests)), ())
    prepared = Prepared(requests)
    with one_blas_thread():
        _fit_groups(requests, prepared, apart, results)
        # A run that contradicts the others must not pull their mean.
        again = {
            k: fit.suspect_runs
            for k, fit in enumerate(results)
            if fit is not None and fit.suspect_runs
        }
        _fit_groups(requests, prepared, again, results)
    return results


def _fit_groups(
    requests: Sequence[TableRequest],
    prepared: Prepared,
    apart: Mapping[int, tuple[int, ...]],
    results: list[TableFit | None],
) -> None:
    """Fit some of the requests, runs that contradict the others named beforehand."""
    groups: dict[tuple[Any, ...], list[tuple[int, Lane]]] = {}
    for k in apart:
        results[k] = None
    # `fit_table` meets what cannot be fitted again and says it.
    for k, lane in prepared.lanes(apart):
        request = requests[k]
        kind = request.smoothness if isinstance(request.smoothness, str) else "fixed"
        groups.setdefault((*lane.shape, kind, request.loss), []).append((k, lane))
    for group in groups.values():
        for start in range(0, len(group), _MOST):
            part = group[start : start + _MOST]
            own = [requests[k] for k, _ in part]
            found = _fit(own, [lane for _, lane in part])
            for (k, _), fit in zip(part, found, strict=True):
                results[k] = fit


def _fit(
    requests: Sequence[TableRequest], lanes: Sequence[Lane]
) -> Iterator[TableFit | None]:
    stack = stacked(lanes)
    effects = np.zeros((len(lanes), stack.effects))
    for rows, designs in with_equal_runs(lanes):
        effects[rows] = starts_of(designs, stack.error[rows])
    weights = None
    if not isinstance(requests[0].smoothness, str):
        density = stack.density(stack.whole)
        # The fits without each run have theirs from the same fit.
        known = {id(request.smoothness): request.smoothness for request in requests}
        pairs = {name: _given(smoothness) for name, smoothness in known.items()}
        given = [pairs[id(request.smoothness)] for request in requests]
        weights = np.array(
            [
                pair if scaled else (max(pair[0], FILL * own), 0.0)
                for (pair, scaled), own in zip(given, density, strict=True)
            ]
        )
    state = estimate_lanes(stack, requests[0].loss, weights, start_of(stack, effects))
    yield from results_of(requests, state)


def _given(
    smoothness: float | str | Mapping[str, float],
) -> tuple[tuple[float, float], bool]:
    """Return weights that were asked for, and whether they are to be taken as they are."""
    if isinstance(smoothness, Mapping):
        return Smoothness.named(smoothness, 1).slow, True
    return (float(smoothness), 0.0), False
