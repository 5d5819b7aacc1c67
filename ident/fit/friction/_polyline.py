"""The polyline that follows a curve best, downhill from where its knots are."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float, Int

from ._curve import Curve, Points

_MOST = 25
"""Steps downhill at most."""
_SETTLED = 1e-4
"""Share of the squares that a last step gains at most."""
_ENOUGH = 1e-8
"""Squares, in list units, below which nothing is left to gain."""
_CLOSEST = 1e-6
"""List units of speed: knots closer than that count as so far apart."""
_MOVES = 3
"""Knots that are taken elsewhere at most."""
_TRIED = 0.2
"""Share of its loss that a knot must gain elsewhere to be taken there: the others follow."""
_WORTH = 0.999
"""Share of the squares that is left at most where that was worth it."""
_SHRINK = 0.7
"""Share of a gap between knots that one step may take away."""
_LIGHT = 1e-10
"""Share of the heaviest knot with which each leans on the curve: some have no point beside."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class _Hats:
    """Knots with the heights that follow a curve best, and the sums that tell what moves them.

    Each segment has two hats: what the knot on its left says, falling from 1 to 0 along
    it, and what the knot on its right says.

    Attributes:
        points: Knots.
        cost: Weighted squares.
        gaps: Lengths of the segments.
        cell: Segment of each place of the curve.
        share: Way along its segment that each has gone, 0 to 1.
        left: Left hat there, times the weight.
        right: Right hat there, times the weight.
        missed: What the polyline lacks there.
        squares: Left hat squared, left times right and right squared, summed by segment.
        inverse: Of the matrix of the heights.
    """

    points: Points
    cost: float
    gaps: Float[np.ndarray, " s"]
    cell: Int[np.ndarray, " m"]
    share: Float[np.ndarray, " m"]
    left: Float[np.ndarray, " m"]
    right: Float[np.ndarray, " m"]
    missed: Float[np.ndarray, " m"]
    squares: tuple[
        Float[np.ndarray, " s"], Float[np.ndarray, " s"], Float[np.ndarray, " s"]
    ]
    inverse: Float[np.ndarray, "k k"]

    def slopes(self) -> tuple[Float[np.ndarray, "i i"], Float[np.ndarray, " i"]]:
        """Return the curvature of half the squares over the inner places, and the way down.

        Moving a knot by a little lowers the line by its slope, as far as the knot has a
        say: the columns of the places are those of the heights times the slope. The
        heights follow the places (variable projection).
        """
        count = len(self.gaps)
        lean = np.diff(self.points.heights) / self.gaps
        ahead = lean * np.bincount(self.cell, self.left * self.missed, count)
        back = lean * np.bincount(self.cell, self.right * self.missed, count)
        first, mixed, last = (lean * each for each in self.squares)
        inner = count - 1
        both = np.zeros((inner, inner))
        _diagonal(both, 0)[:] = (lean * last)[:-1] + (lean * first)[1:]
        _diagonal(both, 1)[:] = _diagonal(both, -1)[:] = (lean * mixed)[1:-1]
        across = np.zeros((count + 1, inner))
        flat = across.reshape(-1)
        flat[:: inner + 1][:inner] = -mixed[:-1]
        flat[inner :: inner + 1][:inner] = -last[:-1] - first[1:]
        flat[2 * inner :: inner + 1][:inner] = -mixed[1:]
        both -= across.T @ (self.inverse @ across)
        return both, -ahead[1:] - back[:-1]

    def exchanged(self) -> Float[np.ndarray, " k"] | None:
        """Return the places with one knot taken to where it gains more, or None.

        What taking a knot away costs, and what one more in the middle of a segment
        gains, both follow from the sums that are there; each for itself.
        """
        count = len(self.gaps)
        if count < 3:
            return None
        per_gap = 1.0 / self.gaps
        lean = np.diff(self.points.heights) * per_gap
        rows = np.arange(count - 1)
        bend = np.zeros((count - 1, count + 1))
        bend[rows, rows], bend[rows, rows + 2] = per_gap[:-1], per_gap[1:]
        bend[rows, rows + 1] = -per_gap[:-1] - per_gap[1:]
        lost = np.diff(lean) ** 2 / ((bend @ self.inverse) * bend).sum(axis=1)
        hat = 2.0 * np.minimum(self.share, 1.0 - self.share)
        raised = np.minimum(self.left, self.right) * 2.0
        first = np.bincount(self.cell, hat * self.left, count)
        last = np.bincount(self.cell, hat * self.right, count)
        whole = np.bincount(self.cell, hat * raised, count)
        cells = np.arange(count)
        own = whole - (
            first * first * self.inverse[cells, cells]
            + 2.0 * first * last * self.inverse[cells, cells + 1]
            + last * last * self.inverse[cells + 1, cells + 1]
        )
        gained = np.bincount(self.cell, raised * self.missed, count) ** 2
        gained = np.where(own > 1e-6 * whole, gained / np.maximum(own, 1e-300), 0.0)
        # A knot beside the segment would be missed there.
        worth = gained[:, None] - _TRIED * lost
        worth[cells[1:], rows] = worth[cells[:-1], rows] = -np.inf
        to, knot = divmod(int(np.argmax(worth)), count - 1)
        if not worth[to, knot] > 0:
            return None
        middle = 0.5 * (self.points.places[to] + self.points.places[to + 1])
        rest = np.delete(self.points.places, knot + 1)
        return np.sort(np.append(rest, middle))


def _diagonal(matrix: Float[np.ndarray, "r c"], above: int) -> Float[np.ndarray, " d"]:
    """Return a view of a diagonal of a square matrix."""
    width = len(matrix)
    flat = matrix.reshape(-1)
    begin = above if above >= 0 else -above * width
    return flat[begin :: width + 1][: width - abs(above)]


def _hats(curve: Curve, places: Float[np.ndarray, " k"]) -> _Hats:
    """Return the best heights of knots at these places."""
    count = len(places) - 1
    edges = np.empty(count + 1, np.int64)
    edges[0], edges[-1] = 0, len(curve.place)
    edges[1:-1] = curve.place.searchsorted(places[1:-1], "right")
    cell = np.repeat(np.arange(count), edges[1:] - edges[:-1])
    gaps = np.maximum(places[1:] - places[:-1], _CLOSEST)
    share = (curve.place - places[cell]) / gaps[cell]
    share = np.minimum(np.maximum(share, 0.0), 1.0)
    right = curve.weight * share
    left = curve.weight - right
    mixed = np.bincount(cell, left * share, count)
    first = np.bincount(cell, left, count) - mixed
    last = np.bincount(cell, right * share, count)
    on = curve.at(places)
    missed = curve.height - on[cell] - share * (on[1:] - on[:-1])[cell]
    matrix = np.zeros((count + 1, count + 1))
    diagonal = _diagonal(matrix, 0)
    diagonal[:-1] = first
    diagonal[1:] += last
    # Knots with no point beside them lean on the curve, ever so lightly.
    diagonal += _LIGHT * diagonal.max()
    _diagonal(matrix, 1)[:] = _diagonal(matrix, -1)[:] = mixed
    wanted = np.zeros(count + 1)
    wanted[:-1] = np.bincount(cell, left * missed, count)
    wanted[1:] += np.bincount(cell, right * missed, count)
    inverse = np.linalg.inv(matrix)
    off = inverse @ wanted
    missed -= off[cell] + share * (off[1:] - off[:-1])[cell]
    return _Hats(
        points=Points(places, on + off),
        cost=float(curve.weight @ (missed * missed)),
        gaps=gaps,
        cell=cell,
        share=share,
        left=left,
        right=right,
        missed=missed,
        squares=(first, mixed, last),
        inverse=inverse,
    )


def best_heights(
    curve: Curve, places: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Return the heights of knots at these places that follow the curve best."""
    return _hats(curve, places).points.heights


def polished(curve: Curve, places: Float[np.ndarray, " k"]) -> Points:
    """Return the knots after their places went downhill, ends pinned, heights the best ones.

    Where a knot serves more elsewhere it is taken there, and all go downhill again.
    """
    found = _downhill(curve, _hats(curve, places.astype(float)))
    for _ in range(_MOVES):
        moved = None if found.cost < _ENOUGH else found.exchanged()
        if moved is None:
            break
        there = _downhill(curve, _hats(curve, moved))
        if there.cost > _WORTH * found.cost:
            break
        found = there
    return found.points


def _downhill(curve: Curve, now: _Hats) -> _Hats:
    """Return where damped Gauss-Newton steps of the places lead.

    No gap between knots shrinks to nothing in one step.
    """
    if len(now.gaps) < 2:
        return now
    matrix, push = now.slopes()
    damping = 1e-3
    for _ in range(_MOST):
        # In shares of the gaps beside a knot, steps of all knots compare.
        scale = np.minimum(now.gaps[1:], now.gaps[:-1])
        damped = matrix * scale * scale[:, None]
        diagonal = _diagonal(damped, 0)
        diagonal += damping * np.maximum(diagonal, 1e-9 * diagonal.max() + 1e-300)
        step = np.zeros(len(now.gaps) + 1)
        step[1:-1] = scale * np.linalg.solve(damped, scale * push)
        shrunk = float(np.max((step[:-1] - step[1:]) / now.gaps))
        step *= min(1.0, _SHRINK / max(shrunk, 1e-300))
        there = _hats(curve, now.points.places + step)
        if there.cost >= now.cost:
            damping *= 8.0
            if damping > 1e9:
                break
            continue
        gain = now.cost - there.cost
        now = there
        if gain <= _SETTLED * now.cost or now.cost < _ENOUGH:
            break
        matrix, push = now.slopes()
        damping = max(0.2 * damping, 1e-9)
    return now
