"""Measurements whose zeros are not alike: the machine's, the instrument's, one per run."""

import re
from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.job import JobError, JobResult, TableResult, run_job
from axcomp.ident.report import headline_of
from axcomp.ident.report._scale import scale_of

from .screw import offsets, table

NODES = np.arange(0.0, 601.0, 50.0)


def error(x: np.ndarray) -> np.ndarray:
    """19 µm in the mean, with a slope and a wave."""
    return np.asarray(0.008 * np.sin(x / 110) + 6e-5 * x)


def laser(path: Path, zeros: list[float], seed: int) -> None:
    """One run for each zero of the instrument; 0.5 µm of noise."""
    there = np.tile(np.concatenate([NODES, NODES[::-1]]), len(zeros))
    run = np.repeat(np.arange(len(zeros)), 2 * len(NODES))
    seen = error(there) + np.array(zeros)[run]
    seen += 5e-4 * np.random.default_rng(seed).normal(size=len(run))
    table(path, "position,error,run", there, seen, run)


def job(folder: Path, removed: dict[str, str], group: str = "") -> Path:
    text = "[axes.X]\nnumber = 1\n"
    for name, kind in removed.items():
        text += f'[measurements.{name}]\nfile = "{name}.csv"\nremove = "{kind}"\n'
        text += f'[measurements.{name}.columns]\n"X.position" = "position"\n'
        text += 'run = "run"\n"X.error" = { column = "error", unit = "mm" }\n'
    sources = ", ".join(f'"{name}"' for name in removed)
    text += '[[fits]]\ncompensation = "leadscrew"\naxis = "X"\n'
    text += f"measurements = [{sources}]\nstart = 0.0\ninterval = 50.0\npoints = 13\n"
    path = folder / "job.toml"
    path.write_text(text + group)
    return path


def left(result: JobResult, folder: Path) -> np.ndarray:
    assert result.passed
    return error(NODES) + offsets(folder / "out", 1, A1=NODES, D=np.ones(len(NODES)))


@pytest.mark.parametrize("group", ["", 'group = "X"\n'])
def test_an_arbitrary_zero_has_no_say_in_the_constant_of_a_list(
    tmp_path: Path, group: str
) -> None:
    laser(tmp_path / "a.csv", [0.0] * 3, 1)
    laser(tmp_path / "b.csv", [0.04] * 9, 2)
    path = job(tmp_path, {"a": "none", "b": "offset"}, group)
    result = run_job(path, tmp_path / "out")
    # 24 readings per node: 0.1 µm, and the zero of three runs; the votes of nine runs with
    # their own mean for a zero made it 14 µm.
    assert np.max(np.abs(left(result, tmp_path))) < 6e-4
    (screw,) = result.fits
    # What is not the machine's is none of the error, either.
    assert screw.error["predicted"].rms < 8e-4
    assert not any("Contradicts" in remark.message for remark in screw.remarks)


@pytest.mark.parametrize("group", ["", 'group = "X"\n'])
def test_a_run_that_is_held_out_is_expected_to_be_as_far_off_as_runs_are(
    tmp_path: Path, group: str
) -> None:
    zeros = 0.005 * np.random.default_rng(3).normal(size=12)
    laser(tmp_path / "a.csv", zeros.tolist(), 1)
    result = run_job(job(tmp_path, {"a": "none"}, group), tmp_path / "out")
    (screw,) = result.fits
    assert isinstance(screw, TableResult)
    view = screw.samples
    # Readings are 0.5 µm, and each node is known to 0.1 µm beside the mean of all runs.
    expected = float(np.std(zeros, ddof=1))
    assert float(np.median(view.predicted_sd)) == pytest.approx(expected, rel=0.05)
    ratio = np.sqrt(np.mean((view.predicted / view.predicted_sd) ** 2))
    # A run is predicted by the mean of the other eleven: 12/11 as far.
    assert ratio == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("apart", [0.0, 0.08])
def test_zeros_of_measurements_without_runs_are_compared_where_both_were_read(
    tmp_path: Path, apart: float
) -> None:
    rng = np.random.default_rng(1)
    fine = np.arange(0.0, 601.0, 25.0)
    for name, place, zero in (("a", fine[:17], 0.0), ("b", fine[10:], apart)):
        seen = error(place) + zero + 5e-4 * rng.normal(size=len(place))
        table(tmp_path / f"{name}.csv", "position,error", place, seen)
    path = job(tmp_path, {"a": "none", "b": "none"})
    text = path.read_text().replace('run = "run"\n', "")
    finer = "interval = 25.0\npoints = 25"
    path.write_text(text.replace("interval = 50.0\npoints = 13", finer))
    (screw,) = run_job(path, tmp_path / "out").fits
    said = " ".join(remark.message for remark in screw.remarks)
    assert bool(re.search("'b' lies (79|80|81) µm above 'a' where both", said)) is bool(
        apart
    )


@pytest.mark.parametrize("creeps", [False, True])
def test_zeros_of_two_measurements_are_told_from_a_creep(
    tmp_path: Path, creeps: bool
) -> None:
    step = 0.004 * np.arange(6.0) if creeps else 0.02 * np.repeat([0.0, 1.0], 3)
    laser(tmp_path / "a.csv", step[:3].tolist(), 1)
    laser(tmp_path / "b.csv", step[3:].tolist(), 2)
    path = job(tmp_path, {"a": "none", "b": "none"})
    (screw,) = run_job(path, tmp_path / "out").fits
    said = " ".join(remark.message for remark in screw.remarks)
    assert ("Run after run lies +4.0 µm further on" in said) == creeps
    assert ("Measurement 'b' lies 20 µm above 'a', and the runs" in said) != creeps


def test_a_slope_of_one_instrument_beside_that_of_the_machine_is_refused(
    tmp_path: Path,
) -> None:
    laser(tmp_path / "a.csv", [0.0] * 3, 1)
    laser(tmp_path / "b.csv", [0.04] * 3, 2)
    columns = np.genfromtxt(tmp_path / "b.csv", delimiter=",", names=True)
    place, seen = columns["position"], columns["error"] - 1e-4 * columns["position"]
    table(tmp_path / "b.csv", "position,error,run", place, seen, columns["run"])
    (screw,) = run_job(job(tmp_path, dict.fromkeys("ab", "none")), tmp_path / "o").fits
    said = " ".join(remark.message for remark in screw.remarks)
    advice = "leave out the one whose slope is the instrument's"
    assert f'{advice} (or state remove = "line" in all' in said
    path = job(tmp_path, {"a": "none", "b": "line"})
    words = r'found "line" beside a, whose slope .* leave b out, or state "line" in all'
    with pytest.raises(JobError, match=words):
        run_job(path, tmp_path / "out")
    for followed in ({"a": "none"}, {"a": "line", "b": "line"}):
        (screw,) = run_job(job(tmp_path, followed), tmp_path / "out").fits
        assert screw.error["predicted"].rms < 8e-4  # readings of 0.5 µm


def test_measurements_of_other_places_are_proven_by_blocks(tmp_path: Path) -> None:
    for name, part, zero, seed in (("a", NODES[:7], 0.0, 1), ("b", NODES[6:], 0.04, 2)):
        place = np.tile(part, 6)
        seen = error(place) + zero
        seen += 5e-4 * np.random.default_rng(seed).normal(size=len(place))
        table(tmp_path / f"{name}.csv", "position,error", place, seen)
    path = job(tmp_path, {"a": "none", "b": "offset"})
    path.write_text(path.read_text().replace('run = "run"\n', ""))
    result = run_job(path, tmp_path / "out")
    # They meet at one place: its 12 readings give b its zero, of 0.3 µm.
    assert np.max(np.abs(left(result, tmp_path))) < 1.2e-3


OWN = {
    "offset": {"a": "offset", "b": "offset"},
    "datum": {"a": "none", "b": "none"},
    "one of them": {"a": "none", "b": "offset"},
}


def halves(
    folder: Path, removed: str, zeros: tuple[float, float], times: float = 0.0
) -> Path:
    """Two measurements that meet in the middle, with a list that acts so many times."""
    folder.mkdir()
    lists = folder.parent / "out"
    for name, part, zero in (("a", NODES[:8], zeros[0]), ("b", NODES[5:], zeros[1])):
        there = np.tile(np.concatenate([part, part[::-1]]), 3)
        seen = error(there) + zero
        if times:
            seen += times * offsets(lists, 1, A1=there, D=np.ones(len(there)))
        # The second measurement has noise of its own.
        noise = np.random.default_rng(len(part) + bool(times)).normal(size=len(there))
        run = np.repeat(np.arange(3), 2 * len(part))
        table(
            folder / f"{name}.csv",
            "position,error,run",
            there,
            seen + 5e-4 * noise,
            run,
        )
    path = job(folder, OWN[removed])
    text = path.read_text()
    if removed == "datum":
        text = text.replace('remove = "none"', "datum = { at = 300.0 }")
    if times:
        text = text.replace('.csv"', '.csv"\nactive = ["leadscrew"]')
        text = text.replace("= 1\n", f"= 1\nlist = '{lists / 'achskw1.lis'}'\n", 1)
    path.write_text(text)
    return path


@pytest.mark.parametrize("runs", [True, False])
@pytest.mark.parametrize("removed", ["offset", "datum"])
def test_figures_of_measurements_with_a_zero_each_are_those_of_one_zero(
    tmp_path: Path, removed: str, runs: bool
) -> None:
    path = halves(tmp_path / "first", removed, (0.0, 0.02))
    if not runs:
        path.write_text(path.read_text().replace('run = "run"\n', ""))
    result = run_job(path, tmp_path / "out")
    rest = left(result, tmp_path)
    # 6 to 12 readings per node of 0.5 µm, and the zero of one by those where they meet.
    assert np.max(np.abs(rest - rest.mean())) < 8e-4
    (screw,) = result.fits
    assert screw.error["predicted"].rms < 8e-4
    assert screw.error["from_file"].rms < 8e-4
    assert not any("Run after run" in remark.message for remark in screw.remarks)


@pytest.mark.parametrize("times", [1.0, -1.0])
@pytest.mark.parametrize("removed", [*OWN])
def test_a_list_is_judged_by_measurements_with_a_zero_each(
    tmp_path: Path, removed: str, times: float
) -> None:
    first = halves(tmp_path / "first", removed, (0.0, 0.02))
    run_job(first, tmp_path / "out")
    again = halves(tmp_path / "again", removed, (0.0, -0.015), times)
    (screw,) = run_job(first, tmp_path / "out", after=again).fits
    assert screw.again is not None
    assert screw.again.diagnosis is not None
    wanted = "right" if times > 0 else "sign"
    assert screw.again.diagnosis.verdict == wanted
    # Of 20 µm in the mean and 8 µm about it nothing is left, or twice as much.
    assert screw.again.rms is not None
    assert (screw.again.rms < 8e-4) == (times > 0)


def test_a_slope_of_another_axis_is_no_part_of_it(tmp_path: Path) -> None:
    laser(tmp_path / "a.csv", [0.0] * 3, 1)
    laser(tmp_path / "b.csv", [0.04] * 3, 2)
    text = job(tmp_path, {"a": "none", "b": "line"}, 'group = "g"\n').read_text()
    head, _, tail = text.partition("[measurements.b]")
    text = head + "[measurements.b]" + tail.replace('"X.error"', '"Y.error"')
    cross = '[[fits]]\ncompensation = "cross"\naxis = "Y"\nmaster = "X"\n'
    cross += 'measurements = ["a", "b"]\nstart = 0.0\ninterval = 50.0\npoints = 13\n'
    path = tmp_path / "both.toml"
    path.write_text(f'[axes.Y]\nnumber = 2\n{text}{cross}group = "g"\n')
    # 6 readings per node of 0.5 µm.
    assert np.max(np.abs(left(run_job(path, tmp_path / "out"), tmp_path))) < 8e-4


def test_runs_that_each_had_a_zero_are_named_as_such(tmp_path: Path) -> None:
    laser(tmp_path / "a.csv", [-0.05, 0.0, 0.06], 1)
    path = job(tmp_path, {"a": "offset"})
    result = run_job(path, tmp_path / "out")
    assert not result.passed
    (screw,) = result.fits
    said = headline_of(screw, scale_of(screw.unit)).sentence
    match = re.search(r"Its runs lie up to ([\d.]+) µm apart", said)
    assert match is not None
    assert float(match[1]) == pytest.approx(110.0, abs=0.5)  # 0.1 µm each
    assert "give it as a measurement of its own" in said


def probed(path: Path, drift: float) -> None:
    """Every place visited twice, one after the other pass; the instrument warms up."""
    x = np.concatenate([NODES, NODES[::-1]] * 4)
    time = 5.0 * np.arange(len(x))
    seen = error(x) + drift * (1.0 - np.exp(-time / 200.0))
    seen += 5e-4 * np.random.default_rng(4).normal(size=len(x))
    table(path, "position,error,time", x, seen, time)


def drifting(folder: Path, keys: str, group: str) -> Path:
    path = job(folder, {"a": "none"}, group)
    text = path.read_text().replace('remove = "none"\n', f'remove = "none"\n{keys}')
    path.write_text(text.replace('run = "run"', 'time = "time"'))
    return path


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_a_drift_that_readings_of_one_place_show_is_told(
    tmp_path: Path, drift: float
) -> None:
    probed(tmp_path / "a.csv", drift)
    (screw,) = run_job(drifting(tmp_path, "", ""), tmp_path / "out").fits
    said = " ".join(remark.message for remark in screw.remarks)
    assert ("Readings of the same place wander in time by" in said) == (drift > 0)


@pytest.mark.parametrize("other", ["Y.position", "X.direction"])
def test_another_axis_or_the_way_of_approach_is_no_drift(
    tmp_path: Path, other: str
) -> None:
    place = np.tile(np.concatenate([NODES, NODES[::-1]]), 4)
    way = np.tile(np.repeat([1.0, -1.0], len(NODES)), 4)
    beside = way if other == "X.direction" else np.repeat([0.0, 1.0], 4 * len(NODES))
    seen = error(place) + 0.003 * beside
    seen += 5e-4 * np.random.default_rng(4).normal(size=len(place))
    table(tmp_path / "a.csv", "position,error,other", place, seen, beside)
    # A position that is no number stops nothing that does without it.
    rows = (tmp_path / "a.csv").read_text().splitlines()
    marks = ["Z.position", *("?" for _ in rows[1:])]
    lines = [f"{row},{mark}" for row, mark in zip(rows, marks, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    path = job(tmp_path, {"a": "none"})
    roles = f'"{other}" = "other"\n"Z.position" = "Z.position"'
    text = path.read_text().replace('run = "run"', roles)
    path.write_text(f"[axes.Y]\nnumber = 2\n[axes.Z]\nnumber = 3\n{text}")
    (screw,) = run_job(path, tmp_path / "out").fits
    said = " ".join(remark.message for remark in screw.remarks)
    assert "wander in time" not in said


@pytest.mark.parametrize("lost", [0.0, 0.008])
def test_a_mean_of_readings_there_and_back_is_told(tmp_path: Path, lost: float) -> None:
    place, run = np.tile(NODES, 6), np.repeat(np.arange(6.0), len(NODES))
    seen = error(place) - lost * (run % 2)  # every second run came from the other side
    seen += 3e-4 * np.random.default_rng(4).normal(size=len(place))
    table(tmp_path / "a.csv", "position,error,run", place, seen, run)
    path = job(tmp_path, {"a": "none"})
    (screw,) = run_job(path, tmp_path / "out").fits
    said = " ".join(remark.message for remark in screw.remarks)
    assert ("Every second reading of a place lies 8 µm from" in said) == (lost > 0.0)


@pytest.mark.parametrize(("interval", "told"), [(50.0, False), (100.0, True)])
def test_nodes_too_far_apart_for_readings_that_repeat_are_told(
    tmp_path: Path, interval: float, told: bool
) -> None:
    laser(tmp_path / "a.csv", [0.0] * 3, 5)
    columns = np.genfromtxt(tmp_path / "a.csv", delimiter=",", names=True)
    place, run = columns["position"], columns["run"]
    # From place to place the pitch errs by ±4 µm: no table of every second one follows.
    seen = columns["error"] + np.where(place % 100.0 > 1.0, 0.004, -0.004)
    table(tmp_path / "a.csv", "position,error,run", place, seen, run)
    path = job(tmp_path, {"a": "none"})
    grid = f"interval = {interval}\npoints = {int(600 / interval) + 1}"
    text = path.read_text().replace("interval = 50.0\npoints = 13", grid)
    path.write_text(text + "smoothness = 0\n")
    (screw,) = run_job(path, tmp_path / "out").fits
    said = " ".join(remark.message for remark in screw.remarks)
    wide = "along X its nodes lie 100 apart, the readings 50. Closer nodes follow them."
    assert (wide in said) == told
    assert ("Readings of a place repeat within 0." in said) == told


@pytest.mark.parametrize("passes", [2, 6])
def test_lost_motion_under_a_table_for_both_directions_is_told(
    tmp_path: Path, passes: int
) -> None:
    place, run = np.tile(NODES, passes), np.repeat(np.arange(float(passes)), len(NODES))
    way = 1.0 - 2.0 * (run % 2)
    seen = error(place) + 0.008 * (way < 0)
    seen += 3e-4 * np.random.default_rng(4).normal(size=len(place))
    table(tmp_path / "a.csv", "position,error,run,direction", place, seen, run, way)
    path = job(tmp_path, {"a": "none"})
    columns = '"X.position" = "position"'
    text = path.read_text()
    assert columns in text
    path.write_text(text.replace(columns, f'{columns}\n"X.direction" = "direction"'))
    (screw,) = run_job(path, tmp_path / "out").fits
    said = " ".join(remark.message for remark in screw.remarks)
    # Of two passes the mean of 13 differences is known to 0.12 µm.
    assert re.search(
        r"in \+ direction lie (7\.[89]|8(\.[12])?) µm from those in −", said
    )


def test_beside_a_drift_the_constant_is_known_as_well_as_the_drift(
    tmp_path: Path,
) -> None:
    probed(tmp_path / "a.csv", 0.02)
    path = drifting(tmp_path, "drift = 6\n", 'group = "X"\n')
    result = run_job(path, tmp_path / "out")
    (screw,) = result.fits
    off = np.mean(left(result, tmp_path))
    assert isinstance(screw, TableResult)
    (values,) = screw.standard_deviation.values()
    deviation = float(np.median(values))
    # The mean of the drift, 10 to 20 µm, is in the list, of which the readings tell nothing.
    assert abs(off) > 0.01
    assert abs(off) < 4.0 * deviation
    said = " ".join(remark.message for remark in screw.remarks)
    assert "The instrument drifted: the constant of this list" in said


@pytest.mark.parametrize("group", ["", 'group = "X"\n'])
@pytest.mark.parametrize("zeroed", ["never", "each pass", "each file"])
def test_a_zero_of_each_direction_is_said_to_hide_the_lost_motion(
    tmp_path: Path, zeroed: str, group: str
) -> None:
    rng = np.random.default_rng(5)
    names = ("up", "down") if zeroed == "each file" else ("both", "both")
    rows: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for way, name in zip((1, -1) * 3, names * 3, strict=True):
        x = NODES[::way]
        seen = error(x) + 3e-3 * way + 2e-4 * rng.normal(size=len(x))
        seen -= seen[0] if zeroed == "each pass" else 0.0
        rows[name].append(np.stack([x, seen, np.full(len(x), way)], axis=1))
    for name, parts in rows.items():
        table(tmp_path / f"{name}.csv", "position,error,run", *np.vstack(parts).T)
    kind = "offset" if zeroed == "each file" else "none"
    path = job(tmp_path, dict.fromkeys(rows, kind), "bilateral = true\n" + group)
    text = path.read_text().replace('run = "run"', '"X.direction" = "run"')
    path.write_text(text)
    (screw,) = run_job(path, tmp_path / "out").fits
    said = " ".join(remark.message for remark in screw.remarks)
    assert ("what X loses where it turns is in no reading" in said) == (
        zeroed != "never"
    )


def test_parts_of_an_axis_have_one_datum_and_the_zeros_of_the_others_are_told(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(3)
    for name, part, zero in (("a", NODES[:8], 0.0), ("b", NODES[6:], 0.05)):
        there, run = np.tile(part, 6), np.repeat(np.arange(6), len(part))
        seen = error(there) + zero + 1e-4 * rng.normal(size=len(there))
        table(tmp_path / f"{name}.csv", "position,error,run", there, seen, run)
    path = job(tmp_path, {"a": "none", "b": "offset"})
    with_datum = 'file = "a.csv"\ndatum = { at = 100.0 }\n'
    text = path.read_text().replace('file = "a.csv"\nremove = "none"\n', with_datum)
    path.write_text(text)
    rest = left(run_job(path, tmp_path / "out"), tmp_path)
    # Noise of 12 readings where the parts meet; the step between them was 50 µm.
    assert np.ptp(rest) < 3e-4
    assert rest[2] == pytest.approx(error(np.array([100.0]))[0], abs=2e-4)


@pytest.mark.parametrize("group", ["", 'group = "X"\n'])
def test_lines_off_different_stretches_are_refused(tmp_path: Path, group: str) -> None:
    path = job(tmp_path, dict.fromkeys("ab", "line"), group)
    path.write_text(path.read_text().replace('run = "run"\n', ""))
    rng = np.random.default_rng(3)
    for first in (1, 6):
        for name, part in (("a", NODES[:-1]), ("b", NODES[first:])):
            there = np.tile(part, 3)
            seen = error(there) + 1e-4 * there * (name == "b")
            seen += 5e-4 * rng.normal(size=len(there))
            table(tmp_path / f"{name}.csv", "position,error", there, seen)
        if first == 1:  # a twelfth of the way makes no other stretch
            run_job(path, tmp_path / "out")
    words = r"different stretches of X \('a' 0 to 550, 'b' 300 to 600\).*\"offset\""
    with pytest.raises(JobError, match=words):
        run_job(path, tmp_path / "out")


def test_set_ups_that_stood_at_one_place_each_say_nothing_of_a_cross(
    tmp_path: Path,
) -> None:
    rng, text = np.random.default_rng(5), "[axes.X]\nnumber = 1\n[axes.Y]\nnumber = 2\n"
    for y in (0, 100, 200):
        error = 1e-5 * y + 0.003 * rng.normal() + 3e-4 * rng.normal(size=5)
        rows = "".join(f"{50 * k},{y},{e:.6f}\n" for k, e in enumerate(error))
        (tmp_path / f"{y}.csv").write_text("x,y,e\n" + rows)
        text += (
            f'[measurements.at{y}]\nfile = "{y}.csv"\nremove = "offset"\n'
            'columns = { "X.position" = "x", "Y.position" = "y", "X.error" = { column = "e",'
            ' unit = "mm" } }\n'
        )
    text += (
        '[[fits]]\ncompensation = "cross"\naxis = "X"\nmaster = "Y"\n'
        'measurements = ["at0", "at100", "at200"]\nstart = 0.0\ninterval = 100.0\npoints = 3\n'
    )
    (tmp_path / "job.toml").write_text(text)
    with pytest.raises(JobError, match="stood at one place of Y and has a zero of its"):
        run_job(tmp_path / "job.toml", tmp_path / "out")


def cross_said(folder: Path, x: np.ndarray, error: np.ndarray, points: int) -> str:
    """Return what a job says of a cross table of Y over X, 0 to 200 mm."""
    table(folder / "m.csv", "x,e", x, error)
    (folder / "job.toml").write_text(
        "[axes.X]\nnumber = 1\n[axes.Y]\nnumber = 2\n"
        '[measurements.m]\nfile = "m.csv"\nremove = "none"\ncolumns = { "X.position" = "x",'
        ' "Y.error" = { column = "e", unit = "mm" } }\n'
        '[[fits]]\ncompensation = "cross"\naxis = "Y"\nmaster = "X"\nmeasurement = "m"\n'
        f"start = 0.0\ninterval = {200.0 / (points - 1)}\npoints = {points}\n"
    )
    (cross,) = run_job(folder / "job.toml", folder / "out").fits
    return " ".join(remark.message for remark in cross.remarks)


def test_a_cross_that_lies_apart_by_directions_is_told_that_no_list_holds_that(
    tmp_path: Path,
) -> None:
    x = np.tile(np.concatenate([NODES[:5], NODES[4::-1]]), 3)
    seen = error(x) + 0.008 * (np.arange(x.size) // 5 % 2)
    seen += 3e-4 * np.random.default_rng(4).normal(size=x.size)
    said = cross_said(tmp_path, x, seen, 5)
    assert "No cross list holds a difference of directions: look at the play" in said
    assert "bilateral" not in said


def test_places_that_were_read_twice_are_no_single_readings_of_a_fine_table(
    tmp_path: Path,
) -> None:
    x = np.tile(np.linspace(0.0, 200.0, 21), 2)
    seen = error(x) + 3e-4 * np.random.default_rng(4).normal(size=x.size)
    assert "Nothing was measured twice" not in cross_said(tmp_path, x, seen, 41)
