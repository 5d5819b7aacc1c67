"""Measuring the virtual machine: instruments that scatter, drift and round, and their files."""

import dataclasses
from collections.abc import Sequence
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


def measure_length(
    machine: VirtualMachine,
    axis: str,
    targets: Float[np.ndarray, " p"],
    runs: int,
    instrument: Instrument,
    seed: int,
) -> Reading:
    """Measure an axis with a laser: up and down over the targets, several times."""
    ascending = np.sort(targets)
    once = np.concatenate([ascending, ascending[::-1]])
    ways = np.repeat([1, -1], len(targets))
    return _measure(
        machine, axis, (axis,), np.tile(once, runs)[:, None], np.tile(ways, runs),
        np.repeat(np.arange(runs), len(once)), instrument, seed,
    )  # fmt: skip


def measure_straightness(
    machine: VirtualMachine,
    axis: str,
    along: str,
    targets: Float[np.ndarray, " p"],
    runs: int,
    instrument: Instrument,
    seed: int,
) -> Reading:
    """Measure how far ``axis`` is pushed aside while ``along`` moves."""
    once = np.sort(targets)
    positions = np.tile(once, runs)[:, None]
    run = np.repeat(np.arange(runs), len(once))
    ways = np.ones(len(run), dtype=np.int64)
    return _measure(machine, axis, (along,), positions, ways, run, instrument, seed)


def measure_surface(
    machine: VirtualMachine,
    axis: str,
    across: tuple[str, str],
    points: Float[np.ndarray, "t 2"],
    instrument: Instrument,
    seed: int,
) -> Reading:
    """Probe a surface at the given points, in their order."""
    run = np.zeros(len(points), dtype=np.int64)
    ways = -np.ones(len(points), dtype=np.int64)  # a probe comes down
    return _measure(machine, axis, across, points, ways, run, instrument, seed)


def _measure(
    machine: VirtualMachine,
    axis: str,
    moved: tuple[str, ...],
    positions: Float[np.ndarray, "t d"],
    direction: Int[np.ndarray, " t"],
    run: Int[np.ndarray, " t"],
    instrument: Instrument,
    seed: int,
) -> Reading:
    where = {name: positions[:, column] for column, name in enumerate(moved)}
    truth = machine.error(axis, where, direction)
    rng = np.random.default_rng(seed)
    reading, wild = instrument.read(truth, positions[:, 0], run, rng)
    return Reading(positions, reading, truth, direction, run + 1, wild)


def write_laser_table(path: Path, found: Reading) -> None:
    """Write ``run, direction, target, error`` with target in mm and error in µm."""
    columns = [found.run, found.direction, found.positions, 1000 * found.reading]
    forms = ("%d", "%+d", "%.3f", "%.3f")
    _write_csv(path, "run,direction,target [mm],error [um]", columns, forms)


def write_straightness(path: Path, along: str, found: Reading) -> None:
    """Write ``run, position, deviation`` with position in mm and deviation in µm."""
    header = f"run,{along.lower()} [mm],deviation [um]"
    columns = [found.run, found.positions, 1000 * found.reading]
    _write_csv(path, header, columns, ("%d", "%.3f", "%.3f"))


def write_surface(path: Path, across: tuple[str, str], found: Reading) -> None:
    """Write ``x, y, dz`` with positions in mm and heights in µm."""
    first, second = (axis.lower() for axis in across)
    columns = [found.positions, 1000 * found.reading]
    _write_csv(path, f"{first} [mm],{second} [mm],dz [um]", columns, ("%.3f",) * 3)


def _write_csv(
    path: Path, header: str, columns: Sequence[np.ndarray], forms: Sequence[str]
) -> None:
    table = np.column_stack(columns)
    np.savetxt(path, table, forms, ",", header=header, comments="")
