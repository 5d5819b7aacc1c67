"""Readings that do not tell a fit: it is named and left out, and the rest is written."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.cli import main
from axcomp.ident.job import JobResult, run_job

AXES = "".join(f"[axes.{a}]\nnumber = {k}\n" for k, a in enumerate("XYZ", 1))
LINE = "start = 0.0\ninterval = 40.0\npoints = 11\n"
NOISE = 5e-4
ROWS = 400


def entry(kind: str, axis: str, keys: str = "", group: str = "") -> str:
    text = f'[[fits]]\ncompensation = "{kind}"\naxis = "{axis}"\nmeasurement = "m"\n'
    return text + keys + (f'group = "{group}"\n' if group else "")


def job(folder: Path, columns: dict[str, np.ndarray], fits: str) -> Path:
    table = np.column_stack(list(columns.values()))
    heads = ",".join(columns)
    np.savetxt(folder / "data.csv", table, "%.6f", ",", header=heads, comments="")
    path = folder / "job.toml"
    path.write_text(
        f'{AXES}[measurements.m]\nfile = "data.csv"\nremove = "none"\n{fits}'
    )
    return path


def screw(x: np.ndarray) -> np.ndarray:
    return np.asarray(3e-5 * x + 3e-3 * np.sin(x / 60))


def noise(seed: int = 0) -> np.ndarray:
    return NOISE * np.random.default_rng(seed).normal(size=ROWS)


def left_out(result: JobResult) -> dict[str, str]:
    """Return the error of each fit that nothing was written of, by its compensation."""
    assert not result.passed
    return {
        one.compensation: remark.message
        for one in result.fits
        for remark in one.remarks
        if remark.level == "error" and not one.files
    }


WARM = 'sensor = "scale"\nlag = "none"\n'


@pytest.fixture
def rising() -> dict[str, np.ndarray]:
    """The temperature goes up with the position, both once."""
    share = np.linspace(0.0, 1.0, ROWS)
    x, heat = 400 * share, 20 + 6 * share
    error = screw(x) + 1.1e-5 * (heat - 20) * x + noise()
    return {
        "time": 5.0 * np.arange(ROWS),
        "X.position": x,
        "X.error": error,
        "temperature.scale": heat + 0.01 * noise(1) / NOISE,
    }


def test_a_temperature_alone_that_rose_with_the_position_is_not_written(
    tmp_path: Path, rising: dict[str, np.ndarray]
) -> None:
    path = job(tmp_path, rising, entry("temperature", "X", WARM))
    said = left_out(run_job(path, tmp_path / "out"))
    assert "cannot tell the leadscrew of X and the temperature" in said["temperature"]
    assert "Measure the same positions again" in said["temperature"]
    assert not (tmp_path / "out" / "temperature_X.csv").exists()


def test_two_fits_of_no_group_that_are_confounded_are_both_left_out(
    tmp_path: Path, rising: dict[str, np.ndarray]
) -> None:
    fits = entry("leadscrew", "X", LINE) + entry("temperature", "X", WARM)
    said = left_out(run_job(job(tmp_path, rising, fits), tmp_path / "out"))
    assert set(said) == {"leadscrew", "temperature"}
    assert not list((tmp_path / "out").glob("*.lis"))


@pytest.mark.parametrize(("jitter", "way"), [(0.0, 1.0), (0.5, -1.0)])
def test_a_plane_over_masters_that_moved_together_is_not_written(
    tmp_path: Path, jitter: float, way: float
) -> None:
    rng = np.random.default_rng(3)
    x = 400 * rng.random(ROWS)
    y = 200 + way * (x - 200) + jitter * rng.normal(size=ROWS)
    columns = {"X.position": x, "Y.position": y, "Z.error": screw(x) + noise()}
    keys = 'masters = ["X", "Y"]\nstart = [-40.0, -40.0]\ninterval = [40.0, 40.0]\n'
    path = job(tmp_path, columns, entry("plane", "Z", keys + "points = [13, 13]\n"))
    said = left_out(run_job(path, tmp_path / "out"))
    assert "X and Y moved together" in said["plane"]
    assert "Move each of them while the other stands still" in said["plane"]
    assert not list((tmp_path / "out").glob("*.lis"))


def test_one_direction_leaves_the_backlash_out_and_writes_the_table(
    tmp_path: Path,
) -> None:
    x = np.tile(np.linspace(0, 400, 40), 10)
    columns = {
        "X.position": x,
        "X.direction": np.ones(ROWS),
        "run": np.repeat(np.arange(10.0), 40),
        "X.error": screw(x) + noise(),
    }
    fits = entry("leadscrew", "X", LINE) + entry("backlash", "X")
    result = run_job(job(tmp_path, columns, fits), tmp_path / "out")
    assert (
        "No reading shows the backlash of X: measure X in both"
        in left_out(result)["backlash"]
    )
    assert (tmp_path / "out" / "achskw1.lis").exists()
    assert "getriebe[0].lose" not in (tmp_path / "out" / "achsmds1.add.lis").read_text()


def test_a_sensor_that_stays_leaves_its_temperature_out_of_a_group(
    tmp_path: Path,
) -> None:
    x = 400 * np.random.default_rng(4).random(ROWS)
    columns = {
        "time": 5.0 * np.arange(ROWS),
        "X.position": x,
        "X.error": screw(x) + noise(),
        "temperature.scale": 26.0 + 0.01 * noise(1) / NOISE,
    }
    fits = entry("leadscrew", "X", LINE, "g") + entry("temperature", "X", WARM, "g")
    result = run_job(job(tmp_path, columns, fits), tmp_path / "out")
    assert "scale stays at 26 °C within 0.0" in left_out(result)["temperature"]
    (group,) = result.groups
    assert group.fits == (0, 1)
    # As measured at 26 °C: nothing was taken from it for a temperature.
    assert group.axes[0].error["from_file"].sound.rms < 1.1 * NOISE
    assert (tmp_path / "out" / "achskw1.lis").exists()
    assert not (tmp_path / "out" / "temperature_X.csv").exists()


def test_accelerations_of_one_sign_leave_the_crosstalk_out_of_a_group(
    tmp_path: Path,
) -> None:
    time = 0.01 * np.arange(ROWS)
    x = 50.0 * (time % 2.0) ** 2
    columns = {
        "time": time,
        "X.position": x,
        "X.velocity": 100.0 * (time % 2.0),
        "X.acceleration": np.where(time % 2.0 > 1.0, 100.0, 0.0),
        "Y.error": screw(x) + noise(),
    }
    cross = 'master = "X"\nstart = 0.0\ninterval = 20.0\npoints = 11\n'
    fits = entry("cross", "Y", cross, "g") + entry(
        "crosstalk", "Y", 'master = "X"\n', "g"
    )
    result = run_job(job(tmp_path, columns, fits), tmp_path / "out")
    assert "never slows down in these readings" in left_out(result)["crosstalk"]
    assert (tmp_path / "out" / "achskw2.lis").exists()


def two_sensors(seed: int = 5) -> dict[str, np.ndarray]:
    share = np.linspace(0.0, 1.0, ROWS)
    x = 400 * np.random.default_rng(seed).random(ROWS)
    heat = 22 + 3 * np.sin(11.0 * share)
    error = screw(x) + 1.1e-5 * (heat - 20) * x - 2e-3 * (heat - 20) + noise()
    return {
        "time": 5.0 * np.arange(ROWS),
        "X.position": x,
        "X.error": error,
        "temperature.scale": heat,
        "temperature.spindle": 30 + 2 * (heat - 20),
    }


def test_two_sensors_of_different_ranges_are_read_back_as_they_were_fitted(
    tmp_path: Path,
) -> None:
    # The spindle never was below 28 °C, the scale never above 25 °C.
    keys = 'sensors = { offset = "spindle", coefficient = "scale" }\nlag = "none"\n'
    fits = entry("leadscrew", "X", LINE, "g") + entry("temperature", "X", keys, "g")
    result = run_job(job(tmp_path, two_sensors(), fits), tmp_path / "out")
    assert result.passed
    (whole,) = result.groups[0].axes
    # Rounding to 0.1 µm aside, the files hold what was fitted: the noise is left.
    assert whole.error["from_file"].sound.rms < 1.05 * NOISE
    words = " ".join(r.message for r in result.fits[1].remarks)
    assert "Nothing is corrected with spindle at 28" in words
    assert "and scale at 20 °C" in words
    assert "spindle and scale changed alike (correlation 1.0000)" in words


def test_discover_does_not_choose_between_sensors_that_changed_alike(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = job(tmp_path, two_sensors(), "")
    assert main(["discover", str(path)]) == 1
    said = capsys.readouterr().out
    assert "the data cannot tell: temperature of X by " in said
    assert "changed alike; measure once while they do not" in said


def test_a_terminal_reads_the_group_first_and_nothing_twice(
    tmp_path: Path, rising: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    rising["X.direction"] = np.where(np.arange(ROWS) % 2, 1.0, -1.0)
    rising["X.error"] = rising["X.error"] + 0.003 * rising["X.direction"]
    fits = entry("leadscrew", "X", LINE, "g") + entry("backlash", "X", "", "g")
    path = job(tmp_path, rising, fits + entry("temperature", "X", WARM, "g"))
    assert main(["fit", str(path), "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().out
    assert "group g: 3 fits as one" in said
    rows = [line for line in said.splitlines() if line.startswith("│")]
    assert any("backlash of X" in row and "written" in row for row in rows)
    assert sum("not known" in row and "LEFT OUT" in row for row in rows) == 2
    assert said.count("cannot tell the leadscrew of X and the temperature") == 1
    assert said.count("error: The leadscrew of X is left out:") == 1
    assert "is left out:\n" not in said
    assert said.count("is left out: as said above.") == 2
    # What the written list is judged beside is on the machine.
    unlisted = "These figures take the leadscrew of X and temperature of X (scale) off"
    assert unlisted in said
    assert said.count("A straight line over X may be moved between") == 1
    assert "Identified together" not in said


@pytest.mark.parametrize("case", ["one way", "in lockstep", "at rest"])
def test_a_group_writes_no_table_whose_readings_a_fit_alone_refuses(
    tmp_path: Path, case: str
) -> None:
    rng = np.random.default_rng(3)
    x, y, z = rng.uniform(0.0, 400.0, (3, ROWS))
    if case == "in lockstep":
        y = 400.0 - x
    if case == "at rest":
        y = np.full(ROWS, 200.0)
    columns = {"X.position": x, "Y.position": y, "Z.position": z}
    columns |= {"Z.error": screw(x) + noise(), "Z.direction": np.ones(ROWS)}
    other = entry("cross", "Z", f'master = "X"\n{LINE}', "z")
    if case == "one way":
        fits = entry("leadscrew", "Z", f"{LINE}bilateral = true\n", "z") + other
    else:
        grid = "start = [0, 0]\ninterval = [40, 40]\npoints = [11, 11]\n"
        fits = entry("plane", "Z", f'masters = ["X", "Y"]\n{grid}', "z")
        fits += entry("leadscrew", "Z", LINE, "z")
    said = left_out(run_job(job(tmp_path, columns, fits), tmp_path / "out"))
    words = {
        "one way": ("leadscrew", "No reading in − direction of Z"),
        "in lockstep": ("plane", "X and Y moved together"),
        "at rest": ("plane", "All readings stand at 200 along Y"),
    }
    kind, reason = words[case]
    assert [*said] == [kind]
    assert reason in said[kind]


@pytest.mark.parametrize("group", ["", "x"])
def test_zeros_of_measurements_that_went_one_way_each_hide_a_backlash(
    tmp_path: Path, group: str
) -> None:
    rng = np.random.default_rng(4)
    x = rng.uniform(0.0, 400.0, ROWS)
    way = np.repeat([1.0, -1.0], ROWS // 2)
    error = screw(x) + 3e-3 * way + np.where(way > 0, 0.05, -0.02) + noise()
    fits = entry("leadscrew", "X", LINE, group) + entry("backlash", "X", "", group)
    columns = {"X.position": x, "X.error": error, "X.direction": way}
    text = job(tmp_path, columns, "").read_text().replace('"none"', '"offset"')
    table = text[text.index("[measurements.m]") :]
    for name, rows in (("m", way > 0), ("n", way < 0)):
        job(tmp_path, {key: each[rows] for key, each in columns.items()}, "")
        (tmp_path / "data.csv").rename(tmp_path / f"{name}.csv")
    text = AXES + "".join(
        table.replace("measurements.m", f"measurements.{name}").replace("data", name)
        for name in "mn"
    )
    fits = fits.replace('measurement = "m"', 'measurements = ["m", "n"]')
    (tmp_path / "job.toml").write_text(text + fits)
    said = left_out(run_job(tmp_path / "job.toml", tmp_path / "out"))
    assert "cannot tell the backlash of X and the runs of X" in said["backlash"]


def test_readings_of_a_group_that_lack_a_temperature_are_counted(
    tmp_path: Path, rising: dict[str, np.ndarray]
) -> None:
    rng = np.random.default_rng(7)
    rising["X.position"] = x = rng.uniform(0.0, 400.0, ROWS)
    warm = rising["temperature.scale"]
    rising["X.error"] = screw(x) + 1.1e-5 * (warm - 20) * x + noise()
    rising["temperature.scale"] = np.where(np.arange(ROWS) % 10 < 3, np.nan, warm)
    fits = entry("leadscrew", "X", LINE, "x") + entry("temperature", "X", WARM, "x")
    path = job(tmp_path, rising, fits)
    text = (tmp_path / "data.csv").read_text().replace("nan", "")
    (tmp_path / "data.csv").write_text(text)
    for one in run_job(path, tmp_path / "out").fits:
        said = " ".join(remark.message for remark in one.remarks)
        assert "120 of 400 readings of X were left out: they lack a value" in said
