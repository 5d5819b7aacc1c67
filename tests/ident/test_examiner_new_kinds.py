"""Backlash, friction and temperature in jobs that a second pair of eyes made up."""

import json
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.cli import main
from axcomp.ident.friction import place_knots
from axcomp.ident.job import BacklashResult, JobError, JobResult, run_job
from axcomp.ident.report import scale_of

from .thermal_line import fitted, readings

WIDTH, NOISE = 0.012, 0.0005
BOTH = """
[axes.X]
number = 1
{axis}
[measurements.laser]
file = "laser.csv"
remove = "none"
active = []
axis = "X"
{fits}
"""
BACKLASH = """
[[fits]]
compensation = "backlash"
axis = "X"
measurement = "laser"
"""
LEADSCREW = """
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
start = 0.0
interval = 50.0
points = 9
"""


def laser(folder: Path, noise: float = NOISE, size: float = 1.0) -> np.ndarray:
    """Three runs both ways: a screw error, and positions too large coming back."""
    rng = np.random.default_rng(4)
    rows = [
        (
            x,
            size * (4e-5 * x + 0.003 * np.sin(x / 70) + (WIDTH if way < 0 else 0)),
            k,
            way,
        )
        for k in (1, 2, 3)
        for way in (1, -1)
        for x in np.linspace(0.0, 400.0, 17)[::way]
    ]
    table = np.array(rows, dtype=float)
    table[:, 1] += noise * rng.normal(size=len(table))
    np.savetxt(
        folder / "laser.csv", table, "%.7f,%.7f,%d,%d",
        header="target,error,run,direction", comments="",
    )  # fmt: skip
    return table


def run(folder: Path, fits: str, axis: str = "") -> JobResult:
    (folder / "job.toml").write_text(BOTH.format(fits=fits, axis=axis))
    return run_job(folder / "job.toml", folder / "out")


@pytest.mark.parametrize("reference", [1, 2])
@pytest.mark.parametrize("fits", [BACKLASH + LEADSCREW, LEADSCREW + BACKLASH])
def test_table_of_one_direction_lies_on_the_reference_flank_of_the_backlash(
    tmp_path: Path, fits: str, reference: int
) -> None:
    target, error, _, way = laser(tmp_path).T
    (tmp_path / "achsmds1.lis").write_text(
        f"kopf.achs_nr 1\nlr_param.anwahl_losekomp {reference}\ngetriebe[0].lose 10\n"
    )
    result = run(tmp_path, fits, 'machine_data = "achsmds1.lis"')
    assert [one.compensation for one in result.fits] == [
        name for name in fits.split('"') if name in ("backlash", "leadscrew")
    ]
    listing = ListFile.read(tmp_path / "out" / "achskw1.lis")
    machine = ListFile.read(tmp_path / "out" / "achsmds1.lis")
    width = (machine.integer("getriebe[0].lose") or 0) * 1e-4
    entries = np.array(list(listing.table("kw.ssfk", "pos").values())) * 1e-4
    # The rules by hand (S-45, S-18): against the reference the play is taken off there,
    # and entries are errors.
    back = (
        np.where(way < 0, -width, 0) if reference == 1 else np.where(way > 0, width, 0)
    )
    left = error + back - np.interp(target, np.linspace(0, 400, 9), entries)
    # Noise and the bends between nodes; half a backlash more would be 6 µm.
    assert np.sqrt(np.mean(left**2)) < 1.3 * NOISE


def test_readings_that_are_all_zero_show_no_backlash(tmp_path: Path) -> None:
    laser(tmp_path, noise=0.0, size=0.0)
    found = run(tmp_path, BACKLASH).fits[0]
    assert isinstance(found, BacklashResult)
    assert found.width == 0.0
    assert not found.files


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_backlash_of_a_rotary_axis_is_told_in_degrees(
    tmp_path: Path, size: float
) -> None:
    laser(tmp_path, size=size)
    found = run(tmp_path, BACKLASH, 'type = "rotary"').fits[0]
    assert isinstance(found, BacklashResult)
    words = [remark.message for remark in found.remarks]
    assert scale_of(found.unit).error == "m°"
    assert not any("µm" in each or "0.001°" in each for each in words)
    assert size or any("m° ± " in each for each in words)


def test_every_kind_of_fit_has_the_keys_that_the_interface_promises(
    tmp_path: Path,
) -> None:
    laser(tmp_path)
    run(tmp_path, BACKLASH)
    found = json.loads((tmp_path / "out" / "result.json").read_text())["fits"][0]
    promised = (
        "compensation axis parameters standard_deviations support noise smoothness error"
        " gate findings conventions"
    )
    assert set(promised.split()) <= set(found)
    assert set(found["error"]) == {"before", "predicted", "from_file"}


def test_temperature_in_kelvin_without_its_unit_is_refused(tmp_path: Path) -> None:
    warm = np.linspace(293.0, 308.0, 60)
    noise = 1e-4 * np.random.default_rng(6).normal(size=60)
    table = np.column_stack([0.002 * (warm - 293.0) + noise, warm])
    np.savetxt(tmp_path / "w.csv", table, "%.6f", ",", header="e,f", comments="")
    (tmp_path / "job.toml").write_text(
        "[axes.X]\nnumber = 1\n[measurements.w]\nfile = 'w.csv'\n"
        "[measurements.w.columns]\n'X.error' = 'e'\n'temperature.f' = 'f'\n"
        "[[fits]]\ncompensation = 'temperature'\naxis = 'X'\nmeasurement = 'w'\n"
        "sensors = { offset = 'f' }\nlaw = { offset = 'linear' }\nlag = 'none'\n"
    )
    with pytest.raises(JobError, match=r"temperature.f: found 300.5 .*unit = .K."):
        run_job(tmp_path / "job.toml", tmp_path / "out")


def test_lines_that_are_flat_at_zero_meet_nowhere() -> None:
    warm = np.linspace(20.0, 35.0, 60)
    place = np.tile(np.linspace(0.0, 500.0, 6), 10)
    data = readings(np.zeros(60), warm, position=place, time=60.0 * np.arange(60))
    found = fitted(data, law=("linear", "linear"), lag="none")
    assert found.meeting == "parallel"


@pytest.mark.parametrize("entries", [3, 4, 5])
def test_friction_table_never_has_more_entries_than_asked_for(entries: int) -> None:
    speed = np.geomspace(4.0, 200.0, 100)
    curve = 2.0 + 1.5 * np.exp(-speed / 8.0) + 0.002 * speed
    knots = place_knots(speed, curve, np.ones(100), entries=entries, unit=0.01)
    assert len(knots.velocity) <= entries
    assert knots.velocity[0] == 1
    assert knots.velocity[-1] > 200_000
    assert knots.out[-1] == knots.out[-2]
    # Where nobody measured: no more than at the slowest speed, to half a list unit.
    assert knots.out[0] * knots.unit <= curve[0] + 0.5 * knots.unit


def test_friction_that_was_driven_down_to_the_slowest_speed_has_whole_entries() -> None:
    speed = np.geomspace(0.001, 200.0, 100)
    knots = place_knots(speed, 2.0 + 0.002 * speed, np.ones(100), unit=0.01)
    assert knots.velocity.dtype.kind == knots.out.dtype.kind == "i"
    assert knots.velocity[0] == 1


def test_nothing_is_said_of_rejected_lists_where_none_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    time = np.arange(0.0, 8.0, 0.005)
    place = 40.0 * time
    table = np.column_stack([time, place, 2.0 + 0.1 * np.sin(9 * time)])
    np.savetxt(tmp_path / "trace.csv", table, "%.6f", ",", header="t,x,i", comments="")
    job = tmp_path / "job.toml"
    job.write_text(
        "[axes.X]\nnumber = 1\n[measurements.m]\nfile = 'trace.csv'\n"
        "[measurements.m.columns]\ntime = 't'\n'X.position' = 'x'\n'X.current' = 'i'\n"
        "[[fits]]\ncompensation = 'friction'\naxis = 'X'\nmeasurement = 'm'\n"
        "rated_current = 10.0\ntorque_unit = 0.001\n"
    )
    assert main(["fit", str(job), "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().out
    assert "NOT PASSED" in said
    assert "rejected lists" not in said
