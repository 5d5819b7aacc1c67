"""The table fit over readings that do not fit into memory.

All that a fit needs of its readings are sums, and sums add up: over pieces of a file, over
files, over workers. The estimator is the one of `fit_table`; only the pass is another.
"""

import abc
import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ..core import (
    FitError,
    Loss,
    Stack,
    Sums,
    choose_loss,
    estimate,
    leave_one_out,
    one_blas_thread,
    sums_of,
)
from ._checks import Extent, check_extent, check_finite, check_layout, check_smoothness
from ._table import (
    NONE_LEFT_OUT,
    TOO_MANY,
    Smoothness,
    first_level,
    floor_of,
    fold_of,
    suspect_nodes,
    table_fit,
    weights_of,
)
from ._types import Samples, TableFit, TableLayout

Part = Callable[[], Iterable[Samples]]
"""Yields the same readings, piece by piece, every time it is called."""
Apply = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""Like `map`: here one after the other, or on workers."""
Grouping = Callable[[Samples], Int[np.ndarray, " t"]]
"""Tells the group of each reading: what is left out together."""

_Result = TypeVar("_Result")


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a piece lies: its part, and how many readings of the part come before it."""

    part: int
    row: int


class AbstractPass(abc.ABC):
    """What is asked of one pass over readings; what parts give adds up with ``+``."""

    @abc.abstractmethod
    def onto(self, done: Any, samples: Samples, place: Place) -> Any:
        """Return what a piece gives, added to what those before it gave (None)."""


@dataclasses.dataclass
class Stream:
    """Readings in pieces.

    Attributes:
        parts: Readings; each part may be summed on another machine. Sums are added in this
            order, so that the result does not depend on who did which.
        apply: How to run a function over the parts.
        passes: How often the readings were read.
    """

    parts: Sequence[Part]
    apply: Apply = map
    passes: int = 0

    def ask(self, wanted: AbstractPass) -> Any:
        """Return what one pass gives.

        Raises:
            FitError: If there are no readings.
        """
        self.passes += 1
        total: Any = None
        for found in self.apply(
            partial(_over_part, wanted), list(enumerate(self.parts))
        ):
            total = found if total is None else added(total, found)
        if total is None:
            msg = "found 0 readings, expected at least one per node."
            raise FitError(msg)
        return total


def _over_part(wanted: AbstractPass, job: tuple[int, Part]) -> Any:
    number, part = job
    total, row = None, 0
    for samples in part():
        if len(samples.error):
            total = wanted.onto(total, samples, Place(number, row))
            row += len(samples.error)
    return total


def added(total: _Result | None, more: _Result | None) -> _Result:
    """Return a sum that may not have begun."""
    if total is None or more is None:
        found = more if total is None else total
        assert found is not None
        return found
    both: Any = total
    result: _Result = both + more
    return result


@dataclasses.dataclass(frozen=True)
class StreamedFit:
    """A table fitted to readings in pieces.

    Attributes:
        fit: The table; its arrays over readings (``residual``, ``share``, ``wild``) are empty.
        count: Number of readings.
        wild: How many of them are wild.
        crowded: Nodes at which wild readings stand side by side.
        folds: By group, the table fitted to all readings but those of the group.
    """

    fit: TableFit
    count: int
    wild: int
    crowded: int
    folds: Mapping[int, TableFit]

    def judged(
        self, samples: Samples
    ) -> tuple[Bool[np.ndarray, " t"], Float[np.ndarray, " t"]]:
        """Return which of some readings are wild, and the weight that the loss leaves each."""
        found, layout = self.fit.estimate, self.fit.layout
        assert found is not None
        ratio = _scaled(layout, samples, found.about) / found.loss.scale
        wild = found.loss.wild(ratio)
        return wild, found.loss.share(ratio)


def fit_streamed(
    layout: TableLayout,
    parts: Sequence[Part],
    *,
    smoothness: Smoothness = "auto",
    loss: str = "student",
    apply: Apply = map,
) -> TableFit:
    """Fit a table to readings of any number in constant memory.

    Agrees with `fit_table` on the same readings to rounding.

    Args:
        layout: Where the nodes lie.
        parts: Readings; each part may be summed on another machine. Sums are added in this
            order, so that the result does not depend on who did which.
        smoothness: As for `fit_table`.
        loss: As for `fit_table`.
        apply: How to run a function over the parts.

    Returns:
        The fit; its arrays over readings (``residual``, ``share``, ``wild``) are empty.

    Raises:
        FitError: If the readings do not determine the table or an option is unknown.
    """
    return fit_with_folds(
        layout, parts, None, smoothness=smoothness, loss=loss, apply=apply
    ).fit


def fit_with_folds(
    layout: TableLayout,
    parts: Sequence[Part],
    grouping: Grouping | None,
    *,
    smoothness: Smoothness = "auto",
    loss: str = "student",
    apply: Apply = map,
) -> StreamedFit:
    """Fit a table as `fit_streamed` does, and beside it one without each group of readings.

    Args:
        layout: Where the nodes lie.
        parts: As for `fit_streamed`.
        grouping: Tells the group of each reading of a piece; None: no folds.
        smoothness: As for `fit_table`.
        loss: As for `fit_table`.
        apply: As for `fit_streamed`.

    Raises:
        FitError: If the readings do not determine a table, an option is unknown, or all
            readings are of one group.
    """
    check_layout(layout)
    check_smoothness(smoothness)
    choose_loss(loss, np.ones(1), 1.0, 1.0)
    stream = Stream(parts, apply)
    with one_blas_thread():
        found = _attempt(layout, stream, grouping, smoothness, loss)
        if loss == "student" and found.wild > TOO_MANY * found.count:
            found = _attempt(layout, stream, grouping, smoothness, "huber")
            fit = dataclasses.replace(
                found.fit, message=f"{found.fit.message} {NONE_LEFT_OUT}"
            )
            found = dataclasses.replace(found, fit=fit)
    message = f"{found.fit.message} Read in {stream.passes} passes."
    return dataclasses.replace(
        found, fit=dataclasses.replace(found.fit, message=message)
    )


def _attempt(
    layout: TableLayout,
    stream: Stream,
    grouping: Grouping | None,
    smoothness: Smoothness,
    loss: str,
) -> StreamedFit:
    first = next(
        (piece for part in stream.parts for piece in part() if len(piece.error)), None
    )
    if first is None:
        msg = "found 0 readings, expected at least one per node."
        raise FitError(msg)
    check_finite(first)
    stack, table = Stack((layout.effect,)), layout.effect
    looks: list[_Found] = []

    def over(theta: Float[np.ndarray, " u"], by: Loss, full: bool) -> Sums:
        groups = grouping if not looks else None
        found: _Found = stream.ask(_SumUp(layout, theta, by, full, not looks, groups))
        if not looks:
            assert found.extent is not None
            if found.extent.counts.sum() <= stack.free:
                msg = (
                    f"found {int(found.extent.counts.sum())} readings, "
                    f"expected more than {stack.free}."
                )
                raise FitError(msg)
            check_extent(layout, found.extent, False)
            looks.append(found)
        return found.total

    fixed = None if isinstance(smoothness, str) else weights_of(stack, smoothness)
    whole = estimate(
        stack,
        over,
        loss=loss,
        weights=fixed,
        floor=floor_of(first.error),
        start=np.full(table.size, first_level(first.error)),
    )
    last = looks[0]
    if loss != "gauss":
        last = stream.ask(
            _SumUp(layout, whole.about, whole.loss, True, False, grouping, True)
        )
    assert looks[0].extent is not None
    count = int(looks[0].extent.counts.sum())
    fit = table_fit(
        layout,
        whole,
        loss,
        fixed=fixed is not None,
        count=count,
        spread=float(np.ptp(first.error)),
    )
    fit = dataclasses.replace(fit, estimate=whole)
    wild = count - int(whole.posterior.problem.count)
    crowded = 0
    if loss != "gauss":
        near, kept, rejected = last.nodes
        place = table.to_table(np.arange(table.size))
        suspects = suspect_nodes(near.astype(np.int64), kept, place)
        fit = dataclasses.replace(fit, suspect_nodes=suspects)
        several = (rejected >= 3) & (rejected > 0.2 * near)
        crowded = int((several | ((near > 1) & (rejected > 0.5 * near))).sum())
    folds = {}
    if grouping is not None:
        folds = {
            label: fold_of(fit, post)
            for label, post in leave_one_out(whole, last.groups, {}).items()
        }
    return StreamedFit(fit, count, wild, crowded, folds)


def _scaled(
    layout: TableLayout, samples: Samples, theta: Float[np.ndarray, " u"]
) -> Float[np.ndarray, " t"]:
    """Return residuals × √weight."""
    stack = Stack((layout.effect,))
    return sums_of(stack, layout.readings(samples), theta, Loss(), False)[1]


@dataclasses.dataclass(frozen=True)
class _Found:
    """What a pass gives.

    Attributes:
        groups: Sums by group; all in group 0 without a grouping.
        extent: How many readings there are and where.
        nodes: Readings next to each unknown, the weight they keep, those that are wild.
    """

    groups: Mapping[int, Sums]
    extent: Extent | None
    nodes: Float[np.ndarray, "3 n"]

    def __add__(self, other: "_Found") -> "_Found":
        groups = dict(self.groups)
        for label, own in other.groups.items():
            groups[label] = groups[label] + own if label in groups else own
        extent = None
        if self.extent is not None and other.extent is not None:
            extent = self.extent + other.extent
        return _Found(groups, extent, self.nodes + other.nodes)

    @property
    def total(self) -> Sums:
        """Sums of all groups."""
        first, *rest = (self.groups[label] for label in sorted(self.groups))
        for one in rest:
            first = first + one
        return first


@final
@dataclasses.dataclass(frozen=True)
class _SumUp(AbstractPass):
    """Asks for the sums of readings about an estimate.

    Attributes:
        layout: The table.
        theta: Estimate.
        loss: How much each reading counts.
        full: Also the matrix.
        look: Also how many readings there are and where.
        grouping: Groups; None: all are of one.
        nodes: Also what the loss leaves of the readings next to each node.
    """

    layout: TableLayout
    theta: Float[np.ndarray, " u"]
    loss: Loss
    full: bool
    look: bool
    grouping: Grouping | None = None
    nodes: bool = False

    def onto(self, done: _Found | None, samples: Samples, place: Place) -> _Found:
        """See `AbstractPass`."""
        extent = None
        if self.look:
            check_finite(samples)
            extent = Extent.of(self.layout, samples)
        stack = Stack((self.layout.effect,))
        groups: dict[int, Sums] = {}
        parts = {0: samples}
        if self.grouping is not None:
            labels = self.grouping(samples)
            parts = {int(g): samples.take(labels == g) for g in np.unique(labels)}
        for label, own in parts.items():
            readings = self.layout.readings(own)
            groups[label], _ = sums_of(
                stack, readings, self.theta, self.loss, self.full
            )
        found = _Found(groups, extent, self._judged(samples))
        return added(done, found)

    def _judged(self, samples: Samples) -> Float[np.ndarray, "3 n"]:
        table = self.layout.effect
        if not self.nodes:
            return np.zeros((3, 1))
        ratio = _scaled(self.layout, samples, self.theta) / self.loss.scale
        nodes, shares = table.design(self.layout.readings(samples))
        nearest = nodes[np.arange(len(nodes)), shares.argmax(axis=1)]
        wild = self.loss.wild(ratio)
        weights = (None, self.loss.share(ratio), wild.astype(float))
        return np.stack([np.bincount(nearest, own, table.size) for own in weights])
