"""A sensor on its clock: the temperature of what follows it, for one lag after the other."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ..thermal._lag import lagged

_FIRST = 30.0
"""Share of a lag that counts as its beginning is one over this."""
_STRAIGHT = 4.0
"""Square of the readings' distance from a line, in their noise, up to which it is one."""


@dataclasses.dataclass(frozen=True)
class Clocked:
    """Readings of one sensor in order of time.

    Attributes:
        known: Rows with time and reading.
        clock: Different instants in s, ascending.
        back: Instant of each known row.
        values: Mean reading at each instant in °C.
        count: Readings at each instant.
    """

    known: Bool[np.ndarray, " t"]
    clock: Float[np.ndarray, " l"]
    back: Int[np.ndarray, " k"]
    values: Float[np.ndarray, " l"]
    count: Int[np.ndarray, " l"]

    def structure(self, lag: float) -> Float[np.ndarray, " t"]:
        """Return the temperature of the structure in °C per row, NaN where it is not known."""
        result: Float[np.ndarray, " t"] = np.full(len(self.known), np.nan)
        if not len(self.clock):
            return result
        values = self.values.copy()
        values[0] = self._at_first(lag)
        result[self.known] = lagged(self.clock, values, lag)[self.back]
        return result

    def _at_first(self, lag: float) -> float:
        """Return the temperature with which the structure begins: a line through the first.

        What the first reading alone is off by would last for the whole lag. A sensor that
        jumps before the line knows its level is taken at its word.
        """
        since, values = self.clock - self.clock[0], self.values
        weight = self.count * np.exp(-_FIRST * since / lag)
        weight = weight / weight.sum()
        middle, level = float(weight @ since), float(weight @ values)
        spread = float(weight @ np.square(since - middle))
        if not spread > 0.0:
            return level
        slope = float(weight @ ((since - middle) * values)) / spread
        bent = values - level - slope * (since - middle)
        noise = 0.5 * float(weight[1:] @ np.square(np.diff(values)))
        if float(weight @ np.square(bent)) > _STRAIGHT * noise:
            return float(values[0])
        return level - slope * middle


def clocked(time: Float[np.ndarray, " t"], values: Float[np.ndarray, " t"]) -> Clocked:
    """Return readings in order of time; rows need not be.

    Args:
        time: In s, NaN = no clock.
        values: Of the sensor in °C, NaN = missed.
    """
    known = np.isfinite(time) & np.isfinite(values)
    clock, back = np.unique(time[known], return_inverse=True)
    count = np.bincount(back, minlength=len(clock))
    mean = np.bincount(back, values[known], len(clock)) / np.maximum(count, 1)
    return Clocked(known, clock, back, mean, count)
