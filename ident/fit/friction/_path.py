"""The best way through candidates for each knot of a polyline: dynamic programmes."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ._curve import Curve, Points

_NARROW = 0.5
"""List units of speed: knots closer than that are none."""
_NOTHING = 1e-14
"""Share of the weight that is none."""
_FLAT = 1e-12
"""Share of the squares below which the spread of places is rounding alone."""


def best_path(
    curve: Curve, places: Float[np.ndarray, "k c"], heights: Float[np.ndarray, "k c"]
) -> Points:
    """Return the best polyline through one candidate of each knot."""
    xx, xy, yy = _sums(curve, places, heights, 3)
    width = _widths(places)
    lean = (heights[1:, :, None] - heights[:-1, None, :]) / np.maximum(width, _NARROW)
    which = _cheapest(list(_possible(yy + lean * (lean * xx - 2.0 * xy), width)))
    rows = np.arange(len(places))
    return Points(places[rows, which], heights[rows, which])


def best_break(
    curve: Curve, places: Float[np.ndarray, "k c"]
) -> Float[np.ndarray, " k"]:
    """Return the places between which straight lines of their own follow the curve best.

    The lines need not meet: no heights to look for, and where the curve bends the ends
    of the lines are nearly those of a polyline.
    """
    which = _cheapest(list(_lines(curve, places)))
    return np.asarray(places[np.arange(len(places)), which])


def best_break_of(
    curve: Curve, places: Float[np.ndarray, " c"], count: int
) -> Float[np.ndarray, " k"]:
    """Return as many of these places, the first and the last among them, alike."""
    first, step = _lines(curve, np.stack([places] * 3))
    which = _cheapest([first[:, :1], *[step] * (count - 3), step[-1:]])
    which[0], which[-1] = 0, len(places) - 1
    return np.asarray(places[which])


def _cheapest(steps: Sequence[np.ndarray]) -> Int[np.ndarray, " k"]:
    """Return the candidate of each knot on the cheapest way.

    Args:
        steps: Costs between each knot and the next: to each candidate (rows) from each.
    """
    rows = np.arange(len(steps[0]))
    cost: np.ndarray | float = 0.0
    came = []
    for each in steps:
        total = each + cost
        best = total.argmin(axis=1)
        came.append(best)
        cost = total[rows[: len(best)], best]
    at = int(np.argmin(cost))
    path = [at]
    for best in reversed(came):
        path.append(int(best[path[-1]]))
    return np.array(path[::-1])


def _sums(
    curve: Curve,
    places: Float[np.ndarray, "k c"],
    heights: Float[np.ndarray, "k c"],
    wanted: int,
) -> list[Float[np.ndarray, "s c c"]]:
    """Return sums of x², xy, y², x, y and 1 between each two candidates, by weight.

    Candidates on the right are rows, those on the left columns, from which x and y are
    counted: squares of small numbers lose no digits. A knot's own point belongs to the
    segment on its left, that of the first knot to the first segment.

    Args:
        curve: What is summed.
        places: Candidates per knot.
        heights: Height to count from at each of them.
        wanted: So many of them.
    """
    end = curve.place.searchsorted(places, "right")
    begin = end[:-1].copy()
    begin[0] = 0  # a first knot may have been rounded up, beyond the first point
    x, y = places[:-1], heights[:-1] - curve.level
    segments, count = x.shape
    # What each sum about (x, y) takes of the sums of 1, x, x², y, xy and y² about 0.
    shift = np.zeros((segments, 6, 6, count))
    shift[:, [2, 4, 5, 1, 3, 0], [0, 1, 2, 3, 4, 5]] = 1.0
    shift[:, 0, 0], shift[:, 1, 0] = x * x, -2.0 * x
    shift[:, 0, 1], shift[:, 1, 1], shift[:, 3, 1] = x * y, -y, -x
    shift[:, 0, 2], shift[:, 3, 2] = y * y, -2.0 * y
    shift[:, 0, 3], shift[:, 0, 4] = -x, -y
    shift = np.ascontiguousarray(shift[:, :, :wanted])
    before = np.einsum("scm,smwc->swc", curve.sums[begin], shift)
    found = curve.sums[end[1:]] @ shift.reshape(segments, 6, -1)
    found -= before.reshape(segments, 1, -1)
    return [found[:, :, k * count : (k + 1) * count] for k in range(wanted)]


def _possible(
    cost: Float[np.ndarray, "s c c"], width: Float[np.ndarray, "s c c"]
) -> Float[np.ndarray, "s c c"]:
    """Return costs of lines; those that do not go to the right are infinitely bad."""
    return np.asarray(np.where(width > _NARROW, np.maximum(cost, 0.0), np.inf))


def _widths(places: Float[np.ndarray, "k c"]) -> Float[np.ndarray, "s c c"]:
    return np.asarray(places[1:, :, None] - places[:-1, None, :])


def _lines(
    curve: Curve, places: Float[np.ndarray, "k c"]
) -> Float[np.ndarray, "s c c"]:
    """Return the weighted squares left by the best straight line between candidates."""
    xx, xy, yy, x, y, one = _sums(curve, places, curve.at(places), 6)
    # Where nothing counts, nothing is left.
    per_one = np.where(one > _NOTHING, 1.0 / np.maximum(one, _NOTHING), 0.0)
    mean = x * per_one
    spread = xx - mean * x
    both = xy - mean * y
    rises = spread > _FLAT * xx
    gain = np.where(rises, both * both / np.where(rises, spread, 1.0), 0.0)
    return _possible(yy - y * y * per_one - gain, _widths(places))
