"""Parts of the machine that warm up, and sensors that see it before or after them."""

import dataclasses

import numpy as np
from jaxtyping import Float

_STEP = 1.0


@dataclasses.dataclass(frozen=True)
class HeatedPart:
    """A part with a sensor near its source of heat.

    Attributes:
        name: Of the part and of its sensor.
        rise: In K above the ambient under full load, in the end.
        warming: Time constant of the sensor's place, in s.
        lag: Time constant with which the part follows the sensor, in s.
        ambient: In °C.
        shift: How long the load stays on or off at a time, in s, about.
        noise: Of the sensor in K.
        resolution: Of the sensor in K.
    """

    name: str
    rise: float
    warming: float
    lag: float
    ambient: float = 20.0
    shift: float = 300.0
    noise: float = 0.02
    resolution: float = 0.01

    def warm(
        self, time: Float[np.ndarray, " t"], rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
        """Return in °C over time in s what the sensor shows and how warm the part is.

        The machine starts cold, works, pauses, works at another load.
        """
        grid = np.arange(0.0, time[-1] + 2 * _STEP, _STEP)
        load = np.zeros(len(grid))
        start, on = 0.1 * self.shift, True
        while start < grid[-1]:
            length = self.shift * rng.uniform(0.7, 1.3)
            if on:
                load[(grid >= start) & (grid < start + length)] = rng.uniform(0.6, 1.0)
            start, on = start + length, not on
        near = self.rise * following(load, self.warming, _STEP)
        inside = following(near, self.lag, _STEP)
        sensor = np.interp(time, grid, near) + self.ambient
        sensor = sensor + self.noise * rng.standard_normal(len(time))
        sensor = self.resolution * np.rint(sensor / self.resolution)
        return sensor, np.interp(time, grid, inside) + self.ambient


def following(
    values: Float[np.ndarray, " n"], lag: float, step: float
) -> Float[np.ndarray, " n"]:
    """Return the solution of T' = (value − T) / lag from where the values start.

    Args:
        values: At equal steps.
        lag: In s; 0: the values themselves.
        step: In s.
    """
    from scipy.signal import lfilter

    if not lag > 0:
        return values
    # The trapezoidal rule: a step of the grid neither leads nor lags.
    turns = 2.0 * lag / step
    above = np.array([1.0, 1.0]) / (1.0 + turns)
    below = [1.0, (1.0 - turns) / (1.0 + turns)]
    return np.asarray(lfilter(above, below, values - values[0]) + values[0])
