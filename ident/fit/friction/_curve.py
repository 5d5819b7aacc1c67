"""A friction curve in list units, and knots that are to follow it."""

import dataclasses
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float


@dataclasses.dataclass(frozen=True)
class Points:
    """Knots of a polyline.

    Attributes:
        places: Ascending, in list units of speed.
        heights: In list units of current.
    """

    places: Float[np.ndarray, " k"]
    heights: Float[np.ndarray, " k"]


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
        wx, wy = w * x, w * y
        sums = np.zeros((len(x) + 1, 6))
        sums[1:].T[:] = w, wx, wx * x, wy, wx * y, wy * y
        np.cumsum(sums, axis=0, out=sums)
        return sums

    @cached_property
    def slope(self) -> Float[np.ndarray, " m"]:
        """Slope of the curve at its places: that of the parabola through the neighbours."""
        gap = self.place[1:] - self.place[:-1]
        lean = (self.height[1:] - self.height[:-1]) / gap
        found = np.empty(len(self.place))
        found[0], found[-1] = lean[0], lean[-1]
        found[1:-1] = (lean[:-1] * gap[1:] + lean[1:] * gap[:-1]) / (gap[1:] + gap[:-1])
        return found

    def at(self, place: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
        """Return the height of the curve at places."""
        return np.asarray(np.interp(place, self.place, self.height))

    def rms(self, points: Points) -> float:
        """Return the weighted root mean square distance of a polyline."""
        error = np.interp(self.place, points.places, points.heights) - self.height
        return float(np.sqrt(self.weight @ error**2))
