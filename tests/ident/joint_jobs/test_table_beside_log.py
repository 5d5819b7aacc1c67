"""A table read from place to place beside a log in motion, in one group."""

import json
from pathlib import Path

import numpy as np

from axcomp.ident.job import run_job

WIDTH, DELAY, ZERO = 5.0, 0.003, 50.0
"""Backlash in µm, delay of the laser in s, and its zero in µm."""

JOB = """
[axes.X]
number = 1
[measurements.tab]
file = "tab.csv"
active = []
remove = "none"
[measurements.log]
file = "log.csv"
active = []
remove = "offset"
[[fits]]
compensation = "leadscrew"
axis = "X"
measurements = ["tab", "log"]
group = "X"
start = 0.0
interval = 50.0
points = 17
[[fits]]
compensation = "backlash"
axis = "X"
measurements = ["tab", "log"]
group = "X"
"""


def screw(x: np.ndarray) -> np.ndarray:
    return 6.0 * np.sin(x / 120.0)


def write(folder: Path) -> None:
    rng = np.random.default_rng(71)
    step, strokes = 0.01, []
    for k, speed in enumerate((60.0, 150.0, 90.0, 120.0)):
        count = round(800.0 / speed / step)
        phase = (np.arange(count) + 0.5) / count
        stroke = 400.0 - 400.0 * np.cos(np.pi * phase)
        strokes.append(stroke if k % 2 == 0 else stroke[::-1])
    x = np.concatenate(strokes)
    time = step * np.arange(x.size)
    error = screw(x) - 0.5 * WIDTH * np.sign(np.gradient(x)) + ZERO
    actual = np.interp(time - DELAY, time, x + 1e-3 * error)
    log = np.column_stack([time, x, x, actual + 6e-4 * rng.standard_normal(x.size)])
    head = "time [s],X.position [mm],X.encoder [mm],X.actual [mm]"
    np.savetxt(folder / "log.csv", log, "%.5f", ",", header=head, comments="")
    place = np.arange(0.0, 801.0, 50.0)
    rows = []
    for run in range(3):
        for way, at in ((1.0, place), (-1.0, place[::-1])):
            seen = screw(at) - 0.5 * WIDTH * way + 0.4 * rng.standard_normal(at.size)
            rows += [
                [len(rows) * 8.0, run, way, *each]
                for each in zip(at, seen, strict=True)
            ]
    head = "time [s],run,X.direction,X.position [mm],X.error [um]"
    table = np.array(rows)
    np.savetxt(folder / "tab.csv", table, "%.4f", ",", header=head, comments="")
    (folder / "job.toml").write_text(JOB)


def test_the_table_tells_the_constant_that_the_laser_does_not_know(
    tmp_path: Path,
) -> None:
    write(tmp_path)
    run_job(tmp_path / "job.toml", tmp_path / "out")
    fits = json.loads((tmp_path / "out" / "result.json").read_text())["fits"]
    table = 1e3 * np.array(fits[0]["parameters"]["table"]["pos"])
    off = table + 0.5 * WIDTH - screw(np.arange(0.0, 801.0, 50.0))
    # Three runs of 34 readings of 0.4 µm: the constant is known to 0.04.
    assert abs(off.mean()) < 0.16
    width = 1e3 * fits[1]["parameters"]["backlash"]
    assert abs(width - WIDTH) < 0.3  # 4 deviations


def test_zeros_of_logs_over_parts_of_the_travel_are_no_error_that_is_predicted(
    tmp_path: Path,
) -> None:
    # Each log begins at a zero of its own, over another part: their means differ by 35 µm.
    rng, noise = np.random.default_rng(1), 4e-4
    text = "[axes.X]\nnumber = 1\n"
    parts = {"a": (0.0, 800.0, 0.05), "b": (0.0, 400.0, -0.1), "c": (300.0, 800.0, 0.3)}
    for name, (low, high, zero) in parts.items():
        x = np.tile(np.concatenate([t := np.arange(low, high + 1, 20.0), t[::-1]]), 2)
        way = np.tile(np.repeat([1, -1], len(t)), 2)
        run = np.repeat([1, 2], 2 * len(t))
        error = 0.02 * np.sin(x / 120) + 8e-5 * x + 0.012 * (way < 0) + zero
        error += noise * rng.normal(size=len(x))
        np.savetxt(
            tmp_path / f"{name}.csv", np.column_stack([x, way, error, run]), "%.6f", ",",
            header="X.position,X.direction,X.error,run", comments="",
        )  # fmt: skip
        text += f'[measurements.{name}]\nfile = "{name}.csv"\nremove = "offset"\n'
    for kind in ("leadscrew", "backlash"):
        text += f'[[fits]]\ncompensation = "{kind}"\naxis = "X"\ngroup = "X"\n'
        text += 'measurements = ["a", "b", "c"]\n'
        text += "start = 0.0\ninterval = 20.0\npoints = 41\n" * (kind == "leadscrew")
    (tmp_path / "job.toml").write_text(text)
    found = run_job(tmp_path / "job.toml", tmp_path / "out")
    error = found.groups[0].axes[0].error
    # 450 readings tell the rms to 3 %, three of them; 41 nodes of 450 readings add 5 %.
    assert error["predicted"].sound.rms < 1.15 * noise
    assert error["from_file"].sound.rms < 1.1 * noise
