"""The search for the knots of a friction curve.

Knots begin where straight lines of their own would end, found by a dynamic programme over
places, and go downhill from there as a polyline. Programmes over whole places and heights
around them then find the whole numbers of the list.
"""

import numpy as np
from jaxtyping import Float

from ._curve import Curve, Points
from ._polyline import best_heights, polished

_PLACES = 40
"""Places of which the first knots are chosen, at least; two for each."""
_BENT = 0.75
"""Share of them that lie where the curve bends."""
_REACHES = (0.9, 0.4)
"""Shares of the gap beside a knot in which its place is looked for again."""
_NEAR = np.linspace(-1.0, 1.0, 9)
_ROUNDED = (0.9, 0.9, 0.45, 0.2)
"""The same for whole heights."""
_LAST = (4.0, 1.0)
"""List units of speed by which whole places are moved in the end."""
_BLOCK = np.stack([np.repeat([-1.0, 0.0, 1.0], 3), np.tile([-1.0, 0.0, 1.0], 3)])
_ENDS = [0, -1]


def best_knots(curve: Curve, low: int, high: int, most: int) -> tuple[Points, Points]:
    """Return the best knots of a curve, and the best whole numbers near them.

    Args:
        curve: What the knots are to follow.
        low: Place of the first knot, in list units of speed.
        high: Of the last one.
        most: Knots at most.
    """
    places = _candidates(curve, low, high, max(_PLACES, 2 * most))
    count = min(most, len(places))
    if count > 2:
        places = _breaks(curve, places, count)
        for reach in _REACHES:
            near = places[:, None] + _beside(places, reach * _NEAR)
            places = _cheapest(curve, near, curve.at(near), meet=False).places
    best = polished(curve, places[[0, -1]] if count < 3 else places)
    return best, _on_whole_numbers(curve, best, low, high)


def _candidates(
    curve: Curve, low: int, high: int, count: int
) -> Float[np.ndarray, " c"]:
    """Return places to begin with: most where the curve bends, some of them anywhere.

    Straight lines follow a curve best where their ends lie as densely as the fifth root
    of weight times bend squared.
    """
    place = curve.place
    gap = place[1:] - place[:-1]
    lean = (curve.height[1:] - curve.height[:-1]) / gap
    across = 0.5 * (gap[1:] + gap[:-1])
    bend = (lean[1:] - lean[:-1]) / across
    dense = across * (bend * bend * curve.weight[1:-1] / across) ** 0.2
    bends = np.zeros(len(place))
    np.cumsum(dense, out=bends[1:-1])
    bends[-1] = dense.sum()
    evenly = [np.log(place / place[0]), place - place[0], curve.sums[1:, 0]]
    share = sum(each / each[-1] for each in evenly) * (1.0 - _BENT) / 3.0
    share = share + _BENT * bends / max(bends[-1], 1e-300)
    found = np.interp(np.linspace(share[0], share[-1], count), share, place)
    found[0], found[-1] = low, high
    found = np.minimum(np.maximum(np.round(found), low), high)
    return np.append(found[:-1][found[1:] > found[:-1]], high)


def _breaks(
    curve: Curve, among: Float[np.ndarray, " c"], count: int
) -> Float[np.ndarray, " k"]:
    """Return the places between which straight lines of their own follow the curve best.

    The lines need not meet: no heights to look for, and where a curve bends the ends of
    the lines are nearly those of a polyline.
    """
    from . import _path

    which = np.empty(count, np.int64)
    _path.chain(curve.place, curve.sums, curve.level, among, curve.at(among), which)
    return among[which]


def _cheapest(
    curve: Curve,
    places: Float[np.ndarray, "k c"],
    heights: Float[np.ndarray, "k c"],
    *,
    meet: bool,
) -> Points:
    """Return the best way through one candidate of each knot; lines meet or need not."""
    from . import _path

    which = np.empty(len(places), np.int64)
    _path.cheapest(curve.place, curve.sums, curve.level, places, heights, meet, which)
    knots = np.arange(len(places))
    return Points(places[knots, which], heights[knots, which])


def _beside(
    places: Float[np.ndarray, " k"], shares: Float[np.ndarray, " a"]
) -> Float[np.ndarray, "k a"]:
    """Return steps from each knot, in shares of the gap to the next; ends are pinned."""
    gaps = (places[1:] - places[:-1])[:, None]
    step = np.zeros((len(places), len(shares)))
    step[:-1] = gaps * np.maximum(shares, 0.0)
    step[1:] += gaps * np.minimum(shares, 0.0)
    step[_ENDS] = 0.0
    return step


def _on_whole_numbers(curve: Curve, points: Points, low: int, high: int) -> Points:
    """Return the best whole numbers near the best knots."""
    from . import _path

    # No two on one place.
    rank = np.arange(float(len(points.places)))
    places = np.maximum.accumulate(np.round(points.places) - rank) + rank
    places = np.minimum(places, high - rank[::-1])
    found = Points(places, np.round(best_heights(curve, places)))
    off = points.heights - curve.at(points.places)
    around = np.empty((2, len(places), 4 * _path.MIDDLE + 3))
    for reach in _ROUNDED:
        _path.crossings(
            *(curve.place, curve.height, curve.slope, found.places, found.heights),
            *(off, reach, *around),
        )
        found = _cheapest(curve, *around, meet=True)
    for step in _LAST:
        beside = found.places[:, None] + step * _BLOCK[0]
        beside[_ENDS] = found.places[_ENDS, None]
        beside = np.minimum(np.maximum(beside, low), high)
        heights = found.heights[:, None] + _BLOCK[1]
        found = _cheapest(curve, beside, heights, meet=True)
    return found
