"""A measuring instrument: it scatters, drifts, rounds, and knows no zero."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclasses.dataclass(frozen=True)
class Instrument:
    """What stands between the true error and the reading; lengths in mm.

    Attributes:
        noise: Standard deviation of one reading.
        resolution: Readings are whole multiples of this.
        drift: Standard deviation of the drift from the start to the end of a run, as
            the temperature of the hall makes it.
        run_offset: Standard deviation of the shift between runs.
        zero: The instrument's arbitrary zero.
        tilt: Slope of its arbitrary straight line, in mm per mm along the first axis.
        wild: Share of readings that are plainly wrong.
        wild_size: How wrong they are, at most.
    """

    noise: float
    resolution: float
    drift: float = 0.0
    run_offset: float = 0.0
    zero: float = 0.0
    tilt: float = 0.0
    wild: float = 0.0
    wild_size: float = 0.1

    def read(
        self,
        error: Float[np.ndarray, " t"],
        along: Float[np.ndarray, " t"],
        run: Int[np.ndarray, " t"],
        rng: np.random.Generator,
    ) -> tuple[Float[np.ndarray, " t"], Bool[np.ndarray, " t"]]:
        """Return the readings in mm, and which of them are wild.

        Args:
            error: True error in mm in the order of measuring.
            along: Position along the instrument's own line in mm.
            run: Run of each reading, 0, 1, …, ascending.
            rng: Source of chance.
        """
        size = len(error)
        runs = int(run.max(initial=0)) + 1
        start = np.searchsorted(run, np.arange(runs))
        length = np.bincount(run, minlength=runs)
        progress = (np.arange(size) - start[run]) / np.maximum(length - 1, 1)[run]
        reading = error + self.zero + self.tilt * along
        reading += self.run_offset * rng.standard_normal(runs)[run]
        # About the middle of the run, so that a run's mean is its offset.
        reading += self.drift * rng.standard_normal(runs)[run] * (progress - 0.5)
        reading += self.noise * rng.standard_normal(size)
        wild = rng.random(size) < self.wild
        size_of = rng.uniform(0.3, 1.0, size) * self.wild_size
        reading += np.where(wild, size_of * rng.choice([-1.0, 1.0], size), 0.0)
        return self.resolution * np.rint(reading / self.resolution), wild
