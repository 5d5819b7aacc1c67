"""A temperature that the machine follows late, and one that the readings do not tell."""

import json
from pathlib import Path

import numpy as np

from axcomp.ident.job import run_job

from .mill import table

NOISE = 5e-4
COEFFICIENT = 11.5e-6
STEP = 10.0
LAG = 600.0

JOB = """
[axes.X]
number = 1
limits = [0, 600]
[measurements.log]
file = "log.csv"
active = []
remove = "none"
columns = { time = "t", "X.position" = "x", "X.error" = "e", "temperature.scale" = "warm" }
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "log"
start = 0.0
interval = 100.0
points = 7
group = "g"
[[fits]]
compensation = "temperature"
axis = "X"
measurement = "log"
sensors = { coefficient = "scale" }
reference = 0.0
group = "g"
"""


def readings(folder: Path, place: np.ndarray, warm: np.ndarray, late: float) -> Path:
    """A screw of 5 µm, and a structure that follows its sensor late."""
    rng = np.random.default_rng(5)
    structure = warm.copy()
    for k in range(1, len(warm)):
        share = -np.expm1(-STEP / late) if late else 1.0
        structure[k] = structure[k - 1] + share * (warm[k] - structure[k - 1])
    error = 5e-3 * np.sin(place / 90.0) + COEFFICIENT * (structure - 20.0) * place
    error += NOISE * rng.standard_normal(len(place))
    time = STEP * np.arange(len(place))
    table(folder / "log.csv", "t,x,e,warm", time, place, error, warm)
    (folder / "job.toml").write_text(JOB)
    return folder / "job.toml"


def test_the_whole_axis_is_judged_with_the_lag_that_the_controller_has(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(6)
    place = 50.0 * rng.integers(0, 13, 1500)
    warm = 20.0 + 4.0 * np.sin(2.0 * np.pi * STEP * np.arange(1500) / 1500.0)
    result = run_job(readings(tmp_path, place, warm, LAG), tmp_path / "out")
    assert result.passed
    whole = json.loads((tmp_path / "out" / "result.json").read_text())["whole"]["X"]
    left = [one["value"] for one in whole["gate"] if one["name"] == "axis error"]
    # Without the lag up to 10 µm are left; with it the noise of a reading, and roundings.
    assert max(left) < 2.0 * NOISE


def test_a_law_that_readings_do_not_tell_from_none_is_not_let_out(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(7)
    place = 510.0 + rng.uniform(-2.0, 2.0, 60)
    warm = 20.0 + 4.0 * np.sin(np.linspace(0.0, 12.0, 60))
    job = readings(tmp_path, place, warm, 0.0)
    alone = JOB[: JOB.index("[[fits]]")] + JOB[JOB.rindex("[[fits]]") :]
    alone = alone.replace(
        'group = "g"', 'law = { offset = "linear", coefficient = "linear" }'
    )
    sensors = '{ offset = "scale", coefficient = "scale" }'
    job.write_text(alone.replace('{ coefficient = "scale" }', sensors))
    result = run_job(job, tmp_path / "out")
    assert not result.passed
    # Near one place shift and growth are one: together they fit, elsewhere they are off.
    said = [one.message for one in result.fits[0].remarks if one.level == "error"]
    assert len([words for words in said if "do not tell it from none" in words]) == 2


def test_a_datum_whose_readings_move_with_the_temperature_is_none(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(8)
    place = np.tile(np.arange(0.0, 601.0, 100.0), 60)
    warm = 20.0 + 4.0 * np.sin(np.linspace(0.0, 12.0, len(place)))
    job = readings(tmp_path, place, warm, 0.0)
    error = 2e-3 * (warm - 20.0) + COEFFICIENT * (warm - 20.0) * place
    error += NOISE * rng.standard_normal(len(place))
    time = STEP * np.arange(len(place))
    table(tmp_path / "log.csv", "t,x,e,warm", time, place, error, warm)
    alone = JOB[: JOB.index("[[fits]]")] + JOB[JOB.rindex("[[fits]]") :]
    alone = alone.replace('group = "g"', "").replace("reference = 0.0", "")
    job.write_text(alone.replace('remove = "none"', "datum = { at = 0.0 }"))
    result = run_job(job, tmp_path / "out")
    assert not result.passed
    said = " ".join(one.message for one in result.fits[0].remarks)
    # 2 µm/K over 8 K, beside the noise.
    assert "its readings there move by 1" in said
