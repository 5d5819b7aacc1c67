"""An external instrument that follows an axis in motion, with a clock of its own."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ._programme import CYCLE


@dataclasses.dataclass(frozen=True)
class Tracker:
    """What stands between where an axis is and what is recorded; lengths in mm.

    Attributes:
        noise: Standard deviation of one reading.
        resolution: Readings are whole multiples of this.
        delay: In s: the reading shows where the axis was so long ago.
        rate: Growth of the delay in s per s: the instrument's clock is slow by so much.
        drift: Standard deviation after half an hour of a wandering zero.
        outliers: Share of readings that are off by several µm.
        outlier_size: How far, at most.
        wild: Share of readings that are plainly wrong.
        wild_size: How wrong they are, at most.
        zero: The instrument's arbitrary zero.
    """

    noise: float
    resolution: float = 1e-5
    delay: float = 0.0
    rate: float = 0.0
    drift: float = 0.0
    outliers: float = 0.0
    outlier_size: float = 0.01
    wild: float = 0.0
    wild_size: float = 1.0
    zero: float = 0.0

    def read(
        self, actual: Float[np.ndarray, " t"], rng: np.random.Generator
    ) -> tuple[Float[np.ndarray, " t"], Bool[np.ndarray, " t"]]:
        """Return the readings in mm, one per cycle, and which of them are wrong.

        Args:
            actual: Where the axis is, cycle by cycle.
            rng: Source of chance.
        """
        size = len(actual)
        late = self.delay / CYCLE + self.rate * np.arange(size)
        reading = _between(actual, np.arange(size) - late) + self.zero
        reading += self.noise * rng.standard_normal(size)
        reading += _wander(size, self.drift, rng)
        wrong = np.zeros(size, dtype=bool)
        kinds = ((self.outliers, self.outlier_size), (self.wild, self.wild_size))
        for share, most in kinds:
            rows = np.flatnonzero(rng.random(size) < share)
            signs = rng.choice([-1.0, 1.0], len(rows))
            reading[rows] += signs * most * rng.uniform(0.3, 1.0, len(rows))
            wrong[rows] = True
        return self.resolution * np.rint(reading / self.resolution), wrong


def _between(
    values: Float[np.ndarray, " t"], at: Float[np.ndarray, " t"]
) -> Float[np.ndarray, " t"]:
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


def _wander(
    size: int, drift: float, rng: np.random.Generator
) -> Float[np.ndarray, " t"]:
    """Return a random walk that is `drift` wide after half an hour."""
    step = 1.0
    grid = np.arange(0.0, size * CYCLE + 2 * step, step)
    walk = np.cumsum(rng.standard_normal(len(grid))) * drift * np.sqrt(step / 1800.0)
    return np.asarray(np.interp(np.arange(size) * CYCLE, grid, walk - walk.mean()))
