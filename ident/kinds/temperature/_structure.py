r"""The temperature of the structure behind a sensor: missed readings, plateaus, a lag.

The lag is of first order, $\theta' = (T - \theta)/\tau$, exact for a temperature that runs
linearly between its readings. The structure starts at the temperature of the sensor, as its
first readings together have it.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import solve_banded
from scipy.ndimage import median_filter

from ...core import FitError

_FIRST = 30.0
"""Share of a lag that counts as its beginning is one over this."""
_STRAIGHT = 4.0
"""Square of the readings' distance from a line, in their noise, up to which it is one."""
_ABSOLUTE_ZERO = -273.15
_WINDOW = 7
"""Readings over which a temperature is compared with its neighbours."""
_GLITCH = 8.0
"""Distance from the neighbours, in typical distances, that no structure can follow."""
_LEAST = 1.0
"""Distance in K that is no glitch in any case."""


def lagged(
    time: Float[np.ndarray, " l"],
    temperature: Float[np.ndarray, " l"],
    time_constant: float,
) -> Float[np.ndarray, " l"]:
    """Return the temperature of the structure in °C at the instants of the sensor.

    A negative time constant gives the structure *before* the sensor, to first order: what a
    sensor shows that follows late.

    Args:
        time: Ascending, in s.
        temperature: Of the sensor in °C.
        time_constant: In s; 0 = the structure is at the temperature of the sensor.
    """
    if time_constant == 0.0 or len(time) < 2:
        return np.asarray(temperature)
    if time_constant < 0.0:
        return np.asarray(2.0 * temperature - lagged(time, temperature, -time_constant))
    share = np.diff(time) / time_constant
    kept = np.exp(-share)
    # (1 − e^−x)/x, which is 1 for readings of the same instant.
    mean = np.where(share > 0, -np.expm1(-share) / np.where(share > 0, share, 1.0), 1.0)
    rise = np.diff(temperature)
    right = np.empty_like(temperature)
    right[0] = temperature[0]
    right[1:] = temperature[1:] - kept * temperature[:-1] - mean * rise
    band = np.ones((2, len(time)))
    band[1, :-1] = -kept
    return np.asarray(solve_banded((1, 0), band, right))


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
        if len(self.clock):
            result[self.known] = self._behind(lag)[self.back]
        return result

    def _behind(self, lag: float) -> Float[np.ndarray, " l"]:
        """Return the structure at the instants of the sensor.

        What a noisy first reading is off by would last for the whole lag: a line through
        the first readings begins instead.
        """
        if lag == 0.0 or len(self.clock) < 2:
            return self.values
        values = self.values.astype(float)
        values[0] = self._beginning(abs(lag))
        return lagged(self.clock, values, lag)

    def _beginning(self, lag: float) -> float:
        """Return where a line through the first readings begins, in °C.

        A sensor that jumps before the line knows its level is taken at its word.
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
        # Half of all steps from reading to reading: a jump is none of them.
        steps = np.abs(np.diff(values[: max(int((since < lag / 10.0).sum()), 3)]))
        noise = 0.5 * (1.4826 * float(np.median(steps))) ** 2
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


def missed_temperatures(
    temperature: Float[np.ndarray, " t"],
) -> Bool[np.ndarray, " t"]:
    """Return which readings of a sensor are none: not finite, impossible, or lone jumps.

    Args:
        temperature: In °C, in order of time.
    """
    missed = ~np.isfinite(temperature) | (temperature < _ABSOLUTE_ZERO)
    values = temperature[~missed]
    if len(values) >= _WINDOW:
        away = np.abs(values - median_filter(values, _WINDOW, mode="nearest"))
        typical = 1.4826 * float(np.median(away))
        missed[~missed] = away > max(_GLITCH * typical, _LEAST)
    return np.asarray(missed)


def steady(
    time: Float[np.ndarray, " t"],
    value: Float[np.ndarray, " t"],
    within: float,
    level: float | None = None,
) -> Bool[np.ndarray, " t"]:
    """Return the readings of the longest plateau of a signal: heating done, load constant.

    Args:
        time: In s, ascending.
        value: Of the signal that is to be steady (a heater, a spindle), NaN = missed.
        within: Largest distance from the level.
        level: Of the plateau; None = the most frequent one.

    Raises:
        FitError: If there is none.
    """
    known = np.isfinite(value)
    if level is None and known.any():
        ordered = np.sort(value[known])
        # The densest half: a plateau is where the signal spends its time.
        half = max(len(ordered) // 2, 1)
        width = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
        first = int(np.argmin(width))
        level = float(np.median(ordered[first : first + half]))
    inside = known & (np.abs(value - (0.0 if level is None else level)) <= within)
    # A lone reading outside does not end a plateau.
    bridged = inside.copy()
    bridged[1:-1] |= ~inside[1:-1] & inside[:-2] & inside[2:]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bridged, [False]])))
    starts, ends = edges[::2], edges[1::2]
    if not len(starts):
        msg = f"no reading lies within ±{within:g} of a plateau, expected a steady stretch."
        raise FitError(msg)
    longest = int(np.argmax(time[ends - 1] - time[starts]))
    result = np.zeros(len(value), bool)
    result[starts[longest] : ends[longest]] = True
    return np.asarray(result & inside)
