"""Measuring the virtual machine: files as a laser, a probe, a straightedge leave."""

import csv
import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from ._instrument import Instrument
from ._machine import VirtualMachine


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
    rows = zip(
        found.run, found.direction, found.positions[:, 0], found.reading, strict=True
    )
    lines = ([r, f"{d:+d}", f"{x:.3f}", f"{1000 * e:.3f}"] for r, d, x, e in rows)
    _write_csv(path, ["run", "direction", "target [mm]", "error [um]"], lines)


def write_straightness(path: Path, along: str, found: Reading) -> None:
    """Write ``run, position, deviation`` with position in mm and deviation in µm."""
    rows = zip(found.run, found.positions[:, 0], found.reading, strict=True)
    lines = ([r, f"{x:.3f}", f"{1000 * e:.3f}"] for r, x, e in rows)
    _write_csv(path, ["run", f"{along.lower()} [mm]", "deviation [um]"], lines)


def write_surface(path: Path, across: tuple[str, str], found: Reading) -> None:
    """Write ``x, y, dz`` with positions in mm and heights in µm."""
    rows = zip(found.positions, found.reading, strict=True)
    lines = ([f"{x:.3f}", f"{y:.3f}", f"{1000 * e:.3f}"] for (x, y), e in rows)
    first, second = (axis.lower() for axis in across)
    _write_csv(path, [f"{first} [mm]", f"{second} [mm]", "dz [um]"], lines)


def _write_csv(
    path: Path, header: Sequence[str], lines: Iterable[Sequence[object]]
) -> None:
    with path.open("w", encoding="ascii", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(lines)
