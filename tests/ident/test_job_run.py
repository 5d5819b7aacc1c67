"""Jobs end to end with a known truth: what is written does to the error."""

import json
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile, check
from axcomp.ident.exchange import Motion, simulate
from axcomp.ident.job import JobError, JobResult, run_job
from axcomp.models import Conventions

LIST_UNIT = 1e-4


def table(path: Path, header: str, *columns: np.ndarray) -> None:
    rows = zip(*(column.tolist() for column in columns), strict=True)
    lines = [header, *(",".join(f"{cell!r}" for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")


def screw_error(position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Piecewise linear between the nodes 0, 100, … 400, so that a table can hold it."""
    nodes = np.arange(0.0, 401.0, 100.0)
    up = np.array([0.0, 0.012, 0.02, 0.011, -0.005])
    down = up - np.array([0.003, 0.004, 0.006, 0.004, 0.003])
    both = np.interp(position, nodes, up), np.interp(position, nodes, down)
    return np.where(direction > 0, *both)


def laser(path: Path, scale: float = 1.0, runs: int = 3, offset: float = 0.0) -> None:
    rng = np.random.default_rng(7)
    there = np.arange(0.0, 401.0, 50.0)
    target = np.tile(np.concatenate([there, there[::-1]]), runs)
    direction = np.tile(np.repeat([1, -1], len(there)), runs)
    run = np.repeat(np.arange(1, runs + 1), 2 * len(there))
    # 0.1 µm of noise: small beside every effect that is tested.
    error = scale * screw_error(target, direction) + 1e-4 * rng.standard_normal(
        len(run)
    )
    table(
        path, "target,actual,run,direction",
        target, target + error + offset, run, direction,
    )  # fmt: skip


SCREW_JOB = """
title = "screw"
[axes.X]
number = 1
{axis}
[measurements.laser]
file = "laser.csv"
{measurement}
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
bilateral = true
start = 0.0
interval = 100.0
points = 5
{fit}
smoothness = 0
loss = "gauss"
"""


def screw_job(
    folder: Path, *, axis: str = "", measurement: str = "", fit: str = ""
) -> Path:
    job = folder / "job.toml"
    job.write_text(SCREW_JOB.format(axis=axis, measurement=measurement, fit=fit))
    return job


def state_conventions(job: Path) -> None:
    head = '[machine]\nconventions = "mill.toml"\n[axes.X]'
    job.write_text(job.read_text().replace("[axes.X]", head))


def offsets(folder: Path, axis: int, **positions: np.ndarray) -> np.ndarray:
    """What `simulate` says that the written list adds; A1=… are positions, D=… ±1."""
    direction = positions.pop("D", None)
    motion = Motion(
        {int(name[1:]): values for name, values in positions.items()},
        {} if direction is None else {axis: direction},
        None,
    )
    lists = [ListFile.read(folder / f"achskw{axis}.lis")]
    return simulate(lists, motion, Conventions())[0].total


def grade(result: JobResult) -> dict[str, float]:
    return {name: figures.rms for name, figures in result.tables[0].error.items()}


def test_defaults_find_the_same_table_as_plain_means(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path)
    plain = run_job(job, tmp_path / "out")
    text = job.read_text().replace("smoothness = 0", "").replace('loss = "gauss"', "")
    job.write_text(text)
    auto = run_job(job, tmp_path / "out")
    for name in ("pos", "neg"):
        shift = auto.tables[0].table[name] - plain.tables[0].table[name]
        # Inside two standard errors, and rounding of both.
        allowed = 2 * auto.tables[0].standard_deviation[name] + LIST_UNIT
        assert np.all(np.abs(shift) < allowed)


def test_written_leadscrew_list_takes_the_error_away(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    result = run_job(screw_job(tmp_path), tmp_path / "out")
    position = np.tile(np.linspace(0.0, 400.0, 81), 2)
    direction = np.repeat([1, -1], 81)
    error = screw_error(position, direction)
    left = error + offsets(tmp_path / "out", 1, A1=position, D=direction)
    assert result.passed
    # A wrong sign would leave 40 µm; 0.1 µm of noise on 6 readings per node and 0.05 µm
    # of rounding leave well under 0.5 µm.
    assert np.max(np.abs(error)) > 0.015
    assert np.max(np.abs(left)) < 5e-4


def test_written_cross_list_takes_the_error_away(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(-10.0, 410.0, 85)
    nodes = np.arange(-10.0, 411.0, 60.0)
    truth = 0.02 * np.sin(nodes / 90.0)
    table(
        tmp_path / "edge.csv", "x,dy", x,
        np.interp(x, nodes, truth) + 1e-4 * rng.standard_normal(len(x)),
    )  # fmt: skip
    (tmp_path / "job.toml").write_text("""
[axes.X]
number = 1
limits = [-10, 410]
[axes.Y]
number = 2
[measurements.edge]
file = "edge.csv"
columns = { "X.position" = "x", "Y.error" = "dy" }
[[fits]]
compensation = "cross"
axis = "Y"
master = "X"
measurement = "edge"
smoothness = 0
start = -10.0
interval = 60.0
points = 8
n_cycles = 20
""")
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    left = truth + offsets(tmp_path / "out", 2, A1=nodes)
    assert result.passed
    # 0.1 µm of noise on some ten readings per node, 0.05 µm of rounding.
    assert np.max(np.abs(left)) < 3e-4
    written = ListFile.read(tmp_path / "out" / "achskw2.lis")
    assert written.integer("kw.crosscomp.n_cycles") == 20
    assert written.integer("kw.crosscomp.master_ax_nr") == 1


def test_written_plane_list_takes_the_error_away(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(-40.0, 61.0, 10.0), np.arange(-70.0, 31.0, 10.0))
    x, y = x.ravel(), y.ravel()
    # Bilinear, and different along the two masters: swapped indices would show.
    truth = 1e-4 * x - 3e-4 * y + 2e-6 * x * y
    noise = 1e-4 * rng.standard_normal(len(x))
    table(tmp_path / "probe.csv", "x,y,dz", x, y, 1e3 * (truth + noise))
    (tmp_path / "job.toml").write_text("""
[axes.X]
number = 1
[axes.Y]
number = 2
[axes.Z]
number = 3
name = "Z_ACHSE"
[measurements.probe]
file = "probe.csv"
[measurements.probe.columns]
"X.position" = { column = "x", unit = "mm" }
"Y.position" = { column = "y", unit = "mm" }
"Z.error" = { column = "dz", unit = "um" }
[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
measurement = "probe"
smoothness = 10
start = [-40.0, -70.0]
interval = [20.0, 10.0]
points = [6, 11]
""")
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    left = truth + offsets(tmp_path / "out", 3, A1=x, A2=y)
    assert result.passed
    # 0.1 µm of noise, one or two readings per node, 3 sigma, 0.05 µm of rounding.
    assert np.max(np.abs(left)) < 4e-4
    written = ListFile.read(tmp_path / "out" / "achskw3.lis")
    assert written.text("kw.crosscomp2.grid") == "RECTANGULAR"
    assert written.text("kopf.log_achs_name") == "Z_ACHSE"
    first = json.loads((tmp_path / "out" / "result.json").read_text())["fits"][0]
    assert np.shape(first["parameters"]["table"]) == (11, 6)
    # In mm and with the sign of the entry, which for a plane is the offset.
    assert first["parameters"]["table"][0][0] == pytest.approx(-truth[0], abs=5e-4)


def test_table_of_a_modulo_axis_closes(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    angle = np.tile(np.arange(0.0, 360.0, 10.0), 2)
    error = 4e-3 * np.sin(np.deg2rad(angle)) + 1e-3
    run = np.repeat([1, 2], 36)
    noise = 1e-4 * rng.standard_normal(len(angle))
    table(tmp_path / "c.csv", "run,c,e", run, angle, error + noise)
    (tmp_path / "job.toml").write_text("""
[axes.C]
number = 6
type = "rotary"
modulo = [0.0, 360.0]
[measurements.table]
file = "c.csv"
columns = { run = "run", "C.position" = "c", "C.error" = "e" }
[[fits]]
compensation = "leadscrew"
axis = "C"
measurement = "table"
smoothness = 0
modulo = true
start = 0.0
interval = 30.0
points = 13
""")
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    values = result.tables[0].table["pos"]
    assert result.tables[0].unit == "deg"
    assert values[0] == values[-1]
    at = np.array([-1.0, 0.0, 359.0, 361.0, 719.0])
    added = offsets(tmp_path / "out", 6, A6=at)
    # −1°, 359° and 719° are one place, up to the rounding of the wrapped angle.
    assert added[0] == pytest.approx(added[2], abs=1e-9)
    assert added[4] == pytest.approx(added[2], abs=1e-9)
    # Offset = −error; sagitta of a sine over 30° nodes is 0.14e-3, plus noise.
    assert added[1] == pytest.approx(-1e-3, abs=3e-4)


OLD_LIST = (
    "# Achse 1, Stand März\r\n"
    "kopf.achs_nr            1\r\n"
    "kopf.log_achs_name      X\r\n"
    "kw.crosscomp.unit 1 ( 0,1 µm )\r\n"
    "kw.crosscomp.last_index     1\r\n"
    "kw.crosscomp.master_ax_nr   2\r\n"
    "kw.crosscomp.table[0].setpoint   0\r\n"
    "kw.crosscomp.table[0].correction 0\r\n"
    "kw.crosscomp.table[1].setpoint   1000000\r\n"
    "kw.crosscomp.table[1].correction 0\r\n"
    "\r\n"
    "kw.ssfk.unit        1\r\n"
    "kw.ssfk.interval    1000000 /* 100 mm */\r\n"
    "kw.ssfk.kw_startpos 0\r\n"
    "kw.ssfk.kw_nr_max   5   # f\xfcnf\r\n"
    "kw.ssfk.bilateral   1\r\n"
    "kw.ssfk.modulo      0\r\n"
    "kw.ssfk.set_pos_without_comp 1\r\n"
    "kw.ssfk.res1        17\r\n"
    "kw.ssfk.table[ 0].pos     0   ;  Anfang\r\n"
    "kw.ssfk.table[ 1].pos   100\r\n"
    "kw.ssfk.table[ 2].pos   150\r\n"
    "kw.ssfk.table[ 3].pos    80\r\n"
    "kw.ssfk.table[ 4].pos   -40\r\n"
    "kw.ssfk.table[ 0].neg   -30\r\n"
    "kw.ssfk.table[ 1].neg    60\r\n"
    "kw.ssfk.table[ 2].neg    90\r\n"
    "kw.ssfk.table[ 3].neg    40\r\n"
    "kw.ssfk.table[ 4].neg   -70\r\n"
    "Ende\r\n"
)
OLD_POS = np.array([0, 100, 150, 80, -40]) * LIST_UNIT
OLD_NEG = np.array([-30, 60, 90, 40, -70]) * LIST_UNIT


def old_list(folder: Path) -> bytes:
    raw = OLD_LIST.replace("µ", "\xb5").encode("latin-1")
    (folder / "achskw1.lis").write_bytes(raw)
    return raw


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


def test_backlash_active_beside_a_bilateral_fit_is_refused(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path, measurement='active = ["backlash"]')
    with pytest.raises(JobError, match="found backlash for a bilateral leadscrew fit"):
        run_job(job, tmp_path / "out")


def test_written_lists_have_no_error_and_no_warning(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    run_job(screw_job(tmp_path), tmp_path / "out")
    files = [ListFile.read(path) for path in (tmp_path / "out").glob("*.lis")]
    assert len(files) == 3
    found = [*check(files), *(item for file in files for item in check([file]))]
    assert [item for item in found if item.level != "info"] == []


def test_fragment_names_no_whole_list(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    run_job(screw_job(tmp_path), tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"achskw1.lis", "achsmds1.add.lis", "hochlauf.add.lis"} <= names
    assert "achsmds1.lis" not in names
    assert "hochlauf.lis" not in names


def test_datum_makes_the_table_zero_there(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv", offset=0.05)
    plain = run_job(screw_job(tmp_path), tmp_path / "out")
    at_zero = run_job(
        screw_job(tmp_path, measurement="datum = { at = 200.0 }"), tmp_path / "out"
    )
    pos, neg = (at_zero.tables[0].table[name][2] for name in ("pos", "neg"))
    # Mean of both directions, up to rounding of each.
    assert 0.5 * (pos + neg) == pytest.approx(0.0, abs=LIST_UNIT)
    whole = plain.tables[0].table["pos"] - at_zero.tables[0].table["pos"]
    # All nodes move by the same constant: 50 µm and the mean of 20 and 14 µm.
    np.testing.assert_allclose(whole, 0.05 + 0.017, atol=3e-4)


def test_run_effects_leave_reversal_and_mean_alone(tmp_path: Path) -> None:
    # Runs numbered per direction, each with an offset of its own.
    rng = np.random.default_rng(13)
    there = np.arange(0.0, 401.0, 50.0)
    rows = []
    for k in range(6):
        sense = 1 if k % 2 == 0 else -1
        own = np.full(len(there), sense)
        path = there[::sense]
        error = screw_error(path, own) + 2e-3 * (k // 2 - 1)
        rows.append((path, error, np.full(len(there), k + 1), own))
    target, error, run, direction = (np.concatenate(part) for part in zip(*rows))  # noqa: B905
    error = error + 1e-4 * rng.standard_normal(len(error))
    table(
        tmp_path / "laser.csv", "target,actual,run,direction",
        target, target + error, run, direction,
    )  # fmt: skip
    result = run_job(screw_job(tmp_path), tmp_path / "out")
    nodes = np.arange(0.0, 401.0, 100.0)
    ones = np.ones(5, dtype=np.int64)
    found = result.tables[0].table
    np.testing.assert_allclose(found["pos"], screw_error(nodes, ones), atol=5e-4)
    np.testing.assert_allclose(found["neg"], screw_error(nodes, -ones), atol=5e-4)
    assert len(result.tables[0].fit.runs) == 3


def test_second_fit_of_an_axis_takes_what_the_first_leaves(tmp_path: Path) -> None:
    rng = np.random.default_rng(17)
    x, y = (
        a.ravel() for a in np.meshgrid(np.arange(0, 101, 10.0), np.arange(0, 51, 10.0))
    )
    truth = 3e-4 * x + 2e-4 * y
    noise = 1e-4 * rng.standard_normal(len(x))
    table(tmp_path / "probe.csv", "x,y,dz", x, y, truth + noise)
    (tmp_path / "job.toml").write_text("""
[axes.X]
number = 1
limits = [0, 100]
[axes.Y]
number = 2
[axes.Z]
number = 3
[measurements.probe]
file = "probe.csv"
columns = { "X.position" = "x", "Y.position" = "y", "Z.error" = "dz" }
[[fits]]
compensation = "cross"
axis = "Z"
master = "X"
measurement = "probe"
smoothness = 10
start = 0.0
interval = 50.0
points = 3
[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
measurement = "probe"
smoothness = 10
start = [0.0, 0.0]
interval = [50.0, 50.0]
points = [3, 2]
""")
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    left = truth + offsets(tmp_path / "out", 3, A1=x, A2=y)
    # Both tables together correct once; each alone for all of it would double.
    assert np.max(np.abs(left)) < 4e-4
    assert any("earlier fit" in r.message for r in result.tables[1].remarks)


def test_result_holds_what_the_interface_promises(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    run_job(screw_job(tmp_path), tmp_path / "out")
    text = (tmp_path / "out" / "result.json").read_text()
    found = json.loads(text)
    assert "NaN" not in text
    assert {"inputs", "versions", "wall_time"} <= set(found)
    assert set(found["inputs"]) == {"job.toml", "laser.csv"}
    fit = found["fits"][0]
    for key in (
        "compensation", "axis", "parameters", "standard_deviations", "support",
        "noise", "smoothness", "error", "gate", "findings", "conventions",
    ):  # fmt: skip
        assert key in fit
    assert set(fit["parameters"]["table"]) == {"pos", "neg"}
    assert np.shape(fit["support"]["neg"]) == (5,)
    for stage in ("before", "predicted", "from_file"):
        assert {"rms", "max", "A", "R", "B", "E", "M"} <= set(fit["error"][stage])
    states = {item["name"]: item["state"] for item in fit["conventions"]}
    assert states["leadscrew_sign"] == "assumed"


def test_conventions_of_the_machine_turn_the_sign(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path)
    plain = run_job(job, tmp_path / "out")
    (tmp_path / "mill.toml").write_text("leadscrew_sign = 1\n")
    state_conventions(job)
    turned = run_job(job, tmp_path / "out")
    np.testing.assert_array_equal(
        turned.tables[0].table["pos"], -plain.tables[0].table["pos"]
    )
    states = {rule.name: rule.state for rule in turned.tables[0].conventions}
    assert states["leadscrew_sign"] == "verified"
    assert states["start_direction"] == "assumed"


def test_unknown_convention_names_the_nearest(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path)
    (tmp_path / "mill.toml").write_text("leadscrew_sing = 1\n")
    state_conventions(job)
    with pytest.raises(JobError, match=r"mill.toml:1: .*'leadscrew_sign'"):
        run_job(job, tmp_path / "out")


def test_gantry_partner_without_a_table_is_a_warning(tmp_path: Path) -> None:
    x = np.linspace(0.0, 100.0, 21)
    table(tmp_path / "edge.csv", "x,dy", x, 1e-4 * np.sin(x))
    (tmp_path / "job.toml").write_text("""
[axes.X]
number = 1
limits = [0, 100]
[axes.Y]
number = 2
gantry = "Y2"
[axes.Y2]
number = 5
[measurements.edge]
file = "edge.csv"
columns = { "X.position" = "x", "Y.error" = "dy" }
[[fits]]
compensation = "cross"
axis = "Y"
master = "X"
measurement = "edge"
smoothness = 1
start = 0.0
interval = 25.0
points = 5
""")
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    warned = [r.message for r in result.tables[0].remarks if r.level == "warning"]
    assert any(
        "axis 5, gantry partner of axis 2, has no list" in text for text in warned
    )
    assert result.passed


def test_table_that_was_off_and_stays_in_the_list_is_named(tmp_path: Path) -> None:
    raw = OLD_LIST.replace("µ", "u").replace(
        "table[1].correction 0", "table[1].correction 50"
    )
    (tmp_path / "achskw1.lis").write_bytes(raw.encode("latin-1"))
    laser(tmp_path / "laser.csv")
    off = run_job(screw_job(tmp_path, axis='list = "achskw1.lis"'), tmp_path / "out")
    assert any("also holds a cross table that was off" in r.message
               for r in off.tables[0].remarks)  # fmt: skip
    on = run_job(
        screw_job(
            tmp_path, axis='list = "achskw1.lis"', measurement='active = ["cross"]'
        ),
        tmp_path / "out",
    )
    assert not any("that was off" in r.message for r in on.tables[0].remarks)


def test_load_sheet_tells_files_order_check_and_the_way_back(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    result = run_job(screw_job(tmp_path), tmp_path / "out")
    text = "\n".join(f"{step.action}: {step.detail}" for step in result.load_sheet)
    for word in (
        "achskw1.lis", "achsmds1.add.lis", "hochlauf.add.lis", "Restart the controller",
        "X[COMP ON LEAD]", "V.A.LEAD_COMP_ACTIVE.X", "P-AXIS-00465", "Go back",
        "computed, not verified",
    ):  # fmt: skip
        assert word in text
    old_list(tmp_path)
    again = run_job(screw_job(tmp_path, axis='list = "achskw1.lis"'), tmp_path / "out")
    assert "Reload the lists" in {step.action for step in again.load_sheet}
