"""A sensor on its clock: the temperature of what follows it, for one lag after the other."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ._lag import followed


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
        theta = followed(self.clock, self.values, self.count, lag)
        result[self.known] = theta[self.back]
        return result


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
