"""What only the user knows: whose a constant and a slope are, and what was on."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.job import JobError, run_job
from axcomp.ident.job.table._trend import trend_through

from .screw import LIST_UNIT, laser, screw_job, table

PLACES = np.linspace(0.0, 400.0, 41)
JOB = """
[axes.X]
number = 1
[axes.C]
number = 2
type = "rotary"
modulo = [0.0, 360.0]
[measurements.m]
file = "m.csv"
{stated}
[[fits]]
compensation = "{kind}"
axis = "{axis}"
measurement = "m"
start = 0.0
interval = {interval}
points = {points}
{keys}
"""


def shown(constant: float, slope: float) -> np.ndarray:
    """Return a wave of 5 µm and noise of 0.5 µm about a line, mm."""
    noise = 5e-4 * np.random.default_rng(3).normal(size=len(PLACES))
    line = constant + slope * (PLACES - PLACES.mean())
    return 5e-3 * np.sin(2 * np.pi * PLACES / 100.0) + line + noise


def job(folder: Path, error: np.ndarray, stated: str = "", **keys: object) -> Path:
    table(folder / "m.csv", "X.position [mm],X.error [mm]", PLACES, error)
    form = {
        "kind": "leadscrew",
        "axis": "X",
        "interval": 20.0,
        "points": 21,
        "keys": "",
    }
    path = folder / "job.toml"
    path.write_text(JOB.format(stated=stated, **form | keys))
    return path


@pytest.mark.parametrize(
    ("constant", "slope", "numbers"),
    [
        # Of the wave, 21 nodes leave a standard deviation of 3.6 µm / √21 to a mean.
        (0.03, 0.0, r"a constant of 30\.\d+ ± 0\.\d+ µm and a slope of -?\d\.\d ± \d"),
        (
            0.0,
            5e-5,
            r"a constant of \S+ ± 0\.\d+ µm and a slope of 4\d\.\d ± \d\.\d µm/m",
        ),
    ],
)
def test_a_constant_or_slope_that_nobody_owns_stops_the_job(
    tmp_path: Path, constant: float, slope: float, numbers: str
) -> None:
    path = job(tmp_path, shown(constant, slope))
    keys = r'datum = \{ at = … \}.*remove = "none".*"offset".*"line"'
    expected = (
        rf"job\.toml:8: measurements\.m: found {numbers}.* in the error of X.*{keys}"
    )
    with pytest.raises(JobError, match=expected):
        run_job(path, tmp_path / "out")
    assert not list((tmp_path / "out").glob("*"))


@pytest.mark.parametrize(
    "stated", ['remove = "none"', 'remove = "line"', "datum = { at = 0.0 }"]
)
def test_each_answer_is_taken(tmp_path: Path, stated: str) -> None:
    result = run_job(job(tmp_path, shown(0.03, 5e-5), stated), tmp_path / "out")
    assert result.passed


def test_well_zeroed_readings_are_asked_nothing(tmp_path: Path) -> None:
    # 1 µm and 3 µm over the travel are less than the wave of the screw.
    assert run_job(job(tmp_path, shown(1e-3, 8e-6)), tmp_path / "out").passed


def test_what_is_far_below_the_gate_is_asked_nothing(tmp_path: Path) -> None:
    exact = np.full(len(PLACES), 5e-4) + 1e-5 * np.sin(PLACES)
    assert run_job(job(tmp_path, exact), tmp_path / "out").passed


def test_a_group_is_asked_as_well(tmp_path: Path) -> None:
    path = job(tmp_path, shown(0.03, 0.0), keys='group = "X"')
    second = (
        '[[fits]]\ncompensation = "backlash"\naxis = "X"\nmeasurement = "m"\n'
        'group = "X"\n'
    )
    path.write_text(path.read_text() + second)
    way = np.where(np.arange(len(PLACES)) % 2, 1, -1)
    head = "X.position [mm],X.error [mm],X.direction"
    both = shown(0.03, 0.0) + 2e-3 * way
    table(tmp_path / "m.csv", head, PLACES, both, way)
    with pytest.raises(
        JobError, match=r'a constant of .*say whose they are: remove = "none"'
    ):
        run_job(path, tmp_path / "out")


def test_a_plane_is_asked_for_its_slope_over_each_master(tmp_path: Path) -> None:
    x, y = (one.ravel() for one in np.meshgrid(np.arange(0, 101, 10.0), PLACES[::4]))
    error = 1e-4 * (y - y.mean()) + 5e-4 * np.random.default_rng(5).normal(size=x.size)
    table(
        tmp_path / "m.csv", "X.position [mm],Y.position [mm],Z.error [mm]", x, y, error
    )
    axes = "".join(f"[axes.{axis}]\nnumber = {k}\n" for k, axis in enumerate("XYZ", 1))
    keys = "start = [0, 0]\ninterval = [20, 40]\npoints = [6, 11]\n"
    fit = (
        'compensation = "plane"\naxis = "Z"\nmasters = ["X", "Y"]\nmeasurement = "m"\n'
    )
    path = tmp_path / "job.toml"
    path.write_text(f'{axes}[measurements.m]\nfile = "m.csv"\n[[fits]]\n{fit}{keys}')
    over_x, over_y = (
        r"a slope of \S+ ± \S+ µm/m over X",
        r"a slope of (99|100)\.\d+ ± \S+",
    )
    with pytest.raises(JobError, match=f"{over_x} and {over_y} µm/m over Y"):
        run_job(path, tmp_path / "out")


def test_a_whole_turn_has_no_slope(tmp_path: Path) -> None:
    turn = np.linspace(0.0, 350.0, 36)
    error = 0.05 + 1e-3 * np.sin(np.deg2rad(3 * turn))
    path = job(
        tmp_path, shown(0, 0), axis="C", interval=10.0, points=37, keys="modulo = true"
    )
    table(tmp_path / "m.csv", "C.position [deg],C.error [deg]", turn, error)
    match = r"found a constant of 50\.\d+ ± 0\.\d+ m° in the error of C"
    with pytest.raises(JobError, match=match):
        run_job(path, tmp_path / "out")


def test_a_table_over_a_whole_turn_closes_or_is_refused(tmp_path: Path) -> None:
    # Unclosed, the last node is a guess, and C jumps by it where a turn ends.
    turn = np.arange(0.0, 360.0, 15.0)
    error = 4e-3 * np.sin(np.deg2rad(turn))
    path = job(tmp_path, shown(0, 0), axis="C", interval=10.0, points=37)
    table(tmp_path / "m.csv", "C.position [deg],C.error [deg]", turn, error)
    match = r"for C, which .* no modulo, expected its whole turn and modulo = true"
    with pytest.raises(JobError, match=match):
        run_job(path, tmp_path / "out")
    assert not list((tmp_path / "out").glob("*"))


@pytest.mark.parametrize(
    ("start", "points", "found"),
    [(-180.0, 37, "from -180 to 180"), (-350.0, 36, "from -350 to 0"),
     (0.0, 35, "from 0 to 340")],
)  # fmt: skip
def test_nodes_over_another_turn_or_a_part_of_it_are_refused(
    tmp_path: Path, start: float, points: int, found: str
) -> None:
    # Positions wrap into the modulo range: nodes beside it are never reached, and between
    # the last one and the first one of the next turn the axis would step.
    turn = start + np.arange(0.0, 360.0, 15.0)
    error = 4e-3 * np.sin(np.deg2rad(turn))
    path = job(tmp_path, shown(0, 0), axis="C", interval=10.0, points=points)
    path.write_text(path.read_text().replace("start = 0.0", f"start = {start}"))
    table(tmp_path / "m.csv", "C.position [deg],C.error [deg]", turn, error)
    with pytest.raises(JobError, match=rf"{found} for C, .*goes\s+round from 0 to 360"):
        run_job(path, tmp_path / "out")
    if start == 0.0:  # with two ends it may be a part of the turn
        text = path.read_text()
        limits = "modulo = [0.0, 360.0]\nlimits = [0.0, 345.0]"
        text = text.replace("modulo = [0.0, 360.0]", limits)
        path.write_text(
            text.replace('file = "m.csv"', 'file = "m.csv"\nremove = "none"')
        )
        run_job(path, tmp_path / "out")


def test_a_list_with_the_compensation_asks_whether_it_was_on(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    run_job(screw_job(tmp_path), tmp_path / "out")
    path = screw_job(tmp_path, axis='list = "out/achskw1.lis"')
    path.write_text(path.read_text().replace("\nactive = []", ""))
    expected = (
        r"measurements\.laser: found no active, and .*achskw1\.lis holds leadscrew of X"
        r' already, expected active = \["leadscrew"\] if it was on while measuring'
        r".* or active = \[\] if it was off"
    )
    with pytest.raises(JobError, match=expected):
        run_job(path, tmp_path / "again")
    assert not list((tmp_path / "again").glob("*"))


def test_nodes_finer_than_readings_are_filled_marked_and_a_grid_is_proposed(
    tmp_path: Path,
) -> None:
    places = np.linspace(0.0, 400.0, 9)
    error = 0.01 * np.sin(places / 60.0)
    path = job(tmp_path, shown(0, 0), 'remove = "none"')
    table(tmp_path / "m.csv", "X.position [mm],X.error [mm]", places, error)
    (fit,) = run_job(path, tmp_path / "out").fits
    support = fit.support["pos"]  # type: ignore[attr-defined]
    assert (support > 0).sum() == 13
    words = " ".join(remark.message for remark in fit.remarks)
    assert "8 of 21 node values (X = 20; 80; 120;" in words
    assert "more nodes than readings" in words
    assert "start = 0, interval = 50, points = 9" in words
    # Between targets 50 mm apart, smoothness makes more of a wave of 60 mm than a line
    # does: 0.9 µm.
    values = fit.table["pos"]  # type: ignore[attr-defined]
    truth = 0.01 * np.sin(np.arange(0.0, 401.0, 20.0) / 60.0)
    assert np.max(np.abs(values - truth)) < 9e-4 + LIST_UNIT


def test_a_fit_without_nodes_is_told_which_suit_its_readings(tmp_path: Path) -> None:
    path = job(tmp_path, shown(0, 0))
    text = path.read_text()
    path.write_text(text[: text.index("start =")])
    match = (
        r"no nodes, expected .*suit the readings: start = 0, interval = 10, points = 41"
    )
    with pytest.raises(JobError, match=match):
        run_job(path, tmp_path / "out")


def test_a_place_that_is_far_off_leaves_the_constant_its_deviation() -> None:
    grid = np.stack(np.meshgrid(50.0 * np.arange(6), 40.0 * np.arange(5)), axis=-1)
    places = grid.reshape(-1, 2)
    places[0, 0] = 1e9  # rounded where its square stood beside the others: NaN
    values = 0.002 * np.random.default_rng(1).normal(size=30)
    found = trend_through(places, values).deviations[0]
    # Of 30 draws a standard deviation is known to 13 %; 2.6 of these.
    assert found == pytest.approx(0.002 / np.sqrt(30), rel=0.35)
