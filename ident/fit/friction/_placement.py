"""The best few knots for a friction curve: whole velocities, whole currents."""

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solveh_banded
from scipy.optimize import least_squares

from .._errors import FitError

SLOWEST = 1e-3
"""mm/s: the list reaches down to it, 1 µm/s, its smallest step."""

_PER_MM = 1000.0
_PLACES = 140
_HEIGHTS = np.array([-4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0])


@dataclasses.dataclass(frozen=True)
class Knots:
    """Entries of a friction list, in list units.

    Attributes:
        velocity: In µm/s (0.001°/s), ascending.
        out: In list units of current.
        unit: Current that one unit of ``out`` is.
        rms: Weighted root mean square deviation from the curve, in units of current.
        unrounded_rms: The same before rounding to whole numbers.
    """

    velocity: Int[np.ndarray, " k"]
    out: Int[np.ndarray, " k"]
    unit: float
    rms: float
    unrounded_rms: float

    def current(self, velocity: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return the current at speeds in mm/s, linear between knots, edges held."""
        places = self.velocity / _PER_MM
        return np.asarray(np.interp(velocity, places, self.out * self.unit))


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

    The first knot lies at 1 µm/s and the last beyond the fastest speed, both level with
    their neighbours: what the controller does outside a friction table is not
    documented (S-27), and nobody measured there. Those between are found by a dynamic
    programme over places and heights, which is exact on its lattice; the lattice is
    then narrowed around what it found, and at last lies on the whole numbers of the
    list.

    Args:
        velocity: Speeds in mm/s, ascending, positive: those that the axis drives.
        current: The curve there, in units of current.
        weight: How much each speed counts, at least 0; zero where nobody measured.
        entries: Knots at most (P-COMP-00042).
        unit: Current that one unit of the list is.
        reach: Speed in mm/s beyond which the table must reach; the fastest if left out.

    Raises:
        FitError: If there are fewer than 3 entries or 2 speeds, or arguments are no
            numbers or out of order.
    """
    _refuse(velocity, current, weight, entries, unit)
    low = max(1, round(velocity[0] * _PER_MM))
    high = max(low + 1, math.ceil(velocity[-1] * _PER_MM - 1e-6))
    beyond = max(high + 1, math.ceil(1.05 * (reach or velocity[-1]) * _PER_MM))
    before = 1 if low > 1 and entries > 3 else 0
    low = low if before else 1  # three entries: one line from 1 µm/s on
    inner = max(2, entries - 1 - before)
    curve = _Curve(velocity * _PER_MM, current / unit, weight)
    best = _best(curve, low, high, inner)
    whole = _on_whole_numbers(curve, best, low, high)
    places = np.array([place for place, _ in whole], dtype=np.int64)
    heights = np.array([height for _, height in whole], dtype=np.int64)
    # Where nobody measured, no more than at the slowest speed that was driven.
    if places[0] < curve.place[0] and heights[0] > curve.height[0]:
        heights[0] = math.floor(curve.height[0])
        whole = list(zip(places.tolist(), heights.tolist(), strict=True))
    places = np.concatenate([np.ones(before, np.int64), places, [beyond]])
    heights = np.concatenate([heights[:1]] * before + [heights, heights[-1:]])
    keep = _needed(places, heights)
    return Knots(
        velocity=places[keep],
        out=heights[keep],
        unit=unit,
        rms=unit * curve.rms(whole),
        unrounded_rms=unit * curve.rms(best),
    )


def _refuse(
    velocity: Float[np.ndarray, " m"],
    current: Float[np.ndarray, " m"],
    weight: Float[np.ndarray, " m"],
    entries: int,
    unit: float,
) -> None:
    if entries < 3:
        msg = f"found {entries} entries, expected at least 3 for a friction table"
        raise FitError(msg)
    if len(velocity) < 2:
        msg = f"found {len(velocity)} speeds, expected at least 2 for a friction table"
        raise FitError(msg)
    if not (velocity[0] > 0 and np.all(np.diff(velocity) > 0)):
        msg = "found speeds that do not ascend from above 0, expected them to"
        raise FitError(msg)
    if not (np.isfinite(current).all() and np.isfinite(weight).all()):
        msg = "found gaps in the friction curve, expected numbers"
        raise FitError(msg)
    if np.any(weight < 0) or not np.any(weight > 0):
        msg = "found no speed that counts, expected weights of 0 or more"
        raise FitError(msg)
    if not unit > 0:
        msg = f"found {unit:g} per list unit, expected more than 0"
        raise FitError(msg)


Points = Sequence[tuple[float, float]]
"""Place and height of each knot, in list units."""


class _Curve:
    """Sums over the curve, from which the misfit of any straight line follows at once."""

    def __init__(
        self,
        place: Float[np.ndarray, " m"],
        height: Float[np.ndarray, " m"],
        weight: Float[np.ndarray, " m"],
    ) -> None:
        self.place, self.height = place, height
        self.weight = weight / weight.sum()
        # About the middle: the misfit is a small difference of large sums.
        self._middle = float(self.weight @ place)
        self._level = float(self.weight @ height)
        x, y, w = place - self._middle, height - self._level, self.weight
        terms = np.stack([w, w * x, w * x * x, w * y, w * x * y, w * y * y])
        self._sums = np.concatenate([np.zeros((6, 1)), np.cumsum(terms, axis=1)], 1)

    def at(self, place: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        return np.asarray(np.interp(place, self.place, self.height))

    def misfit(
        self,
        left: Float[np.ndarray, "a 2"],
        right: Float[np.ndarray, "b 2"],
        first: bool,
    ) -> Float[np.ndarray, "a b"]:
        """Return the weighted squares under the line from each left to each right knot.

        A knot's own point belongs to the segment on its left; ``first``: to this one.
        Lines that do not go to the right are infinitely bad.
        """
        x0 = left[:, None, 0] - self._middle
        x1 = right[None, :, 0] - self._middle
        y0 = left[:, None, 1] - self._level
        y1 = right[None, :, 1] - self._level
        begin = np.searchsorted(self.place, left[:, 0], "left" if first else "right")
        end = np.searchsorted(self.place, right[:, 0], "right")
        total = self._sums[:, None, end] - self._sums[:, begin, None]
        width = x1 - x0
        good = width > 0.5
        slope = (y1 - y0) / np.where(good, width, 1.0)
        level = y0 - slope * x0
        one, x, xx, y, xy, yy = total
        squares = (
            yy
            - 2.0 * (level * y + slope * xy)
            + level * level * one
            + 2.0 * level * slope * x
            + slope * slope * xx
        )
        return np.where(good, np.maximum(squares, 0.0), np.inf)

    def rms(self, points: Points) -> float:
        places, heights = np.array(points, dtype=float).T
        error = np.interp(self.place, places, heights) - self.height
        return float(np.sqrt(self.weight @ error**2))


def _programme(
    curve: _Curve, layers: Sequence[Float[np.ndarray, "_s 2"]]
) -> list[tuple[float, float]]:
    """Return the best path through one candidate of each layer."""
    cost = np.zeros(len(layers[0]))
    came: list[np.ndarray] = []
    misfit = np.zeros((0, 0))
    for k, (left, right) in enumerate(itertools.pairwise(layers)):
        # Layers between the ends may be one and the same: so is what lies between them.
        if k < 2 or left is not right or layers[k - 1] is not left:
            misfit = curve.misfit(left, right, first=k == 0)
        total = cost[:, None] + misfit
        came.append(np.argmin(total, axis=0))
        cost = total[came[-1], np.arange(len(right))]
    at = int(np.argmin(cost))
    path = [at]
    for step in reversed(came):
        path.append(int(step[path[-1]]))
    path.reverse()
    return [
        (float(layer[k, 0]), float(layer[k, 1]))
        for layer, k in zip(layers, path, strict=True)
    ]


def _best(curve: _Curve, low: int, high: int, count: int) -> list[tuple[float, float]]:
    """Return the best knots, places and heights any numbers, ends pinned in place."""
    places = _candidates(curve, low, high)
    count = min(count, len(places))
    first, last = places[:1], places[-1:]
    scale = 0.0
    layers: list[np.ndarray] = []
    found: list[tuple[float, float]] = []
    # Heights on the curve first: how far they miss it tells how far to look beside it.
    for heights in (np.zeros(1), _HEIGHTS):
        every = _lattice(curve, places, heights * scale)
        ends = (_lattice(curve, end, heights * scale) for end in (first, last))
        begin, end = ends
        layers = [begin, *[every] * (count - 2), end]
        found = _programme(curve, layers)
        scale = 0.4 * curve.rms(found)
    return _polished(curve, found)


def _polished(curve: _Curve, points: Points) -> list[tuple[float, float]]:
    """Return the knots after their places went downhill, heights always the best ones.

    The heights are linear and drop out (variable projection); the places between the
    ends are the shares of the way that each gap takes, so that they stay in order.
    """
    places = np.array([place for place, _ in points])
    root = np.sqrt(curve.weight)
    length = float(places[-1] - places[0])

    def knots(free: Float[np.ndarray, " f"]) -> Float[np.ndarray, " k"]:
        gaps = np.exp(np.append(free, 0.0) - max(float(free.max(initial=0.0)), 0.0))
        ends = np.cumsum(gaps) / gaps.sum()
        ends[-1] = 1.0
        return np.asarray(places[0] + length * np.concatenate([[0.0], ends]))

    def error(free: Float[np.ndarray, " f"]) -> Float[np.ndarray, " m"]:
        at = knots(free)
        line = np.interp(curve.place, at, _heights(curve, at))
        return np.asarray(root * (line - curve.height))

    free = np.log(np.diff(places))
    free = free[:-1] - free[-1]
    if len(free):
        free = least_squares(error, free, x_scale=0.3, max_nfev=60).x
    at = knots(free)
    return list(zip(at.tolist(), _heights(curve, at).tolist(), strict=True))


def _heights(curve: _Curve, at: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return the heights of knots at these places that follow the curve best."""
    count, w = len(at), curve.weight
    cell = np.clip(np.searchsorted(at, curve.place, "right") - 1, 0, count - 2)
    share = np.clip((curve.place - at[cell]) / np.diff(at)[cell], 0.0, 1.0)

    def sums(left: np.ndarray, right: np.ndarray) -> np.ndarray:
        return np.bincount(cell, left, count) + np.bincount(cell + 1, right, count)

    squares = sums(w * (1 - share) ** 2, w * share**2)
    between = np.bincount(cell, w * share * (1 - share), count)
    wanted = sums(w * (1 - share) * curve.height, w * share * curve.height)
    # Knots with no point beside them lean on the curve, ever so lightly.
    light = 1e-10 * float(squares.max())
    bands = np.stack([np.roll(between, 1), squares + light])
    return np.asarray(solveh_banded(bands, wanted + light * curve.at(at)))


def _candidates(curve: _Curve, low: int, high: int) -> Float[np.ndarray, " c"]:
    """Return places to begin with: even in speed, in its logarithm, and in the data."""
    third = _PLACES // 3
    share = np.cumsum(curve.weight)
    data = np.interp(np.linspace(0, 1, third), share, curve.place)
    places = np.concatenate(
        [np.geomspace(low, high, third), np.linspace(low, high, third), data]
    )
    return np.unique(np.clip(np.round(places), low, high))


def _lattice(
    curve: _Curve, places: Float[np.ndarray, " c"], heights: Float[np.ndarray, " h"]
) -> Float[np.ndarray, "s 2"]:
    at = np.repeat(places, len(heights))
    beside = np.tile(heights, len(places))
    return np.stack([at, curve.at(at) + beside], axis=1)


def _on_whole_numbers(
    curve: _Curve, points: Points, low: int, high: int
) -> list[tuple[float, float]]:
    """Return the best whole numbers near the best knots."""
    found = [(float(round(place)), float(round(height))) for place, height in points]
    # Rounding the heights moves the best places by more than one step where the curve
    # is flat; a few rounds follow them.
    for reach in (8, 3, 1, 1):
        layers = []
        for k, (place, height) in enumerate(found):
            ends = k in (0, len(found) - 1)
            steps = np.zeros(1) if ends else np.arange(-reach, reach + 1)
            around = np.unique(np.clip(place + steps, low, high))
            grid = np.meshgrid(around, height + np.arange(-2, 3), indexing="ij")
            layers.append(np.stack([each.ravel() for each in grid], axis=1))
        found = _programme(curve, layers)
    return found


def _needed(
    places: Int[np.ndarray, " k"], heights: Int[np.ndarray, " k"]
) -> Int[np.ndarray, " n"]:
    """Return the knots that are not on the straight line of their neighbours.

    The last two stay: they say that the table is flat from there on.
    """
    keep = [0]
    for k in range(1, len(places) - 1):
        a, b = keep[-1], k + 1
        lean = (heights[k] - heights[a]) * (places[b] - places[k])
        if k == len(places) - 2 or lean != (heights[b] - heights[k]) * (
            places[k] - places[a]
        ):
            keep.append(k)
    return np.array([*keep, len(places) - 1], dtype=np.int64)
