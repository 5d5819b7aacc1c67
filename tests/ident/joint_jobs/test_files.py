"""Several files of one measurement: joined on time, with the offset between their clocks."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import MeasurementError
from axcomp.ident.job import JobError, TemperatureResult, load_job, run_job

SHIFT = 437.0  # s: the logger was started that much later
SLOPE = -4e-4  # mm/K

JOB = """
[axes.Z]
number = 3

[measurements.warm]
files = ["gauge.csv", "logger.csv"]
{offsets}
[measurements.warm.columns]
time = "time"
"Z.error" = "error"
{sensors}
[[fits]]
compensation = "temperature"
axis = "Z"
measurement = "warm"
sensors = {{ offset = "spindle" }}
law = {{ offset = "linear" }}
lag = "none"
"""

Table = dict[str, np.ndarray]


def spindle(time: np.ndarray) -> np.ndarray:
    """Two warm-ups and a rest in °C; no stretch is like another."""
    cycle = np.sin(time / 900.0) + 0.6 * np.sin(time / 377.0 + 1.0)
    return 24.0 + 4.0 * cycle + 1e-3 * time


def write(path: Path, columns: Table) -> None:
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(f"{v:.7f}" for v in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")


def gauge(seed: int = 1) -> Table:
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 7200.0, 20.0)
    error = SLOPE * (spindle(time) - 24.0) + 3e-5 * rng.normal(size=time.size)
    return {"time": time, "error": error}


def logger(seed: int = 2) -> Table:
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 6000.0, 7.0)
    warm = spindle(time + SHIFT) + 0.02 * rng.normal(size=time.size)
    return {"time": time, "spindle": warm}


@pytest.fixture
def job(tmp_path: Path) -> Callable[..., Path]:
    def written(
        first: Table,
        second: Table,
        sensors: str = '"temperature.spindle" = "spindle"\n',
        offsets: str = "",
    ) -> Path:
        write(tmp_path / "gauge.csv", first)
        write(tmp_path / "logger.csv", second)
        path = tmp_path / "job.toml"
        path.write_text(JOB.format(offsets=offsets, sensors=sensors))
        return path

    return written


def run(path: Path) -> TemperatureResult:
    found = run_job(path, path.parent / "out").fits[0]
    assert isinstance(found, TemperatureResult)
    return found


def test_offset_between_an_error_and_the_temperature_it_follows_is_found(
    job: Callable[..., Path],
) -> None:
    path = job(gauge(), logger())
    found = run_job(path, path.parent / "out")
    clock = found.clocks[0]
    assert clock.standard_deviation is not None
    # 4 deviations, one seeded draw; and of use: a small part of a period of 2370 s.
    assert abs(clock.offset - SHIFT) < 4 * clock.standard_deviation
    assert clock.standard_deviation < 20.0
    thermal = found.fits[0]
    assert isinstance(thermal, TemperatureResult)
    slope, deviation = thermal.fit.offset.slope
    # The offset is uncertain too, which the deviation of the slope does not hold: 2 %.
    assert abs(slope - SLOPE) < 4 * deviation + 0.02 * abs(SLOPE)


def test_offset_and_its_deviation_stand_in_result_and_remarks(
    job: Callable[..., Path],
) -> None:
    path = job(gauge(), logger())
    found = run(path)
    stored = json.loads((path.parent / "out" / "result.json").read_text())["clocks"]
    assert stored[0]["measurement"] == "warm"
    assert stored[0]["file"] == "logger.csv"
    assert stored[0]["offset"] == pytest.approx(SHIFT, abs=40.0)
    words = " ".join(remark.message for remark in found.remarks)
    assert "logger.csv is put onto the clock of the first file by +" in words
    assert "(1 sd), from Z.error, which follows temperature.spindle" in words


def test_sensor_in_both_files_tells_the_offset_best(job: Callable[..., Path]) -> None:
    rng = np.random.default_rng(5)
    first = gauge()
    first["ambient"] = spindle(first["time"]) + 0.02 * rng.normal(
        size=first["time"].size
    )
    second = logger()
    second["ambient"] = second["spindle"] + 0.02 * rng.normal(size=second["time"].size)
    path = job(
        first,
        second,
        '"temperature.spindle" = "spindle"\n"temperature.ambient" = "ambient"\n',
    )
    clock = run_job(path, path.parent / "out").clocks[0]
    assert clock.by == "temperature.ambient"
    assert clock.standard_deviation is not None
    assert abs(clock.offset - SHIFT) < 4 * clock.standard_deviation  # one seeded draw
    assert clock.standard_deviation < 2.0  # 0.03 K against 0.005 K/s, 360 readings


def test_given_offset_is_taken_as_it_is(job: Callable[..., Path]) -> None:
    path = job(gauge(), logger(), offsets=f"offsets = [{SHIFT}]\n")
    found = run_job(path, path.parent / "out")
    assert found.clocks[0].offset == SHIFT
    assert found.clocks[0].standard_deviation is None
    words = " ".join(remark.message for remark in found.fits[0].remarks)
    assert "by +437 s, as the job says (offsets)" in words


def test_motion_seen_by_two_instruments_tells_milliseconds(
    job: Callable[..., Path], tmp_path: Path
) -> None:
    def place(time: np.ndarray) -> np.ndarray:
        return 100.0 * np.sin(time / 3.0) + 40.0 * np.sin(time * 0.71)

    rng = np.random.default_rng(7)
    time, other = np.arange(0.0, 60.0, 0.01), np.arange(0.0, 45.0, 0.004)
    first = {"time": time, "error": np.zeros(time.size), "command": place(time)}
    second = {
        "time": other,
        "spindle": np.linspace(20.0, 25.0, other.size),
        "scale": place(other + 11.2345) + 1e-3 * rng.normal(size=other.size),
    }
    path = job(
        first,
        second,
        '"temperature.spindle" = "spindle"\n"Z.position" = "command"\n'
        '"Z.encoder" = "scale"\n',
    )
    from axcomp.ident.readings import Tables

    tables = Tables(load_job(path))
    tables.table("warm")
    clock = tables.clocks[0]
    assert clock.by == "Z.position and Z.encoder"
    # Linear interpolation of 10 ms steps is off by 1 µm at 30 mm/s: 0.05 ms.
    assert clock.offset == pytest.approx(11.2345, abs=2e-4)


WARMING = """
[axes.X]
number = 1
[measurements.warm]
files = ["gauge.csv", "logger.csv"]
active = []
remove = "none"
[measurements.warm.columns]
time = "time"
"X.position" = "x"
"X.error" = "error"
"temperature.scale" = "scale"
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "warm"
start = 0.0
interval = 100.0
points = 5
group = "X"
[[fits]]
compensation = "temperature"
axis = "X"
measurement = "warm"
sensors = { coefficient = "scale" }
reference = 0.0
lag = "none"
group = "X"
"""


def warming(path: Path, cold: float, late: float) -> Path:
    """Three hours of runs while an axis warms up by 7 K exponentially from 0 s on."""

    def scale(time: np.ndarray) -> np.ndarray:
        return 20.0 + 7.0 * (1.0 - np.exp(-np.maximum(time, 0.0) / 2500.0))

    rng = np.random.default_rng(1)
    time, log = np.arange(0.0, 10200.0, 15.0), np.arange(-cold, 10500.0, 30.0)
    place = 200.0 - 200.0 * np.cos(np.pi * np.arange(time.size) / 17.0)
    error = 0.012 * np.sin(place / 110.0) + 11e-6 * (scale(time) - 20.0) * place
    error += 5e-4 * rng.normal(size=time.size)
    write(path / "gauge.csv", {"time": time, "x": place, "error": error})
    warm = scale(log) + 0.02 * rng.normal(size=log.size)
    write(path / "logger.csv", {"time": log + late, "scale": warm})
    job = path / "job.toml"
    job.write_text(WARMING)
    return job


# Cold for 50 minutes before, too: no reading says when the logger saw the change.
@pytest.mark.parametrize("cold", [300.0, 3000.0])
def test_an_exponential_warming_leaves_clocks_that_agree_as_they_are(
    cold: float, tmp_path: Path
) -> None:
    found = run_job(warming(tmp_path, cold, 0.0), tmp_path / "out")
    clock = found.clocks[0]
    # Any shift to the left fits the readings that are left, with a steeper line: -5000 s.
    assert clock.offset == 0.0
    assert clock.standard_deviation is None
    words = " ".join(remark.message for remark in found.groups[0].remarks)
    assert "the offset between them is not determined by X.error" in words
    thermal = found.fits[1]
    assert isinstance(thermal, TemperatureResult)
    assert thermal.fit.coefficient is not None
    # Noise of 0.02 K and 0.5 µm in 680 readings; a clock 5000 s off makes it 7 times as steep.
    assert thermal.fit.coefficient.slope[0] == pytest.approx(11e-6, rel=0.02)


def test_an_exponential_warming_on_clocks_apart_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        JobError,
        match=r"offsets between the clocks from -\d+ to -?\d+ s fit about as well",
    ):
        run_job(warming(tmp_path, 300.0, 3000.0), tmp_path / "out")


def test_rows_outside_the_time_of_the_other_file_are_told(
    job: Callable[..., Path],
) -> None:
    words = " ".join(remark.message for remark in run(job(gauge(), logger())).remarks)
    # 20 s apart, up to 437 s before the logger began: 22; after its end at 6431 s: 38.
    assert re.search(r"\b\d\d of 360 rows of gauge.csv lie outside its time", words)


def test_files_without_common_signal_are_refused(job: Callable[..., Path]) -> None:
    first = {"time": np.arange(100.0), "pressure": np.arange(100.0) % 7}
    path = job(
        first, logger(), '"Z.position" = "pressure"\n"temperature.s" = "spindle"'
    )
    text = path.read_text().replace('"Z.error" = "error"\n', "")
    path.write_text(text)
    with pytest.raises(
        JobError, match=r"measurements\.warm\.files.*no column that both"
    ):
        run(path)


def test_signals_that_do_not_tell_the_offset_are_refused(
    job: Callable[..., Path],
) -> None:
    first = gauge()
    first["error"] = np.random.default_rng(3).normal(size=first["time"].size)
    with pytest.raises(
        JobError, match=r"files: logger\.csv beside gauge\.csv: by Z.error"
    ):
        run(job(first, logger()))


def test_motion_that_repeats_is_refused(job: Callable[..., Path]) -> None:
    first, second = gauge(), logger()
    first["error"] = np.random.default_rng(3).normal(size=first["time"].size)
    first["frame"] = np.sin(first["time"] / 60.0)
    second["frame"] = np.sin(second["time"] / 60.0)
    sensors = '"temperature.spindle" = "spindle"\n"temperature.frame" = "frame"\n'
    with pytest.raises(JobError, match="repeats itself, so that another offset"):
        run(job(first, second, sensors))


def test_file_without_time_is_refused(job: Callable[..., Path]) -> None:
    second = logger()
    del second["time"]
    with pytest.raises(MeasurementError, match=r"logger\.csv.*role time in each"):
        run(job(gauge(), second))


def test_logs_taken_apart_are_refused(job: Callable[..., Path]) -> None:
    path = job(gauge(), logger(), offsets="offsets = [1e6]\n")
    with pytest.raises(JobError, match="found no common time"):
        run(path)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('files = ["gauge.csv", "logger.csv"]', 'files = ["gauge.csv", "gauge.csv"]',
         "expected each once"),
        ("files =", 'file = "gauge.csv"\nfiles =', "found beside file"),
        ("[measurements.warm.columns]", "offsets = [1.0, 2.0]\n[measurements.warm.columns]",
         "found 2 for 2 files"),
        ('"Z.error" = "error"', '"Z.error" = { column = "error", file = "gage.csv" }',
         "nearest: 'gauge.csv'"),
    ],
)  # fmt: skip
def test_contradictions_are_named(
    job: Callable[..., Path], old: str, new: str, match: str
) -> None:
    path = job(gauge(), logger())
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(JobError, match=match):
        load_job(path)
