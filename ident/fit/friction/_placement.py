"""The best few knots for a friction curve: whole velocities, whole currents."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float, Int

from .._errors import FitError
from ._polyline import Curve, Points, best_heights, best_path, polished

SLOWEST = 1e-3
"""mm/s: the list reaches down to it, 1 µm/s, its smallest step."""

_PER_MM = 1000.0
_PLACES = 140
_SHARES = np.linspace(-1.0, 1.0, 7)
_REACHES = (0.9, 0.9, 0.9, 0.45)
"""Shares of the gap beside a knot in which its place is looked for again."""
_AGAIN = (0.9,)
_ROUNDED = (0.9, 0.9, 0.45, 0.15)
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
    programme over places on the curve, which is exact on its lattice, then over places
    and heights around what it found; they go downhill from there, and a last programme
    runs over the whole numbers of the list around them.

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
    curve = Curve(velocity * _PER_MM, current / unit, weight)
    best = _best(curve, low, high, inner)
    whole = _on_whole_numbers(curve, best, low, high)
    places = whole.places.astype(np.int64)
    heights = whole.heights.astype(np.int64)
    # Where nobody measured, no more than at the slowest speed that was driven.
    if places[0] < curve.place[0] and heights[0] > curve.height[0]:
        heights[0] = math.floor(curve.height[0])
        whole = Points(places.astype(float), heights.astype(float))
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


def _best(curve: Curve, low: int, high: int, count: int) -> Points:
    """Return the best knots, places and heights any numbers, ends pinned in place."""
    places = _candidates(curve, low, high)
    count = min(count, len(places))
    if count < 3:
        return polished(curve, Points(places[[0, -1]], curve.at(places[[0, -1]])))
    # Heights on the curve first: how far they miss it tells how far to look beside it.
    every = np.stack([np.full(places.shape, places[0]), places, places, places])
    every[-1] = places[-1]
    found = best_path(curve, every, curve.at(every)[:, :, None], again=count - 3)
    for reach in _REACHES:
        beside = 0.4 * curve.rms(found) * _HEIGHTS
        found = _around(curve, found, reach * _SHARES, beside)
    found = polished(curve, found)
    for reach in _AGAIN:
        beside = 0.4 * curve.rms(found) * _HEIGHTS
        found = _around(curve, found, reach * _SHARES, beside)
    return polished(curve, found)


def _candidates(curve: Curve, low: int, high: int) -> Float[np.ndarray, " c"]:
    """Return places to begin with: even in speed, in its logarithm, and in the data."""
    third = _PLACES // 3
    share = np.cumsum(curve.weight)
    data = np.interp(np.linspace(0, 1, third), share, curve.place)
    places = np.concatenate(
        [np.geomspace(low, high, third), np.linspace(low, high, third), data]
    )
    return np.unique(np.clip(np.round(places), low, high))


def _around(
    curve: Curve,
    points: Points,
    shares: Float[np.ndarray, " a"],
    beside: Float[np.ndarray, " b"],
    *,
    whole: bool = False,
) -> Points:
    """Return the best knots near some, ends pinned in place.

    Args:
        curve: What they are to follow.
        points: The knots.
        shares: Steps of a place, of the gaps beside it.
        beside: Steps of a height.
        whole: Places are whole numbers.
    """
    gaps = np.diff(points.places)
    ahead = np.append(gaps, 0.0)[:, None] * np.maximum(shares, 0.0)
    back = np.append(0.0, gaps)[:, None] * np.minimum(shares, 0.0)
    step = ahead + back
    step[[0, -1]] = 0.0
    places = points.places[:, None] + (np.round(step) if whole else step)
    heights = points.heights[:, None, None] + beside
    return best_path(
        curve, places, np.broadcast_to(heights, (*places.shape, len(beside)))
    )


def _on_whole_numbers(curve: Curve, points: Points, low: int, high: int) -> Points:
    """Return the best whole numbers near the best knots."""
    places = np.round(points.places)
    found = Points(places, np.round(best_heights(curve, places)))
    beside = np.arange(-2.0, 3.0)
    # Where rounding costs more than a place does, knots move far to save it.
    for reach in _ROUNDED:
        step = max(1.0, np.round(reach * curve.rms(found)))
        found = _around(curve, found, reach * _SHARES, step * beside, whole=True)
    # Rounding the heights moves the best places by more than one step where the curve
    # is flat; a few rounds follow them.
    for reach in (8, 3, 1):
        steps = np.arange(-reach, reach + 1.0)
        around = np.clip(found.places[:, None] + steps, low, high)
        around[[0, -1]] = found.places[[0, -1], None]
        heights = found.heights[:, None, None] + beside
        heights = np.broadcast_to(heights, (*around.shape, len(beside)))
        found = best_path(curve, around, heights)
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
