"""Lists that are there already: edited, added to or replaced, and nothing else changed."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.job import JobError, run_job

from .screw import (
    LIST_UNIT,
    OLD_NEG,
    OLD_POS,
    grade,
    laser,
    old_list,
    screw_error,
    screw_job,
    table,
)


def test_only_the_entries_of_the_refitted_table_change(tmp_path: Path) -> None:
    raw = old_list(tmp_path)
    laser(tmp_path / "laser.csv")
    result = run_job(screw_job(tmp_path, axis='list = "achskw1.lis"'), tmp_path / "out")
    new = (tmp_path / "out" / "achskw1.lis").read_bytes()
    before, after = raw.split(b"\r\n"), new.split(b"\r\n")
    assert len(before) == len(after)
    for old_line, new_line in zip(before, after, strict=True):
        if old_line != new_line:
            # The name, the blanks in its index and a comment stay where they are.
            assert old_line.startswith(b"kw.ssfk.table[ ")
            assert new_line[:21] == old_line[:21]
            assert old_line[21:].partition(b";")[2] == new_line[21:].partition(b";")[2]
    # 0 at X = 0 upwards is the truth as well, and may stay.
    changed = sum(a != b for a, b in zip(before, after, strict=True))
    assert 8 <= changed <= 10
    assert (tmp_path / "achskw1.lis").read_bytes() == raw
    assert result.passed


@pytest.mark.parametrize("active", [True, False])
def test_active_table_is_added_to_and_an_inactive_one_replaced(
    tmp_path: Path, active: bool
) -> None:
    old_list(tmp_path)
    # Measured with the old table on, half of the error is left.
    laser(tmp_path / "laser.csv", scale=0.5)
    state = '["leadscrew"]' if active else "[]"
    result = run_job(
        screw_job(
            tmp_path, axis='list = "achskw1.lis"', measurement=f"active = {state}"
        ),
        tmp_path / "out",
    )
    nodes = np.arange(0.0, 401.0, 100.0)
    ones = np.ones(5, dtype=np.int64)
    residual = 0.5 * screw_error(nodes, ones), 0.5 * screw_error(nodes, -ones)
    found = result.tables[0].table
    old = (OLD_POS, OLD_NEG) if active else (0.0, 0.0)
    # Leadscrew entries are errors, so old + residual; noise and rounding as above.
    np.testing.assert_allclose(found["pos"], old[0] + residual[0], atol=5e-4)
    np.testing.assert_allclose(found["neg"], old[1] + residual[1], atol=5e-4)
    assert grade(result)["from_file"] < 0.05 * grade(result)["before"]


def test_active_plane_is_added_to_with_the_sign_of_a_plane(tmp_path: Path) -> None:
    x, y = np.meshgrid(np.arange(0.0, 41.0, 10.0), np.arange(0.0, 31.0, 10.0))
    x, y = x.ravel(), y.ravel()
    rng = np.random.default_rng(11)
    residual = 2e-4 * x + 1e-4 * y
    noise = 5e-5 * rng.standard_normal(len(x))
    table(tmp_path / "probe.csv", "x,y,dz", x, y, residual + noise)
    head = {
        "unit": 1, "interval": 100_000, "last_index_master1": 4,
        "last_index_master2": 3, "start_position_master1": 0,
        "start_position_master2": 0, "master1_ax_nr": 1, "master2_ax_nr": 2,
    }  # fmt: skip
    lines = ["kopf.achs_nr 3", "kopf.log_achs_name Z"]
    lines += [f"kw.crosscomp2.{key} {value}" for key, value in head.items()]
    lines += [
        f"kw.crosscomp2.table[{j}][{i}].correction {10 * i - 20 * j}"
        for j in range(4)
        for i in range(5)
    ]
    (tmp_path / "achskw3.lis").write_text("\n".join(lines) + "\n")
    (tmp_path / "job.toml").write_text("""
[axes.X]
number = 1
[axes.Y]
number = 2
[axes.Z]
number = 3
list = "achskw3.lis"
[measurements.probe]
file = "probe.csv"
remove = "none"
active = ["plane"]
columns = { "X.position" = "x", "Y.position" = "y", "Z.error" = "dz" }
[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
measurement = "probe"
smoothness = 10
""")
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    j, i = np.mgrid[0:4, 0:5]
    expected = (10 * i - 20 * j) * LIST_UNIT - (2e-3 * i + 1e-3 * j)
    # Plane entries are offsets: old − residual. 0.05 µm noise, 0.05 µm rounding.
    np.testing.assert_allclose(result.tables[0].table[""], expected, atol=3e-4)
    assert grade(result)["from_file"] < 0.05 * grade(result)["before"]


def test_an_old_table_keeps_its_shape_in_a_gap_that_nobody_read(tmp_path: Path) -> None:
    old_list(tmp_path)
    active = 'active = ["leadscrew"]'
    job = screw_job(tmp_path, axis='list = "achskw1.lis"', measurement=active)
    laser(tmp_path / "laser.csv")
    head, *rows = (tmp_path / "laser.csv").read_text().splitlines()
    ends = [row for row in rows if float(row.split(",")[0]) in (0.0, 400.0)]
    (tmp_path / "laser.csv").write_text("\n".join([head, *ends]) + "\n")
    (fit,) = run_job(job, tmp_path / "out").fits
    said = [remark.message for remark in fit.remarks if remark.level == "warning"]
    words = (
        "The old table keeps its shape in a gap: no reading lies between X = 0 and 400,"
    )
    assert any(each.startswith(words) for each in said)


def test_nodes_missing_from_an_active_table_are_named(tmp_path: Path) -> None:
    old_list(tmp_path)
    laser(tmp_path / "laser.csv")
    job = screw_job(
        tmp_path, axis='list = "achskw1.lis"', measurement='active = ["leadscrew"]'
    )
    job.write_text(
        job.read_text()
        .replace("interval = 100.0", "interval = 200.0")
        .replace("points = 5", "points = 3")
    )
    with pytest.raises(JobError, match="nodes of axis 1 at 100, 300 in the table that"):
        run_job(job, tmp_path / "out")
    job.write_text(
        job.read_text()
        .replace("interval = 200.0", "interval = 50.0")
        .replace("points = 3", "points = 9")
    )
    assert run_job(job, tmp_path / "out").passed  # a superset


def test_active_without_the_list_that_was_active_is_refused(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path, measurement='active = ["leadscrew"]')
    with pytest.raises(
        JobError, match="leadscrew was active while measuring, but no l"
    ):
        run_job(job, tmp_path / "out")


def test_shrinking_table_loses_its_stale_entries(tmp_path: Path) -> None:
    old_list(tmp_path)
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path, axis='list = "achskw1.lis"')
    job.write_text(
        job.read_text()
        .replace("interval = 100.0", "interval = 200.0")
        .replace("points = 5", "points = 3")
        .replace("bilateral = true", "")
    )
    run_job(job, tmp_path / "out")
    written = ListFile.read(tmp_path / "out" / "achskw1.lis")
    assert written.table("kw.ssfk", "neg") == {}
    assert sorted(written.table("kw.ssfk", "pos")) == [0, 1, 2]
    assert written.integer("kw.ssfk.bilateral") == 0
    assert written.integer("kw.ssfk.res1") == 17
    assert written.table("kw.crosscomp", "setpoint") == {0: 0, 1: 1_000_000}


def test_axis_list_is_edited_and_its_backlash_switched_off(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    machine = (
        "kopf.achs_nr 1\nlr_param.anwahl_losekomp 1 # wie gemessen\n"
        "getriebe[0].lose 50\nlr_param.ssfk 0\n"
    )
    (tmp_path / "achsmds1.lis").write_text(machine)
    result = run_job(
        screw_job(tmp_path, axis='machine_data = "achsmds1.lis"'), tmp_path / "out"
    )
    text = (tmp_path / "out" / "achsmds1.lis").read_text()
    assert "lr_param.anwahl_losekomp 0 # wie gemessen\ngetriebe[0].lose 50\n" in text
    assert "lr_param.ssfk 1\n" in text
    # 6 µm of reversal: 2 cycles of 1 ms make 3 mm/s and 3000 mm/s².
    assert result.tables[0].cycles == 2
    assert ListFile.parse(text.encode()).integer("lr_param.n_backlash_cyc") == 2
    assert any("switched off" in r.message for r in result.tables[0].remarks)
    assert not (tmp_path / "out" / "achsmds1.add.lis").exists()
    assert (tmp_path / "achsmds1.lis").read_text() == machine


def test_entries_to_add_are_no_axis_list(tmp_path: Path) -> None:
    # Copied over the controller's, it would lose limits, gains and all that acts.
    laser(tmp_path / "laser.csv")
    run_job(screw_job(tmp_path), tmp_path / "out")
    added = tmp_path / "out" / "achsmds1.add.lis"
    (tmp_path / "axis.lis").write_bytes(added.read_bytes())
    path = screw_job(tmp_path, axis='machine_data = "axis.lis"')
    with pytest.raises(JobError, match="found entries to add to an axis list"):
        run_job(path, tmp_path / "again")


@pytest.mark.parametrize(("width", "refused"), [(0.0, True), (0.008, False)])
def test_backlash_of_the_axis_list_of_which_no_reading_shows_stops_a_table(
    tmp_path: Path, width: float, refused: bool
) -> None:
    places = np.arange(0.0, 401.0, 20.0)
    target = np.tile(np.concatenate([places, places[::-1]]), 3)
    way = np.tile(np.repeat([1, -1], len(places)), 3)
    run = np.repeat([1, 2, 3], 2 * len(places))
    noise = 5e-4 * np.random.default_rng(2).standard_normal(len(run))
    error = 0.012 * np.sin(target / 70.0) + width * (way < 0) + noise
    rows = np.stack([target, error, run, way], axis=1)
    np.savetxt(
        tmp_path / "laser.csv", rows, "%.6f", ",", comments="",
        header="X.position,X.error,run,X.direction",
    )  # fmt: skip
    machine = "kopf.achs_nr 1\nlr_param.anwahl_losekomp 1\ngetriebe[0].lose 80\n"
    (tmp_path / "achsmds1.lis").write_text(machine)
    (tmp_path / "job.toml").write_text(
        '[axes.X]\nnumber = 1\nmachine_data = "achsmds1.lis"\n'
        '[measurements.laser]\nfile = "laser.csv"\nactive = []\nremove = "none"\n'
        '[[fits]]\ncompensation = "leadscrew"\naxis = "X"\nmeasurement = "laser"\n'
        "bilateral = false\nstart = 0.0\ninterval = 20.0\npoints = 21\n"
    )
    found = run_job(tmp_path / "job.toml", tmp_path / "out").fits[0]
    said = [each.message for each in found.remarks if each.level == "error"]
    assert any("parts the directions by 8 µm" in words for words in said) == refused


def test_a_bilateral_fit_names_the_direction_without_readings(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    head, *rows = (tmp_path / "laser.csv").read_text().splitlines()
    at = [name.strip() for name in head.split(",")].index("direction")
    up = [row for row in rows if float(row.split(",")[at]) > 0]
    (tmp_path / "laser.csv").write_text("\n".join([head, *up]) + "\n")
    with pytest.raises(JobError, match="found no reading in − direction of X"):
        run_job(screw_job(tmp_path), tmp_path / "out")


def test_backlash_active_beside_a_bilateral_fit_is_refused(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path, measurement='active = ["backlash"]')
    with pytest.raises(JobError, match="found backlash for a bilateral leadscrew fit"):
        run_job(job, tmp_path / "out")


def test_cross_that_takes_the_place_of_one_over_another_axis_is_said(
    tmp_path: Path,
) -> None:
    lines = "kopf.achs_nr 2\nkw.crosscomp.unit 1\nkw.crosscomp.last_index 1\n"
    lines += "kw.crosscomp.master_ax_nr 3\n"
    for k, value in enumerate((0, 300)):
        lines += f"kw.crosscomp.table[{k}].setpoint {1_000_000 * k}\n"
        lines += f"kw.crosscomp.table[{k}].correction {value}\n"
    (tmp_path / "y.lis").write_text(lines)
    place = np.tile(np.arange(0.0, 101.0, 10.0), 3)
    table(tmp_path / "m.csv", "x,e", place, 2e-4 * place)
    (tmp_path / "job.toml").write_text("""
[axes.X]
number = 1
[axes.Y]
number = 2
list = "y.lis"
[measurements.m]
file = "m.csv"
active = []
remove = "none"
columns = { "X.position" = "x", "Y.error" = "e" }
[[fits]]
compensation = "cross"
axis = "Y"
master = "X"
measurement = "m"
start = 0.0
interval = 50.0
points = 3
""")
    (fit,) = run_job(tmp_path / "job.toml", tmp_path / "out").tables
    (said,) = [one.message for one in fit.remarks if "takes its place" in one.message]
    assert "follows axis 3" in said


def test_correction_that_no_entry_holds_asks_for_the_unit_of_the_error(
    tmp_path: Path,
) -> None:
    laser(tmp_path / "laser.csv", scale=1e3)
    with pytest.raises(JobError, match=r"fits\[0\].*unit of X.error right"):
        run_job(screw_job(tmp_path), tmp_path / "out")


def test_limit_of_a_change_says_where_there_is_nothing_to_compare_with(
    tmp_path: Path,
) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path)
    job.write_text(job.read_text() + "[gate]\nmax_change = 0.001\n")
    (fit,) = run_job(job, tmp_path / "out").tables
    (said,) = [one.message for one in fit.remarks if "max_change" in one.message]
    assert "axes.X.list" in said


def test_list_whose_name_alone_says_another_axis_is_refused(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    (tmp_path / "achskw2.lis").write_text("kw.ssfk.unit 1\n")
    with pytest.raises(JobError, match=r"a list of axis 2 \(achskw2.lis\)"):
        run_job(screw_job(tmp_path, axis='list = "achskw2.lis"'), tmp_path / "out")


def test_table_that_was_on_while_its_axis_list_has_it_off_is_doubted(
    tmp_path: Path,
) -> None:
    old_list(tmp_path)
    laser(tmp_path / "laser.csv", scale=0.5)
    (tmp_path / "m.lis").write_text("kopf.achs_nr 1\nlr_param.ssfk 0\n")
    job = screw_job(
        tmp_path,
        axis='list = "achskw1.lis"\nmachine_data = "m.lis"',
        measurement='active = ["leadscrew"]',
    )
    (fit,) = run_job(job, tmp_path / "out").tables
    assert any("once too often" in one.message for one in fit.remarks)


@pytest.mark.parametrize(("scale", "doubted"), [(1.0, True), (0.3, False)])
def test_readings_with_the_error_that_a_table_takes_off_were_not_taken_with_it(
    tmp_path: Path, scale: float, doubted: bool
) -> None:
    old_list(tmp_path)
    laser(tmp_path / "laser.csv", scale=scale)
    axis, measurement = 'list = "achskw1.lis"', 'active = ["leadscrew"]'
    job = screw_job(tmp_path, axis=axis, measurement=measurement)
    (fit,) = run_job(job, tmp_path / "out").tables
    said = [one.message for one in fit.remarks if "Was it off?" in one.message]
    assert len(said) == doubted


@pytest.mark.parametrize("switched", [1, 0])
def test_readings_without_the_error_that_a_table_takes_off_were_not_taken_without_it(
    tmp_path: Path, switched: int
) -> None:
    old_list(tmp_path)
    (tmp_path / "axis.lis").write_text(f"kopf.achs_nr 1\nlr_param.ssfk {switched}\n")
    laser(tmp_path / "laser.csv", scale=0.02)
    axis = 'list = "achskw1.lis"\nmachine_data = "axis.lis"'
    result = run_job(screw_job(tmp_path, axis=axis), tmp_path / "out")
    said = [one.message for one in result.fits[0].remarks if one.level == "error"]
    # Where the axis list has switched it off, it may well have been wrong.
    assert len([words for words in said if "Was it on?" in words]) == switched
    assert result.passed == (not switched)
