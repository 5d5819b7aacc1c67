"""What a table fit asks of its readings in one pass: sums that add up."""

import dataclasses
import functools
import operator
from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ..core._loss import AbstractLoss
from ._checks import Extent, check_finite
from ._grid import Grid, Located
from ._information import (
    Normal,
    moment_sums,
    normal_from_moments,
    touched,
    vector_from_moments,
)
from ._passes import AbstractPass, Grouping, Place, added
from ._plane_sums import Tally, has_cells, sums_of
from ._streamed_looks import Rule, believed, by_group, residual_of, weights_of
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
        centre: About which they are taken.
        grouping: Groups; None: all are of group 0.
    """

    centre: float
    grouping: Grouping | None

    def onto(
        self,
        done: "ByGroup | Tallies | None",
        grid: Grid,
        samples: Samples,
        place: Place,
    ) -> "ByGroup | Tallies":
        """See `AbstractPass`."""
        if has_cells(grid):
            found = Tallies({}) if done is None else done
            assert isinstance(found, Tallies)  # it is the grid that decides
            return found.with_more(grid, samples, self.centre, self.grouping)
        assert not isinstance(done, Tallies)
        check_finite(samples)
        groups = by_group(samples, self.grouping)
        own = ByGroup(
            {group: _plain(grid, own, self.centre) for group, own in groups.items()},
            Extent.of(grid.layout, samples),
        )
        return added(done, own)


@dataclasses.dataclass(frozen=True)
class Tallies:
    """Readings of a plane, each group in a tally of its own."""

    tallies: dict[int, Tally]

    def with_more(
        self, grid: Grid, samples: Samples, centre: float, grouping: Grouping | None
    ) -> "Tallies":
        """Add readings to the tallies; the same object, since a tally is large.

        Raises:
            FitError: If any is not finite, or a weight is not positive.
        """
        if samples.weight is not None or samples.order is not None:
            check_finite(samples)
        sound = True
        for group, own in by_group(samples, grouping).items():
            tally = self.tallies.setdefault(group, Tally(grid))
            sound = tally.add(own, centre) and sound
        if not sound:
            check_finite(samples)
        return self

    def __add__(self, other: "Tallies") -> "Tallies":
        tallies = dict(self.tallies)
        for group, own in other.tallies.items():
            tallies[group] = tallies[group] + own if group in tallies else own
        return Tallies(tallies)

    def finished(self) -> "ByGroup":
        """Return the sums."""
        extents = [tally.extent for tally in self.tallies.values()]
        return ByGroup(
            {group: _half(tally) for group, tally in self.tallies.items()},
            functools.reduce(operator.add, extents),
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

    def finished(self) -> "ByGroup":
        """Return the sums."""
        return self

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

    def onto(
        self, done: Sums | None, grid: Grid, samples: Samples, place: Place
    ) -> Sums:
        """See `AbstractPass`."""
        loss, weight = self.loss, weights_of(samples)
        root = np.sqrt(weight)
        where = None if has_cells(grid) else grid.locate(samples)
        residual = residual_of(grid, samples, where, self.values)
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
            own, part = np.where(keep, weight, 0.0), np.where(keep, pseudo, 0.0)
            sums = _weighted(grid, samples, where, keep, own, part)
            count = int(keep.sum())
            return Half(*sums[:3], float(slope[keep].sum()), count, sums[3])

        first = half(now)
        changed = int((now != active).sum())
        sums = Sums(first, first if not changed else half(active), changed)
        return added(done, sums)


def _plain(grid: Grid, samples: Samples, centre: float) -> Half:
    """Return the sums with every reading in full."""
    left = samples.error - centre
    normal, vector = sums_of(grid, dataclasses.replace(samples, error=left))
    square = float((left if samples.weight is None else samples.weight * left) @ left)
    support = touched(grid, grid.locate(samples))
    return Half(normal, vector, square, float(len(left)), len(left), support)


def _weighted(
    grid: Grid,
    samples: Samples,
    where: Located | None,
    keep: Bool[np.ndarray, " t"],
    weight: Float[np.ndarray, " t"],
    pseudo: Float[np.ndarray, " t"],
) -> tuple[Normal, Float[np.ndarray, "l s"], float, Int[np.ndarray, "l s"]]:
    """Return matrix, right-hand side, Σ w y² and support of pseudo-readings."""
    if where is None:
        tally = Tally(grid)
        tally.add(Samples(samples.positions, pseudo, weight=weight))
        return *tally.sums(), tally.square, tally.support
    weighted = weight * pseudo
    return (
        normal_from_moments(grid, moment_sums(grid, where, weight, 2)),
        vector_from_moments(grid, moment_sums(grid, where, weighted, 1)),
        float(weighted @ pseudo),
        touched(grid, where.take(keep)),
    )


def _half(tally: Tally) -> Half:
    count = tally.count
    return Half(*tally.sums(), tally.square, float(count), count, tally.support)
