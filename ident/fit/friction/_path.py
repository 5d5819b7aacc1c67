"""The best way through candidates for each knot of polylines: dynamic programmes.

One polyline for each of some curves: what is done for one of them takes less time than
to begin it.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ._curve import Curves, Points

_NARROW = 0.5
"""List units of speed: knots closer than that are none."""
_NOTHING = 1e-14
"""Share of the weight that is none."""
_FLAT = 1e-12
"""Share of the squares below which the spread of places is rounding alone."""


def best_path(
    curves: Curves,
    places: Float[np.ndarray, "j k c"],
    heights: Float[np.ndarray, "j k c"],
) -> Points:
    """Return the best polylines through one candidate of each knot."""
    xx, xy, yy = _sums(curves, places, heights, 3)
    width = _steps(places)
    lean = _steps(heights) / np.maximum(width, _NARROW)
    cost = _possible(yy + lean * (lean * xx - 2.0 * xy), width)
    which = _cheapest([cost[:, k] for k in range(cost.shape[1])])
    return Points(_taken(places, which), _taken(heights, which))


def best_break(
    curves: Curves, places: Float[np.ndarray, "j k c"]
) -> Float[np.ndarray, "j k"]:
    """Return the places between which straight lines of their own follow the curves best.

    The lines need not meet: no heights to look for, and where a curve bends the ends of
    the lines are nearly those of a polyline.
    """
    cost = _lines(curves, places)
    which = _cheapest([cost[:, k] for k in range(cost.shape[1])])
    return _taken(places, which)


def best_break_of(
    curves: Curves, places: Float[np.ndarray, "j c"], count: int
) -> Float[np.ndarray, "j k"]:
    """Return as many of these places, the first and the last among them, alike."""
    cost = _lines(curves, np.stack([places] * 3, axis=1))
    first, step = cost[:, 0], cost[:, 1]
    which = _cheapest([first[:, :, :1], *[step] * (count - 3), step[:, -1:]])
    which[:, 0], which[:, -1] = 0, places.shape[1] - 1
    return np.take_along_axis(places, which, axis=1)


def _taken(
    candidates: Float[np.ndarray, "j k c"], which: Int[np.ndarray, "j k"]
) -> Float[np.ndarray, "j k"]:
    return np.take_along_axis(candidates, which[:, :, None], axis=2)[:, :, 0]


def _cheapest(steps: Sequence[np.ndarray]) -> Int[np.ndarray, "j k"]:
    """Return the candidate of each knot on the cheapest ways.

    Args:
        steps: Costs between each knot and the next: to each candidate (rows) from each.
    """
    costs = [np.zeros(steps[0][:, 0].shape)]
    for step in steps:
        costs.append((step + costs[-1][:, None]).min(axis=2))
    rows = np.arange(len(steps[0]))
    ways = [costs[-1].argmin(axis=1)]
    # Back from the end: where the cheapest way to a candidate came from.
    for step, cost in zip(reversed(steps), costs[-2::-1], strict=True):
        ways.append((step[rows, ways[-1]] + cost).argmin(axis=1))
    return np.stack(ways[::-1], axis=1)


def _sums(
    curves: Curves,
    places: Float[np.ndarray, "j k c"],
    heights: Float[np.ndarray, "j k c"],
    wanted: int,
) -> Float[np.ndarray, "{wanted} j s c c"]:
    """Return sums of x², xy, y², x, y and 1 between each two candidates, by weight.

    Candidates on the right are rows, those on the left columns, from which x and y are
    counted: squares of small numbers lose no digits. A knot's own point belongs to the
    segment on its left, that of the first knot to the first segment.

    Args:
        curves: What is summed.
        places: Candidates per knot.
        heights: Height to count from at each of them.
        wanted: So many of them.
    """
    end = curves.before(places)
    begin = end[:, :-1].copy()
    # A first knot may have been rounded up, beyond the first point.
    begin[:, 0] = curves.first[:, None]
    rows, knots, count = places.shape
    segments = rows * (knots - 1)
    x = places[:, :-1].reshape(segments, count)
    y = (heights[:, :-1] - curves.level[:, None, None]).reshape(segments, count)
    # What each sum about (x, y) takes of the sums of 1, x, x², y, xy and y² about 0.
    takes = (
        {0: x * x, 1: -2.0 * x, 2: 1.0},
        {0: x * y, 1: -y, 3: -x, 4: 1.0},
        {0: y * y, 3: -2.0 * y, 5: 1.0},
        {0: -x, 1: 1.0},
        {0: -y, 3: 1.0},
        {0: 1.0},
    )
    shift = np.zeros((segments, 6, wanted, count))
    for place, each in enumerate(takes[:wanted]):
        for of, share in each.items():
            shift[:, of, place] = share
    at_begin = curves.sums[begin.reshape(segments, count)]
    at_end = curves.sums[end[:, 1:].reshape(segments, count)]
    before = np.einsum("scm,smwc->swc", at_begin, shift)
    upto = (at_end @ shift.reshape(segments, 6, -1)).reshape(
        segments, count, wanted, count
    )
    # One sum after the other: all that follows runs through memory as it lies there.
    found = np.empty((wanted, segments, count, count))
    np.subtract(upto.transpose(2, 0, 1, 3), before.swapaxes(0, 1)[:, :, None], found)
    return found.reshape(wanted, rows, knots - 1, count, count)


def _possible(
    cost: Float[np.ndarray, "j s c c"], width: Float[np.ndarray, "j s c c"]
) -> Float[np.ndarray, "j s c c"]:
    """Return costs of lines; those that do not go to the right are infinitely bad."""
    return np.asarray(np.where(width > _NARROW, np.maximum(cost, 0.0), np.inf))


def _steps(candidates: Float[np.ndarray, "j k c"]) -> Float[np.ndarray, "j s c c"]:
    """Return how far it is to each candidate of the next knot (rows) from each."""
    return np.asarray(candidates[:, 1:, :, None] - candidates[:, :-1, None, :])


def _lines(
    curves: Curves, places: Float[np.ndarray, "j k c"]
) -> Float[np.ndarray, "j s c c"]:
    """Return the weighted squares left by the best straight line between candidates."""
    xx, xy, yy, x, y, one = _sums(curves, places, curves.at(places), 6)
    # Where nothing counts, nothing is left.
    per_one = np.where(one > _NOTHING, 1.0 / np.maximum(one, _NOTHING), 0.0)
    mean = x * per_one
    spread = xx - mean * x
    both = xy - mean * y
    rises = spread > _FLAT * xx
    gain = np.where(rises, both * both / np.where(rises, spread, 1.0), 0.0)
    return _possible(yy - y * y * per_one - gain, _steps(places))
