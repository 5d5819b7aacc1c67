"""The files that the pages speak of, as instruments write them: made from a seed."""

from pathlib import Path

import numpy as np
import pytest

SEED = 7


def write(path: Path, head: str, *columns: np.ndarray) -> None:
    rows = np.column_stack(columns)
    np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.6f")


def sag(position: np.ndarray) -> np.ndarray:
    """An error of 20 µm that is 0 at 0."""
    return 0.02 * np.sin(np.pi * position / 800.0)


def runs(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Targets, run and direction of five runs up and down."""
    up = np.arange(0.0, 801.0, 10.0)
    target = np.tile(np.concatenate([up, up[::-1]]), 5)
    way = np.tile(np.repeat([1.0, -1.0], up.size), 5)
    return target, np.repeat(np.arange(1.0, 6.0), 2 * up.size), way


def laser(folder: Path, rng: np.random.Generator) -> None:
    target, run, way = runs(rng)
    noise = 5e-4 * rng.normal(size=target.size)
    error = sag(target) - 0.006 * (way < 0) + noise
    write(folder / "laser.csv", "target,error,run,direction", target, error, run, way)
    write(
        folder / "laser_after.csv", "target,error,run,direction",
        target, 5e-4 * rng.normal(size=target.size), run, way,
    )  # fmt: skip


def maps(folder: Path, rng: np.random.Generator) -> None:
    target, run, _ = runs(rng)
    bent = 1e3 * sag(target) + 0.3 * rng.normal(size=target.size)
    write(folder / "straightness_y.csv", "x,dy,run", target, bent, run)
    x, y = (
        a.ravel() for a in np.meshgrid(np.arange(0, 801, 20), np.arange(0, 401, 20))
    )
    for name in ("surface_z.csv", "surface_again.csv"):
        flat = 1e3 * sag(x) * (y / 400.0) + 0.4 * rng.normal(size=x.size)
        write(folder / name, "x,y,dz", x, y, flat)


def warm(folder: Path, rng: np.random.Generator) -> None:
    time = np.arange(0.0, 14_400.0, 60.0)
    frame = 20.0 + 6.0 * np.sin(np.pi * time / 14_400.0) ** 2
    z = np.tile([0.0, 100.0, 200.0, 300.0], time.size // 4)
    growth = (frame - 20.0) * (1.5 + 11e-3 * z)
    error = growth + 0.3 * rng.normal(size=time.size)
    write(folder / "warm.csv", "time,z,dz,t_frame", time, z, error, frame)


def drive(folder: Path, rng: np.random.Generator) -> None:
    time = np.arange(0.0, 60.0, 0.004)
    swing = 2 * np.pi * (0.05 * time + 0.004 * time**2)
    position = 40.0 * np.sin(swing)
    velocity = np.gradient(position, time)
    speed = np.abs(velocity)
    current = np.sign(velocity) * (1.2 + 0.8 * np.exp(-speed / 8.0) + 0.004 * speed)
    current += 4e-4 * np.gradient(velocity, time) + 0.02 * rng.normal(size=time.size)
    write(folder / "scope.csv", "time,ActPos,ActCurrent", time, position, current)


def log(folder: Path, rng: np.random.Generator) -> None:
    step = 0.001
    parts, start = [], 0.0
    push = np.concatenate(
        [np.full(60, 5000.0), np.zeros(80), np.full(60, -5000.0), np.zeros(120)]
    )
    cycle = np.concatenate([push, -push])
    z = []
    for place in (0.0, 200.0, 400.0):
        parts.append(np.tile(cycle, 8))
        z.append(np.full(8 * cycle.size, place))
    acceleration, height = np.concatenate(parts), np.concatenate(z)
    velocity = np.cumsum(acceleration) * step
    x = 100.0 + start + np.cumsum(velocity) * step
    time = step * np.arange(x.size)
    error = -acceleration / 5000.0 * (2.0 + 0.01 * height)
    error += 0.2 * rng.normal(size=x.size)
    write(
        folder / "log.csv", "time,x,z,y,dy", time, x, height, np.full(x.size, 50.0), error
    )  # fmt: skip


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with every file that a page speaks of."""
    rng = np.random.default_rng(SEED)
    for make in (laser, maps, warm, drive, log):
        make(tmp_path, rng)
    monkeypatch.chdir(tmp_path)
    return tmp_path
