"""A friction curve in list units, and knots that are to follow it."""

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float, Int


@dataclasses.dataclass(frozen=True)
class Points:
    """Knots of a polyline, or of one for each of some curves.

    Attributes:
        places: Ascending, in list units of speed.
        heights: In list units of current.
    """

    places: Float[np.ndarray, "*j k"]
    heights: Float[np.ndarray, "*j k"]


@final
@dataclasses.dataclass(frozen=True)
class Curve:
    """A curve with weights, and the sums that tell the misfit of any straight line at once.

    Attributes:
        place: Ascending, in list units of speed.
        height: In list units of current.
        raw_weight: How much each place counts.
    """

    place: Float[np.ndarray, " m"]
    height: Float[np.ndarray, " m"]
    raw_weight: Float[np.ndarray, " m"]

    @cached_property
    def weight(self) -> Float[np.ndarray, " m"]:
        """How much each place counts, all together 1."""
        return np.asarray(self.raw_weight / self.raw_weight.sum())

    @cached_property
    def level(self) -> float:
        """Mean height; sums are about it, since a misfit is a small difference of them."""
        return float(self.weight @ self.height)

    @cached_property
    def sums(self) -> Float[np.ndarray, "m1 6"]:
        """Weight, x, x², y, xy and y² summed up to each place.

        Places are counted from rest, where segments are short: there the sums are small.
        """
        x, y, w = self.place, self.height - self.level, self.weight
        sums = np.zeros((len(x) + 1, 6))
        terms = np.stack([w, w * x, w * x * x, w * y, w * x * y, w * y * y], axis=1)
        np.cumsum(terms, axis=0, out=sums[1:])
        return sums

    @cached_property
    def slope(self) -> Float[np.ndarray, " m"]:
        """Slope of the curve at its places."""
        return np.asarray(np.gradient(self.height, self.place))

    def at(self, place: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
        """Return the height of the curve at places."""
        return np.asarray(np.interp(place, self.place, self.height))

    def rms(self, points: Points) -> float:
        """Return the weighted root mean square distance of a polyline."""
        error = np.interp(self.place, points.places, points.heights) - self.height
        return float(np.sqrt(self.weight @ error**2))


@final
@dataclasses.dataclass(frozen=True)
class Curves:
    """Some curves side by side; what is asked of them has one row for each.

    Attributes:
        each: The curves.
    """

    each: Sequence[Curve]

    @cached_property
    def first(self) -> Int[np.ndarray, " j"]:
        """Row of `sums` at which those of each curve begin."""
        sizes = [len(curve.sums) for curve in self.each]
        return np.cumsum([0, *sizes[:-1]])

    @cached_property
    def sums(self) -> Float[np.ndarray, "m 6"]:
        """The sums of all of them, one below the other."""
        return np.concatenate([curve.sums for curve in self.each])

    @cached_property
    def level(self) -> Float[np.ndarray, " j"]:
        """Their mean heights."""
        return np.array([curve.level for curve in self.each])

    def before(self, place: Float[np.ndarray, "j *k"]) -> Int[np.ndarray, "j *k"]:
        """Return the row of `sums` up to each place."""
        found = [
            curve.place.searchsorted(own, "right") + first
            for curve, own, first in zip(self.each, place, self.first, strict=True)
        ]
        return np.stack(found)

    def at(self, place: Float[np.ndarray, "j *k"]) -> Float[np.ndarray, "j *k"]:
        """Return the heights of the curves at places."""
        pairs = zip(self.each, place, strict=True)
        return np.stack([curve.at(own) for curve, own in pairs])

    def slope_at(self, place: Float[np.ndarray, "j *k"]) -> Float[np.ndarray, "j *k"]:
        """Return the slopes of the curves at places."""
        pairs = zip(self.each, place, strict=True)
        return np.stack(
            [np.interp(own, curve.place, curve.slope) for curve, own in pairs]
        )
