"""Measuring the virtual machine: instruments that scatter, drift and round, and their files."""

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from ._machine import VirtualMachine


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


@dataclasses.dataclass(frozen=True)
class Reading:
    """A finished measurement with the truth behind it; lengths in mm.

    Attributes:
        positions: Commanded, one column per axis that moved, shape ``(t, d)``.
        reading: Error as the instrument shows it.
        truth: Error that the machine really had.
        direction: ±1 per reading.
        run: 1, 2, … per reading.
        wild: Readings that are plainly wrong.
    """

    positions: Float[np.ndarray, "t d"]
    reading: Float[np.ndarray, " t"]
    truth: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"]
    run: Int[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]


def measure(
    machine: VirtualMachine,
    axis: str,
    moved: tuple[str, ...],
    points: Float[np.ndarray, "p d"],
    instrument: Instrument,
    seed: int,
    *,
    runs: int = 1,
    ways: tuple[int, ...] = (1,),
) -> Reading:
    """Measure the error of an axis where others stand, or it does itself.

    Args:
        machine: What is measured.
        axis: Whose error is read.
        moved: Axes that move.
        points: Their places in mm, in the order of measuring.
        instrument: What reads it.
        seed: Of chance.
        runs: How often all of it is done.
        ways: Of each run: 1 in the order of the points, −1 back over them.
    """
    once = np.concatenate([points[::way] for way in ways])
    run = np.repeat(np.arange(runs), len(once))
    positions = np.tile(once, (runs, 1))
    direction = np.tile(np.repeat(ways, len(points)), runs)
    where = {name: positions[:, column] for column, name in enumerate(moved)}
    truth = machine.error(axis, where, direction)
    rng = np.random.default_rng(seed)
    reading, wild = instrument.read(truth, positions[:, 0], run, rng)
    return Reading(positions, reading, truth, direction, run + 1, wild)


def write_reading(path: Path, header: str, found: Reading) -> None:
    """Write a measurement as CSV, with positions in mm and errors in µm.

    Args:
        path: File to write.
        header: Names of the columns: ``run`` and ``direction``, where they are wanted, the
            positions, and the error.
        found: The measurement.
    """
    stated = {"run": (found.run, "%d"), "direction": (found.direction, "%+d")}
    used = [stated[name] for name in header.split(",") if name in stated]
    columns = [*(column for column, _ in used), found.positions, 1000 * found.reading]
    table = np.column_stack(columns)
    forms = [form for _, form in used]
    forms += ["%.3f"] * (table.shape[1] - len(forms))
    np.savetxt(path, table, forms, ",", header=header, comments="")
