"""Readings in pieces, and the table fit over those that do not fit into memory.

All that a fit needs of its readings are sums, and sums add up: over pieces of a file, over
files, over workers. The estimator is the one of `fit_table`; only the pass is another.
"""

import dataclasses
import functools
import itertools
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from .. import core
from ._reconsider import crowded
from ._result import folds_of, none_left_out, result_of, wild_readings
from ._table import TOO_MANY, fixed_weights, level_of
from ._types import Extent, Samples, Smoothness, TableFit

Part = Callable[[], Iterable[Samples]]
"""Yields the same readings, piece by piece, every time it is called."""
Apply = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""Like `map`: here one after the other, or on workers."""

Grouping = Callable[[Samples], Int[np.ndarray, " t"]]
"""Tells the group of each reading: what is left out together."""


@dataclasses.dataclass(frozen=True)
class StreamedFit:
    """A table fitted to readings in pieces.

    Attributes:
        fit: The table; its arrays over readings (``residual``, ``wild``) are empty.
        count: Number of readings.
        wild: How many of them are wild.
        crowded: Nodes at which wild readings stand side by side.
        groups: Sums over the readings of each group.
    """

    fit: TableFit
    count: int
    wild: int
    crowded: int
    groups: Mapping[int, core.Sums]

    @cached_property
    def folds(self) -> dict[int, TableFit]:
        """By group, the table fitted to all readings but those of the group."""
        with core.one_blas_thread():
            return folds_of(self.fit, self.groups, {}) if self.groups else {}

    def wild_of(self, samples: Samples) -> Bool[np.ndarray, " t"]:
        """Return which of some readings are wild."""
        estimate, stack = self.fit.estimate, core.Stack((self.fit.layout,))
        if not self.wild:
            return np.zeros(len(samples.error), bool)
        assert estimate is not None
        about = estimate.about, estimate.loss
        return wild_readings(stack, samples.readings, *about)[0]


def fit_streamed(
    layout: core.TableEffect,
    parts: Sequence[Part],
    grouping: Grouping | None = None,
    *,
    smoothness: Smoothness = "auto",
    loss: str = "student",
    apply: Apply = map,
) -> StreamedFit:
    """Fit a table to readings of any number in constant memory.

    Agrees with `fit_table` on the same readings to rounding.

    Args:
        layout: Where the nodes lie.
        parts: Readings; each part may be summed on another machine. Sums are added in this
            order, so that the result does not depend on who did which.
        grouping: Tells the group of each reading of a piece, for fits without each group;
            None: no folds.
        smoothness: As for `fit_table`.
        loss: As for `fit_table`.
        apply: How to run a function over the parts.

    Raises:
        FitError: If the readings do not determine a table, an option is unknown, or all
            readings are of one group.
    """
    layout.check()
    weights = fixed_weights(smoothness)
    pieces = (piece.error for part in parts for piece in part())
    first = next((error for error in pieces if len(error)), np.zeros(1))
    stack, passes = core.Stack((layout,)), itertools.count()

    def sum_up(*asked: Any) -> _Summed:
        next(passes)
        work = functools.partial(_summed, layout, *asked)
        total = functools.reduce(operator.add, apply(work, parts), _NOTHING)
        if not total.groups:
            msg = "found no readings, expected at least one per node."
            raise core.FitError(msg)
        return total

    def attempt(loss: str) -> StreamedFit:
        firsts: list[_Summed] = []

        def over(
            theta: Float[np.ndarray, " u"], by: core.Loss, former: core.Sums | None
        ) -> core.Sums:
            groups = None if firsts else grouping
            sums = sum_up(theta, by, former is None, groups, False)
            if not firsts:
                sums.extent.check(layout, stack.free, allow_gaps=False)
                firsts.append(sums)
            return sums.total if former is None else sums.total.with_matrix(former)

        start = np.full(stack.size, level_of(first))
        floor = core.least_scale(first)
        fitted = core.Passes(stack, over, loss, weights, floor).run(start)
        last, nodes, crowds, wild = firsts[0], None, 0, 0
        if loss != "gauss":
            about, by = fitted.about, fitted.loss
            last = sum_up(about, by, True, grouping, True)
            nodes, crowds = last.nodes, int(crowded(last.nodes).sum())
            wild = int(nodes[2].sum())
        count, spread = int(last.extent.counts.sum()), float(np.ptp(first))
        fit = result_of(layout, fitted, loss, count=count, spread=spread, nodes=nodes)
        return StreamedFit(fit, count, wild, crowds, last.groups)

    with core.one_blas_thread():
        result, remark = attempt(loss), ""
        if loss == "student" and result.wild > TOO_MANY * result.count:
            remark = f"{none_left_out(result.wild / result.count)} "
            result = dataclasses.replace(attempt("huber"), wild=0)
    message = f"{result.fit.message} {remark}Read in {next(passes)} passes."
    fit = dataclasses.replace(result.fit, message=message)
    return dataclasses.replace(result, fit=fit)


@dataclasses.dataclass(frozen=True)
class _Summed:
    """What a pass gives.

    Attributes:
        groups: Sums by group; all in group 0 without a grouping.
        extent: How many readings there are and where.
        nodes: Of `wild_readings`, if asked for.
    """

    groups: Mapping[int, core.Sums]
    extent: Extent
    nodes: Float[np.ndarray, "3 n"]

    def __add__(self, other: "_Summed") -> "_Summed":
        groups = dict(self.groups)
        for label, sums in other.groups.items():
            groups[label] = groups[label] + sums if label in groups else sums
        extent, nodes = self.extent + other.extent, self.nodes + other.nodes
        return _Summed(groups, extent, nodes)

    @property
    def total(self) -> core.Sums:
        """Sums of all groups."""
        groups = (self.groups[label] for label in sorted(self.groups))
        return functools.reduce(operator.add, groups)


_NOWHERE = Extent(np.zeros(1, np.int64), np.full(1, np.inf), np.full(1, -np.inf))
_NOTHING = _Summed({}, _NOWHERE, np.zeros((3, 1)))


def _summed(
    layout: core.TableEffect,
    theta: Float[np.ndarray, " u"],
    loss: core.Loss,
    full: bool,
    grouping: Grouping | None,
    nodes: bool,
    part: Part,
) -> _Summed:
    """Return the sums of a part of the readings about an estimate, as they are asked for."""
    stack, total = core.Stack((layout,)), _NOTHING
    former = None if full else core.Sums.empty(stack)
    for samples in part():
        if not len(samples.error):
            continue
        split, groups, seen = {0: samples}, {}, np.zeros((3, 1))
        if grouping is not None:
            labels = grouping(samples)
            split = {int(g): samples.take(labels == g) for g in np.unique(labels)}
        for label, group in split.items():
            about = stack, group.readings, theta, loss
            groups[label], _ = core.sums_of(*about, former)
            if nodes:
                seen = seen + wild_readings(*about)[1]
        total = total + _Summed(groups, Extent.of(layout, samples), seen)
    return total
