"""The polyline that follows a curve best, downhill from where its knots are."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ._curve import Curve, Points

if TYPE_CHECKING:
    from ._hats import Hats

_ENOUGH = 1e-8
"""Squares, in list units, below which nothing is left to gain."""
_MOST = 25
"""Steps downhill at most."""
_MOVES = 3
"""Knots that are taken elsewhere at most."""
_TRIED = 0.2
"""Share of its loss that a knot must gain elsewhere to be taken there: the others follow."""
_WORTH = 0.999
"""Share of the squares that is left at most where that was worth it."""


def best_heights(
    curve: Curve, places: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Return the heights of knots at these places that follow the curve best."""
    from . import _hats

    found = _hats.downhill(curve.place, curve.height, curve.weight, places, 0)
    return np.asarray(found.heights)


def polished(curve: Curve, places: Float[np.ndarray, " k"]) -> Points:
    """Return the knots after their places went downhill, ends pinned, heights the best ones.

    Where a knot serves more elsewhere it is taken there, and all go downhill again.
    """
    from . import _hats

    given = curve.place, curve.height, curve.weight
    found = _hats.downhill(*given, places, _MOST)
    for _ in range(_MOVES):
        moved = None if found.cost < _ENOUGH else _exchanged(found, curve.weight)
        if moved is None:
            break
        there = _hats.downhill(*given, moved, _MOST)
        if there.cost > _WORTH * found.cost:
            break
        found = there
    return Points(found.knots, found.heights)


def _exchanged(
    hats: "Hats", weight: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " k"] | None:
    """Return the places with one knot taken to where it gains more, or None.

    What taking a knot away costs, and what one more in the middle of a segment gains, both
    follow from the sums that are there; each for itself.

    Args:
        hats: The knots.
        weight: Of each place of the curve.
    """
    count = len(hats.gaps)
    if count < 3:
        return None
    cell = np.repeat(np.arange(count), hats.edges[1:] - hats.edges[:-1])
    per_gap = 1.0 / hats.gaps
    lean = (hats.heights[1:] - hats.heights[:-1]) * per_gap
    rows = np.arange(count - 1)
    bend = np.zeros((count - 1, count + 1))
    bend[rows, rows], bend[rows, rows + 2] = per_gap[:-1], per_gap[1:]
    bend[rows, rows + 1] = -per_gap[:-1] - per_gap[1:]
    lost = (lean[1:] - lean[:-1]) ** 2 / ((bend @ hats.inverse) * bend).sum(axis=1)
    right = weight * hats.share
    left = weight - right
    hat = 2.0 * np.minimum(hats.share, 1.0 - hats.share)
    raised = np.minimum(left, right) * 2.0
    first = np.bincount(cell, hat * left, count)
    last = np.bincount(cell, hat * right, count)
    whole = np.bincount(cell, hat * raised, count)
    cells = np.arange(count)
    own = whole - (
        first * first * hats.inverse[cells, cells]
        + 2.0 * first * last * hats.inverse[cells, cells + 1]
        + last * last * hats.inverse[cells + 1, cells + 1]
    )
    gained = np.bincount(cell, raised * hats.missed, count) ** 2
    gained = np.where(own > 1e-6 * whole, gained / np.maximum(own, 1e-300), 0.0)
    # A knot beside the segment would be missed there.
    worth = gained[:, None] - _TRIED * lost
    worth[cells[1:], rows] = worth[cells[:-1], rows] = -np.inf
    to, knot = divmod(int(np.argmax(worth)), count - 1)
    if not worth[to, knot] > 0:
        return None
    middle = 0.5 * (hats.knots[to] + hats.knots[to + 1])
    return np.sort(np.append(np.delete(hats.knots, knot + 1), middle))
