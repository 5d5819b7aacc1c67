"""The polyline that follows a curve best: a dynamic programme, and the way downhill from it."""

import dataclasses
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float

_MOST = 60
"""Steps downhill at most."""
_SETTLED = 1e-7
"""Share of the squares that a last step gains at most."""
_SHRINK = 0.7
"""Share of a gap between knots that one step may take away."""
_LIGHT = 1e-10
"""Share of the heaviest knot with which each leans on the curve: some have no point beside."""


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
    def middle(self) -> float:
        """Mean place; sums are about it, since a misfit is a small difference of them."""
        return float(self.weight @ self.place)

    @cached_property
    def level(self) -> float:
        """Mean height."""
        return float(self.weight @ self.height)

    @cached_property
    def sums(self) -> Float[np.ndarray, "6 m1"]:
        """Weight, x, x², y, xy and y² summed up to each place."""
        x, y, w = self.place - self.middle, self.height - self.level, self.weight
        terms = np.stack([w, w * x, w * x * x, w * y, w * x * y, w * y * y])
        return np.concatenate([np.zeros((6, 1)), np.cumsum(terms, axis=1)], axis=1)

    def at(self, place: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
        """Return the height of the curve at places."""
        return np.asarray(np.interp(place, self.place, self.height))

    def rms(self, points: Points) -> float:
        """Return the weighted root mean square distance of a polyline."""
        error = np.interp(self.place, points.places, points.heights) - self.height
        return float(np.sqrt(self.weight @ error**2))


def best_path(
    curve: Curve,
    places: Float[np.ndarray, "k a"],
    heights: Float[np.ndarray, "k a b"],
    *,
    again: int | None = None,
) -> Points:
    """Return the best polyline through one candidate of each knot.

    Args:
        curve: What it is to follow.
        places: Candidates per knot.
        heights: Candidates at each of them.
        again: Where all knots between the ends have the same candidates, four are given,
            and the step between the two in the middle is taken so many times.
    """
    misfit = _misfits(curve, places, heights)
    knots = np.arange(len(places))
    steps = list(misfit)
    if again is not None:
        knots = np.array([0, 1, *[1] * again, 3])
        steps = [misfit[0], *[misfit[1]] * again, misfit[2]]
    cost = np.zeros(misfit.shape[2])
    came = []
    for each in steps:
        total = each + cost
        best = np.argmin(total, axis=1)
        came.append(best)
        cost = total[np.arange(len(best)), best]
    at = int(np.argmin(cost))
    path = [at]
    for step in reversed(came):
        path.append(int(step[path[-1]]))
    path.reverse()
    width = heights.shape[2]
    which = np.array(path)
    return Points(
        places[knots, which // width], heights[knots, which // width, which % width]
    )


def _misfits(
    curve: Curve,
    places: Float[np.ndarray, "k a"],
    heights: Float[np.ndarray, "k a b"],
) -> Float[np.ndarray, "k1 c c"]:
    """Return the weighted squares under the line to each candidate (rows) from each before.

    A knot's own point belongs to the segment on its left, that of the first knot to the
    first segment. Lines that do not go to the right are infinitely bad.
    """
    begin = np.searchsorted(curve.place, places[:-1], "right")
    begin[0] = 0  # a first knot may have been rounded up, beyond the first point
    end = np.searchsorted(curve.place, places[1:], "right")
    total = curve.sums[:, end][:, :, :, None] - curve.sums[:, begin][:, :, None]
    one, x, xx, y, xy, yy = total
    # Heights about the curve at the left knot: squares of small numbers lose no digits.
    level = (curve.at(places[:-1]) - curve.level)[:, None]
    yy = yy - 2.0 * level * y + level * level * one
    y, xy = y - level * one, xy - level * x
    x0 = (places[:-1] - curve.middle)[:, None]
    width = (places[1:] - curve.middle)[:, :, None] - x0
    good = width > 0.5
    width = np.where(good, width, 1.0)
    # Sums over the share of the way from left to right that each point has gone.
    u = (x - x0 * one) / width
    uu = (xx - 2.0 * x0 * x + x0 * x0 * one) / (width * width)
    uy = (xy - x0 * y) / width
    height = heights - curve.level
    left = (height[:-1] - level[:, 0, :, None])[:, None, None]
    right = height[1:, :, :, None, None] - level[:, :, None, :, None]

    def spread(values: np.ndarray) -> np.ndarray:
        return values[:, :, None, :, None]

    least = spread(np.where(good, yy, np.inf))
    from_left = least + left * (
        spread(one - 2.0 * u + uu) * left - spread(2.0 * (y - uy))
    )
    from_right = right * (spread(uu) * right - spread(2.0 * uy))
    found = spread(2.0 * (u - uu)) * left
    found = found * right
    found += from_left
    found += from_right
    count = heights.shape[1] * heights.shape[2]
    return np.maximum(found, 0.0).reshape(len(found), count, count)


def polished(curve: Curve, points: Points) -> Points:
    """Return the knots after their places went downhill, ends pinned, heights the best ones.

    Damped Gauss-Newton steps of places and heights together; then the heights drop out
    (variable projection). No gap between knots shrinks to nothing in one step.
    """
    places, heights = points.places.astype(float), points.heights
    heights, cost, normal, push = _downhill(curve, places)
    damping, inner = 1e-3, slice(1, len(places) - 1)
    if len(places) < 3:
        return Points(places, heights)
    for _ in range(_MOST):
        gaps = np.diff(places)
        # In shares of the gaps beside a knot, steps of all knots compare.
        scale = np.minimum(gaps[1:], gaps[:-1])
        matrix = normal * scale * scale[:, None]
        diagonal = np.diag(matrix)
        ridge = damping * np.maximum(diagonal, 1e-9 * diagonal.max() + 1e-300)
        step = scale * np.linalg.solve(matrix + np.diag(ridge), scale * push)
        change = np.diff(np.concatenate([[0.0], step, [0.0]]))
        step *= min(1.0, _SHRINK / max(float(np.max(-change / gaps)), 1e-300))
        trial = places.copy()
        trial[inner] += step
        there = _downhill(curve, trial)
        if there[1] >= cost:
            damping *= 8.0
            if damping > 1e9:
                break
            continue
        gain = cost - there[1]
        places = trial
        heights, cost, normal, push = there
        damping = max(0.2 * damping, 1e-9)
        if gain <= _SETTLED * cost:
            break
    return Points(places, heights)


def best_heights(
    curve: Curve, places: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Return the heights of knots at these places that follow the curve best."""
    return _downhill(curve, places)[0]


def _downhill(
    curve: Curve, at: Float[np.ndarray, " k"]
) -> tuple[
    Float[np.ndarray, " k"], float, Float[np.ndarray, "i i"], Float[np.ndarray, " i"]
]:
    """Return the best heights of knots, their squares, and what moves the inner knots.

    Moving a knot by a little lowers the line by its slope, as far as the knot has a say:
    the columns of the places are those of the heights times the slope.
    """
    count, rows = len(at), np.arange(len(curve.place))
    cell = np.clip(np.searchsorted(at, curve.place, "right") - 1, 0, count - 2)
    gaps = np.maximum(np.diff(at), 1e-300)
    share = np.clip((curve.place - at[cell]) / gaps[cell], 0.0, 1.0)
    root = np.sqrt(curve.weight)
    hats = np.zeros((len(rows), count))
    hats[rows, cell], hats[rows, cell + 1] = root * (1.0 - share), root * share
    squares = hats.T @ hats
    # Knots with no point beside them lean on the curve, ever so lightly.
    light = _LIGHT * float(squares.diagonal().max())
    squares[np.diag_indices(count)] += light
    wanted = hats.T @ (root * curve.height) + light * curve.at(at)
    inverse = np.linalg.inv(squares)
    heights = inverse @ wanted
    slope = (np.diff(heights) / gaps)[cell]
    left = root * curve.height - hats @ heights
    moved = hats[:, 1:-1] * -slope[:, None]
    across = hats.T @ moved
    normal = moved.T @ moved - across.T @ inverse @ across
    push = moved.T @ left
    return heights, float(left @ left), normal, push
