"""One probed machine for the tests of groups: a table, a beam, a screw that grows."""

import dataclasses
from pathlib import Path

import numpy as np

NOISE = 5e-4  # mm
PITCH = 30e-6  # mm/mm: what the screw of X is too long
GROWTH = 11e-6  # mm/mm per K
WIDTH = 0.006  # mm, backlash of X
SPINDLE = 1.5e-3  # mm/K, Z falls as the spindle warms
START = 20.0  # °C

JOB = """
title = "Probed machine"
[axes.X]
number = 1
limits = [0.0, 400.0]
{X}
[axes.Y]
number = 2
limits = [0.0, 300.0]
[axes.Z]
number = 3
limits = [0.0, 200.0]
{Z}
[measurements.probe]
file = "probe.csv"
remove = "none"
active = {active}
{fits}
"""

LEADSCREW = """
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "probe"
start = 0.0
interval = 25.0
points = 17
group = "all"
"""
BACKLASH = """
[[fits]]
compensation = "backlash"
axis = "X"
measurement = "probe"
group = "all"
"""
GROWING = """
[[fits]]
compensation = "temperature"
axis = "X"
measurement = "probe"
sensors = { coefficient = "scale" }
reference = 0.0
group = "all"
"""
PLANE = """
[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
measurement = "probe"
start = [0.0, 0.0]
interval = [50.0, 50.0]
points = [9, 7]
group = "all"
"""
WARM = """
[[fits]]
compensation = "temperature"
axis = "Z"
measurement = "probe"
sensors = { offset = "spindle" }
lag = "none"
group = "all"
"""

EVERYTHING = LEADSCREW + BACKLASH + GROWING + PLANE + WARM


@dataclasses.dataclass(frozen=True)
class Probe:
    """What the probe recorded, one array per column."""

    columns: dict[str, np.ndarray]

    def write(self, folder: Path) -> None:
        rows = zip(*self.columns.values(), strict=True)
        lines = [",".join(self.columns)]
        lines += [",".join(f"{value:.7f}" for value in row) for row in rows]
        (folder / "probe.csv").write_text("\n".join(lines) + "\n")

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["time"])


def screw(x: np.ndarray) -> np.ndarray:
    """Error of X at 20 °C in mm, moving positive."""
    return np.asarray(PITCH * x + 4e-3 * np.sin(x / 55.0))


def table(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Error of Z over the table in mm."""
    return np.asarray(8e-3 * np.sin(x / 130.0) * np.cos(y / 110.0) + 2e-5 * y)


def probe(rows: int = 1500, seed: int = 1, *, rising: bool = False) -> Probe:
    """Probe places at random while the machine warms up and cools down.

    Args:
        rows: Readings.
        seed: Of noise and places.
        rising: The temperature goes with X, so that nothing tells them apart.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(rows) * 10.0
    x, y = rng.uniform(0, 400, rows).round(3), rng.uniform(0, 300, rows).round(3)
    way = rng.choice([-1.0, 1.0], rows)
    phase = time / time[-1]
    scale = START + 5.0 * np.sin(np.pi * phase) ** 2 + 0.8 * np.sin(9.0 * phase)
    spindle = START + 9.0 * np.sin(1.7 * np.pi * phase) ** 2
    if rising:
        scale = START + 5.0 * phase
        x = np.round(400.0 * phase, 3)
    error_x = screw(x) - 0.5 * WIDTH * (way - 1.0) + GROWTH * (scale - START) * x
    error_z = table(x, y) - SPINDLE * (spindle - START)
    noise = NOISE * rng.normal(size=(2, rows))
    wild = rng.choice(rows, rows // 200, replace=False)
    noise[:, wild] += 0.08
    columns = {
        "time": time,
        "X.position": x,
        "Y.position": y,
        "X.direction": way,
        "temperature.scale": scale + 0.01 * rng.normal(size=rows),
        "temperature.spindle": spindle + 0.01 * rng.normal(size=rows),
        "X.error": error_x + noise[0],
        "Z.error": error_z + noise[1],
    }
    return Probe(columns)


def job(folder: Path, fits: str, x: str = "", z: str = "", active: str = "[]") -> Path:
    """Write a job file and return it."""
    path = folder / "job.toml"
    path.write_text(JOB.format(X=x, Z=z, fits=fits, active=active))
    return path
