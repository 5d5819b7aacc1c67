"""A fleet of machines for the tests of batches: jobs and their measurements."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ..friction_job import friction_job

_JOB = """\
title = "axis {k}"
[machine]
id = "m{machine}"
measured_at = 2026-{month:02d}-{day:02d}
[axes.X]
number = 1
[measurements.laser]
file = "{k:05d}.csv"
active = []
remove = "none"
[measurements.laser.columns]
"X.position" = "x"
"X.error" = {{ column = "e", unit = "um" }}
"X.direction" = "dir"
"run" = "run"
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
bilateral = true
start = -20.0
interval = 5.0
points = 9
"""

_RATED = "rated_current = 12.0\ntorque_unit = 0.001"


def fleet(folder: Path, count: int) -> list[str]:
    """Write leadscrew jobs, 9 targets × 5 runs × 2 directions each; return their names."""
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(count):
        (folder / f"{k:05d}.csv").write_text(readings(k))
        text = _JOB.format(k=k, machine=k // 6, month=1 + k % 6, day=1 + k % 28)
        (folder / f"{k:05d}.toml").write_text(text)
    return [f"{k:05d}" for k in range(count)]


def readings(seed: int, louder: float = 1.0) -> str:
    """Return the readings of one axis as CSV, errors in µm."""
    rng = np.random.default_rng(seed)
    nodes = np.linspace(-20.0, 20.0, 9)
    size, wave, phase = rng.uniform(5, 40), rng.uniform(0.03, 0.25), rng.uniform(0, 6)
    back = rng.uniform(1, 8)
    there = np.concatenate([nodes, nodes[::-1]])
    sense = np.repeat([1, -1], 9)
    rows = ["x,e,dir,run"]
    for run in range(1, 6):
        error = size * np.sin(wave * there + phase) - np.where(sense < 0, back, 0.0)
        error += rng.normal(0, 1.0) + rng.normal(0, 1.0) * np.linspace(0, 1, 18)
        error = louder * (error + rng.normal(0, 1.2, 18))
        rows += [
            f"{x:g},{e:.3f},{d},{run}"
            for x, e, d in zip(there, error, sense, strict=True)
        ]
    return "\n".join(rows) + "\n"


def friction_fleet(folder: Path, count: int) -> list[str]:
    """Write friction jobs of 2 000 samples each; return their names."""
    folder.mkdir(parents=True, exist_ok=True)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.minimum(1.0, np.arange(143) / 30))
    speeds = [way * v for v in (1, 2, 4, 8, 16, 40, 100) for way in (1, -1)]
    velocity = np.concatenate([v * ramp * ramp[::-1] for v in speeds])[:2000]
    time = 0.01 * np.arange(len(velocity))
    position, speed = 0.01 * np.cumsum(velocity), np.abs(velocity)
    for k in range(count):
        rng = np.random.default_rng(k)
        level, drop = rng.uniform(1, 3), rng.uniform(0.2, 1.5)
        bend, slope = rng.uniform(2, 10), rng.uniform(0.002, 0.01)
        current = np.sign(velocity) * (level + drop * np.exp(-((speed / bend) ** 2)))
        current += slope * velocity + 0.002 * np.gradient(velocity, 0.01) + 0.3
        current += 0.05 * rng.normal(size=len(velocity))
        np.savetxt(
            folder / f"{k:05d}.csv",
            np.column_stack([time, position, current]),
            "%.7f",
            ",",
            header="t,x,i",
            comments="",
        )
        (folder / f"{k:05d}.toml").write_text(friction_job(_RATED, file=f"{k:05d}.csv"))
    return [f"{k:05d}" for k in range(count)]


_PLANE = """\
[axes.X]
number = 1
[axes.Y]
number = 2
[axes.Z]
number = 3
[measurements.probe]
file = "{file}"
{read}
remove = "none"
[measurements.probe.columns]
"X.position" = "x"
"Y.position" = "y"
"Z.error" = "e"
[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
measurement = "probe"
start = [0.0, 0.0]
interval = [{step}, {step}]
points = [{side}, {side}]
{fit}
"""


def plane_job(
    path: Path, file: str, side: int, step: float, *, read: str = "", fit: str = ""
) -> None:
    """Write the job of a square plane over a file of x, y and e.

    Args:
        path: Of the job.
        file: Beside it.
        side: Nodes along each axis.
        step: Between them, in mm.
        read: Further keys of the measurement.
        fit: Further keys of the fit.
    """
    path.write_text(_PLANE.format(file=file, side=side, step=step, read=read, fit=fit))


def endless_job(folder: Path, name: str) -> None:
    """Write a plane of so many nodes that its fit takes far longer than any time limit here."""
    side = np.linspace(0.0, 1.0, 222)
    x, y = (grid.ravel() for grid in np.meshgrid(side, side))
    error = np.random.default_rng(0).normal(size=len(x))
    rows = [f"{a:.6f},{b:.6f},{e:.5f}" for a, b, e in zip(x, y, error, strict=True)]
    (folder / f"{name}.csv").write_text("x,y,e\n" + "\n".join(rows) + "\n")
    plane_job(folder / f"{name}.toml", f"{name}.csv", 220, 0.0045)


@pytest.fixture(name="fleet", scope="session")
def _fleet() -> Callable[[Path, int], list[str]]:
    return fleet


@pytest.fixture(name="friction_fleet", scope="session")
def _friction_fleet() -> Callable[[Path, int], list[str]]:
    return friction_fleet


@pytest.fixture(name="endless_job", scope="session")
def _endless_job() -> Callable[[Path, str], None]:
    return endless_job


@pytest.fixture(name="plane_job", scope="session")
def _plane_job() -> Callable[..., None]:
    return plane_job


@pytest.fixture(name="readings", scope="session")
def _readings() -> Callable[[int, float], str]:
    return readings
