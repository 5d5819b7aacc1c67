"""The entries of a friction list: few knots on a curve, whole velocities, whole currents.

Found by dynamic programming (R. Bellman, R. Roth, J. Am. Stat. Assoc. 64, 1969): lines between
places all along the curve, then whole places and heights ever nearer to the best so far.
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from ..core import FitError
from ._samples import Trace
from ._structures import KnotTable
from ._weights import ridged

_PER_MM = 1000.0
_PLACES = 60
"""Places between which lines are drawn, at least; three for each knot."""
_STEPS = np.linspace(-1.0, 1.0, 5)
"""Places beside a knot that are tried at a time, in reaches."""
_REACHES = (0.1, 0.03, 0.8, 0.3, 0.06)
"""Shares of the gap beside a knot in which better places are looked for, one after another."""


@dataclasses.dataclass(frozen=True)
class Knots:
    """Entries of a friction list, in list units.

    Attributes:
        velocity: In µm/s (0.001°/s), ascending.
        out: In list units of current.
        unit: Current that one unit of ``out`` is.
        rms: Weighted root mean square deviation from the curve, in units of current.
    """

    velocity: Int[np.ndarray, " k"]
    out: Int[np.ndarray, " k"]
    unit: float
    rms: float

    def current(self, velocity: Trace) -> Trace:
        """Return the current at speeds in mm/s, linear between knots, edges held."""
        places, currents = self.velocity / _PER_MM, self.out * self.unit
        return np.asarray(np.interp(velocity, places, currents))


def place_knots(
    velocity: Float[np.ndarray, " m"],
    current: Float[np.ndarray, " m"],
    weight: Float[np.ndarray, " m"],
    *,
    entries: int = 20,
    unit: float,
    reach: float | None = None,
) -> Knots:
    """Return the knots whose straight lines follow a curve best, by least squares.

    The first knot lies at 1 µm/s and the last beyond the fastest speed, both level with their
    neighbours: what happens outside a table is not documented (S-27), and nobody measured there.

    Args:
        velocity: Speeds in mm/s, ascending, positive: those that the axis drives.
        current: The curve there, in units of current.
        weight: How much each speed counts, at least 0; zero where nobody measured.
        entries: Knots at most (P-COMP-00042).
        unit: Current that one unit of the list is.
        reach: Speed in mm/s beyond which the table must reach; the fastest if left out.

    Raises:
        FitError: If there are fewer than 3 entries or 2 speeds.
    """
    if entries < 3 or len(velocity) < 2:
        msg = f"found {entries} entries and {len(velocity)} speeds, expected 3 and 2 or more"
        raise FitError(msg)
    low = max(1, round(velocity[0] * _PER_MM)) if entries > 3 else 1
    high = max(low + 1, int(np.ceil(velocity[-1] * _PER_MM - 1e-6)))
    beyond = max(high + 1, int(np.ceil(1.05 * (reach or velocity[-1]) * _PER_MM)))
    curve = _Curve(velocity * _PER_MM, current / unit, weight / weight.sum())
    places, heights = _finer(curve, _lines(curve, low, high, entries - 1 - (low > 1)))
    # Where nobody measured, no more than at the slowest speed that was driven.
    if places[0] < curve.place[0] and heights[0] > curve.height[0]:
        heights[0] = np.floor(curve.height[0])
    error = np.interp(curve.place, places, heights) - curve.height
    rms = unit * float(np.sqrt(curve.weight @ error**2))
    places = np.concatenate([[1.0] * (low > 1), places, [beyond]])
    heights = np.pad(heights, (int(low > 1), 1), mode="edge")
    # What lies on the line of its neighbours is left out, but for the level end.
    slope = np.diff(heights) / np.diff(places)
    needed = np.concatenate([[True], slope[1:-1] != slope[:-2], [True, True]])
    return Knots(places[needed].astype(int), heights[needed].astype(int), unit, rms)


class _Curve:
    """A curve with weights, and sums that tell the misfit of any straight line at once."""

    def __init__(self, *curve: Float[np.ndarray, " m"]) -> None:
        self.place, self.height, self.weight = place, height, weight = curve
        self._level = float(weight @ height)
        x, y = place / place[-1], height - self._level
        products = np.stack([np.ones_like(x), x, x * x, y, x * y, y * y])
        self._sums = np.pad(np.cumsum(weight * products, axis=1), ((0, 0), (1, 0)))

    def heights(self, places: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Return the heights whose polyline follows the curve best, no further off than chords."""
        hats = KnotTable(knots=tuple(places)).steady(self.place)
        weighted = hats.T * self.weight
        chord = np.interp(places, self.place, self.height)  # where no point tells one
        miss = self.height - hats @ chord
        most = np.max(np.abs(miss)[:, None] * (hats > 0), axis=0)
        most[places > self.place[self.weight > 0][-1] + 1.0] = np.inf  # nobody measured
        beside = ridged(weighted @ hats, weighted @ miss)
        return np.asarray(chord + np.clip(beside, -most, most))

    def _between(self, left: np.ndarray, right: np.ndarray) -> list[np.ndarray]:
        """Return sums over the points in (left, right]."""
        first, last = (self.place.searchsorted(k, side="right") for k in (left, right))
        return [sums[last] - sums[first] for sums in self._sums]

    def unjoined(self, left: np.ndarray, right: np.ndarray) -> Float[np.ndarray, "*n"]:
        """Return the weighted squares that the best lines leave, which need not meet."""
        number, x, xx, y, xy, yy = self._between(left, right)
        number = np.maximum(number, 1e-14)  # where nothing counts, nothing is left
        spread, cross = xx - x * x / number, xy - x * y / number
        gain = y * y / number + cross**2 / np.where(spread > 1e-12 * xx, spread, np.inf)
        return np.where(right > left, np.maximum(yy - gain, 0.0), np.inf)

    def misfit(self, *ends: np.ndarray) -> Float[np.ndarray, "*n"]:
        """Return the weighted squares that lines leave: places, then heights of their ends."""
        left, right, low, high = ends
        number, x, xx, y, xy, yy = self._between(left, right)
        width = (right - left) / self.place[-1]
        lean = (high - low) / np.where(width > 0, width, 1.0)
        base = low - self._level - lean * left / self.place[-1]
        miss = yy - 2.0 * (lean * xy + base * y) + lean * (lean * xx + 2.0 * base * x)
        return np.where(width > 0, np.maximum(miss + base * base * number, 0.0), np.inf)


def _lines(curve: _Curve, low: int, high: int, count: int) -> Float[np.ndarray, " k"]:
    """Return the whole ends of the lines that follow the curve best and need not meet.

    Candidates lie anywhere, and more where the curve bends: straight lines follow it best
    where their ends lie as densely as the fifth root of weight times bend squared.
    """
    place, gap = curve.place, np.gradient(curve.place)
    bend = np.gradient(np.gradient(curve.height, place), place)
    dense = np.cumsum(gap * (bend**2 * curve.weight / gap) ** 0.2)
    share = np.log(place / place[0]) / np.log(place[-1] / place[0])
    share += 3.0 * dense / max(float(dense[-1]), 1e-300)
    places = np.linspace(share[0], share[-1], max(_PLACES, 3 * count))
    places = np.round(np.interp(places, share, place))
    places = np.unique(np.clip([low, *places, high], low, high))
    costs = [curve.unjoined(places[:, None], places)] * (min(count, len(places)) - 1)
    costs[0], costs[-1] = costs[0][:1], costs[-1][:, -1:]
    return np.asarray(places[[0, *_cheapest(costs)[1:-1], -1]])


def _cheapest(costs: list[np.ndarray]) -> Int[np.ndarray, " k"]:
    """Return the candidates on the cheapest way, by costs from one knot's to the next's."""
    total, sources = np.zeros(len(costs[0])), []
    for cost in costs:
        totals = total[:, None] + cost
        sources.append(totals.argmin(axis=0))
        total = np.minimum.reduce(totals)
    path = [int(total.argmin())]
    for source in reversed(sources):
        path.append(int(source[path[-1]]))
    return np.array(path[::-1])


def _finer(curve: _Curve, places: Trace) -> tuple[Trace, Trace]:
    """Return better whole places and whole heights of knots; the ends stay in place.

    Candidates are whole heights beside what least squares wants at places near by, and places
    where none needs rounding; the last height, which is held beyond, is the nearest.
    """
    heights, count = np.round(curve.heights(places)), len(places)
    lines = places[:-1], places[1:], heights[:-1], heights[1:]
    typical = np.sqrt(curve.misfit(*lines).sum())
    slope = np.gradient(curve.height, curve.place) + 1e-300
    for reach in _REACHES:
        gap = reach * np.diff(places, prepend=places[0], append=places[-1])[:, None]
        near = places[:, None] + _STEPS * np.where(_STEPS > 0, gap[1:], gap[:-1])
        near[[0, -1]] = places[[0, -1], None]
        lift = curve.heights(places) - np.interp(places, curve.place, curve.height)
        target = (np.interp(near, curve.place, curve.height) + lift[:, None])[..., None]
        aside = max(1.0, np.round(2.0 * reach * typical))
        rounded = np.floor(target) + aside * np.arange(-1.0, 3.0)
        shift = (rounded - target) / np.interp(near, curve.place, slope)[:, :, None]
        limit = np.ptp(near, axis=1)[:, None, None] / (2 * len(_STEPS))
        trials = np.round(near[:, :, None] + np.clip(shift, -limit, limit))
        x = np.column_stack([places, trials.reshape(count, -1)])
        y = np.column_stack([heights, rounded.reshape(count, -1)])
        wanted = np.interp(x, curve.place, curve.height) + lift[:, None]
        y = np.clip(y, np.floor(wanted + 1.0 - aside), np.ceil(wanted + aside - 1.0))
        y[-1] = np.round(wanted[-1])
        costs = curve.misfit(x[:-1, :, None], x[1:, None], y[:-1, :, None], y[1:, None])
        best = np.arange(count), _cheapest(list(costs))
        places, heights = x[best], y[best]
    return places, heights
