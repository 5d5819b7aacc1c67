"""The search for the knots of a friction curve: dynamic programmes and least squares.

Straight lines that need not meet are placed by a dynamic programme; from their ends least
squares moves the knots of a polyline; programmes over whole places and heights around these
find the whole numbers of the list. Source: R. Bellman, R. Roth, Curve fitting by segmented
straight lines, J. Am. Stat. Assoc. 64, 1969.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import leastsq

from ...models import linear_weights

_PLACES = 60
"""Places between which chords are drawn, at least; three for each knot."""
_STEPS = 7
"""Places beside a knot, and its own, that are tried at a time."""
_NEAR = (0.9, 0.4)
"""Shares of the gap beside a knot in which ends of lines are looked for again."""
_REACHES = (0.9, 0.9, 0.45, 0.2)
"""Shares of the gap beside a knot in which whole numbers are looked for."""
_LAST = (4.0, 1.0)
"""List units of speed by which whole places are moved in the end."""
_RIDGE = 1e-10
"""Of the total weight, added where no point tells the height of a knot."""
_FLAT = 20.0
"""Largest logarithm of the ratio of two gaps."""


def best_knots(
    curve: "Curve", low: int, high: int, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the best places of knots, and the best whole places and heights near them.

    Args:
        curve: What the knots are to follow, in list units.
        low: Place of the first knot.
        high: Of the last one.
        count: Knots at most.
    """
    best = _downhill(curve, _lines(curve, low, high, count))
    return best, *_on_whole_numbers(curve, best, low, high)


class Curve:
    """A curve with weights, and sums that tell the misfit of any straight line at once."""

    def __init__(
        self, place: np.ndarray, height: np.ndarray, weight: np.ndarray
    ) -> None:
        self.place, self.height, self.weight = place, height, weight
        self._level = float(weight @ height)
        self._places, self._normal = np.zeros(0), (np.zeros((0, 0)), np.zeros((0, 0)))
        x, y = place / place[-1], height - self._level
        products = np.stack([np.ones_like(x), x, x * x, y, x * y, y * y])
        self._sums = np.pad(np.cumsum(weight * products, axis=1), ((0, 0), (1, 0))).T

    def at(self, place: Float[np.ndarray, "*k"]) -> Float[np.ndarray, "*k"]:
        """Return the height of the curve at places."""
        return np.asarray(np.interp(place, self.place, self.height))

    def rms(self, places: np.ndarray, heights: np.ndarray) -> float:
        """Return the weighted root mean square distance of a polyline."""
        error = np.interp(self.place, places, heights) - self.height
        return float(np.sqrt(self.weight @ error**2))

    def hats(self, places: Float[np.ndarray, " k"]) -> Float[np.ndarray, "m k"]:
        """Return the weighted columns of a polyline's heights."""
        first, weights = linear_weights(places, self.place)
        found, rows = np.zeros((len(self.place), len(places))), np.arange(len(first))
        found[rows, first], found[rows, first + 1] = np.sqrt(self.weight) * weights
        return found

    def heights(self, places: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Return the heights at which a polyline with these knots follows the curve best."""
        chord = self.at(places)  # stays where no point tells a height
        hats, inverse = self.normal(places)
        off = np.sqrt(self.weight) * self.height - hats @ chord
        return np.asarray(chord + inverse @ (hats.T @ off))

    def normal(
        self, places: Float[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "k k"]]:
        """Return the hats of these places and the inverse of their normal matrix."""
        if not np.array_equal(self._places, places):
            hats, ridge = self.hats(places), _RIDGE * np.eye(len(places))
            self._normal = hats, np.linalg.inv(hats.T @ hats + ridge)
            self._places = places
        return self._normal

    def _between(
        self, left: Float[np.ndarray, "*l"], right: Float[np.ndarray, "*r"]
    ) -> tuple[Float[np.ndarray, "*n"], ...]:
        """Return sums over the points in (left, right], from the first point on."""
        first = np.searchsorted(self.place, left, side="right")
        first = np.where(left < self.place[0], 0, first)
        last = np.searchsorted(self.place, right, side="right")
        return tuple(np.moveaxis(self._sums[last] - self._sums[first], -1, 0))

    def apart(
        self, left: Float[np.ndarray, "*l"], right: Float[np.ndarray, "*r"]
    ) -> Float[np.ndarray, "*n"]:
        """Return the weighted squares that the best lines leave, which need not meet."""
        one, x, xx, y, xy, yy = self._between(left, right)
        one = np.maximum(one, 1e-14)  # where nothing counts, nothing is left
        spread, both, square = xx - x * x / one, xy - x * y / one, yy - y * y / one
        rises = spread > 1e-12 * xx
        gain = np.where(rises, both**2 / np.where(rises, spread, 1.0), 0.0)
        return np.where(right > left, np.maximum(square - gain, 0.0), np.inf)

    def misfit(
        self, left: np.ndarray, right: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> Float[np.ndarray, "*n"]:
        """Return the weighted squares that lines of given heights at their ends leave."""
        one, x, xx, y, xy, yy = self._between(left, right)
        width = (right - left) / self.place[-1]
        lean = (high - low) / np.where(width > 0, width, 1.0)
        base = low - self._level - lean * left / self.place[-1]
        miss = yy - 2.0 * (lean * xy + base * y) + lean * (lean * xx + 2.0 * base * x)
        return np.where(width > 0, np.maximum(miss + base * base * one, 0.0), np.inf)


def _lines(curve: Curve, low: int, high: int, count: int) -> Float[np.ndarray, " k"]:
    """Return the ends of the lines that follow the curve best and need not meet.

    Candidates lie where the curve bends, and some anywhere: straight lines follow a curve
    best where their ends lie as densely as the fifth root of weight times bend squared.
    """
    place, dense = curve.place, np.zeros(len(curve.place))
    if len(place) > 2:
        gap = np.gradient(place)
        bend = np.gradient(np.gradient(curve.height, place), place)
        dense = gap * (bend**2 * curve.weight / gap) ** 0.2
    evenly = [np.log(place / place[0]), place - place[0], np.cumsum(curve.weight)]
    share = sum((each / each[-1] for each in evenly), np.zeros(len(place)))
    share += 9.0 * np.cumsum(dense) / max(float(dense.sum()), 1e-300)
    many = min(max(_PLACES, 3 * count), high - low + 1)
    among = np.interp(np.linspace(share[0], share[-1], many), share, place)
    among = np.unique(np.clip(np.round([low, *among, high]), low, high))
    if len(among) <= count:
        return among
    cost = curve.apart(among[:, None], among)
    start = np.where(np.arange(len(among)) == 0, 0.0, np.inf)
    found = among[_cheapest(start, [cost] * (count - 1), len(among) - 1)]
    for reach in _NEAR:
        near = np.sort(found[:, None] + _beside(found, reach, _STEPS + 2), axis=1)
        near[[0, -1]] = found[[0, -1], None]
        costs = list(curve.apart(near[:-1, :, None], near[1:, None]))
        path = _cheapest(np.zeros(near.shape[1]), costs)
        found = near[np.arange(len(near)), path]
    return np.asarray(found)


def _beside(
    places: Float[np.ndarray, " k"], reach: float, count: int
) -> Float[np.ndarray, "k a"]:
    """Return steps from each knot, up to a share of the gap to the next on either side."""
    steps = np.linspace(-reach, reach, count)
    gap = np.diff(places, append=places[-1] + 1.0)[:, None]
    back = np.diff(places, prepend=places[0] - 1.0)[:, None]
    return np.asarray(gap * np.maximum(steps, 0.0) + back * np.minimum(steps, 0.0))


def _cheapest(
    start: Float[np.ndarray, " a"], costs: list[np.ndarray], end: int | None = None
) -> Int[np.ndarray, " k"]:
    """Return the candidate of each knot on the cheapest way: a dynamic programme.

    Args:
        start: Cost of beginning at each candidate of the first knot.
        costs: Of going from each candidate of a knot to each of the next.
        end: Candidate of the last knot, where it is given.
    """
    total, came = start, []
    for cost in costs:
        ways = total[:, None] + cost
        came.append(np.argmin(ways, axis=0))
        total = np.min(ways, axis=0)
    path = [int(np.argmin(total)) if end is None else end]
    for before in reversed(came):
        path.append(int(before[path[-1]]))
    return np.array(path[::-1])


def _downhill(curve: Curve, places: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return the knots after their places followed least squares; ends are pinned.

    Free are the logarithms of the gaps relative to the last one, heights are eliminated.
    """
    low, span, root = places[0], places[-1] - places[0], np.sqrt(curve.weight)

    def knots(free: np.ndarray) -> np.ndarray:
        parts = np.cumsum(np.exp(np.clip(np.append(free, 0.0), -_FLAT, _FLAT)))
        return np.asarray(low + span * np.append(0.0, parts / parts[-1]))

    def residual(free: np.ndarray) -> np.ndarray:
        at = knots(free)
        return np.asarray(curve.normal(at)[0] @ curve.heights(at) - root * curve.height)

    def jacobian(free: np.ndarray) -> np.ndarray:
        at = knots(free)
        (hats, inverse), slope = (
            curve.normal(at),
            np.diff(curve.heights(at)) / np.diff(at),
        )
        cell = np.clip(np.searchsorted(at, curve.place) - 1, 0, len(slope) - 1)
        moved = -slope[cell][:, None] * hats[:, 1:-1]
        share = np.diff(at)[:-1] / span
        chain = np.tri(len(free)) - ((at[1:-1] - low) / span)[:, None]
        return np.asarray(
            (moved - hats @ (inverse @ (hats.T @ moved))) @ (span * chain * share)
        )

    gaps = np.log(np.diff(places))
    if len(gaps) < 2 or len(gaps) > len(curve.place):
        return places
    start = gaps[:-1] - gaps[-1]
    # With the full output it does not warn where it ends after so many steps.
    found = leastsq(residual, start, Dfun=jacobian, maxfev=40, full_output=True)
    return knots(found[0])


def _on_whole_numbers(
    curve: Curve, best: Float[np.ndarray, " k"], low: int, high: int
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return whole places and heights near the best knots.

    Rounding a height costs most where the curve is steep; there the place can move to where
    nothing needs rounding. Where it is flat both whole heights are candidates.
    """
    rank = np.arange(float(len(best)))
    places = np.maximum.accumulate(np.round(best) - rank) + rank  # no two on one place
    places = np.minimum(places, high - rank[::-1])
    heights = np.round(curve.heights(places))
    off = curve.heights(best) - curve.at(best)
    slope = np.gradient(curve.height, curve.place)
    ends = np.zeros((len(best), 1), bool)
    ends[[0, -1]] = True

    def best_of(xs: np.ndarray, ys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        xs = np.where(ends, places[:, None], np.clip(xs, low, high))
        cost = curve.misfit(
            xs[:-1, :, None], xs[1:, None], ys[:-1, :, None], ys[1:, None]
        )
        path = _cheapest(np.zeros(xs.shape[1]), list(cost))
        return xs[np.arange(len(xs)), path], ys[np.arange(len(xs)), path]

    for reach in _REACHES:
        step = _beside(places, reach, _STEPS)
        near = places[:, None] + step
        wanted, lean = (
            curve.at(near) + off[:, None],
            np.interp(near, curve.place, slope),
        )
        whole = np.floor(wanted) + np.array([0.0, 1.0])[:, None, None]
        room = np.ptp(step, axis=1)[:, None] / (2 * _STEPS)  # half the way to the next
        move = (whole - wanted) / np.where(np.abs(lean) > 1e-12, lean, 1e-12)
        tried = np.round(near + np.clip(move, -room, room))
        nearby = heights[:, None] + np.resize([0.0, 1.0, -1.0, 2.0, -2.0], 2 * _STEPS)
        ys = np.where(ends, nearby, np.hstack([*whole]))
        places, heights = best_of(
            np.hstack([places[:, None], *tried]), np.hstack([heights[:, None], ys])
        )
    for far in _LAST:
        beside = places[:, None] + far * np.repeat([-1.0, 0.0, 1.0], 3)
        places, heights = best_of(
            beside, heights[:, None] + np.tile([-1.0, 0.0, 1.0], 3)
        )
    return places, heights
