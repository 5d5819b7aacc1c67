"""The entries of a friction list: few knots on a curve, whole velocities, whole currents."""

import dataclasses
import math

import numpy as np
from jaxtyping import Float, Int

from ..core import FitError
from ._polyline import Curve, best_knots

_PER_MM = 1000.0
_PLACES = 60
"""Places between which chords are drawn, at least; three for each knot."""
_STEPS = np.linspace(-1.0, 1.0, 7)
"""Steps from a knot towards its neighbours, in shares of `_REACHES`."""
_REACHES = (0.9, 0.9, 0.45, 0.2)
"""Shares of the gap beside a knot in which whole numbers are looked for."""
_LAST = (4.0, 1.0)
"""List units of speed by which whole places are moved in the end."""
_NEAR = (0.9, 0.4)
_FLAT = 20.0
"""Largest logarithm of the ratio of two gaps."""


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
    their neighbours: what the controller does outside a friction table is not documented
    (S-27), and nobody measured there.

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
    count = min(max(2, entries - 1 - before), high - low + 1)
    curve = Curve(velocity * _PER_MM, current / unit, weight / weight.sum())
    best, places, heights = best_knots(curve, low, high, count)
    # Where nobody measured, no more than at the slowest speed that was driven.
    if places[0] < curve.place[0] and heights[0] > curve.height[0]:
        heights[0] = math.floor(curve.height[0])
    rms = unit * curve.rms(places, heights)
    places = np.concatenate([np.ones(before), places, [beyond]]).astype(np.int64)
    heights = np.concatenate([heights[:1]] * before + [heights, heights[-1:]])
    keep = _needed(places, heights.astype(np.int64))
    return Knots(
        velocity=places[keep],
        out=heights.astype(np.int64)[keep],
        unit=unit,
        rms=rms,
        unrounded_rms=unit * curve.rms(best, curve.heights(best)),
    )


def _refuse(
    velocity: Float[np.ndarray, " m"],
    current: Float[np.ndarray, " m"],
    weight: Float[np.ndarray, " m"],
    entries: int,
    unit: float,
) -> None:
    msg = ""
    if entries < 3:
        msg = f"{entries} entries, expected at least 3 for a friction table"
    elif len(velocity) < 2:
        msg = f"{len(velocity)} speeds, expected at least 2 for a friction table"
    elif not (velocity[0] > 0 and np.all(np.diff(velocity) > 0)):
        msg = "speeds that do not ascend from above 0, expected them to"
    elif not (np.isfinite(current).all() and np.isfinite(weight).all()):
        msg = "gaps in the friction curve, expected numbers"
    elif np.any(weight < 0) or not np.any(weight > 0):
        msg = "no speed that counts, expected weights of 0 or more"
    elif not unit > 0:
        msg = f"{unit:g} per list unit, expected more than 0"
    if msg:
        raise FitError("found " + msg)


def _needed(
    places: Int[np.ndarray, " k"], heights: Int[np.ndarray, " k"]
) -> Int[np.ndarray, " n"]:
    """Return the knots that are not on the straight line of their neighbours.

    The last two stay: they say that the table is flat from there on.
    """
    at, high = places.tolist(), heights.tolist()
    keep = [0]
    for k in range(1, len(at) - 1):
        a, b = keep[-1], k + 1
        lean = (high[k] - high[a]) * (at[b] - at[k])
        if k == len(at) - 2 or lean != (high[b] - high[k]) * (at[k] - at[a]):
            keep.append(k)
    return np.array([*keep, len(at) - 1], dtype=np.int64)
