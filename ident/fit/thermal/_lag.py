r"""The temperature of the structure behind a sensor: a first-order lag.

$\theta' = (T - \theta)/\tau$, exact for a temperature that runs linearly between its readings.
The structure starts at the temperature of the sensor.
"""

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_banded

from ._types import SensorLog


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


def structure_at(
    log: SensorLog, sensor: int, time: Float[np.ndarray, " t"], time_constant: float
) -> Float[np.ndarray, " t"]:
    """Return the structure temperature in °C at other instants; NaN outside the log."""
    values = log.temperature[:, sensor]
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(time), np.nan)
    clock = log.time[known]
    theta = lagged(clock, values[known], time_constant)
    return np.asarray(np.interp(time, clock, theta, left=np.nan, right=np.nan))
