"""Looks at readings in one pass: how many, where, every n-th of them, which are believed."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ..core._loss import AbstractLoss
from ._checks import Extent, check_finite
from ._grid import Grid, Located
from ._information import evaluate
from ._passes import AbstractPass, Grouping, Part, Place, added
from ._plane_sums import has_cells, plane_residual
from ._suspects import nearest
from ._types import Samples

Rule = tuple[Float[np.ndarray, "l s"], AbstractLoss]
"""Table and loss by which a reading is believed, or is wild."""


@dataclasses.dataclass(frozen=True)
class Counted:
    """How many readings there are, and where.

    Attributes:
        rows: By part and group.
        extent: Of all of them.
    """

    rows: Mapping[tuple[int, int], int]
    extent: Extent

    def __add__(self, other: "Counted") -> "Counted":
        rows = dict(self.rows)
        for key, count in other.rows.items():
            rows[key] = rows.get(key, 0) + count
        return Counted(rows, self.extent + other.extent)

    @property
    def groups(self) -> tuple[int, ...]:
        """Groups that any reading belongs to, in order."""
        return tuple(sorted({group for _, group in self.rows}))

    def without(self, group: int | None, parts: int) -> tuple[int, ...]:
        """Return how many readings each part has, those of a group left out."""
        counts = [0] * parts
        for (part, own), count in self.rows.items():
            counts[part] += count if own != group else 0
        return tuple(counts)


@final
@dataclasses.dataclass(frozen=True)
class Count(AbstractPass):
    """Asks how many readings there are; what cannot be fitted is refused."""

    grouping: Grouping | None

    def onto(
        self, done: Counted | None, grid: Grid, samples: Samples, place: Place
    ) -> Counted:
        """See `AbstractPass`."""
        check_finite(samples)
        rows = {
            (place.part, group): len(own.error)
            for group, own in by_group(samples, self.grouping).items()
        }
        return added(done, Counted(rows, Extent.of(grid.layout, samples)))


@dataclasses.dataclass(frozen=True)
class Thin:
    """Evenly spread readings, and how many there are in all."""

    count: int
    located: Located
    error: Float[np.ndarray, " t"]
    weight: Float[np.ndarray, " t"]

    def residual(
        self, grid: Grid, values: Float[np.ndarray, "l s"]
    ) -> Float[np.ndarray, " t"]:
        """Return reading − table."""
        return np.asarray(self.error - evaluate(grid, self.located, values))

    def __add__(self, other: "Thin") -> "Thin":
        places = (self.located, other.located)
        return Thin(
            self.count + other.count,
            Located(
                *(_both(*(getattr(one, name) for one in places)) for name in "lsuv")
            ),
            _both(self.error, other.error),
            _both(self.weight, other.weight),
        )


def _both(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.concatenate([first, second])


@final
@dataclasses.dataclass(frozen=True)
class TakeEvery(AbstractPass):
    """Asks for every n-th reading.

    Attributes:
        step: n.
        starts: Number of the first reading of each part, among all.
    """

    step: int
    starts: tuple[int, ...]

    def onto(
        self, done: Thin | None, grid: Grid, samples: Samples, place: Place
    ) -> Thin:
        """See `AbstractPass`."""
        row = self.starts[place.part] + place.row
        part = slice(-row % self.step, None, self.step)
        few = Samples(
            samples.positions[part],
            np.asarray(samples.error[part], float),
            None if samples.branch is None else samples.branch[part],
        )
        weight = weights_of(samples)[part]
        found = Thin(len(samples.error), grid.locate(few), few.error, weight)
        return added(done, found)


@dataclasses.dataclass(frozen=True)
class Judged:
    """What the last table leaves of the readings.

    Attributes:
        inner: Σ w r² of those believed.
        near: Readings next to each node.
        kept: Weight that the loss leaves them.
        wild: Those not believed.
    """

    inner: float
    near: Int[np.ndarray, " n"]
    kept: Float[np.ndarray, " n"]
    wild: Int[np.ndarray, " n"]

    def __add__(self, other: "Judged") -> "Judged":
        return Judged(
            self.inner + other.inner,
            self.near + other.near,
            self.kept + other.kept,
            self.wild + other.wild,
        )


@final
@dataclasses.dataclass(frozen=True)
class Judge(AbstractPass):
    """Asks what the last table leaves of the readings.

    Attributes:
        values: The table.
        loss: Loss at its last scale.
        rule: By what readings are believed; None for all of them.
    """

    values: Float[np.ndarray, "l s"]
    loss: AbstractLoss
    rule: Rule | None

    def onto(
        self, done: Judged | None, grid: Grid, samples: Samples, place: Place
    ) -> Judged:
        """See `AbstractPass`."""
        where, weight = grid.locate(samples), weights_of(samples)
        known = None if has_cells(grid) else where
        residual = residual_of(grid, samples, known, self.values)
        active = believed(grid, known, samples, self.rule)
        share = self.loss.share(residual * np.sqrt(weight) / self.loss.scale)
        node = nearest(grid, where)
        found = Judged(
            float((weight * residual**2)[active].sum()),
            np.bincount(node, minlength=grid.size),
            np.bincount(node, np.where(active, share, 0.0), grid.size),
            np.bincount(node[~active], minlength=grid.size),
        )
        return added(done, found)


def residual_of(
    grid: Grid,
    samples: Samples,
    where: Located | None,
    values: Float[np.ndarray, "l s"],
) -> Float[np.ndarray, " t"]:
    """Return reading − table; ``where`` may be None for a grid that `has_cells`."""
    if where is None:
        return plane_residual(grid, samples, values)
    return np.asarray(samples.error - evaluate(grid, where, values))


def believed(
    grid: Grid, where: Located | None, samples: Samples, rule: Rule | None
) -> Bool[np.ndarray, " t"]:
    """Tell which readings a rule believes; without one, all."""
    if rule is None:
        return np.ones(len(samples.error), bool)
    residual = residual_of(grid, samples, where, rule[0])
    scaled = residual * np.sqrt(weights_of(samples))
    return np.asarray(~rule[1].wild(scaled / rule[1].scale))


def weights_of(samples: Samples) -> Float[np.ndarray, " t"]:
    """Return the known weights of readings."""
    if samples.weight is None:
        return np.ones(len(samples.error))
    return np.asarray(samples.weight, float)


def first_of(parts: Sequence[Part]) -> Samples | None:
    """Return the first readings of all."""
    return next((piece for part in parts for piece in part() if len(piece.error)), None)


def by_group(samples: Samples, grouping: Grouping | None) -> dict[int, Samples]:
    """Return readings by group; without a grouping all are of group 0."""
    if grouping is None:
        return {0: samples}
    groups = grouping(samples)
    labels = np.unique(groups)
    if len(labels) == 1:
        return {int(labels[0]): samples}
    return {int(label): samples.take(groups == label) for label in labels}
