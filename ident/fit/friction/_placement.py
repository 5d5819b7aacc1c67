"""The best few knots for a friction curve: whole velocities, whole currents."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float, Int

from .._errors import FitError
from ._curve import Curve, Points
from ._path import best_break, best_break_of, best_path
from ._polyline import best_heights, polished

_PER_MM = 1000.0
_PLACES = 40
"""Places of which the first knots are chosen, at least; two for each."""
_BENT = 0.75
"""Share of them that lie where the curve bends."""
_REACHES = (0.9, 0.4)
"""Shares of the gap beside a knot in which its place is looked for again."""
_BESIDE = np.linspace(-1.0, 1.0, 9)
_ROUNDED = (0.9, 0.9, 0.45, 0.2)
"""The same for whole heights."""
_MIDDLE = 3
_AROUND = np.linspace(-1.0, 1.0, 2 * _MIDDLE + 1)
_LAST = (4.0, 1.0)
"""List units of speed by which whole places are moved in the end."""
_BLOCK = np.stack([np.repeat([-1.0, 0.0, 1.0], 3), np.tile([-1.0, 0.0, 1.0], 3)])


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
    documented (S-27), and nobody measured there. Those between begin where straight
    lines of their own would end, found by a dynamic programme over places, and go
    downhill from there as a polyline. Programmes over whole places and heights around
    them then find the whole numbers of the list.

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
    places = _candidates(curve, low, high, max(_PLACES, 2 * count))
    count = min(count, len(places))
    if count < 3:
        return polished(curve, places[[0, -1]])
    found = best_break_of(curve, places, count)
    for reach in _REACHES:
        found = best_break(curve, found[:, None] + _beside(found, reach * _BESIDE))
    return polished(curve, found)


def _candidates(
    curve: Curve, low: int, high: int, count: int
) -> Float[np.ndarray, " c"]:
    """Return places to begin with: most where the curve bends, some of them anywhere.

    Straight lines follow a curve best where their ends lie as densely as the fifth root
    of weight times bend squared.
    """
    place = curve.place
    gap = np.diff(place)
    across = 0.5 * (gap[1:] + gap[:-1])
    bend = np.diff(np.diff(curve.height) / gap) / across
    dense = across * (bend * bend * curve.weight[1:-1] / across) ** 0.2
    bends = np.concatenate([[0.0], np.cumsum(dense), [dense.sum()]])
    evenly = [np.log(place / place[0]), place - place[0], np.cumsum(curve.weight)]
    share = sum(each / each[-1] for each in evenly) * (1.0 - _BENT) / 3.0
    share = share + _BENT * bends / max(bends[-1], 1e-300)
    found = np.interp(np.linspace(share[0], share[-1], count), share, place)
    found[0], found[-1] = low, high
    return np.unique(np.clip(np.round(found), low, high))


def _beside(
    places: Float[np.ndarray, " k"], shares: Float[np.ndarray, " a"]
) -> Float[np.ndarray, "k a"]:
    """Return steps from each knot, in shares of the gap to the next; ends are pinned."""
    gaps = np.diff(places)
    ahead = np.append(gaps, 0.0)[:, None] * np.maximum(shares, 0.0)
    step = ahead + np.append(0.0, gaps)[:, None] * np.minimum(shares, 0.0)
    step[[0, -1]] = 0.0
    return np.asarray(step)


def _on_whole_numbers(curve: Curve, points: Points, low: int, high: int) -> Points:
    """Return the best whole numbers near the best knots."""
    # No two on one place.
    rank = np.arange(float(len(points.places)))
    places = np.maximum.accumulate(np.round(points.places) - rank) + rank
    places = np.minimum(places, high - rank[::-1])
    found = Points(places, np.round(best_heights(curve, places)))
    off = points.heights - curve.at(points.places)
    for reach in _ROUNDED:
        found = best_path(curve, *_crossings(curve, found, off, reach))
    for step in _LAST:
        beside = found.places[:, None] + step * _BLOCK[0]
        beside[[0, -1]] = found.places[[0, -1], None]
        found = best_path(
            curve, np.clip(beside, low, high), found.heights[:, None] + _BLOCK[1]
        )
    return found


def _crossings(
    curve: Curve, found: Points, off: Float[np.ndarray, " k"], reach: float
) -> tuple[Float[np.ndarray, "k c"], Float[np.ndarray, "k c"]]:
    """Return whole places beside each knot where the best knots would have whole heights.

    Rounding a height costs most where the curve is steep; there the place can move to
    where nothing needs rounding. Where it is flat both whole heights are candidates.

    Args:
        curve: What they are to follow.
        found: The knots.
        off: How far the best heights are from the curve, per knot.
        reach: Share of the gaps beside a knot.
    """
    shares = reach * _AROUND
    step = _beside(found.places, shares)
    place = found.places[:, None] + step
    height = curve.at(place) + off[:, None]
    below = np.floor(height)
    slope = np.interp(place, curve.place, curve.slope)
    slope = np.where(np.abs(slope) > 1e-12, slope, 1e-12)
    # No further than half the way to the candidate beside.
    order = np.maximum(np.abs(np.arange(len(shares)) - _MIDDLE), 1)
    limit = 0.5 * np.abs(step) / order
    limit[:, _MIDDLE] = np.maximum(limit[:, _MIDDLE - 1], limit[:, _MIDDLE + 1])
    moved = [
        place + np.minimum(np.maximum((whole - height) / slope, -limit), limit)
        for whole in (below, below + 1.0)
    ]
    places = np.round(np.concatenate([found.places[:, None], *moved], axis=1))
    heights = np.concatenate([found.heights[:, None], below, below + 1.0], axis=1)
    # The ends cannot move: heights around them.
    around = np.resize([0.0, 1.0, -1.0, 2.0, -2.0], heights.shape[1])
    heights[[0, -1]] = found.heights[[0, -1], None] + around
    return places, heights


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
