"""A friction job: from a recorded trace to the list, its proof and its report."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from axcomp.data.errors import AxcompError
from axcomp.data.lists import ListFile, check
from axcomp.data.measurements import MeasurementError
from axcomp.ident.job import FrictionResult, JobError, JobResult, Verdict, run_job
from axcomp.ident.kinds.friction.entries import friction_from_list
from axcomp.ident.kinds.friction.page import residual_plot
from axcomp.ident.report import write_report
from axcomp.ident.report._scale import scale_of
from axcomp.models import (
    AbstractFriction,
    Conventions,
    FrictionTable,
    Setpoints,
    StribeckFriction,
)

from ..friction_job import friction_job

LAW = StribeckFriction(2.0, 3.0, 5.0, 2.0, 0.004)
INERTIA, OFFSET, NOISE = 0.002, 0.3, 0.1
RATED, SHARE = 12.0, 0.001

PLAIN = f"rated_current = {RATED}\ntorque_unit = {SHARE}"
FULL = f"{PLAIN}\nlevel = 1.0"


def motion(speeds: tuple[float, ...] = (1, 2, 4, 8, 16, 40, 100)) -> np.ndarray:
    """Constant speeds both ways with soft ramps, in mm/s, a sample per 2 ms."""
    count = 400
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.minimum(1, np.arange(count) / 60))
    shape = ramp * ramp[::-1]
    return np.concatenate([way * v * shape for v in speeds for way in (1, -1)])


def record(
    folder: Path,
    *,
    sign: float = 1.0,
    velocity: np.ndarray | None = None,
    law: AbstractFriction = LAW,
    limit: float = np.inf,
    inertia: float = INERTIA,
    load: float = OFFSET,
) -> None:
    rng = np.random.default_rng(8)
    v = motion() if velocity is None else velocity
    step = 0.002
    x, a = np.cumsum(v) * step, np.gradient(v, step)
    i = inertia * a + np.asarray(law(v)) + load + NOISE * rng.normal(size=v.size)
    i = np.clip(i, -limit, limit)
    write(folder, np.column_stack([np.arange(v.size) * step, x, sign * i]))


def read(folder: Path) -> np.ndarray:
    """Columns of the recording: time in s, position in mm, current in A."""
    return np.loadtxt(folder / "trace.csv", delimiter=",", skiprows=1)


def write(folder: Path, table: np.ndarray) -> None:
    np.savetxt(folder / "trace.csv", table, "%.7f", ",", header="t,x,i", comments="")


def run(folder: Path, keys: str = FULL, axis: str = "", unit: str = "A") -> JobResult:
    path = folder / "job.toml"
    path.write_text(friction_job(keys, axis=axis, unit=unit))
    return run_job(path, folder / "out")


def friction(result: JobResult) -> FrictionResult:
    found = result.fits[0]
    assert isinstance(found, FrictionResult)
    return found


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, JobResult]:
    folder = tmp_path_factory.mktemp("friction")
    record(folder)
    return folder, run(folder)


def test_list_never_drives_the_axis(tmp_path: Path) -> None:
    # What current and position of different moments look like: slow speeds below 0.
    law = FrictionTable(
        Setpoints(np.array([0.5, 3.0, 8.0, 100.0])), np.array([-1.0, -0.5, 2.0, 2.5])
    )
    record(tmp_path, law=law)
    result = run(tmp_path)
    # So much of it that the gate stops the list.
    listing = ListFile.read(tmp_path / "out" / "rejected" / "achskw1.lis")
    out = list(listing.table("frict_comp", "out").values())
    assert min(out) == 0
    assert max(out) * RATED * SHARE == pytest.approx(2.5, rel=0.05)
    said = " ".join(remark.message for remark in friction(result).remarks)
    assert "The law is below 0 at speeds up to" in said
    assert "mm/s: friction never drives an axis" in said


def test_law_and_load_come_back(done: tuple[Path, JobResult]) -> None:
    found = friction(done[1])
    # 4 standard deviations: two parameters of one seeded draw.
    for name, truth in (("inertia", INERTIA), ("offset", OFFSET)):
        sd = found.view.found.fit.standard_deviations[name]
        assert abs(found.view.found.fit.parameters[name] - truth) <= 4 * sd
    assert found.view.curve is not None
    driven = found.view.curve.speed > 1.5
    mean = found.view.curve.currents[:2].mean(axis=0)
    # A few per cent of the level: tables stand in for the law where they predict as well.
    assert np.abs(mean - np.asarray(LAW(found.view.curve.speed)))[driven].max() < 0.15


def test_several_recordings_make_one_law(tmp_path: Path) -> None:
    speeds = (1, 2, 4, 8, 16, 40, 100)
    for name, part in (("slow", speeds[:4]), ("fast", speeds[4:])):
        record(tmp_path, velocity=motion(part))
        (tmp_path / "trace.csv").rename(tmp_path / f"{name}.csv")
    head, own = friction_job(FULL, file="slow.csv").split("[[fits]]")
    second = head[head.index("[measurements") :]
    second = second.replace("trace", "other").replace("slow.csv", "fast.csv")
    own = own.replace('measurement = "trace"', 'measurements = ["trace", "other"]')
    (tmp_path / "job.toml").write_text(f"{head}{second}[[fits]]{own}")
    found = friction(run_job(tmp_path / "job.toml", tmp_path / "out"))
    assert found.view.curve is not None
    assert found.view.curve.speed.max() > 90.0
    driven = found.view.curve.speed > 1.5
    mean = found.view.curve.currents[:2].mean(axis=0)
    # As of the whole recording, `test_law_and_load_come_back`.
    assert np.abs(mean - np.asarray(LAW(found.view.curve.speed)))[driven].max() < 0.15


def test_recordings_of_different_sample_times_are_not_joined(tmp_path: Path) -> None:
    record(tmp_path)
    head, *rows = (tmp_path / "trace.csv").read_text().splitlines()
    (tmp_path / "slow.csv").write_text("\n".join([head, *rows[::2]]))
    top, own = friction_job(FULL).split("[[fits]]")
    second = top[top.index("[measurements") :].replace("trace.csv", "slow.csv")
    second = second.replace(".trace", ".other")
    own = own.replace('measurement = "trace"', 'measurements = ["trace", "other"]')
    (tmp_path / "job.toml").write_text(f"{top}{second}[[fits]]{own}")
    with pytest.raises(MeasurementError, match=r"found 4 ms a sample, expected 2 ms"):
        run_job(tmp_path / "job.toml", tmp_path / "out")


def test_samples_that_the_recorder_dropped_end_no_law(tmp_path: Path) -> None:
    record(tmp_path)
    head, *rows = (tmp_path / "trace.csv").read_text().splitlines()
    kept = np.random.default_rng(9).random(len(rows)) > 0.05
    rows = [row for row, keep in zip(rows, kept, strict=True) if keep]
    (tmp_path / "trace.csv").write_text("\n".join([head, *rows]))
    found = friction(run(tmp_path))
    assert found.view.curve is not None
    driven = found.view.curve.speed > 1.5
    mean = found.view.curve.currents[:2].mean(axis=0)
    # As of the whole recording, `test_law_and_load_come_back`.
    assert np.abs(mean - np.asarray(LAW(found.view.curve.speed)))[driven].max() < 0.15
    assert any("recorder dropped" in each.message for each in found.remarks)


@pytest.mark.parametrize("recorded", [False, True])
def test_sharp_ramps_at_a_slow_sample_rate_bend_no_law(
    tmp_path: Path, recorded: bool
) -> None:
    # Ramps of 1500 mm/s²; 0.05 A of noise. Smoothed over a tenth of the sample rate they
    # made the break-away 3 % too low.
    step, reach = 0.002, 0.4
    speeds = np.tile([1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 0.5, 3.0], 2)
    pieces = []
    for k, v in enumerate(speeds):
        fine = np.arange(0.0, reach, step)
        shape = np.clip(1500.0 * np.minimum(fine, reach - fine) / v, 0.0, 1.0)
        still = np.zeros(100)
        pieces += [(1 - 2 * (k >= 9)) * v * shape, still]
    velocity = np.concatenate(pieces * 3)
    law = StribeckFriction(1.2, 2.0, 3.0, 1.0, 0.01)
    acceleration = np.gradient(velocity, step)
    moving = velocity != 0
    current = 8e-4 * acceleration + np.where(moving, np.asarray(law(velocity)), 0.0)
    current += 0.05 * np.random.default_rng(0).normal(size=velocity.size)
    time, place = step * np.arange(velocity.size), np.cumsum(velocity) * step
    columns = [time, place, current, *([velocity] if recorded else [])]
    header = "t,x,i" + (",v" if recorded else "")
    path = tmp_path / "trace.csv"
    np.savetxt(path, np.column_stack(columns), "%.9g", ",", header=header, comments="")
    job = tmp_path / "job.toml"
    text = friction_job(FULL)
    if recorded:
        text = text.replace("[[fits]]", '"X.velocity" = "v"\n[[fits]]')
    job.write_text(text)
    fit = friction(run_job(job, tmp_path / "out")).view.found.fit
    found, sd = fit.parameters["breakaway"], fit.standard_deviations["breakaway"]
    assert found == pytest.approx(2.0, rel=0.015)
    assert abs(found - 2.0) <= 4.0 * sd


def test_spikes_of_the_current_move_no_law(
    tmp_path: Path, done: tuple[Path, JobResult]
) -> None:
    record(tmp_path)
    table = read(tmp_path)
    rng = np.random.default_rng(3)
    rows = np.flatnonzero(rng.random(len(table)) < 0.01)
    table[rows, 2] = rng.choice([-50.0, 50.0], len(rows))
    write(tmp_path, table)
    found, sound = friction(run(tmp_path)), friction(done[1])
    assert found.view.curve is not None
    assert sound.view.curve is not None
    # The filter smeared them over a hundred readings each: 12 % at slow speeds.
    speed = sound.view.curve.speed[sound.view.curve.speed > 1.5]
    one, other = (each.view.found.fit.friction(speed) for each in (found, sound))
    assert np.abs(one - other).max() < 0.02
    words = (
        f"{len(rows)} of {len(table)} readings of the current lie far from those beside"
    )
    assert any(r.message.startswith(words) for r in found.remarks)


@pytest.mark.parametrize("spring", [0.0, 0.02])
def test_a_load_that_changes_with_the_position_is_told(
    tmp_path: Path, spring: float
) -> None:
    record(tmp_path, velocity=np.tile(motion(), 5))
    table = read(tmp_path)
    table[:, 2] += spring * table[:, 1]
    write(tmp_path, table)
    said = [remark.message for remark in friction(run(tmp_path)).remarks]
    assert any("The load changes by" in each for each in said) == (spring > 0.0)


@pytest.mark.parametrize("fall", [0.0, 0.3])
def test_friction_that_changes_while_it_is_recorded_is_told(
    tmp_path: Path, fall: float
) -> None:
    record(tmp_path, velocity=np.tile(motion(), 3))
    table = read(tmp_path)
    # The axis warms: all of the current shrinks, its constant load with it.
    table[:, 2] *= 1.0 - fall * np.linspace(0.0, 1.0, len(table))
    header = "t,x,i"
    path = tmp_path / "trace.csv"
    np.savetxt(path, table, "%.7f", ",", header=header, comments="")
    said = [one.message for one in friction(run(tmp_path)).remarks]
    told = [words for words in said if "over the recording, as it does" in words]
    assert len(told) == (fall > 0.0)
    # From 1.15 to 0.85 of the mean law.
    assert not told or re.search(r"falls by (2\d|3\d)%", told[0])


def test_a_current_that_comes_late_is_no_friction_that_changes(tmp_path: Path) -> None:
    # Fast ramps, slow speeds first.
    turn = np.clip(6.0 * np.sin(2.0 * np.pi * np.arange(400) / 400.0), -1.0, 1.0)
    speeds = np.repeat([1.0, 2.0, 4.0, 8.0, 16.0, 40.0, 100.0], 3)
    record(tmp_path, velocity=np.concatenate([v * turn for v in speeds]))
    table = read(tmp_path)
    table[8:, 2] = table[:-8, 2]
    write(tmp_path, table)
    said = " ".join(remark.message for remark in friction(run(tmp_path)).remarks)
    assert "over the recording, as it does" not in said
    assert "larger about" not in said


def test_entries_too_coarse_for_the_law_are_told(tmp_path: Path) -> None:
    record(tmp_path)
    job = tmp_path / "job.toml"
    fine = friction(run(tmp_path)).remarks
    assert not any("misses the law" in each.message for each in fine)
    text = friction_job(FULL)
    assert "torque_unit = 0.001" in text
    job.write_text(text.replace("torque_unit = 0.001", "torque_unit = 0.1"))
    coarse = friction(run_job(job, tmp_path / "out")).remarks
    assert any("one unit of its entries" in each.message for each in coarse)


def test_a_list_that_rounding_leaves_nothing_of_is_stopped(tmp_path: Path) -> None:
    record(tmp_path)
    job = tmp_path / "job.toml"
    text = friction_job(FULL).replace("torque_unit = 0.001", "torque_unit = 1.0")
    job.write_text(text)
    result = run_job(job, tmp_path / "out")
    failed = {check.name for check in friction(result).gate if not check.passed}
    assert "from_file" in failed


@pytest.mark.parametrize("kind", ["step", "place", "none"])
def test_a_load_that_steps_and_friction_of_the_place_are_told(
    tmp_path: Path, kind: str
) -> None:
    # The same speeds at two places, and the way from one to the other.
    seconds = 0.002 * np.arange(1600)
    over = np.interp(seconds, [0.0, 0.1, 3.1, 3.2], [0.0, 100.0, 100.0, 0.0])
    both = [motion(), over, motion(), -over]
    record(tmp_path, velocity=np.tile(np.concatenate(both), 3))
    table = read(tmp_path)
    place, way = table[:, 1], np.sign(np.gradient(table[:, 1]))
    if kind == "step":  # somebody clamps a workpiece
        table[:, 2] += 0.6 * (np.arange(len(table)) > len(table) // 2)
    if kind == "place":
        table[:, 2] += way * (place > 150.0)
    write(tmp_path, table)
    said = " ".join(remark.message for remark in friction(run(tmp_path)).remarks)
    told = re.findall(r"The constant load changes by (\S+) A", said)
    assert len(told) == (kind == "step")
    # A third of the recording holds the step itself.
    assert not told or float(told[0]) == pytest.approx(0.6, rel=0.05)
    assert ("larger about" in said) == (kind == "place")


@pytest.mark.parametrize("slope", [0.0, 0.02])
def test_friction_that_grows_along_the_way_is_told_where_speed_and_place_go_together(
    tmp_path: Path, slope: float
) -> None:
    # To and fro from one place: only fast motion comes to the far end.
    record(tmp_path, velocity=np.tile(motion(), 5))
    table = read(tmp_path)
    table[:, 2] += slope * table[:, 1] * np.sign(np.gradient(table[:, 1]))
    write(tmp_path, table)
    said = " ".join(remark.message for remark in friction(run(tmp_path)).remarks)
    assert ("larger about" in said) == (slope > 0.0)


def test_list_takes_what_the_law_takes(done: tuple[Path, JobResult]) -> None:
    error = friction(done[1]).error
    assert error["before"].rms > 2.0
    # The noise of the recording is all that can be left.
    assert error["predicted"].sound.rms < 1.2 * NOISE
    assert error["from_file"].sound.rms < 1.02 * error["predicted"].sound.rms


def test_load_sheet_speaks_of_speeds_and_of_no_position(
    done: tuple[Path, JobResult],
) -> None:
    steps = {step.action: step.detail for step in done[1].load_sheet}
    assert "at a few speeds in both directions" in steps["See that it works"]
    assert "no position contains it" in steps["See that it works"]
    assert not any("at a few positions" in detail for detail in steps.values())
    assert "double the error" not in steps["Measure once more with the list active"]


def test_list_is_strict_and_within_the_limits(done: tuple[Path, JobResult]) -> None:
    folder, result = done
    listing = ListFile.read(folder / "out" / "achskw1.lis")
    machine = ListFile.read(folder / "out" / "achsmds1.add.lis")
    assert [f for f in check([listing, machine]) if f.level != "info"] == []
    assert listing.integer("frict_comp.scaling_factor") == 1000
    assert machine.integer("lr_param.frict_comp") == 1
    knots = friction(result).view.knots
    assert knots is not None
    assert len(knots.velocity) <= 20


def test_written_list_gives_the_friction_in_drive_units(
    done: tuple[Path, JobResult],
) -> None:
    listing = ListFile.read(done[0] / "out" / "achskw1.lis")
    table = friction_from_list(listing, Conventions()).law
    out = float(table(np.array([50.0]))[0])
    # One unit is 12 mA; the fit is good to some per cent.
    assert out * RATED * SHARE == pytest.approx(
        float(LAW(np.array([50.0]))[0]), rel=0.05
    )


def test_entries_lie_within_their_stated_deviations(
    done: tuple[Path, JobResult],
) -> None:
    tree = json.loads((done[0] / "out" / "result.json").read_text())["fits"][0]
    table = {key: np.array(each) for key, each in tree["parameters"]["table"].items()}
    deviation = np.array(tree["standard_deviations"]["table"]["current"])
    knots = friction(done[1]).view.knots
    assert knots is not None
    # What rounding leaves beside the law is part of each.
    assert (deviation > knots.rms).all()
    driven = (table["velocity"] > 0.5) & (table["velocity"] < 100.0)
    off = table["current"] - np.asarray(LAW(table["velocity"]))
    # 3 standard deviations: some ten entries of one seeded draw.
    assert (np.abs(off) <= 3 * deviation)[driven].all()
    curve = tree["standard_deviations"]["curve"]["current"]
    assert len(curve) == len(tree["parameters"]["curve"]["velocity"])


def test_gate_judges_the_share_of_the_rated_current(
    done: tuple[Path, JobResult],
) -> None:
    check_ = friction(done[1]).gate[0]
    assert check_.name == "max_current"
    assert check_.value == pytest.approx(3.0 / RATED, rel=0.1)
    assert check_.passed


def test_friction_that_does_not_settle_fails_its_gate(
    done: tuple[Path, JobResult], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The search for the shape of the law ends where it begins.
    monkeypatch.setattr(
        "axcomp.ident.friction._inverse._search",
        lambda equation, weights: (weights.start(equation), False),
    )
    (tmp_path / "trace.csv").write_bytes((done[0] / "trace.csv").read_bytes())
    found = friction(run(tmp_path))
    assert [check.name for check in found.gate if not check.passed] == ["settled"]
    assert not (tmp_path / "out" / "achskw1.lis").exists()


def test_report_says_what_a_list_cannot(done: tuple[Path, JobResult]) -> None:
    page, *plots = write_report(done[1], done[0] / "out")
    text = page.read_text()
    assert "belongs into the torque offset" in text
    # Each value to the second digit of what it is known to.
    known = re.findall(r"\d\.(\d+) ± 0\.0*(\d+) ", text.partition("<th>Law</th>")[2])
    assert len(known) >= 4
    assert {len(significant) for _, significant in known} <= {1, 2}
    assert "Quadrant spikes" in text
    # Pictures hold any three letters by chance.
    assert "nan" not in re.sub(r"base64,[^\"]+", "", text).lower()
    assert {plot.stem.split("-")[-1] for plot in plots} == {
        "curve", "residual", "circle",
    }  # fmt: skip
    tree = json.loads((done[0] / "out" / "result.json").read_text())["fits"][0]
    assert tree["parameters"]["curve"]["velocity"][0] > 0


@pytest.mark.parametrize("inertia", [0.0, -INERTIA])
def test_no_circle_is_drawn_for_a_mass_that_is_none(
    tmp_path: Path, inertia: float
) -> None:
    record(tmp_path, inertia=inertia)
    result = run(tmp_path)
    assert friction(result).circle is None
    assert write_report(result, tmp_path / "out")[0].exists()


def test_what_a_cautious_list_leaves_is_no_friction_of_the_place(
    tmp_path: Path,
) -> None:
    record(tmp_path)
    found = friction(run(tmp_path, keys=f"{PLAIN}\nlevel = 0.15"))
    plot = residual_plot(found, scale_of(found.unit))
    assert plot is not None
    share = re.search(r"moves by up to (\S+) % of the friction", plot.caption)
    assert share is not None
    # No friction of the trace depends on the place: what is left is noise.
    assert float(share[1]) < 10.0


def test_without_torque_unit_the_law_is_reported_and_no_list_written(
    tmp_path: Path,
) -> None:
    record(tmp_path)
    result = run(tmp_path, keys="")
    assert result.passed
    assert not list((tmp_path / "out").glob("*.lis"))
    words = [remark.message for remark in friction(result).remarks]
    assert any("does not state torque_unit" in each for each in words)
    assert friction(result).view.curve is not None


@pytest.mark.parametrize(
    ("unit", "keys", "asks"),
    [
        ("Nm", PLAIN, "is in Nm: state rated_torque in place of rated_current"),
        ("A", f"torque_unit = {SHARE}", "is in A: state rated_current."),
    ],
)
def test_a_list_that_was_asked_for_names_the_rated_value_that_is_missing(
    tmp_path: Path, unit: str, keys: str, asks: str
) -> None:
    record(tmp_path)
    result = run(tmp_path, keys, unit=unit)
    assert not result.passed
    assert friction(result).judgement.verdict is Verdict.UNDETERMINED
    errors = [one.message for one in friction(result).remarks if one.level == "error"]
    assert asks in errors[0]


def test_current_that_opposes_the_motion_is_turned_round(tmp_path: Path) -> None:
    record(tmp_path, sign=-1.0)
    found = friction(run(tmp_path, keys=""))
    assert found.view.curve is not None
    assert found.view.curve.currents[0].min() > 1.0
    (words,) = [r.message for r in found.remarks if "turned round" in r.message]
    assert "was turned round, as torque feedback is ([001] p.74): the current" in words


def test_an_inertia_below_zero_is_named(tmp_path: Path) -> None:
    # Friction with the motion, inertia against it: a column of the wrong sign.
    record(tmp_path, inertia=-INERTIA)
    found = friction(run(tmp_path, keys=""))
    assert any("below 0" in remark.message for remark in found.remarks)
    record(tmp_path)
    found = friction(run(tmp_path, keys=""))
    assert not any("below 0" in remark.message for remark in found.remarks)


def test_a_second_measurement_of_friction_says_what_shows_it(tmp_path: Path) -> None:
    record(tmp_path)
    run(tmp_path)
    job = tmp_path / "job.toml"
    (tmp_path / "later").mkdir()
    record(tmp_path / "later", load=OFFSET + 0.01)
    after = job.read_text().replace('file = "', 'active = ["friction"]\nfile = "later/')
    (tmp_path / "after.toml").write_text(after)
    result = run_job(job, tmp_path / "out", after=tmp_path / "after.toml")
    warnings = [one.message for one in result.remarks if one.level == "warning"]
    assert len(warnings) == 1
    assert "X friction: not judged: it adds current and no position" in warnings[0]
    assert warnings[0] in [one.message for one in result.fits[0].remarks]


def test_a_time_in_microseconds_read_as_seconds_is_named(tmp_path: Path) -> None:
    record(tmp_path)
    table = read(tmp_path)
    table[:, 0] *= 1e6
    write(tmp_path, table)
    result = run(tmp_path)
    assert not result.passed
    errors = [one.message for one in friction(result).remarks if one.level == "error"]
    assert any("look at the units of time and position" in each for each in errors)


@pytest.mark.parametrize("column", [0, 1, None])
def test_a_unit_a_thousand_times_off_is_doubted_by_the_speed(
    tmp_path: Path, column: int | None
) -> None:
    record(tmp_path)
    table = read(tmp_path)
    if column is not None:  # ms for s, m for mm
        table[:, column] *= (1e3, 1e-3)[column]
    np.savetxt(tmp_path / "trace.csv", table, "%.9f", ",", header="t,x,i", comments="")
    said = [
        one.message for one in friction(run(tmp_path)).remarks if one.level == "warning"
    ]
    assert any("The fastest motion is 0.1" in each for each in said) == (
        column is not None
    )


def test_samples_that_stand_twice_at_one_instant_are_refused_in_words(
    tmp_path: Path,
) -> None:
    record(tmp_path)
    table = read(tmp_path)
    table = np.repeat(table, 2, axis=0)
    write(tmp_path, table)
    with pytest.raises(AxcompError, match="samples at the instant before them"):
        run(tmp_path)


def test_level_scales_the_list_and_leaves_the_knob_alone(tmp_path: Path) -> None:
    record(tmp_path)
    half = friction(run(tmp_path, keys=f"{PLAIN}\nlevel = 0.5"))
    listing = ListFile.read(tmp_path / "out" / "achskw1.lis")
    assert half.view.knots is not None
    assert half.view.curve is not None
    mean = half.view.curve.currents[:2].mean(axis=0)
    share = half.view.knots.current(half.view.curve.speed) / mean
    # Rounding to units of 12 mA, and knots that lie beside the curve.
    assert share[half.view.curve.weight > 0].mean() == pytest.approx(0.5, abs=0.02)
    assert listing.integer("frict_comp.scaling_factor") == 1000


def test_list_of_a_controller_that_subtracts_its_entries_is_turned(
    tmp_path: Path,
) -> None:
    record(tmp_path)
    (tmp_path / "rules.toml").write_text("[verified]\nfriction_sign = -1\n")
    rules = '[machine]\nconventions = "rules.toml"'
    found = friction(run(tmp_path, keys=FULL, axis=rules))
    listing = ListFile.read(tmp_path / "out" / "achskw1.lis")
    out = np.array(list(listing.table("frict_comp", "out").values()))
    # Current = −out: 2 A of friction are −167 units of 12 mA.
    assert out.max() < -100
    assert found.error["from_file"].sound.rms < 1.2 * NOISE


def test_level_of_nothing_is_refused_and_more_than_all_is_stopped(
    tmp_path: Path,
) -> None:
    record(tmp_path)
    with pytest.raises(JobError, match=r"level: found 0, expected greater than 0"):
        run(tmp_path, keys=f"{PLAIN}\nlevel = 0")
    found = friction(run(tmp_path, keys=f"{PLAIN}\nlevel = 1.2"))
    assert any("more than there is shakes" in r.message for r in found.remarks)
    assert [check.name for check in found.gate if not check.passed] == ["level"]
    assert found.judgement.verdict == "rejected"
    assert not any("cautious" in remark.message for remark in found.remarks)


@pytest.mark.parametrize(("settled", "level"), [(False, 0.15), (True, 1.0)])
def test_list_is_weak_by_default_until_its_sign_is_settled(
    tmp_path: Path, settled: bool, level: float
) -> None:
    record(tmp_path)
    (tmp_path / "rules.toml").write_text("[verified]\nfriction_sign = 1\n")
    machine = '[machine]\nconventions = "rules.toml"' if settled else ""
    found = friction(run(tmp_path, keys=PLAIN, axis=machine))
    assert found.view.level == level
    assert found.view.knots is not None
    assert found.view.curve is not None
    share = found.view.knots.current(found.view.curve.speed) / found.view.curve.mean
    # Rounding to units of 12 mA, and knots that lie beside the curve.
    assert share[found.view.curve.weight > 0].mean() == pytest.approx(level, abs=0.02)
    verdict = Verdict.GOOD if settled else Verdict.UNPROVEN
    assert found.judgement.verdict is verdict


def test_list_at_half_the_level_promises_half_and_says_what_to_do(
    tmp_path: Path,
) -> None:
    record(tmp_path)
    half = friction(run(tmp_path, keys=f"{PLAIN}\nlevel = 0.5"))
    listing = ListFile.read(tmp_path / "out" / "achskw1.lis")
    at: Any = listing.table("frict_comp", "in")
    out: Any = listing.table("frict_comp", "out")
    velocity = motion()
    moving = np.abs(velocity) > 1.0
    # µm/s, and units of 12 A / 1000.
    speeds = [1e-3 * at[k] for k in sorted(at)]
    added = (
        RATED
        * SHARE
        * np.interp(np.abs(velocity), speeds, [out[k] for k in sorted(out)])
    )
    truth = np.abs(np.asarray(LAW(velocity)))
    left = np.sqrt(np.mean((truth - added)[moving] ** 2))
    # What is promised is what is left of the true law: half of it, a tenth for the
    # noise and for the slow samples, which count differently.
    assert half.error["predicted"].sound.rms == pytest.approx(left, rel=0.1)
    assert left > 0.45 * np.sqrt(np.mean(truth[moving] ** 2))
    words = " ".join(remark.message for remark in half.remarks)
    assert "The rest remains" in words
    assert "raise level and fit again" in words


def test_existing_list_keeps_all_but_its_friction_table(tmp_path: Path) -> None:
    record(tmp_path)
    old = (
        "kopf.achs_nr 1 (keep me)\r\nkw.crosscomp.unit 1\r\n"
        "frict_comp.mode 3\r\nfrict_comp.table_entries 2\r\nfrict_comp.position_delay 4\r\n"
        "frict_comp.table[0].in 1\r\nfrict_comp.table[0].out 9\r\n"
        "frict_comp.table[1].in 90\r\nfrict_comp.table[1].out 7\r\nEnde\r\n"
    )
    (tmp_path / "old.lis").write_bytes(old.encode("latin-1"))
    run(tmp_path, axis='list = "old.lis"')
    listing = ListFile.read(tmp_path / "out" / "achskw1.lis")
    assert b"kopf.achs_nr 1 (keep me)\r\nkw.crosscomp.unit 1\r\n" in listing.dumps()
    assert listing.integer("frict_comp.position_delay") == 4
    assert listing.dumps().rstrip().endswith(b"Ende")


def test_one_direction_alone_writes_nothing(tmp_path: Path) -> None:
    record(tmp_path, velocity=np.abs(motion()))
    result = run(tmp_path)
    assert not list((tmp_path / "out").glob("achskw*.lis"))
    words = [remark.message for remark in friction(result).remarks]
    assert any("one direction" in w or "positive direction" in w for w in words)
    assert not result.passed


def test_axis_that_never_moves_is_refused(tmp_path: Path) -> None:
    record(tmp_path, velocity=np.zeros(3000))
    with pytest.raises(MeasurementError, match="does not move"):
        run(tmp_path)


def test_current_held_at_its_limit_writes_no_list(tmp_path: Path) -> None:
    record(tmp_path, limit=float(np.asarray(LAW(np.array([4.0])))[0]))
    result = run(tmp_path)
    assert not list((tmp_path / "out").glob("achskw*.lis"))
    words = [remark.message for remark in friction(result).remarks]
    assert any(
        "No list is written. The current is held at its limit" in w for w in words
    )
    assert not result.passed


def test_each_direction_counts_at_the_speeds_that_it_saw(tmp_path: Path) -> None:
    slow, fast = motion((1, 2, 4, 8, 15)), motion((1, 3, 10, 40, 120, 300))
    both = np.concatenate([np.maximum(slow, 0.0), np.minimum(fast, 0.0)] * 2)
    law = StribeckFriction(2.0, [2.0, 3.0], 30.0, 1.0, [0.04, 0.001])
    record(tmp_path, velocity=both[both != 0.0], law=law)
    found = friction(run(tmp_path, keys=FULL.replace("12.0", "24.0")))
    assert found.view.curve is not None
    assert found.view.knots is not None
    truth = -np.asarray(law(np.array([-100.0, -290.0])))
    # Only the negative direction was driven so fast: noise and rounding are left.
    np.testing.assert_allclose(
        found.view.knots.current(np.array([100.0, 290.0])), truth, rtol=0.04
    )
    said = " ".join(remark.message for remark in found.remarks)
    assert re.search(
        r"driven at up to 300 mm/s, the other at up to 1[45](\.\d)? only", said
    )
    # The positive law, a steep line, is held where it ends.
    ends = found.view.curve.speed > 16.0
    assert np.ptp(found.view.curve.currents[0][ends]) < 1e-9
    gate = {check.name: check for check in found.gate}
    assert gate["from_file"].passed
    assert gate["from_file"].value <= 1.1 * found.error["predicted"].sound.rms + 0.024


@pytest.mark.usefixtures("no_drawing")
def test_list_and_its_constant_load_go_together_where_directions_saw_other_speeds(
    tmp_path: Path,
) -> None:
    pairs = zip((1, 2, 5, 10, 22) * 2, (1, 3, 9, 30, 90, 250) * 2, strict=False)
    pieces = [motion(pair)[[*range(400), *range(1200, 1600)]] for pair in pairs]
    velocity = np.concatenate([*pieces, motion((250,))[400:]])
    law = StribeckFriction(2.0, [2.0, 3.0], 25.0, 1.3, [0.04, 0.002])
    record(tmp_path, velocity=velocity, law=law)
    found = friction(run(tmp_path, keys=FULL.replace("12.0", "24.0")))
    assert found.view.knots is not None
    assert found.view.offset is not None
    speed = np.array([60.0, 150.0, 240.0])
    # Seen in motion are friction and load together, there in one direction only.
    seen = np.asarray(law(-speed)) + OFFSET
    given = -found.view.knots.current(speed) + found.view.offset
    # Nothing makes up for a load that is none of the list's: it was off by 0.3 A.
    np.testing.assert_allclose(given, seen, atol=0.1)


def test_a_list_that_misses_the_prediction_is_stopped(
    done: tuple[Path, JobResult],
) -> None:
    found = friction(done[1])
    view = found.view
    weak = dataclasses.replace(view, listed=0.8 * (view.before - view.predicted))
    check_ = weak.gate()
    # A fifth of some 2.5 A is left, where 0.1 A of noise was predicted.
    assert not check_.passed
    assert check_.value > 4 * check_.limit / 1.3


@pytest.mark.usefixtures("no_drawing")
def test_figures_and_headline_are_those_of_the_written_level(tmp_path: Path) -> None:
    record(tmp_path)
    result = run(tmp_path, keys=f"{PLAIN}\nlevel = 0.5")
    found = friction(result)
    before, predicted, written = (
        found.error[key].sound.rms for key in ("before", "predicted", "from_file")
    )
    # Half of the friction, beside noise of 4 % of it.
    assert predicted == pytest.approx(0.5 * before, rel=0.02)
    assert written == pytest.approx(predicted, rel=0.02)
    text = write_report(result, tmp_path / "out")[0].read_text()
    assert f"to {predicted:.3g} A rms" in text
    assert "by 50 %" in text
    assert found.gate[1].passed


def test_constant_load_is_the_one_that_goes_with_the_list(tmp_path: Path) -> None:
    # Levels differ by 2 A: seen are 3 + 0.3 going up, 1 − 0.3 going down.
    uneven = StribeckFriction([3.0, 1.0], [3.0, 1.0], 5.0, 2.0, [0.004, 0.012])
    record(tmp_path, law=uneven)
    found = friction(run(tmp_path))
    assert found.view.curve is not None
    view = found.view
    assert view.offset is not None
    rows, listed = view.samples.in_motion, view.before - view.from_file
    for away in (-0.05, 0.05):
        other = view.from_file[rows] + away
        # Any other constant load leaves more of the current beside this list.
        assert np.sum(other**2) > np.sum(view.from_file[rows] ** 2)
    assert np.abs(listed[rows]).mean() > 1.0
    words = [remark.message for remark in found.remarks]
    assert any(f"load of {view.offset:.4g} A" in each for each in words)


def test_load_that_does_not_stand_out_of_its_deviation_is_not_spoken_of(
    tmp_path: Path,
) -> None:
    record(tmp_path, load=0.0)
    words = [remark.message for remark in friction(run(tmp_path)).remarks]
    assert not any("constant load" in each for each in words)


def test_rotary_axes_are_told_in_degrees_per_second(tmp_path: Path) -> None:
    record(tmp_path)
    text = friction_job(FULL, axis='type = "rotary"')
    path = tmp_path / "job.toml"
    path.write_text(text.replace('unit = "mm"', 'unit = "deg"'))
    result = run_job(path, tmp_path / "out")
    found = friction(result)
    page = write_report(result, tmp_path / "out")[0].read_text()
    page = re.sub(r"base64,[^\"]+", "", page)
    assert found.view.samples.unit == "°"
    assert "°/s" in page
    assert "mm/s" not in page
    assert "µm" not in page
    assert "°/s" in found.gate[0].where


def test_stamps_of_arrival_that_repeat_are_read_as_samples_of_an_even_clock(
    tmp_path: Path,
) -> None:
    record(tmp_path)
    table = read(tmp_path)
    late = np.random.default_rng(2).exponential(1.5e-3, len(table))
    table[:, 0] = np.round(np.maximum.accumulate(table[:, 0] + late), 3)
    assert (np.diff(table[:, 0]) == 0.0).sum() > 100
    write(tmp_path, table)
    found = friction(run(tmp_path))
    assert "with samples every 2 ms" in " ".join(one.message for one in found.remarks)
    assert found.view.knots is not None
    speed = np.array([2.0, 5.0, 20.0, 60.0])
    # 0.1 A of noise on 11 000 samples; a line between knots leaves 1 %.
    np.testing.assert_allclose(found.view.knots.current(speed), LAW(speed), rtol=0.02)


def test_stamps_that_repeat_beside_samples_that_are_missing_are_refused(
    tmp_path: Path,
) -> None:
    record(tmp_path)
    table = read(tmp_path)
    table[::2, 0] = table[1::2, 0]  # two samples of 2 ms each
    missing = np.random.default_rng(6).choice(len(table), 20, replace=False)
    table = np.delete(table, missing, axis=0)
    write(tmp_path, table)
    with pytest.raises(
        AxcompError, match=r"at the instant before them|ascending times"
    ):
        run(tmp_path)
