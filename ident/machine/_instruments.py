"""What is seen of a machine: instruments that read its axes, and parts that warm up."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ..readings import place_in_run
from ._programme import CYCLE
from ._sources import HALL, Column

_STEP = 1.0
"""s, in which heat and the zero of an instrument are followed."""


@dataclasses.dataclass(frozen=True)
class Instrument:
    """What stands between the true error, or where an axis is, and the reading; lengths in mm.

    Attributes:
        noise: Standard deviation of one reading.
        resolution: Readings are whole multiples of this.
        drift: Standard deviation of the drift from the start to the end of a run, as
            the temperature of the hall makes it; in motion after half an hour.
        run_offset: Standard deviation of the shift between runs.
        zero: The instrument's arbitrary zero.
        tilt: Slope of its arbitrary straight line, in mm per mm along the first axis.
        wild: Share of readings that are plainly wrong.
        wild_size: How wrong they are, at most.
        outliers: Share of readings in motion that are off by several µm.
        outlier_size: How far, at most.
        delay: In s: in motion the reading shows where the axis was so long ago.
        rate: Growth of the delay in s per s: the instrument's clock is slow by so much.
    """

    noise: float
    resolution: float = 1e-5
    drift: float = 0.0
    run_offset: float = 0.0
    zero: float = 0.0
    tilt: float = 0.0
    wild: float = 0.0
    wild_size: float = 0.1
    outliers: float = 0.0
    outlier_size: float = 0.01
    delay: float = 0.0
    rate: float = 0.0

    def read(
        self,
        error: Column,
        along: Column,
        run: Int[np.ndarray, " t"],
        rng: np.random.Generator,
    ) -> tuple[Column, Bool[np.ndarray, " t"]]:
        """Return the readings in mm of a true error, and which of them are wild.

        In the order of measuring: the error and the position along the instrument's own
        line in mm, and the ascending run 0, 1, ….
        """
        size = len(error)
        runs = int(run.max(initial=0)) + 1
        progress = place_in_run(run, np.arange(size, dtype=float))
        reading = error + self.zero + self.tilt * along
        reading += self.run_offset * rng.standard_normal(runs)[run]
        # About the middle of the run, so that a run's mean is its offset.
        reading += self.drift * rng.standard_normal(runs)[run] * (progress - 0.5)
        reading += self.noise * rng.standard_normal(size)
        wild = rng.random(size) < self.wild
        size_of = rng.uniform(0.3, 1.0, size) * self.wild_size
        reading += np.where(wild, size_of * rng.choice([-1.0, 1.0], size), 0.0)
        return self.resolution * np.rint(reading / self.resolution), wild

    def follow(
        self, actual: Column, rng: np.random.Generator
    ) -> tuple[Column, Bool[np.ndarray, " t"]]:
        """Return a reading in mm of each cycle of an axis, and which of them are wrong."""
        size = len(actual)
        late = self.delay / CYCLE + self.rate * np.arange(size)
        reading = _between(actual, np.arange(size) - late) + self.zero
        reading += self.noise * rng.standard_normal(size)
        reading += _wander(size, self.drift, rng)
        wrong = np.zeros(size, dtype=bool)
        kinds = ((self.outliers, self.outlier_size), (self.wild, self.wild_size))
        for share, largest in kinds:
            rows = np.flatnonzero(rng.random(size) < share)
            signs = rng.choice([-1.0, 1.0], len(rows))
            reading[rows] += signs * largest * rng.uniform(0.3, 1.0, len(rows))
            wrong[rows] = True
        return self.resolution * np.rint(reading / self.resolution), wrong


@dataclasses.dataclass(frozen=True)
class HeatedPart:
    """A part with a sensor near its source of heat.

    Attributes:
        name: Of the part and of its sensor.
        rise: In K above the hall under full load, in the end.
        warming: Time constant of the sensor's place, in s.
        lag: Time constant with which the part follows the sensor, in s.
        shift: How long the load stays on or off at a time, in s, about.
        noise: Of the sensor in K.
        resolution: Of the sensor in K.
    """

    name: str
    rise: float
    warming: float
    lag: float
    shift: float = 300.0
    noise: float = 0.02
    resolution: float = 0.01

    def warm(self, time: Column, rng: np.random.Generator) -> tuple[Column, Column]:
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
        outside = self.rise * response([1.0], [self.warming, 1.0], load, _STEP)
        inside = response([1.0], [self.lag, 1.0], outside, _STEP)
        sensor = np.interp(time, grid, outside) + HALL
        sensor = sensor + self.noise * rng.standard_normal(len(time))
        sensor = self.resolution * np.rint(sensor / self.resolution)
        return sensor, np.interp(time, grid, inside) + HALL


def response(
    above: Sequence[float],
    below: Sequence[float],
    values: Float[np.ndarray, " n"],
    step: float,
) -> Float[np.ndarray, " n"]:
    """Return how a linear system responds to values at equal steps in s, settled at the first one.

    It is the ratio of two polynomials in s, by the trapezoidal rule: a step neither leads nor
    lags.
    """
    from scipy.signal import bilinear, lfilter

    coefficients = bilinear(above, below, fs=1.0 / step)
    b, a = (np.asarray(part, dtype=float) for part in coefficients)
    level = values[0] * np.sum(b) / np.sum(a)
    return np.asarray(lfilter(b, a, values - values[0]) + level)


def _between(values: Column, at: Column) -> Column:
    """Return values between the samples by cubics through four of them."""
    first = np.clip(np.floor(at).astype(np.int64) - 1, 0, len(values) - 4)
    u = np.clip(at, 0.0, len(values) - 1) - first
    a, b, c, d = (values[first + k] for k in range(4))
    return np.asarray(
        -a * (u - 1) * (u - 2) * (u - 3) / 6
        + b * u * (u - 2) * (u - 3) / 2
        - c * u * (u - 1) * (u - 3) / 2
        + d * u * (u - 1) * (u - 2) / 6
    )


def _wander(size: int, drift: float, rng: np.random.Generator) -> Column:
    """Return a random walk that is `drift` wide after half an hour."""
    grid = np.arange(0.0, size * CYCLE + 2 * _STEP, _STEP)
    walk = np.cumsum(rng.standard_normal(len(grid))) * drift * np.sqrt(_STEP / 1800.0)
    return np.asarray(np.interp(np.arange(size) * CYCLE, grid, walk - walk.mean()))
