"""Tables from logs of an axis in motion: what neighbours in time and both ways share."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from jaxtyping import Float
from scipy.signal import lfilter

from axcomp.ident.job import JobError, run_job

Array = Float[np.ndarray, " t"]
CROSS = """compensation = "cross"
axis = "Z"
master = "X"
start = 0.0
interval = 20.0
points = 16
"""
PLANE = """compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
start = [0.0, 0.0]
interval = [30.0, 20.0]
points = [11, 11]
"""
PER_LINE = 150


def fit(
    folder: Path, table: str, x: Array, y: Array, error: Array, runs: int = 0
) -> dict[str, Any]:
    """Fit a table to a log; of so many runs of equal length, where any are numbered."""
    columns = [0.01 * np.arange(x.size), x, y, 1e3 * error]
    header = "t [s],X.position [mm],Y.position [mm],Z.error [um]"
    if runs:
        columns.append(np.arange(x.size) * runs // x.size)
        header += ",run"
    rows = np.column_stack(columns)
    np.savetxt(folder / "log.csv", rows, "%.4f", ",", header=header, comments="")
    axes = "".join(f"[axes.{name}]\nnumber = {k}\n" for k, name in enumerate("XYZ", 1))
    measured = '[measurements.log]\nfile = "log.csv"\nactive = []\nremove = "none"\n'
    own = f'[[fits]]\nmeasurement = "log"\n{table}'
    (folder / "job.toml").write_text(axes + measured + own)
    run_job(folder / "job.toml", folder / "out")
    found: dict[str, Any] = json.loads((folder / "out" / "result.json").read_text())
    return found["fits"][0]


def there_and_back(passes: int) -> tuple[Array, Array]:
    """Return the places of X on some passes over 300 mm, and its direction."""
    there = np.linspace(0.0, 300.0, PER_LINE)
    x = np.concatenate([there[:: (-1) ** k] for k in range(passes)])
    return x, np.repeat([(-1.0) ** k for k in range(passes)], PER_LINE)


def words(found: dict[str, Any]) -> str:
    return " ".join(remark["message"] for remark in found["remarks"])


def test_deviations_hold_what_neighbours_in_time_share(tmp_path: Path) -> None:
    rng = np.random.default_rng(51)
    x, _ = there_and_back(16)
    air = lfilter([1e-3 * np.sqrt(0.1)], [1.0, -0.95], rng.standard_normal(x.size))
    truth = 5e-3 * np.sin(x / 90.0)
    noise = 2e-4 * rng.standard_normal(x.size)
    found = fit(tmp_path, CROSS, x, np.zeros_like(x), truth + air + noise)
    off = np.array(found["parameters"]["table"]) + 5e-3 * np.sin(
        np.arange(16) * 20 / 90
    )
    deviation = np.array(found["standard_deviations"]["table"])
    # Sixteen nodes, of which neighbours err together; white noise would give 3.
    assert 0.4 < np.sqrt(np.mean((off / deviation) ** 2)) < 1.6
    assert "follow each other err alike" in words(found)


def test_a_log_in_pieces_holds_what_neighbours_in_time_share(tmp_path: Path) -> None:
    rng, count = np.random.default_rng(0), 100_000
    x = 150.0 - 150.0 * np.cos(2e-3 * np.pi * 8 * np.arange(count) / 1e3)
    # 0.2 µm that last 0.3 s beside 1 µm of white noise: seen by all readings of a pass only.
    last = np.exp(-1 / 75)
    air = lfilter([2e-4 * np.sqrt(1 - last**2)], [1, -last], rng.standard_normal(count))
    error = 5e-3 * np.sin(x / 90.0) + air + 1e-3 * rng.standard_normal(count)
    log = pa.table({"X.position [mm]": x, "Z.error [um]": 1e3 * error})
    pq.write_table(log, tmp_path / "log.parquet")
    axes = "".join(f"[axes.{name}]\nnumber = {k}\n" for k, name in enumerate("XYZ", 1))
    found = []
    for stream in ("true", "false"):
        measured = f'[measurements.log]\nfile = "log.parquet"\nstream = {stream}\n'
        measured += (
            f'active = []\nremove = "none"\n[[fits]]\nmeasurement = "log"\n{CROSS}'
        )
        (tmp_path / "job.toml").write_text(axes + measured)
        (one,) = run_job(tmp_path / "job.toml", tmp_path / stream).tables
        (deviation,) = one.standard_deviation.values()
        found.append(deviation)
    # The same estimator: what differs is the rounding of its sums.
    np.testing.assert_allclose(*found, rtol=1e-3)


def test_a_group_holds_what_neighbours_in_time_share_once(tmp_path: Path) -> None:
    rng = np.random.default_rng(51)
    x, _ = there_and_back(16)
    air = lfilter([1e-3 * np.sqrt(0.1)], [1.0, -0.95], rng.standard_normal(x.size))
    error = 5e-3 * np.sin(x / 90.0) + air + 2e-4 * rng.standard_normal(x.size)
    rows = np.column_stack([0.01 * np.arange(x.size), x, 1e3 * error, 1e3 * error])
    header = "t [s],X.position [mm],Y.error [um],Z.error [um]"
    np.savetxt(tmp_path / "log.csv", rows, "%.4f", ",", header=header, comments="")
    text = "".join(f"[axes.{name}]\nnumber = {k}\n" for k, name in enumerate("XYZ", 1))
    text += '[measurements.log]\nfile = "log.csv"\nactive = []\nremove = "none"\n'
    for axis in "YZ":
        own = CROSS.replace('"Z"', f'"{axis}"')
        text += f'[[fits]]\nmeasurement = "log"\ngroup = "air"\n{own}'
    (tmp_path / "job.toml").write_text(text)
    for one in run_job(tmp_path / "job.toml", tmp_path / "out").tables:
        (table,), (deviation,) = one.table.values(), one.standard_deviation.values()
        off = table + 5e-3 * np.sin(np.arange(16) * 20 / 90)
        ratio = off / deviation
        # Sixteen nodes; counted once more by their passes it was 0.1.
        assert 0.4 < np.sqrt(np.mean(np.square(ratio))) < 1.6


@pytest.mark.parametrize("runs", [0, 2])
def test_lost_motion_does_not_become_waves_of_a_surface(
    tmp_path: Path, runs: int
) -> None:
    rng = np.random.default_rng(52)
    x, way = (np.tile(each, max(runs, 1)) for each in there_and_back(11))
    y = np.tile(np.repeat(20.0 * np.arange(11), PER_LINE), max(runs, 1))
    truth = 2e-2 * np.sin(x / 90.0) * np.cos(y / 120.0)
    error = truth + 3e-3 * way + 5e-4 * rng.standard_normal(x.size)
    found = fit(tmp_path, PLANE, x, y, error, runs)
    nx, ny = np.meshgrid(30.0 * np.arange(11), 20.0 * np.arange(11))
    off = np.array(found["parameters"]["table"]) + 2e-2 * np.sin(nx / 90) * np.cos(
        ny / 120
    )
    # A tenth of the 6 µm between both ways, which the curvature of the surface hides.
    assert np.std(off.mean(axis=1)) < 6e-4
    assert "mean of both ways" in words(found)


@pytest.mark.parametrize("lost", [0.0, 4e-3])
def test_few_readings_of_a_serpentine_tell_of_lost_motion(
    tmp_path: Path, lost: float
) -> None:
    rng = np.random.default_rng(53)
    across = 30.0 * np.arange(11)
    x = np.concatenate([across[:: (-1) ** line] for line in range(11)])
    way = np.repeat([(-1.0) ** line for line in range(11)], 11)
    y = np.repeat(20.0 * np.arange(11), 11)
    truth = 2e-2 * np.sin(x / 90.0) * np.cos(y / 120.0)
    error = truth + 0.5 * lost * way + 5e-4 * rng.standard_normal(x.size)
    found = fit(tmp_path, PLANE, x, y, error)
    assert ("Pass every line both ways" in words(found)) == (lost > 0.0)
    off = np.array(found["parameters"]["table"]).ravel() + truth[np.lexsort((x, y))]
    # One reading per node at 0.5 µm, beside half of the lost motion, which stays in it.
    assert np.std(off) < 6e-4 + 0.5 * lost


def test_readings_at_a_stop_where_the_axis_turns_are_of_both_ways(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(54)
    stops = np.arange(0.0, 301.0, 20.0)
    # Twenty runs there and back, five readings at each stop: ten of each end, where it turns.
    x = np.tile(np.repeat(np.concatenate([stops, stops[::-1]]), 5), 20)
    way = np.tile(np.repeat([1.0, -1.0], 5 * len(stops)), 20)
    truth = 5e-3 * np.sin(x / 90.0)
    error = truth + 3e-3 * way + 5e-4 * rng.standard_normal(x.size)
    found = fit(tmp_path, CROSS, x, np.zeros_like(x), error, 20)
    off = np.array(found["parameters"]["table"]) + 5e-3 * np.sin(stops / 90.0)
    # 200 readings of 0.5 µm per stop; the last one was off by all of the lost motion.
    assert np.abs(off).max() < 3e-4
    assert "contradict" not in words(found)


def test_both_ways_that_agree_stay_as_they_are(tmp_path: Path) -> None:
    rng = np.random.default_rng(53)
    x, _ = there_and_back(4 + 4)
    error = 5e-3 * np.sin(x / 90.0) + 5e-4 * rng.standard_normal(x.size)
    found = fit(tmp_path, CROSS, x, np.zeros_like(x), error)
    assert "both ways" not in words(found)
    assert "err alike" not in words(found)


def test_a_scanned_surface_does_not_follow_what_its_neighbours_in_time_share(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(52)
    x, _ = there_and_back(21)
    y = np.repeat(np.linspace(0.0, 200.0, 21), PER_LINE)
    # 3 µm of air, alike for some ten readings, of which each node has about twenty.
    air = lfilter([3e-3 * np.sqrt(0.19)], [1.0, -0.9], rng.standard_normal(x.size))

    def truth(x: Array, y: Array) -> Array:
        return 0.02 * np.sin(x / 150.0) * np.cos(y / 120.0)

    found = fit(tmp_path, PLANE, x, y, truth(x, y) + air)
    off = np.array(found["parameters"]["table"])
    off += truth(np.arange(11) * 30.0, np.arange(11)[:, None] * 20.0)
    deviation = np.array(found["standard_deviations"]["table"])
    # 1.1 µm; a smoothness that takes each reading for news follows the air by 2.5 µm.
    assert 1e3 * np.sqrt(np.mean(off**2)) < 1.5
    # Of 121 nodes that are smoothed together some twenty tell something of their own.
    assert 0.6 < np.sqrt(np.mean((off / deviation) ** 2)) < 1.5


@pytest.mark.parametrize("table", ["leadscrew", "backlash"])
def test_a_refusal_says_why_few_rows_of_a_log_in_motion_were_left(
    tmp_path: Path, table: str
) -> None:
    time = 0.02 * np.arange(2000)
    place = np.interp(time % 20.0, [1.0, 9.0, 11.0, 19.0], [0.0, 300.0, 300.0, 0.0])
    rows = np.column_stack([time, place, place + 0.005])
    header = "t [s],X.position [mm],X.actual [mm]"
    np.savetxt(tmp_path / "log.csv", rows, "%.4f", ",", header=header, comments="")
    job = tmp_path / "job.toml"
    job.write_text(
        '[axes.X]\nnumber = 1\n[measurements.log]\nfile = "log.csv"\nactive = []\n'
        'remove = "offset"\n[[fits]]\naxis = "X"\nmeasurement = "log"\n'
        f'compensation = "{table}"\n'
        + (
            "start = 0.0\ninterval = 20.0\npoints = 16\n"
            if table == "leadscrew"
            else ""
        )
    )
    with pytest.raises(
        JobError, match=r"rows at standstill count, since its encoder was"
    ):
        run_job(job, tmp_path / "out")


@pytest.mark.parametrize("way", ["one", "both"])
def test_passes_that_all_go_one_way_say_what_a_late_instrument_would_do(
    tmp_path: Path, way: str
) -> None:
    x, _ = there_and_back(40)
    x = np.tile(x[:PER_LINE], 40) if way == "one" else x
    noise = 2e-4 * np.random.default_rng(1).standard_normal(x.size)
    found = fit(tmp_path, CROSS, x, np.zeros_like(x), 5e-3 * np.sin(x / 90.0) + noise)
    # 300 mm in 1.5 s.
    assert ("go the same way, at about 201 mm/s" in words(found)) == (way == "one")
