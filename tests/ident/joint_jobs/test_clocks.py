"""Measurements of a group whose clocks all begin at 0: a lag remembers none of the others."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.ident._recording import lagged
from axcomp.ident.job import TableResult, TemperatureResult, run_job

NOISE = 5e-4  # mm
LAG = 600.0  # s

JOB = """
[axes.X]
number = 1
[measurements.warming]
file = "warming.csv"
remove = "none"
[measurements.cooling]
file = "cooling.csv"
remove = "none"
[[fits]]
compensation = "leadscrew"
axis = "X"
measurements = ["warming", "cooling"]
start = 0.0
interval = 100.0
points = 11
group = "X"
[[fits]]
compensation = "temperature"
axis = "X"
sensor = "scale"
measurements = ["warming", "cooling"]
group = "X"
"""


def record(path: Path, begin: float, change: float, seed: int) -> None:
    """Four hours at eleven targets, the structure behind its sensor."""
    time = np.arange(0.0, 4 * 3600.0, 30.0)
    sensor = begin + change * (1.0 - np.exp(-time / 3000.0))
    place = 100.0 * (np.arange(len(time)) % 11)
    error = 0.005 * np.sin(place / 150.0)
    error += 1.1e-5 * (lagged(time, sensor, LAG) - 20.0) * place
    error += NOISE * np.random.default_rng(seed).normal(size=len(time))
    columns = np.column_stack([time, place, error, sensor])
    header = "time,X.position,X.error,temperature.scale"
    np.savetxt(path, columns, "%.7f", ",", header=header, comments="")


@pytest.mark.usefixtures("no_drawing")
def test_a_lag_remembers_nothing_of_another_measurement(tmp_path: Path) -> None:
    record(tmp_path / "warming.csv", 20.0, 10.0, 0)
    record(tmp_path / "cooling.csv", 32.0, -10.0, 1)
    job = tmp_path / "job.toml"
    job.write_text(JOB)
    screw, line = run_job(job, tmp_path / "out").fits
    assert isinstance(screw, TableResult)
    assert isinstance(line, TemperatureResult)
    (lag,) = line.fit.lags
    # Stated as 2.7 s: three of them.
    assert abs(lag.time_constant - LAG) < 8.0
    # Readings held out scatter as readings do; with the sensors mixed up it was 4 µm.
    assert line.error["predicted"].sound.rms < 1.1 * NOISE
    truth = -0.005 * np.sin(screw.nodes[0] / 150.0)
    np.testing.assert_allclose(screw.table["pos"] * screw.sign, truth, atol=4e-4)
