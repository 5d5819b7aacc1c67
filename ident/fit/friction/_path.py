"""The best way through candidates for each knot of a polyline: dynamic programmes.

Sums over the places of a curve up to each of them (`Curve.sums`) tell the misfit of any line
between two candidates at once. Candidates of a knot are many, and lines between them are their
product: machine code (compiled like `_kernel`), in which vectors of lines are looked at
together. For that it takes the larger of two numbers by NumPy, and sums apart one by one.
"""

from typing import Any, no_type_check

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from .._machine_code import machine_code

_NARROW = 0.5
"""List units of speed: knots closer than that are none."""
_NOTHING = 1e-14
"""Share of the weight that is none."""
_FLAT = 1e-12
"""Share of the squares below which the spread of places is rounding alone."""
MIDDLE = 3
"""Places beside a knot that are tried on each side."""
_ENDS = (0.0, 1.0, -1.0, 2.0, -2.0)
"""Heights about that of an end, which cannot move."""


@intrinsic
@no_type_check
def _fused(typing: Any, one: Any, other: Any, plus: Any) -> Any:
    """Return one · other + plus, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.fma(*given)

    return types.float64(types.float64, types.float64, types.float64), generate


@njit(error_model="numpy")
@no_type_check
def _row(place, x):
    """Return how many places of a curve lie up to there, which is the row of its sums."""
    low, high = 0, len(place)
    while low < high:
        middle = (low + high) // 2
        if place[middle] <= x:
            low = middle + 1
        else:
            high = middle
    return low


@njit(error_model="numpy")
@no_type_check
def _begun(rows, sums, level, xs, ys):
    """Return what is counted from candidates on the left.

    In rows: x, height, y, and the sums of x², xy, y², x, y and 1 about (x, y) up to there. A
    knot's own point belongs to the segment on its left, that of the first knot to the first
    segment: it may have been rounded up, beyond the first point.
    """
    found = np.empty((9, len(xs)))
    for c in range(len(xs)):
        one, sx, sxx = sums[rows[c], 0], sums[rows[c], 1], sums[rows[c], 2]
        sy, sxy, syy = sums[rows[c], 3], sums[rows[c], 4], sums[rows[c], 5]
        x, y = xs[c], ys[c] - level
        found[0, c], found[1, c], found[2, c] = x, ys[c], y
        found[3, c] = one * (x * x) - sx * (2.0 * x) + sxx
        found[4, c] = one * (x * y) - sx * y - sy * x + sxy
        found[5, c] = one * (y * y) - sy * (2.0 * y) + syy
        found[6, c], found[7, c], found[8, c] = sx - one * x, sy - one * y, one
    return found


@njit(error_model="numpy")
@no_type_check
def _joined(left, upto, x, height, cost):
    """Write the weighted squares left by lines from candidates on the left to one.

    From the left end x and y are counted: squares of small numbers lose no digits.
    """
    one, sx, sxx = upto[0], upto[1], upto[2]
    sy, sxy, syy = upto[3], upto[4], upto[5]
    for c in range(len(cost)):
        a, b = left[0, c], left[2, c]
        xx = _fused(sx, -2.0 * a, one * (a * a)) + sxx - left[3, c]
        xy = _fused(sy, -a, _fused(sx, -b, one * (a * b))) + sxy - left[4, c]
        yy = _fused(sy, -2.0 * b, one * (b * b)) + syy - left[5, c]
        width = x - a
        lean = (height - left[1, c]) / np.maximum(width, _NARROW)
        miss = np.maximum(yy + lean * (lean * xx - 2.0 * xy), 0.0)
        cost[c] = miss if width > _NARROW else np.inf


@njit(error_model="numpy")
@no_type_check
def _apart(left, upto, x, cost):
    """Write the weighted squares left by the best lines in between, which need not meet."""
    one, sx, sxx = upto[0], upto[1], upto[2]
    sy, sxy, syy = upto[3], upto[4], upto[5]
    for c in range(len(cost)):
        a, b = left[0, c], left[2, c]
        xx = _fused(sx, -2.0 * a, one * (a * a)) + sxx - left[3, c]
        xy = _fused(sy, -a, _fused(sx, -b, one * (a * b))) + sxy - left[4, c]
        yy = _fused(sy, -2.0 * b, one * (b * b)) + syy - left[5, c]
        across, up = sx - one * a - left[6, c], sy - one * b - left[7, c]
        weight = one - left[8, c]
        # Where nothing counts, nothing is left.
        per_one = 1.0 / np.maximum(weight, _NOTHING) if weight > _NOTHING else 0.0
        mean = across * per_one
        spread, both = xx - mean * across, xy - mean * up
        rises = spread > _FLAT * xx
        gain = both * both / (spread if rises else 1.0) if rises else 0.0
        miss = np.maximum(yy - up * up * per_one - gain, 0.0)
        cost[c] = miss if x - a > _NARROW else np.inf


@no_type_check
def _cheapest(place, sums, level, xs, ys, meet, which):
    """Write the candidate of each knot on the cheapest way.

    Lines ``meet``, or need not: then heights only say from where to count.
    """
    knots, count = xs.shape
    came, rows = np.zeros((knots, count), np.int64), np.zeros(count, np.int64)
    before, after, cost = np.zeros(count), np.zeros(count), np.empty(count)
    for k in range(1, knots):
        left = _begun(rows, sums, level, xs[k - 1], ys[k - 1])
        for to in range(count):
            rows[to] = _row(place, xs[k, to])
            if meet:
                _joined(left, sums[rows[to]], xs[k, to], ys[k, to], cost)
            else:
                _apart(left, sums[rows[to]], xs[k, to], cost)
            after[to] = np.inf
            for c in range(count):
                way = cost[c] + before[c]
                if way < after[to]:
                    after[to], came[k, to] = way, c
        before, after = after, before
    best = 0
    for c in range(count):
        if before[c] < before[best]:
            best = c
    for k in range(knots - 1, -1, -1):
        which[k] = best
        best = came[k, best]


@no_type_check
def _chain(place, sums, level, among, on, which):
    """Write which places lines of their own between them follow the curve best.

    The first and the last are always among them. Heights ``on`` the curve say from where to
    count.
    """
    count, many = len(among), len(which)
    rows = np.zeros(count, np.int64)
    first = _begun(rows, sums, level, among, on)
    for c in range(count):
        rows[c] = _row(place, among[c])
    left = _begun(rows, sums, level, among, on)
    before, after, cost = np.zeros(count), np.zeros(count), np.empty((count, count))
    for to in range(count):
        _apart(first, sums[rows[to]], among[to], cost[to])
        before[to] = cost[to, 0]
        _apart(left, sums[rows[to]], among[to], cost[to])
    came = np.zeros((many, count), np.int64)
    for k in range(2, many):
        for to in range(count):
            after[to] = np.inf
            for c in range(to):
                way = cost[to, c] + before[c]
                if way < after[to]:
                    after[to], came[k, to] = way, c
        before, after = after, before
    best = count - 1
    for k in range(many - 1, -1, -1):
        which[k] = best
        best = came[k, best]


@no_type_check
def _crossings(place, height, slope, knots, heights, off, reach, xs, ys):
    """Write whole places beside each knot where the best knots would have whole heights.

    Rounding a height costs most where the curve is steep; there the place can move to where
    nothing needs rounding. Where it is flat both whole heights are candidates.

    Args are the curve, knots with heights, how far the best heights are off the curve, and
    the share of the gaps beside a knot within which to look.
    """
    many, side = len(knots), 2 * MIDDLE + 1
    for k in range(many):
        xs[k, 0], ys[k, 0] = knots[k], heights[k]
        back = (knots[k] - knots[k - 1]) * reach if 0 < k < many - 1 else 0.0
        ahead = (knots[k + 1] - knots[k]) * reach if 0 < k < many - 1 else 0.0
        for c in range(side):
            share = (c - MIDDLE) / MIDDLE
            step = (ahead if c > MIDDLE else back) * share
            near = knots[k] + step
            row = min(max(_row(place, near), 1), len(place) - 1)
            rise = (near - place[row - 1]) / (place[row] - place[row - 1])
            rise = min(max(rise, 0.0), 1.0)
            wanted = height[row - 1] + rise * (height[row] - height[row - 1]) + off[k]
            lean = slope[row - 1] + rise * (slope[row] - slope[row - 1])
            lean = lean if abs(lean) > 1e-12 else 1e-12
            # No further than half the way to the candidate beside.
            limit = 0.5 * abs(step) / max(abs(c - MIDDLE), 1)
            if c == MIDDLE:
                limit = 0.5 * max(ahead, back) / MIDDLE
            for up in range(2):
                whole = np.floor(wanted) + up
                move = min(max((whole - wanted) / lean, -limit), limit)
                own = 1 + c + up * side
                xs[k, own], ys[k, own] = np.rint(near + move), whole
    for c in range(xs.shape[1]):
        for k in (0, many - 1):
            ys[k, c] = heights[k] + _ENDS[c % len(_ENDS)]


_Given = types.Array(types.float64, 1, "C", readonly=True)
_Sums = types.Array(types.float64, 2, "C", readonly=True)
_Table = types.Array(types.float64, 2, "C")
_Which = types.Array(types.int64, 1, "C")
_number = types.float64
cheapest = machine_code(
    _cheapest,
    types.void(_Given, _Sums, _number, _Sums, _Sums, types.boolean, _Which),
)
chain = machine_code(_chain, types.void(_Given, _Sums, _number, _Given, _Given, _Which))
crossings = machine_code(
    _crossings,
    types.void(
        *(_Given, _Given, _Given, _Given, _Given, _Given, _number, _Table, _Table)
    ),
)
