"""An error that wanders in time: told, stated in the written job, and allowed for there."""

import csv
import dataclasses
import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.signal import lfilter

from axcomp.ident.cli import main
from axcomp.ident.discover import Discovery, discover
from axcomp.ident.job import JobResult, load_job, run_job
from axcomp.ident.machine import (
    machine_with_everything,
    record,
    work_programme,
    write_motion_log,
)

JOB = """\
[axes.X]
number = 1
[axes.Y]
number = 2
[axes.Z]
number = 3

[measurements.work]
file = "log.csv"
active = []
"""


def found_in(virtual: ModuleType, drift: float, **options: object) -> Discovery:
    motion = virtual.motion(3, axes="X", duration=600.0, rows=3000)
    effects = {"X": [virtual.line("X", 5, 0.004), virtual.reversal("X", 0.004)]}
    observed = virtual.observe(motion, effects, 4, drift=drift)
    return discover(dataclasses.replace(observed, **options), ("X",))


def test_drift_is_told_with_its_size(virtual: ModuleType) -> None:
    (drift,) = found_in(virtual, 3e-3).drifts
    rng = np.random.default_rng(1004)
    rng.normal(size=3000)  # the noise comes first
    share = np.arange(3000) / 2999
    truth = 3e-3 * (rng.normal() * share + rng.normal() * share**2)
    assert (drift.axis, drift.source, drift.unit) == ("X", 0, "mm")
    # What slow positions and the drift share is a few percent of either.
    assert drift.rms == pytest.approx(float(np.std(truth)), rel=0.15)
    assert "wanders in time by" in drift.sentence


def test_where_nothing_drifts_no_drift_is_told(virtual: ModuleType) -> None:
    found = found_in(virtual, 0.0)
    assert [one.compensation for one in found.found] == ["leadscrew", "backlash"]
    assert found.drifts == ()


def test_an_offset_by_another_sensor_than_the_growth_is_no_drift(
    virtual: ModuleType,
) -> None:
    motion = virtual.motion(3, axes="X", duration=1800.0, rows=3000)
    effects = {"X": [virtual.heat("X", ("frame", -3e-3), ("spindle", 9e-6))]}
    found = discover(virtual.observe(motion, effects, 4, drift=0.0), ("X",))
    names = {one.compensation: one for one in found.found}
    assert found.drifts == ()
    sensors = {"offset": "frame", "coefficient": "spindle"}
    keys = dict(names["temperature"].keys)
    # The growth is about 100 mm: 0.5 µm in a reading, and a growth of 54 µm/m in all.
    assert keys.pop("reference") == pytest.approx(100.0, abs=1.0)
    assert keys == {"sensors": sensors}


def test_noise_that_remembers_for_seconds_is_no_drift(virtual: ModuleType) -> None:
    motion = virtual.motion(3, axes="X", duration=1100.0, rows=15_000)
    innovation = np.random.default_rng(2).normal(size=15_000)
    keep = np.exp(-1.0 / 40.0)  # for three seconds
    air = lfilter([8e-4 * np.sqrt(1.0 - keep**2)], [1.0, -keep], innovation)
    effects = {
        "X": [
            virtual.reversal("X", 0.006),
            virtual.heat("X", ("frame", 4e-3), ("frame", 15e-6)),
            lambda _: air,
        ]
    }
    found = discover(virtual.observe(motion, effects, 4, drift=0.0), ("X",))
    names = {one.compensation: one for one in found.found}
    assert names.keys() == {"temperature", "backlash"}
    # Offset and coefficient: none of both is left to a drift.
    assert names["temperature"].keys == {"sensor": "frame"}
    assert (found.drifts, found.unexplained) == ((), ())


def test_without_times_or_with_runs_no_drift_is_told(virtual: ModuleType) -> None:
    # A fit needs the time for it; runs have offsets of their own.
    assert found_in(virtual, 3e-3, time=None).drifts == ()
    runs = np.repeat(np.arange(5), 600)
    assert found_in(virtual, 3e-3, run=runs).drifts == ()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five minutes of the machine with everything; its reference wanders by 2 µm."""
    made = tmp_path_factory.mktemp("drifting")
    machine = machine_with_everything(pace=0.17)
    trackers = {
        axis: dataclasses.replace(one, drift=0.006)
        for axis, one in machine.trackers.items()
    }
    machine = dataclasses.replace(machine, trackers=trackers)
    log = record(machine, work_programme(300.0, seed=5), seed=9).every(36)
    write_motion_log(made / "log.csv", log)
    with (made / "log.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    # One axis shows it, and takes a third of the time.
    others = ("Y.actual", "Z.actual")
    kept = [
        k
        for k, name in enumerate(rows[0])
        if name not in others and not name.endswith("current")
    ]
    with (made / "log.csv").open("w", newline="") as file:
        csv.writer(file).writerows([[row[k] for k in kept] for row in rows])
    (made / "job.toml").write_text(JOB)
    return made


@pytest.fixture(scope="module")
def promised(folder: Path) -> dict[str, object]:
    """Return what discover says; the job that it wrote is new.toml."""
    new = str(folder / "new.toml")
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr("typer.echo", lambda text, **_: lines.append(text))
        assert (
            main(["discover", str(folder / "job.toml"), "--write", new, "--json"]) == 0
        )
    result: dict[str, object] = json.loads("\n".join(lines))
    return result


@pytest.fixture(scope="module")
def kept(folder: Path, promised: dict[str, object]) -> JobResult:
    del promised
    return run_job(folder / "new.toml", folder / "out")


@pytest.mark.slow
def test_the_written_job_states_the_drift_and_the_arbitrary_zero(
    folder: Path, promised: dict[str, object]
) -> None:
    (drift,) = promised["drifts"]  # type: ignore[misc]
    assert drift["axis"] == "X"
    assert drift["measurement"] == "work"
    spec = load_job(folder / "new.toml").spec.measurements["work"]
    assert spec.drift == drift["pieces"]
    # The tracker's zero is 0.31 mm off: twenty times what the error changes.
    assert spec.remove == "offset"


@pytest.mark.slow
def test_the_written_job_gives_what_discover_promised(
    promised: dict[str, object], kept: JobResult
) -> None:
    assert kept.passed
    names = [one["compensation"] for one in promised["found"]]  # type: ignore[attr-defined]
    assert (
        [one.compensation for one in kept.fits] == names == ["leadscrew", "temperature"]
    )
    (whole,) = kept.groups[0].axes
    (said,) = promised["axes"]  # type: ignore[misc]
    # Both estimate the same scatter from 7 000 readings; features are coarser than tables.
    assert whole.noise == pytest.approx(said["noise"], rel=0.1)
    assert whole.error["from_file"].sound.rms < 1.1 * said["noise"]
    # A fifth of five minutes is held out at a time: drift and tables are told by the rest.
    assert whole.error["predicted"].sound.rms < 1.3 * said["noise"]


def written(folder: Path, virtual: ModuleType, job: str) -> str:
    motion = virtual.motion(3, axes="X", duration=600.0, rows=2000)
    effects = {"X": [virtual.line("X", 5, 0.004), virtual.reversal("X", 0.004)]}
    error = virtual.observe(motion, effects, 4, drift=4e-3).error["X"]
    way = motion.direction["X"]
    columns = (motion.time, motion.position["X"], way, error)
    header = "time [s],X.position [mm],X.direction,X.error [mm]"
    table = np.column_stack(columns)
    path = folder / "log.csv"
    np.savetxt(path, table, "%.6f", ",", header=header, comments="")
    (folder / "job.toml").write_text("[axes.X]\nnumber = 1\n" + job)
    main(["discover", str(folder / "job.toml"), "--write", str(folder / "new.toml")])
    return (folder / "new.toml").read_text()


@pytest.mark.parametrize(
    ("job", "pieces"),
    [
        ('[measurements."work"]  # as it came\nfile = "log.csv"\n', None),
        ('[measurements.work]\ndrift = 7\nfile = "log.csv"\n', 7),
        ('[measurements.work]\nfile = "log.csv"\nremove = "offset"\n', None),
        ('[measurements]\nwork = { file = "log.csv" }\n', None),
    ],
)  # fmt: skip
def test_what_the_job_states_of_its_instrument_stays(
    tmp_path: Path, virtual: ModuleType, job: str, pieces: int | None
) -> None:
    text = written(tmp_path, virtual, job)
    spec = load_job(tmp_path / "new.toml").spec.measurements["work"]
    assert spec.drift == pieces if pieces else spec.drift > 0
    assert text.count("drift = ") == 1
    assert text.count("remove = ") == job.count("remove = ")
