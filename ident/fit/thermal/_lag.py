r"""The temperature of the structure behind a sensor: a first-order lag.

$\theta' = (T - \theta)/\tau$, exact for a temperature that runs linearly between its readings.
The structure starts at the temperature of the sensor, as its first readings together have it.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solve_banded

from ._types import SensorLog

_FIRST = 30.0
"""Share of a lag that counts as its beginning is one over this."""
_STRAIGHT = 4.0
"""Square of the readings' distance from a line, in their noise, up to which it is one."""


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


def followed(
    time: Float[np.ndarray, " l"],
    temperature: Float[np.ndarray, " l"],
    count: Int[np.ndarray, " l"],
    time_constant: float,
) -> Float[np.ndarray, " l"]:
    """Return `lagged` behind a sensor that is noisy: its first reading alone begins nothing.

    What that is off by would last for the whole lag.

    Args:
        time: Ascending, in s.
        temperature: Of the sensor in °C.
        count: Readings behind each temperature.
        time_constant: In s, as for `lagged`.
    """
    if time_constant == 0.0 or len(time) < 2:
        return np.asarray(temperature)
    values = np.array(temperature, dtype=float)
    values[0] = _beginning(time - time[0], values, count, abs(time_constant))
    return lagged(time, values, time_constant)


def _beginning(
    since: Float[np.ndarray, " l"],
    values: Float[np.ndarray, " l"],
    count: Int[np.ndarray, " l"],
    lag: float,
) -> float:
    """Return where a line through the first readings begins, in °C.

    A sensor that jumps before the line knows its level is taken at its word.
    """
    weight = count * np.exp(-_FIRST * since / lag)
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


def structure_at(
    log: SensorLog, sensor: int, time: Float[np.ndarray, " t"], time_constant: float
) -> Float[np.ndarray, " t"]:
    """Return the structure temperature in °C at other instants; NaN outside the log."""
    values = log.temperature[:, sensor]
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(time), np.nan)
    clock = log.time[known]
    once = np.ones(len(clock), np.int64)
    theta = followed(clock, values[known], once, time_constant)
    return np.asarray(np.interp(time, clock, theta, left=np.nan, right=np.nan))
