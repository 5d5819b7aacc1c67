"""One pass over the readings of a part: sums that add up, and every n-th reading."""

import dataclasses
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ._checks import check_samples
from ._grid import Grid, Located
from ._information import (
    Normal,
    evaluate,
    moment_sums,
    normal_from_moments,
    touched,
    vector_from_moments,
)
from ._loss import AbstractLoss
from ._plane_sums import sums_and_support
from ._types import Samples


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

    def every(self, step: int, offset: int = 0) -> "Thin":
        """Return every n-th of them."""
        part = slice(offset, None, step)
        place = self.located
        parts = (place.l[part], place.s[part], place.u[part], place.v[part])
        return Thin(self.count, Located(*parts), self.error[part], self.weight[part])

    @classmethod
    def joined(cls, found: Sequence["Thin"]) -> "Thin":
        """Return the readings of all parts."""
        whole = [np.zeros(0, np.int64), np.zeros(0)]
        places = [one.located for one in found]
        return cls(
            sum(one.count for one in found),
            Located(
                *(
                    np.concatenate([*(getattr(place, name) for place in places), none])
                    for name, none in zip(
                        "lsuv", (*whole[:1] * 2, *whole[1:] * 2), strict=True
                    )
                )
            ),
            np.concatenate([*(one.error for one in found), whole[1]]),
            np.concatenate([*(one.weight for one in found), whole[1]]),
        )


def count_readings(grid: Grid, part: Callable[[], Iterable[Samples]]) -> int:
    """Return how many readings a part has; what cannot be fitted is refused."""
    count = 0
    for samples in part():
        if len(samples.error):
            check_samples(grid.layout, samples, "auto", True)
        count += len(samples.error)
    return count


def take_every(
    grid: Grid, job: tuple[Callable[[], Iterable[Samples]], int], *, step: int
) -> Thin:
    """Return every n-th reading of a part that begins at some row of the whole."""
    part, row = job
    kept = []
    for samples in part():
        own = Thin(
            0, grid.locate(samples), np.asarray(samples.error, float), _weights(samples)
        )
        kept.append(own.every(step, -row % step))
        row += len(samples.error)
    return Thin.joined(kept)


def first_of(part: Callable[[], Iterable[Samples]]) -> Samples | None:
    """Return the first readings of a part."""
    return next((samples for samples in part() if len(samples.error)), None)


@dataclasses.dataclass(frozen=True)
class Half:
    """Sums over the readings that one rule leaves active.

    Attributes:
        normal: Σ w x xᵀ.
        vector: Σ w x y, y the pseudo-reading times the mean slope of the loss.
        square: Σ w y².
        inner: Σ w r², r the residuals themselves.
        slope: Σ ψ'.
        count: How many.
        support: Readings that touch each node.
    """

    normal: Normal
    vector: Float[np.ndarray, "l s"]
    square: float
    inner: float
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


def sum_up(
    grid: Grid,
    part: Callable[[], Iterable[Samples]],
    *,
    values: Float[np.ndarray, "l s"],
    loss: AbstractLoss | None,
    before: tuple[Float[np.ndarray, "l s"], AbstractLoss] | None,
    far: bool,
) -> Sums:
    """Return the sums of a part about a table.

    Args:
        grid: Nodes.
        part: Yields the readings.
        values: The table.
        loss: Loss at its present scale; None counts every reading in full.
        before: Table and loss by which readings were active last; None for all of them.
        far: The table is far off: clip residuals where they become wild, nothing more.
    """
    total: Sums | None = None
    for samples in part():
        one = (
            _plain(grid, samples, values)
            if loss is None
            else _robust(grid, samples, values, loss, before, far)
        )
        total = one if total is None else total + one
    if total is None:
        nothing = Samples(np.zeros((0, len(grid.layout.nodes))), np.zeros(0))
        return _plain(grid, nothing, values)
    return total


def _weights(samples: Samples) -> Float[np.ndarray, " t"]:
    if samples.weight is None:
        return np.ones(len(samples.error))
    return np.asarray(samples.weight, float)


def _plain(grid: Grid, samples: Samples, values: Float[np.ndarray, "l s"]) -> Sums:
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
    half = Half(normal, vector, square, square, float(count), count, support)
    return Sums(half, half, 0)


def _robust(
    grid: Grid,
    samples: Samples,
    values: Float[np.ndarray, "l s"],
    loss: AbstractLoss,
    before: tuple[Float[np.ndarray, "l s"], AbstractLoss] | None,
    far: bool,
) -> Sums:
    place, weight = grid.locate(samples), _weights(samples)
    root = np.sqrt(weight)
    residual = samples.error - evaluate(grid, place, values)
    scaled = residual * root
    ratio = scaled / loss.scale
    now = ~loss.wild(ratio)
    active = np.ones(len(now), bool)
    if before is not None:
        other = (samples.error - evaluate(grid, place, before[0])) * root
        active = ~before[1].wild(other / before[1].scale)
    if far:
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
            normal_from_moments(grid, moment_sums(grid, place, own, 2)),
            vector_from_moments(grid, moment_sums(grid, place, weighted, 1)),
            float(weighted @ part),
            float((own * residual) @ residual),
            float(slope[keep].sum()),
            int(keep.sum()),
            touched(grid, place.take(keep)),
        )

    first = half(now)
    changed = int((now != active).sum())
    return Sums(first, first if not changed else half(active), changed)
