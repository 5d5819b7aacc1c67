"""Jobs whose logs are read in pieces: what they write is what they write from memory."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pv
import pyarrow.parquet as pq
import pytest

from axcomp.data.measurements import MeasurementError
from axcomp.ident.job import JobError, JobResult, run_job
from axcomp.ident.job.table import _log_readings
from axcomp.ident.report import write_report

COUNT = 12_000
MANY = 40_000
"""Enough for the noise, the zero and the plots to be judged by every second reading."""

HEAD = """
[axes.X]
number = 1
[axes.Y]
number = 2
[axes.Z]
number = 3
{axis}
[measurements.log]
file = "{file}"
stream = {stream}
{measurement}
[measurements.log.columns]
"X.position" = "x"
"Y.position" = "y"
"Z.position" = "z"
"Z.error" = {{ column = "dz", unit = "um" }}
"Z.direction" = "way"
{columns}
"""
PLANE = """
[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
measurement = "log"
start = [0.0, 0.0]
interval = [50.0, 50.0]
points = [9, 7]
{fit}
"""
LEADSCREW = """
[[fits]]
compensation = "leadscrew"
axis = "Z"
measurement = "log"
bilateral = true
setpoints = [0.0, 50.0, 120.0, 200.0]
{fit}
"""
CROSS = """
[[fits]]
compensation = "cross"
axis = "Z"
master = "X"
measurement = "log"
start = 0.0
interval = 20.0
points = 21
{fit}
"""


def log(path: Path, count: int = COUNT, **more: np.ndarray) -> None:
    rng = np.random.default_rng(4)
    x, y, z = (rng.uniform(-5.0, end, count) for end in (405.0, 305.0, 205.0))
    way = rng.choice([-1, 1], count)
    error = 12.0 * np.sin(x / 70.0) * np.cos(y / 60.0) + 0.02 * z + 1.5 * way
    error += rng.normal(0.0, 2.0, count)
    error[rng.random(count) < 0.002] += 300.0
    columns = {"x": x, "y": y, "z": z, "dz": error, "way": way, "note": x > y}
    table = pa.table(columns | more)
    if path.suffix == ".csv":
        pv.write_csv(table, path)
    else:
        pq.write_table(table, path, row_group_size=3_000)


def job(folder: Path, fits: str, stream: str, fit: str = "", **parts: str) -> Path:
    keys = {"file": "log.parquet", "axis": "", "measurement": "", "columns": ""} | parts
    path = folder / f"job-{stream.strip(chr(34))}.toml"
    text = HEAD.format(stream=stream, **keys) + fits.format(fit=fit)
    path.write_text(text)
    return path


def both(folder: Path, fits: str, fit: str = "", **parts: str) -> list[JobResult]:
    """Run a job from memory and in pieces."""
    return [
        run_job(job(folder, fits, stream, fit, **parts), folder / stream)
        for stream in ("false", "true")
    ]


def assert_same(folder: Path, results: list[JobResult]) -> None:
    """The issue asks for 1e-9 mm; lists hold whole tenths of a micrometre."""
    memory, pieces = (result.tables[0] for result in results)
    assert pieces.every is not None
    assert memory.every is None
    assert memory.readings == pieces.readings
    name = "achskw3.lis"
    found = [
        (folder / stream / name).read_text().splitlines()[2:]
        for stream in ("false", "true")
    ]
    assert found[0] == found[1]
    np.testing.assert_allclose(pieces.fit.values, memory.fit.values, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        pieces.fit.standard_deviation, memory.fit.standard_deviation, rtol=0, atol=1e-9
    )
    assert pieces.fit.noise == pytest.approx(memory.fit.noise, rel=1e-9)
    for branch, support in memory.support.items():
        assert np.array_equal(pieces.support[branch], support)
    assert pieces.error.keys() == memory.error.keys()
    for stage, figures in memory.error.items():
        own = pieces.error[stage].as_tree()
        for key, value in figures.as_tree().items():
            if key in own:  # those of ISO 230-2 are for runs in memory
                assert own[key] == pytest.approx(value, abs=1e-9), (stage, key)
    assert pieces.held_out == memory.held_out
    assert [check.passed for check in pieces.gate] == [c.passed for c in memory.gate]


def words(result: JobResult) -> str:
    return "\n".join(remark.message for remark in result.tables[0].remarks)


@pytest.mark.parametrize("loss", ["student", "gauss"])
def test_a_plane_from_a_log_in_pieces_is_that_from_memory(
    tmp_path: Path, loss: str
) -> None:
    log(tmp_path / "log.parquet", MANY)
    results = both(tmp_path, PLANE, f'loss = "{loss}"')
    assert_same(tmp_path, results)
    said = words(results[1])
    assert "'log': 40000 readings were read in pieces" in said
    assert "show one reading in 2" in said
    # All else that is said of the fit is said of both, but for where each reading lies.
    kept = [x for x in words(results[0]).split("\n") if "Wild readings lie" not in x]
    assert set(kept) <= set(said.split("\n"))
    read = json.loads((tmp_path / "true" / "result.json").read_text())["fits"][0]
    assert (read["route"], read["readings"]) == ("stream", MANY)


@pytest.mark.parametrize(
    "file", ["log.parquet", pytest.param("log.csv", marks=pytest.mark.heavy)]
)
def test_a_bilateral_leadscrew_from_a_log_in_pieces_is_that_from_memory(
    tmp_path: Path, file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("axcomp.data.measurements._large._BLOCK", 300_000)
    log(tmp_path / file, MANY)
    assert_same(tmp_path, both(tmp_path, LEADSCREW, 'loss = "huber"', file=file))


def test_a_log_of_few_readings_is_read_at_once_whatever_is_asked(
    tmp_path: Path,
) -> None:
    log(tmp_path / "log.parquet", 2_000)
    memory, pieces = both(tmp_path, LEADSCREW)
    assert np.array_equal(memory.tables[0].fit.values, pieces.tables[0].fit.values)
    assert "'log' is so short that it was read at once" in words(pieces)


def test_zero_datum_and_active_list_are_the_same_in_pieces(tmp_path: Path) -> None:
    log(tmp_path / "log.parquet", MANY)
    first = run_job(job(tmp_path, CROSS, "false"), tmp_path / "first")
    assert first.passed
    results = both(
        tmp_path,
        CROSS,
        axis='list = "first/achskw3.lis"',
        measurement='active = ["cross"]\nremove = "line"\ndatum = { at = 101.0 }',
    )
    assert_same(tmp_path, results)


def test_a_log_that_scans_line_by_line_may_stand_still_for_a_whole_piece(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_log_readings, "_ROWS", 500)
    log(tmp_path / "log.parquet", y=np.repeat(np.linspace(0.0, 300.0, 12), 1_000))
    assert_same(tmp_path, both(tmp_path, PLANE, 'loss = "gauss"'))


def test_a_large_log_is_read_in_pieces_without_being_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log(tmp_path / "log.parquet")
    path = job(tmp_path, PLANE, '"auto"', 'loss = "gauss"\nsmoothness = 1.0')
    assert run_job(path, tmp_path / "out").tables[0].every is None
    monkeypatch.setattr("axcomp.data.measurements._large._LEAST", 0)
    monkeypatch.setattr(_log_readings, "LARGE", 3 * COUNT)
    assert run_job(path, tmp_path / "out").tables[0].every is None
    monkeypatch.setattr(_log_readings, "LARGE", 3 * COUNT - 1)
    assert run_job(path, tmp_path / "out").tables[0].every is not None


@pytest.mark.parametrize(
    ("fits", "more", "reason"),
    [
        (PLANE + CROSS, "", "the cross fit of Z shares it"),
        (LEADSCREW, "direction", "has no column for 'Z.direction'"),
        (CROSS, "motion", "what its instrument lags behind"),
        (PLANE, "names", "each of its runs is then allowed an offset of its own"),
        (PLANE, "runs", "each of its runs is then allowed an offset of its own"),
    ],
)
def test_a_large_log_that_only_memory_serves_is_read_into_it_and_said(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    fits: str,
    more: str,
    reason: str,
) -> None:
    # Fewer readings of so few nodes would be read at once, whatever stands in the way.
    count = 30_000 if more in ("direction", "motion") else 8_000
    run = np.repeat(np.arange(4), 2_000)
    columns: dict[str, np.ndarray] = {
        "names": {"run": np.array(["a", "b", "c", "d"])[run]},
        "runs": {"run": run},
        "motion": {"t": 0.001 * np.arange(count)},
    }.get(more, {})
    log(tmp_path / "log.parquet", count, **columns)
    roles = {"names": '"run" = "run"', "runs": '"run" = "run"', "motion": 'time = "t"'}
    path = job(tmp_path, fits, '"auto"', columns=roles.get(more, ""))
    text = path.read_text()
    if more == "direction":
        text = text.replace('"Z.direction" = "way"', "")
    if more == "motion":
        text = text.replace("Z.error", "Z.actual")
    path.write_text(text)
    monkeypatch.setattr("axcomp.data.measurements._large._LEAST", 0)
    monkeypatch.setattr(_log_readings, "LARGE", 1)
    asked = path.read_text().replace('"auto"', "true")
    path.with_name("asked.toml").write_text(asked)
    if more in ("names", "runs"):
        found = run_job(path.with_name("asked.toml"), tmp_path / "out")
        assert found.tables[0].held_out == "block"
        assert "allows none of its runs an offset of its own" in words(found)
    else:
        with pytest.raises(JobError, match=f"stream: found true, but .*{reason}"):
            run_job(path.with_name("asked.toml"), tmp_path / "out")
    if more in ("direction", "motion"):
        return  # such rows, in no order, memory refuses as well
    assert f"was read into memory and not in pieces: {reason}" in words(
        run_job(path, tmp_path / "out")
    )


@pytest.mark.parametrize("zero", ["datum = { at = 200.0 }", 'remove = "offset"'])
def test_logs_with_zeros_of_their_own_are_read_into_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, zero: str
) -> None:
    monkeypatch.setattr("axcomp.data.measurements._large._LEAST", 0)
    monkeypatch.setattr(_log_readings, "LARGE", 1)
    rng = np.random.default_rng(6)
    for name, low in (("log", 0.0), ("other", 160.0)):
        x = rng.uniform(low, low + 240.0, COUNT)
        error = 0.1 * x + low + rng.normal(0.0, 1.0, COUNT)
        log(tmp_path / f"{name}.parquet", x=x, dz=error)
    path = job(tmp_path, CROSS, '"auto"', measurement=zero)
    measured, fits, cross = path.read_text().partition("[[fits]]")
    other = measured[measured.index("[measurements.log]") :].replace("log", "other")
    cross = cross.replace('measurement = "log"', 'measurements = ["log", "other"]')
    text = measured + other + fits + cross
    path.write_text(text.replace('"auto"', "true"))
    with pytest.raises(JobError, match=r"log\.stream: found true, but only the table"):
        run_job(path, tmp_path / "out")
    path.write_text(text)
    found = run_job(path, tmp_path / "out")
    assert "in memory, tells the zero of each" in words(found)
    off = found.tables[0].fit.values - 1e-4 * np.arange(0.0, 401.0, 20.0)
    # 1100 readings of 1 µm per node; in pieces it took the steps between the zeros.
    assert np.std(off) < 2e-4


def test_a_surface_whose_ways_lie_apart_is_read_into_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("axcomp.data.measurements._large._LEAST", 0)
    monkeypatch.setattr(_log_readings, "LARGE", 1)
    there, ways = np.linspace(0.0, 400.0, 1_000), (-1) ** np.arange(13)
    x = np.concatenate([there[::way] for way in ways])
    y, way = np.repeat([25.0 * np.arange(13.0), ways], 1_000, axis=1)
    error = 12.0 * np.sin(x / 70.0) * np.cos(y / 60.0) + 3.0 * way
    error += np.random.default_rng(7).normal(0.0, 1.0, len(x))
    log(tmp_path / "log.parquet", len(x), x=x, y=y, dz=error)
    memory, auto = (
        run_job(job(tmp_path, PLANE, stream), tmp_path / "out").tables[0]
        for stream in ("false", '"auto"')
    )
    # In pieces what differs between the ways became waves of 3 µm from line to line.
    np.testing.assert_array_equal(auto.fit.values, memory.fit.values)
    said = [remark.message for remark in auto.remarks]
    assert any("into memory and not in pieces: readings on the way" in x for x in said)
    assert any("is the mean of both ways" in x for x in said)
    with pytest.raises(JobError, match="found true, but readings on the way there and"):
        run_job(job(tmp_path, PLANE, "true"), tmp_path / "out")


def test_a_file_or_a_fit_that_cannot_be_read_in_pieces_is_refused(
    tmp_path: Path,
) -> None:
    (tmp_path / "log.txt").write_bytes("x;dz\n1;2\n".encode("utf-16"))
    with pytest.raises(JobError, match=r"log\.txt cannot be read in pieces"):
        run_job(job(tmp_path, CROSS, "true", file="log.txt"), tmp_path / "out")
    log(tmp_path / "log.parquet", 500)
    backlash = '[[fits]]\ncompensation = "backlash"\naxis = "Z"\nmeasurement = "log"\n'
    with pytest.raises(JobError, match="the backlash fit of Z needs its log in memory"):
        run_job(job(tmp_path, backlash, "true"), tmp_path / "out")


@pytest.mark.parametrize("file", ["log.parquet", "log.csv"])
def test_a_bad_cell_far_on_in_a_log_is_named_by_its_line(
    tmp_path: Path, file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("axcomp.data.measurements._large._BLOCK", 100_000)
    rng = np.random.default_rng(0)
    x = rng.uniform(0.0, 400.0, 20_000)
    x[15_000] = np.nan
    log(tmp_path / file, 20_000, x=x)
    found = []
    for stream in ("false", "true"):
        with pytest.raises(MeasurementError) as error:
            run_job(job(tmp_path, CROSS, stream, file=file), tmp_path / "out")
        found.append(str(error.value))
    assert found[0] == found[1]
    assert "x" in found[1]


def test_wild_readings_side_by_side_are_named_where_they_cannot_be_judged_again(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(2)
    x = rng.uniform(0.0, 400.0, 20_000)
    error = rng.normal(0.0, 1.0, len(x)) + np.where(np.abs(x - 200.0) < 8.0, 90.0, 0.0)
    log(tmp_path / "log.parquet", len(x), x=x, dz=error)
    found = run_job(job(tmp_path, CROSS, "true", "smoothness = 2e4"), tmp_path / "out")
    assert "nodes wild readings stand side by side" in words(found)


def test_readings_that_contradict_any_table_are_all_kept_as_in_memory(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(2)
    error = rng.normal(0.0, 1.0, COUNT) + np.where(rng.random(COUNT) < 0.2, 60.0, 0.0)
    log(tmp_path / "log.parquet", dz=error)
    results = both(tmp_path, CROSS)
    assert_same(tmp_path, results)
    assert [one.tables[0].fit.loss for one in results] == ["huber", "huber"]


@pytest.mark.usefixtures("no_drawing")
def test_the_report_says_that_its_plots_show_a_sample(tmp_path: Path) -> None:
    log(tmp_path / "log.parquet", MANY)
    path = job(tmp_path, CROSS, "true", 'smoothness = 1.0\nloss = "student"')
    result = run_job(path, tmp_path / "out")
    write_report(result, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()
    # Numbers are grouped with narrow spaces, as everywhere in the report.
    assert "readings were read in pieces, and the table and the errors above" in page
    view = result.tables[0].samples
    assert len(view.order) < MANY
    assert view.order.max() > 0.99 * MANY
    wild = result.tables[0].fit.wild
    assert wild.sum() >= 12


def test_the_last_reading_of_a_log_in_pieces_counts_as_one_in_memory(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(4)
    x = rng.uniform(0.0, 330.0, 3 * MANY)
    x[20_001] = 400.0  # not among the readings that are shown
    error = 0.3 * x + rng.normal(0.0, 1.0, len(x))
    y = z = np.zeros(len(x))
    columns = {"x": x, "y": y, "z": z, "dz": error, "way": np.ones(len(x))}
    pq.write_table(pa.table(columns), tmp_path / "log.parquet", row_group_size=3_000)
    results = both(tmp_path, CROSS, measurement='remove = "none"')
    assert_same(tmp_path, results)
    assert "nobody measured" not in words(results[1])


def test_both_directions_of_one_log_in_pieces_are_of_one_zero(tmp_path: Path) -> None:
    log(tmp_path / "log.parquet")
    found = both(tmp_path, LEADSCREW, measurement='remove = "offset"')
    assert not any("measured by itself" in words(one) for one in found)
