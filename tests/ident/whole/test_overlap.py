"""New tables beside those that act already: fitted to the rest, or refused by name."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.cli import main

from .mill import (
    AXES,
    CROSS,
    NOISE,
    PLANE,
    X,
    Y,
    cross_by_hand,
    cross_list,
    edge,
    fit,
    left_over,
    measured,
    plane_by_hand,
    probe,
    sag,
    table,
)

ON = "kopf.achs_nr 3\nlr_param.crosscomp 1\n"


def with_lists(folder: Path, listing: str = "", machine: str = ON) -> str:
    """Write the lists of Z, an old cross for want of another; returns the axes of a job."""
    (folder / "z.lis").write_text(listing or cross_list())
    (folder / "zm.lis").write_text(machine)
    return AXES + 'list = "z.lis"\nmachine_data = "zm.lis"\n'


def test_cross_and_plane_from_two_files_do_not_correct_twice(tmp_path: Path) -> None:
    edge(tmp_path)
    probe(tmp_path)
    text = AXES + measured("edge") + measured("probe") + CROSS + PLANE
    assert fit(tmp_path, text) == 0
    left = left_over(ListFile.read(tmp_path / "out" / "achskw3.lis"))
    # Twice would leave 60 µm; 0.1 µm of noise on two readings per node, and two tables.
    assert np.ptp(left) < 1e-3
    whole = json.loads((tmp_path / "out" / "result.json").read_text())["whole"]["Z"]
    assert set(whole["compensations"]) == {"cross", "plane"}
    assert whole["switching"]["cross"] <= 0.02


def test_plane_first_takes_the_readings_of_the_cross_into_account(
    tmp_path: Path,
) -> None:
    edge(tmp_path)
    probe(tmp_path)
    text = AXES + measured("edge") + measured("probe") + PLANE + CROSS
    assert fit(tmp_path, text) == 0
    assert np.ptp(left_over(ListFile.read(tmp_path / "out" / "achskw3.lis"))) < 1e-3


def test_later_table_whose_readings_lack_a_master_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edge(tmp_path)
    probe(tmp_path)
    alone = measured("edge").replace('"X.position" = "x"\n', "")
    assert fit(tmp_path, AXES + alone + measured("probe") + PLANE + CROSS) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "found no X.position" in said
    assert "group" in said
    assert not (tmp_path / "out" / "achskw3.lis").exists()


def test_plane_beside_a_cross_that_was_off_is_fitted_to_the_rest(
    tmp_path: Path,
) -> None:
    probe(tmp_path)
    axes = with_lists(tmp_path)
    assert fit(tmp_path, axes + measured("probe", "active = []") + PLANE) == 0
    left = left_over(ListFile.read(tmp_path / "out" / "achskw3.lis"))
    assert np.max(np.abs(left)) < 1e-3


@pytest.mark.parametrize("acted", [False, True])
def test_a_settled_sign_beside_an_unsettled_one_proves_nothing_where_that_was_off(
    tmp_path: Path, acted: bool
) -> None:
    probe(tmp_path)
    (tmp_path / "c.toml").write_text('[verified]\nplane_sign = 1\nplane_index = "ji"\n')
    machine = '[machine]\nconventions = "c.toml"\n'
    axes = with_lists(tmp_path)
    active = f"active = {['cross'] if acted else []}"
    assert fit(tmp_path, machine + axes + measured("probe", active) + PLANE) == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    # With the other sign of the old cross, which acted in no reading, twice its size is left.
    assert result["fits"][0]["verdict"] == ("good" if acted else "unproven")
    assert ("cross_sign" in str(result["fits"][0]["reasons"])) == (not acted)
    steps = {step["action"]: step["detail"] for step in result["load_sheet"]}
    told = steps.get("Settle the sign first: plane of Z", "")
    assert ("with the lists that are loaded now" in told) == (not acted)


def test_an_old_table_that_waits_for_a_command_beside_one_that_does_not_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe(tmp_path)
    axes = with_lists(
        tmp_path, listing=cross_list() + "kw.crosscomp.manual_activation 1\n"
    )
    job = axes + measured("probe", "active = []") + PLANE
    told = (
        "waits for Z[COMP ON CROSS] (manual_activation 1), and what is written does not"
    )
    for waits in (False, True):
        assert fit(tmp_path, job + "manual_activation = true\n" * waits) == 0
        assert (told in " ".join(capsys.readouterr().out.split())) == (not waits)


def test_a_plane_of_what_a_cross_of_the_same_job_leaves_rests_on_its_sign(
    tmp_path: Path,
) -> None:
    edge(tmp_path)
    probe(tmp_path)
    (tmp_path / "c.toml").write_text('[verified]\nplane_sign = 1\nplane_index = "ji"\n')
    machine = '[machine]\nconventions = "c.toml"\n'
    both = measured("edge", "active = []") + measured("probe", "active = []")
    assert fit(tmp_path, machine + AXES + both + CROSS + PLANE) == 0
    fits = json.loads((tmp_path / "out" / "result.json").read_text())["fits"]
    assert [one["verdict"] for one in fits] == ["unproven", "unproven"]


@pytest.mark.parametrize("machine", ["kenngr.achs_typ 1\n", "# nothing\n"])
def test_an_axis_list_that_switches_nothing_on_is_one_all_the_same(
    tmp_path: Path, machine: str
) -> None:
    probe(tmp_path)
    axes = with_lists(tmp_path, machine=machine)
    assert fit(tmp_path, axes + measured("probe", "active = []") + PLANE) == 0
    listing = ListFile.read(tmp_path / "out" / "achskw3.lis")
    x, y = (
        line.ravel() for line in np.meshgrid([0.0, 200.0, 400.0], [0.0, 150.0, 300.0])
    )
    # The plane holds all of the sag, since no cross acts beside it.
    left = sag(x, y) + plane_by_hand(listing, x, y)
    assert np.max(np.abs(left)) < 1e-3


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize(("remove", "stopped"), [("none", True), ("offset", False)])
def test_constant_of_an_old_table_over_an_axis_that_stood_somewhere_is_asked_for(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    named: bool,
    remove: str,
    stopped: bool,
) -> None:
    # Measured where Y stood: the cross over Y was off, and adds there what nobody knows.
    place = np.arange(0.0, 401.0, 50.0)
    table(tmp_path / "line.csv", "x,dz", place, 0.02 * np.sin(place / 100.0) + 0.06)
    axes = with_lists(tmp_path)
    if not named:
        axes = axes.replace("[axes.Y]\nnumber = 2\nlimits = [0, 300]\n", "")
    readings = (
        f'[measurements.line]\nfile = "line.csv"\nremove = "{remove}"\nactive = []\n'
        '[measurements.line.columns]\n"Z.position" = "x"\n"Z.error" = "dz"\n'
    )
    screw = (
        '[[fits]]\ncompensation = "leadscrew"\naxis = "Z"\nmeasurement = "line"\n'
        "start = 0.0\ninterval = 50.0\npoints = 9\nsmoothness = 0\n"
    )
    assert fit(tmp_path, axes + readings + screw) == stopped
    said = " ".join(capsys.readouterr().out.split())
    assert ("it lacks Y.position" in said) == (stopped and named)
    # An axis that the job does not name was taken for one that stands at zero, unsaid.
    assert ("[axes.A2] number = 2" in said) == (stopped and not named)


def test_plane_beside_a_cross_of_which_nothing_is_said_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe(tmp_path)
    axes = with_lists(tmp_path)
    assert fit(tmp_path, axes + measured("probe") + PLANE) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "measurements.probe.active" in said
    assert 'active = ["cross"] if it was on, [] if it was off' in said


def test_plane_beside_a_cross_that_may_act_asks_for_the_axis_list(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe(tmp_path)
    (tmp_path / "z.lis").write_text(cross_list())
    axes = AXES + 'list = "z.lis"\n'
    assert fit(tmp_path, axes + measured("probe", "active = []") + PLANE) == 1
    assert "machine_data = the axis list" in " ".join(capsys.readouterr().err.split())


def test_plane_beside_a_cross_that_is_switched_off_replaces_it(tmp_path: Path) -> None:
    probe(tmp_path)
    axes = with_lists(tmp_path, machine=ON.replace("crosscomp 1", "crosscomp 0"))
    assert fit(tmp_path, axes + measured("probe") + PLANE) == 0
    machine = ListFile.read(tmp_path / "out" / "achsmds3.lis")
    assert machine.integer("lr_param.crosscomp") == 0
    assert machine.integer("lr_param.crosscomp2") == 1


def test_cross_that_acted_in_the_readings_and_is_switched_off_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe(tmp_path)
    axes = with_lists(tmp_path, machine=ON.replace("crosscomp 1", "crosscomp 0"))
    assert fit(tmp_path, axes + measured("probe", 'active = ["cross"]') + PLANE) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "measurements.probe.active" in said
    assert "lr_param.crosscomp 1 there if it will act" in said
    assert not (tmp_path / "out").exists()


def test_axis_whose_list_cannot_be_read_is_not_let_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe(tmp_path)
    lost = cross_list().replace("kw.crosscomp.master_ax_nr 2\n", "")
    axes = with_lists(tmp_path, listing=lost)
    assert fit(tmp_path, axes + measured("probe", 'active = ["cross"]') + PLANE) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "What acts on Z cannot be judged as a whole" in said
    assert "switch its compensation off in the axis list" in said


@pytest.mark.parametrize("times", [-1.0, 100.0])
def test_right_list_beside_a_wrong_one_is_not_to_be_taken_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], times: float
) -> None:
    edge(tmp_path)
    x, y = (np.tile(each.ravel(), 2) for each in np.meshgrid(X, Y))
    bump = 0.02 * np.sin(np.pi * x / 200.0)  # what only the plane holds
    noise = NOISE * np.random.default_rng(3).standard_normal((2, len(x)))
    table(tmp_path / "probe.csv", "x,y,dz", x, y, sag(x, y) + bump + noise[0])
    text = AXES + measured("edge") + measured("probe") + CROSS + PLANE
    assert fit(tmp_path, text) == 0
    listing = ListFile.read(tmp_path / "out" / "achskw3.lis")
    adds = plane_by_hand(listing, x, y) + times * cross_by_hand(listing, y)
    again = sag(x, y) + bump + adds + noise[1]
    table(tmp_path / "again.csv", "x,y,dz", x, y, again)
    more = 'active = ["cross", "plane"]'
    after = AXES + 'list = "out/achskw3.lis"\n' + measured("again", more)
    (tmp_path / "after.toml").write_text(after)
    job, out = str(tmp_path / "job.toml"), str(tmp_path / "out")
    assert main(["fit", job, "--out", out, "--after", str(tmp_path / "after.toml")])
    fits = json.loads((tmp_path / "out" / "result.json").read_text())["fits"]
    assert [one["reasons"][0]["code"] for one in fits] == ["diagnosed", "beside"]
    assert "the cross of Z is wrong" in " ".join(capsys.readouterr().out.split())


def again(folder: Path, acts: tuple[float, float], *names: str) -> list[dict[str, Any]]:
    """Fits of cross and plane that act so many times, by second readings of the same names."""
    edge(folder)
    x, y = (np.tile(each.ravel(), 2) for each in np.meshgrid(X, Y))
    noise = 1e-3 * np.random.default_rng(3).standard_normal((2, len(x)))
    table(folder / "probe.csv", "x,y,dz", x, y, sag(x, y) + noise[0])
    plane = PLANE.replace("smoothness = 0\n", "")
    assert fit(folder, AXES + measured("edge") + measured("probe") + CROSS + plane) == 0
    listing = ListFile.read(folder / "out" / "achskw3.lis")
    adds = acts[0] * cross_by_hand(listing, y) + acts[1] * plane_by_hand(listing, x, y)
    after, more = AXES + 'list = "out/achskw3.lis"\n', 'active = ["cross", "plane"]'
    for name in names:
        rows = x == 200.0 if name == "edge" else slice(None)
        left = sag(x, y) + adds + noise[1]
        table(folder / f"{name}2.csv", "x,y,dz", x[rows], y[rows], left[rows])
        after += measured(name, more).replace(".csv", "2.csv")
    (folder / "after.toml").write_text(after)
    job, out = str(folder / "job.toml"), str(folder / "out")
    assert main(["fit", job, "--out", out, "--after", str(folder / "after.toml")])
    return list(json.loads((folder / "out" / "result.json").read_text())["fits"])


@pytest.mark.parametrize("acts", [-1.0, 0.0, 2.0])
def test_list_of_which_nothing_sure_is_known_is_not_blamed_for_a_wrong_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], acts: float
) -> None:
    # Of a plane that slopes noisy readings do not tell where it begins.
    fits = again(tmp_path, (acts, 1.0), "edge", "probe")
    assert fits[1]["diagnosis"]["verdict"] == "cannot tell"
    assert [one["reasons"][0]["code"] for one in fits] == ["diagnosed", "beside"]
    said = " ".join(capsys.readouterr().out.split())
    assert "Not known yet, as one part of what moves Z" in said


def test_readings_that_do_not_see_a_list_verify_no_part_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Along one edge the plane adds next to nothing that changes, and acts turned round.
    cross, plane = again(tmp_path, (1.0, -1.0), "edge")
    assert cross["reasons"][0]["code"] == "verified"
    assert [each["code"] for each in plane["reasons"]] == ["diagnosed", "assumed"]
    said = " ".join(capsys.readouterr().out.split())
    assert "which saw X at 200 mm only" in said
    assert "Verified in part" not in said


@pytest.mark.parametrize("limit", [500, 0])
def test_a_table_beside_an_external_compensation_is_not_let_out(
    tmp_path: Path, limit: int
) -> None:
    edge(tmp_path)
    machine = (
        f"kopf.achs_nr 3\nlr_param.crosscomp 0\nlr_param.ext_comp.err_limit {limit}\n"
    )
    axes = with_lists(tmp_path, machine=machine)
    assert fit(tmp_path, axes + measured("edge", "active = []") + CROSS) == bool(limit)
    assert (tmp_path / "out" / "achskw3.lis").exists() == (not limit)
    (one,) = json.loads((tmp_path / "out" / "result.json").read_text())["fits"]
    told = [each for each in one["remarks"] if "external compensation" in str(each)]
    assert len(told) == bool(limit)
    assert ('state active = ["cross"]' in str(told)) == bool(limit)


def test_a_group_beside_an_old_table_is_held_to_what_it_leaves_as_a_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(14)
    x = np.tile(np.concatenate([X, X[::-1]]), 6)
    way = np.tile(np.repeat([1, -1], len(X)), 6)
    y, run = (np.repeat(each, 2 * len(X)) for each in (Y[1:7], np.arange(1, 7)))
    error = 6e-3 * np.sin(x / 60.0) + 5e-3 * way + NOISE * rng.standard_normal(len(x))
    table(tmp_path / "x.csv", "x,y,ex,way,run", x, y, error, way, run)
    # Off while measuring, and 4 µm rms when it is on: less than the backlash alone.
    (tmp_path / "x.lis").write_text(cross_list(number=1, size=6e-3))
    read = measured("x", "active = []").replace('"Z.error" = "dz"', '"X.error" = "ex"')
    screw = 'compensation = "leadscrew"\nstart = 0.0\ninterval = 50.0\n'
    fits = [f"{screw}points = {len(X)}\n", 'compensation = "backlash"\n']
    own = '[[fits]]\naxis = "X"\ngroup = "g"\nmeasurement = "x"\n'
    job = AXES.replace("[axes.Y]", 'list = "x.lis"\n[axes.Y]') + read
    job += '"X.direction" = "way"\nrun = "run"\n' + "".join(own + each for each in fits)
    assert fit(tmp_path, job) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "the leadscrew and backlash alone leave" in said
    assert "it and cross correct the same error" in said
    assert not (tmp_path / "out" / "achskw1.lis").exists()


def test_a_cross_that_stands_in_the_list_of_its_master_is_not_overlooked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe(tmp_path)
    (tmp_path / "y.lis").write_text(cross_list(number=2, master=3))
    (tmp_path / "rules.toml").write_text('cross_list = "master"\n')
    job = (
        AXES.replace("[axes.Z]", 'list = "y.lis"\n[axes.Z]') + measured("probe") + PLANE
    )
    # The other way round it is one of Y over Z, and no matter of the plane.
    assert fit(tmp_path, job) == 0
    assert fit(tmp_path, '[machine]\nconventions = "rules.toml"\n' + job) == 1
    assert "axes.Y.list: found a cross in" in capsys.readouterr().err
