"""What a table fit asks of its readings in one pass: sums that add up."""

import dataclasses
from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ._checks import Extent, check_finite
from ._grid import Grid
from ._information import (
    Normal,
    evaluate,
    moment_sums,
    normal_from_moments,
    touched,
    vector_from_moments,
)
from ._loss import AbstractLoss
from ._passes import AbstractPass, Grouping, Place
from ._plane_sums import sums_and_support
from ._streamed_looks import Rule, believed, by_group, weights_of
from ._types import Samples


@dataclasses.dataclass(frozen=True)
class Half:
    """Sums over the readings that one rule leaves active.

    Attributes:
        normal: Σ w x xᵀ.
        vector: Σ w x y, y the pseudo-reading times the mean slope of the loss.
        square: Σ w y².
        slope: Σ ψ'.
        count: How many.
        support: Readings that touch each node.
    """

    normal: Normal
    vector: Float[np.ndarray, "l s"]
    square: float
    slope: float
    count: int
    support: Int[np.ndarray, "l s"]

    def __add__(self, other: "Half") -> "Half":
        return Half(
            *(
                getattr(self, field.name) + getattr(other, field.name)
                for field in dataclasses.fields(self)
            )
        )


@final
@dataclasses.dataclass(frozen=True)
class SumByGroup(AbstractPass):
    """Asks for the sums of every reading in full, group by group.

    Attributes:
        values: Table about which they are taken.
        grouping: Groups; None: all are of group 0.
    """

    values: Float[np.ndarray, "l s"]
    grouping: Grouping | None

    def of(self, grid: Grid, samples: Samples, place: Place) -> "ByGroup":
        """See `AbstractPass`."""
        check_finite(samples)
        groups = by_group(samples, self.grouping)
        return ByGroup(
            {group: _plain(grid, own, self.values) for group, own in groups.items()},
            Extent.of(grid.layout, samples),
        )


@dataclasses.dataclass(frozen=True)
class ByGroup:
    """Sums of each group of readings, and where they lie."""

    sums: Mapping[int, Half]
    extent: Extent

    def __add__(self, other: "ByGroup") -> "ByGroup":
        sums = dict(self.sums)
        for group, own in other.sums.items():
            sums[group] = sums[group] + own if group in sums else own
        return ByGroup(sums, self.extent + other.extent)

    def without(self, group: int | None) -> Half:
        """Return the sums of all readings but those of a group."""
        first, *rest = (self.sums[own] for own in sorted(self.sums) if own != group)
        for one in rest:
            first = first + one
        return first


@dataclasses.dataclass(frozen=True)
class Sums:
    """Sums of one pass: by the rule of now, by the one held on to, and what changed."""

    now: Half
    held: Half
    changed: int

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(
            self.now + other.now, self.held + other.held, self.changed + other.changed
        )


@final
@dataclasses.dataclass(frozen=True)
class SumUp(AbstractPass):
    """Asks for the sums of pseudo-readings about a table.

    Attributes:
        values: The table.
        loss: Loss at its present scale.
        before: By what readings were believed last; None for all of them.
        far: The table is far off: clip residuals where they become wild, nothing more.
    """

    values: Float[np.ndarray, "l s"]
    loss: AbstractLoss
    before: Rule | None
    far: bool

    def of(self, grid: Grid, samples: Samples, place: Place) -> Sums:
        """See `AbstractPass`."""
        loss, where, weight = self.loss, grid.locate(samples), weights_of(samples)
        root = np.sqrt(weight)
        residual = samples.error - evaluate(grid, where, self.values)
        scaled = residual * root
        ratio = scaled / loss.scale
        now = ~loss.wild(ratio)
        active = believed(grid, where, samples, self.before)
        if self.far:
            limit = loss.limit * loss.scale
            pseudo = np.clip(scaled, -limit, limit) / root
        else:
            pseudo = residual * loss.share(ratio)
        slope = loss.slope(ratio)

        def half(keep: Bool[np.ndarray, " t"]) -> Half:
            own = np.where(keep, weight, 0.0)
            part = np.where(keep, pseudo, 0.0)
            weighted = weight * part
            return Half(
                normal_from_moments(grid, moment_sums(grid, where, own, 2)),
                vector_from_moments(grid, moment_sums(grid, where, weighted, 1)),
                float(weighted @ part),
                float(slope[keep].sum()),
                int(keep.sum()),
                touched(grid, where.take(keep)),
            )

        first = half(now)
        changed = int((now != active).sum())
        return Sums(first, first if not changed else half(active), changed)


def _plain(grid: Grid, samples: Samples, values: Float[np.ndarray, "l s"]) -> Half:
    """Return the sums with every reading in full."""
    centre = float(values.flat[0])
    left = samples.error - centre
    if not (values == centre).all():
        left = samples.error - evaluate(grid, grid.locate(samples), values)
    normal, vector, support = sums_and_support(
        grid, dataclasses.replace(samples, error=left)
    )
    square = float((left if samples.weight is None else samples.weight * left) @ left)
    count = len(left)
    return Half(normal, vector, square, float(count), count, support)
