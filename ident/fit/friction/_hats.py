"""Polylines that follow a curve: their best heights, and their knots on the way downhill.

Each segment has two hats: what the knot on its left says, falling from 1 to 0 along it, and
what the knot on its right says. The matrix of their products has three diagonals, and all
that is asked of it follows from sums over the places of the curve, segment by segment: one
pass in machine code for each trial of the knots (compiled like `_kernel`).
"""

from typing import NamedTuple, no_type_check

import numpy as np
from numba import njit, types

from .._machine_code import machine_code

_SETTLED = 1e-4
"""Share of the squares that a last step gains at most."""
_ENOUGH = 1e-8
"""Squares, in list units, below which nothing is left to gain."""
_CLOSEST = 1e-6
"""List units of speed: knots closer than that count as so far apart."""
_SHRINK = 0.7
"""Share of a gap between knots that one step may take away."""
_LIGHT = 1e-10
"""Share of the heaviest knot with which each leans on the curve: some have no point beside."""


class Hats(NamedTuple):
    """Knots with the heights that follow a curve best, and the sums that tell what moves them.

    Attributes:
        knots: Their places.
        heights: The best ones.
        cost: Weighted squares.
        gaps: Lengths of the segments.
        edges: First place of the curve in each segment, and the end.
        share: Way along its segment that each place has gone, 0 to 1.
        missed: What the polyline lacks there.
        squares: Left hat squared, left times right, right squared, summed by segment.
        pulls: Left and right hat times what is missed, likewise.
        inverse: Of the matrix of the heights.
    """

    knots: np.ndarray
    heights: np.ndarray
    cost: float
    gaps: np.ndarray
    edges: np.ndarray
    share: np.ndarray
    missed: np.ndarray
    squares: np.ndarray
    pulls: np.ndarray
    inverse: np.ndarray


@njit(error_model="numpy")
@no_type_check
def _inverse(diagonal, beside):
    """Return the inverse of a symmetric matrix with three diagonals."""
    many = len(diagonal)
    pivot, lower = np.empty(many), np.empty(many - 1)
    pivot[0] = diagonal[0]
    for k in range(many - 1):
        lower[k] = beside[k] / pivot[k]
        pivot[k + 1] = diagonal[k + 1] - lower[k] * beside[k]
    found = np.zeros((many, many))
    for j in range(many):
        own = found[j]
        own[j] = 1.0
        for k in range(j, many - 1):
            own[k + 1] = -lower[k] * own[k]
        own[many - 1] /= pivot[many - 1]
        for k in range(many - 2, -1, -1):
            own[k] = own[k] / pivot[k] - lower[k] * own[k + 1]
    return found


@njit(error_model="numpy")
@no_type_check
def _at(place, height, knot):
    """Return the first place of a curve beyond a knot, and its height there."""
    low, high = 0, len(place)
    while low < high:
        middle = (low + high) // 2
        if place[middle] <= knot:
            low = middle + 1
        else:
            high = middle
    if low in (0, len(place)):
        return low, height[max(low - 1, 0)]
    slope = (height[low] - height[low - 1]) / (place[low] - place[low - 1])
    return low, slope * (knot - place[low - 1]) + height[low - 1]


@njit(error_model="numpy")
@no_type_check
def _laid(place, height, weight, knots):
    """Return the best heights of knots at these places."""
    many = len(knots)
    count = many - 1
    edges, on = np.empty(many, np.int64), np.empty(many)
    for k in range(many):
        edges[k], on[k] = _at(place, height, knots[k])
    edges[0], edges[count] = 0, len(place)
    gaps, share, missed = np.empty(count), np.empty(len(place)), np.empty(len(place))
    squares, pulls = np.empty((3, count)), np.empty((2, count))
    diagonal, wanted = np.zeros(many), np.zeros(many)
    for k in range(count):
        gap = max(knots[k + 1] - knots[k], _CLOSEST)
        rise = on[k + 1] - on[k]
        whole = mixed = last = ahead = back = 0.0
        for s in range(edges[k], edges[k + 1]):
            along = min(max((place[s] - knots[k]) / gap, 0.0), 1.0)
            right = weight[s] * along
            left = weight[s] - right
            lack = height[s] - on[k] - along * rise
            whole += left
            mixed += left * along
            last += right * along
            ahead += left * lack
            back += right * lack
            share[s], missed[s] = along, lack
        gaps[k] = gap
        squares[0, k], squares[1, k], squares[2, k] = whole - mixed, mixed, last
        diagonal[k] += whole - mixed
        diagonal[k + 1] += last
        wanted[k] += ahead
        wanted[k + 1] += back
    # Knots with no point beside them lean on the curve, ever so lightly.
    largest = 0.0
    for k in range(many):
        largest = max(largest, diagonal[k])
    for k in range(many):
        diagonal[k] += _LIGHT * largest
    inverse = _inverse(diagonal, squares[1])
    off, heights = np.zeros(many), np.empty(many)
    for i in range(many):
        for j in range(many):
            off[i] += inverse[i, j] * wanted[j]
        heights[i] = on[i] + off[i]
    cost = 0.0
    for k in range(count):
        rise = off[k + 1] - off[k]
        ahead = back = 0.0
        for s in range(edges[k], edges[k + 1]):
            lack = missed[s] - (off[k] + share[s] * rise)
            right = weight[s] * share[s]
            ahead += (weight[s] - right) * lack
            back += right * lack
            cost += weight[s] * (lack * lack)
            missed[s] = lack
        pulls[0, k], pulls[1, k] = ahead, back
    return Hats(
        knots, heights, cost, gaps, edges, share, missed, squares, pulls, inverse
    )


@njit(error_model="numpy")
@no_type_check
def _slopes(hats):
    """Return the curvature of half the squares over the inner places, and the way down.

    Moving a knot by a little lowers the line by its slope, as far as the knot has a say: the
    columns of the places are those of the heights times the slope. The heights follow the
    places (variable projection). The way down is the last column.
    """
    count = len(hats.gaps)
    inner, squares = count - 1, hats.squares
    found, lean = np.zeros((inner, inner + 1)), np.empty(count)
    for k in range(count):
        lean[k] = (hats.heights[k + 1] - hats.heights[k]) / hats.gaps[k]
    # What a place says to the height of the knot before, of its own and of the one after.
    across, follow = np.empty((inner, 3)), np.zeros((inner, count + 1))
    for i in range(inner):
        one, two = lean[i], lean[i + 1]
        found[i, inner] = -two * hats.pulls[0, i + 1] - one * hats.pulls[1, i]
        found[i, i] = one * one * squares[2, i] + two * two * squares[0, i + 1]
        if i + 1 < inner:
            found[i, i + 1] = found[i + 1, i] = two * two * squares[1, i + 1]
        across[i, 0], across[i, 2] = -one * squares[1, i], -two * squares[1, i + 1]
        across[i, 1] = -one * squares[2, i] - two * squares[0, i + 1]
        for k in range(3):
            for j in range(count + 1):
                follow[i, j] += across[i, k] * hats.inverse[i + k, j]
    for i in range(inner):
        for j in range(inner):
            for k in range(3):
                found[i, j] -= follow[i, j + k] * across[j, k]
    return found


@njit(error_model="numpy")
@no_type_check
def _solved(matrix):
    """Return what solves some equations, moments in the last column; they are lost."""
    many = len(matrix)
    found = np.empty(many)
    for k in range(many):
        pivot = k
        for i in range(k + 1, many):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        for j in range(k, many + 1):
            matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        for i in range(k + 1, many):
            share = matrix[i, k] / matrix[k, k]
            for j in range(k, many + 1):
                matrix[i, j] -= share * matrix[k, j]
    for k in range(many - 1, -1, -1):
        rest = matrix[k, many]
        for j in range(k + 1, many):
            rest -= matrix[k, j] * found[j]
        found[k] = rest / matrix[k, k]
    return found


@njit(error_model="numpy")
@no_type_check
def _stepped(hats, equations, damping):
    """Return the places after one damped step downhill; no gap shrinks to nothing."""
    inner, gaps = len(equations), hats.gaps
    damped, scale = np.empty((inner, inner + 1)), np.empty(inner)
    largest = 0.0
    for i in range(inner):
        # In shares of the gaps beside a knot, steps of all knots compare.
        scale[i] = min(gaps[i], gaps[i + 1])
        largest = max(largest, equations[i, i] * scale[i] * scale[i])
    for i in range(inner):
        for j in range(inner):
            damped[i, j] = equations[i, j] * scale[i] * scale[j]
        damped[i, inner] = equations[i, inner] * scale[i]
        damped[i, i] += damping * max(damped[i, i], 1e-9 * largest + 1e-300)
    solved, step, shrunk = _solved(damped), np.zeros(inner + 2), 1e-300
    for i in range(inner):
        step[i + 1] = scale[i] * solved[i]
    for k in range(inner + 1):
        shrunk = max(shrunk, (step[k] - step[k + 1]) / gaps[k])
    for k in range(inner + 2):
        step[k] = hats.knots[k] + step[k] * min(1.0, _SHRINK / shrunk)
    return step


@no_type_check
def _downhill(place, height, weight, knots, most):
    """Return where damped Gauss-Newton steps of the places lead, so many at most."""
    now = _laid(place, height, weight, knots)
    if len(knots) < 3 or not most:
        return now
    equations, damping = _slopes(now), 1e-3
    for _ in range(most):
        there = _laid(place, height, weight, _stepped(now, equations, damping))
        if not there.cost < now.cost:
            damping *= 8.0
            if damping > 1e9:
                break
            continue
        gain = now.cost - there.cost
        now = there
        if gain <= _SETTLED * now.cost or now.cost < _ENOUGH:
            break
        equations = _slopes(now)
        damping = max(0.2 * damping, 1e-9)
    return now


_Given = types.Array(types.float64, 1, "C", readonly=True)
_Line = types.Array(types.float64, 1, "C")
_Places = types.Array(types.int64, 1, "C")
_Table = types.Array(types.float64, 2, "C")
HATS = types.NamedTuple(  # type: ignore[no-untyped-call]
    (
        *(_Line, _Line, types.float64, _Line, _Places),
        *(_Line, _Line, _Table, _Table, _Table),
    ),
    Hats,
)
downhill = machine_code(_downhill, HATS(_Given, _Given, _Given, _Line, types.int64))
