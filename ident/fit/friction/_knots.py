"""The search for the knots of friction curves, those of some curves side by side.

Knots begin where straight lines of their own would end, found by a dynamic programme over
places, and go downhill from there as a polyline. Programmes over whole places and heights
around them then find the whole numbers of the list.
"""

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ._curve import Curve, Curves, Points
from ._path import best_break, best_break_of, best_path
from ._polyline import best_heights, polished

_BESIDE = 8
"""Curves that are searched side by side: what they need fits the cache."""
_PLACES = 40
"""Places of which the first knots are chosen, at least; two for each."""
_BENT = 0.75
"""Share of them that lie where the curve bends."""
_REACHES = (0.9, 0.4)
"""Shares of the gap beside a knot in which its place is looked for again."""
_NEAR = np.linspace(-1.0, 1.0, 9)
_ROUNDED = (0.9, 0.9, 0.45, 0.2)
"""The same for whole heights."""
_MIDDLE = 3
_AROUND = np.linspace(-1.0, 1.0, 2 * _MIDDLE + 1)
_LAST = (4.0, 1.0)
"""List units of speed by which whole places are moved in the end."""
_BLOCK = np.stack([np.repeat([-1.0, 0.0, 1.0], 3), np.tile([-1.0, 0.0, 1.0], 3)])
_ENDS = [0, -1]


@dataclasses.dataclass(frozen=True, eq=False)
class Search:
    """What is looked for.

    Attributes:
        curve: What the knots are to follow.
        low: Place of the first knot, in list units of speed.
        high: Of the last one.
        most: Knots at most.
    """

    curve: Curve
    low: int
    high: int
    most: int

    @cached_property
    def candidates(self) -> Float[np.ndarray, " c"]:
        """Places to begin with."""
        count = max(_PLACES, 2 * self.most)
        return _candidates(self.curve, self.low, self.high, count)

    @property
    def count(self) -> int:
        """How many knots there will be."""
        return min(self.most, len(self.candidates))


def search_all(searches: Sequence[Search]) -> list[tuple[Points, Points]]:
    """Return the best knots of each curve, and the best whole numbers near them."""
    alike: dict[tuple[int, int], list[int]] = {}
    for place, each in enumerate(searches):
        shape = len(each.candidates), each.count
        alike.setdefault(shape, []).append(place)
    found: dict[int, tuple[Points, Points]] = {}
    for own in alike.values():
        for start in range(0, len(own), _BESIDE):
            some = own[start : start + _BESIDE]
            found |= zip(some, _search([searches[k] for k in some]), strict=True)
    return [found[place] for place in range(len(searches))]


def _search(searches: Sequence[Search]) -> list[tuple[Points, Points]]:
    """Return what `search_all` does, for searches of one shape."""
    curves = Curves([each.curve for each in searches])
    best = _best(searches, curves)
    places = np.stack([each.places for each in best])
    heights = np.stack([each.heights for each in best])
    low = np.array([each.low for each in searches], float)
    high = np.array([each.high for each in searches], float)
    whole = _on_whole_numbers(curves, Points(places, heights), low, high)
    return [
        (each, Points(*numbers))
        for each, *numbers in zip(best, whole.places, whole.heights, strict=True)
    ]


def _best(searches: Sequence[Search], curves: Curves) -> list[Points]:
    """Return the best knots, places and heights any numbers, ends pinned in place."""
    places = np.stack([each.candidates for each in searches])
    count = searches[0].count
    found = places[:, _ENDS]
    if count > 2:
        found = best_break_of(curves, places, count)
        for reach in _REACHES:
            beside = _beside(found, reach * _NEAR)
            found = best_break(curves, found[:, :, None] + beside)
    return [
        polished(curve, places)
        for curve, places in zip(curves.each, found, strict=True)
    ]


def _candidates(
    curve: Curve, low: int, high: int, count: int
) -> Float[np.ndarray, " c"]:
    """Return places to begin with: most where the curve bends, some of them anywhere.

    Straight lines follow a curve best where their ends lie as densely as the fifth root
    of weight times bend squared.
    """
    place = curve.place
    gap = np.diff(place)
    across = 0.5 * (gap[1:] + gap[:-1])
    bend = np.diff(np.diff(curve.height) / gap) / across
    dense = across * (bend * bend * curve.weight[1:-1] / across) ** 0.2
    bends = np.concatenate([[0.0], np.cumsum(dense), [dense.sum()]])
    evenly = [np.log(place / place[0]), place - place[0], np.cumsum(curve.weight)]
    share = sum(each / each[-1] for each in evenly) * (1.0 - _BENT) / 3.0
    share = share + _BENT * bends / max(bends[-1], 1e-300)
    found = np.interp(np.linspace(share[0], share[-1], count), share, place)
    found[0], found[-1] = low, high
    return np.unique(np.clip(np.round(found), low, high))


def _beside(
    places: Float[np.ndarray, "j k"], shares: Float[np.ndarray, " a"]
) -> Float[np.ndarray, "j k a"]:
    """Return steps from each knot, in shares of the gap to the next; ends are pinned."""
    gaps = np.diff(places)[:, :, None]
    step = np.zeros((*places.shape, len(shares)))
    step[:, :-1] = gaps * np.maximum(shares, 0.0)
    step[:, 1:] += gaps * np.minimum(shares, 0.0)
    step[:, _ENDS] = 0.0
    return step


def _on_whole_numbers(
    curves: Curves,
    points: Points,
    low: Float[np.ndarray, " j"],
    high: Float[np.ndarray, " j"],
) -> Points:
    """Return the best whole numbers near the best knots."""
    # No two on one place.
    rank = np.arange(float(points.places.shape[1]))
    places = np.maximum.accumulate(np.round(points.places) - rank, axis=1) + rank
    places = np.minimum(places, high[:, None] - rank[::-1])
    pairs = zip(curves.each, places, strict=True)
    heights = np.stack([best_heights(curve, own) for curve, own in pairs])
    found = Points(places, np.round(heights))
    off = points.heights - curves.at(points.places)
    for reach in _ROUNDED:
        found = best_path(curves, *_crossings(curves, found, off, reach))
    for step in _LAST:
        beside = found.places[:, :, None] + step * _BLOCK[0]
        beside[:, _ENDS] = found.places[:, _ENDS, None]
        beside = np.clip(beside, low[:, None, None], high[:, None, None])
        found = best_path(curves, beside, found.heights[:, :, None] + _BLOCK[1])
    return found


def _crossings(
    curves: Curves, found: Points, off: Float[np.ndarray, "j k"], reach: float
) -> tuple[Float[np.ndarray, "j k c"], Float[np.ndarray, "j k c"]]:
    """Return whole places beside each knot where the best knots would have whole heights.

    Rounding a height costs most where the curve is steep; there the place can move to
    where nothing needs rounding. Where it is flat both whole heights are candidates.

    Args:
        curves: What they are to follow.
        found: The knots.
        off: How far the best heights are from the curve, per knot.
        reach: Share of the gaps beside a knot.
    """
    shares = reach * _AROUND
    step = _beside(found.places, shares)
    place = found.places[:, :, None] + step
    height = curves.at(place) + off[:, :, None]
    below = np.floor(height)
    slope = curves.slope_at(place)
    slope = np.where(np.abs(slope) > 1e-12, slope, 1e-12)
    # No further than half the way to the candidate beside.
    order = np.maximum(np.abs(np.arange(len(shares)) - _MIDDLE), 1)
    limit = 0.5 * np.abs(step) / order
    limit[:, :, _MIDDLE] = np.maximum(
        limit[:, :, _MIDDLE - 1], limit[:, :, _MIDDLE + 1]
    )
    moved = [
        place + np.minimum(np.maximum((whole - height) / slope, -limit), limit)
        for whole in (below, below + 1.0)
    ]
    places = np.round(np.concatenate([found.places[:, :, None], *moved], axis=2))
    heights = np.concatenate([found.heights[:, :, None], below, below + 1.0], axis=2)
    # The ends cannot move: heights around them.
    around = np.resize([0.0, 1.0, -1.0, 2.0, -2.0], heights.shape[2])
    heights[:, _ENDS] = found.heights[:, _ENDS, None] + around
    return places, heights
