"""Masters that turn, logs in motion, and batches: what a group meets beside a probe."""

import json
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.batch._rows import rows_of
from axcomp.ident.job import CrosstalkResult, TableResult, run_job
from axcomp.ident.machine import machine_with_everything, record, work_programme

from . import machine as m

NOISE = 4e-4

TURNING = """
[axes.C]
number = 4
type = "rotary"
modulo = [0.0, 360.0]
[axes.X]
number = 1
[axes.Y]
number = 2
[measurements.turn]
file = "turn.csv"
remove = "none"
[[fits]]
compensation = "cross"
axis = "Y"
master = "C"
measurement = "turn"
start = 0.0
interval = 15.0
points = 25
{group}
"""
SCREW = """
[[fits]]
compensation = "leadscrew"
axis = "Y"
measurement = "turn"
start = 0.0
interval = 25.0
points = 13
{group}
"""


def around(angle: np.ndarray) -> np.ndarray:
    """Error of Y over the table's angle in mm: the same at 0 and 360°."""
    turn = np.radians(angle)
    return np.asarray(4e-3 * np.cos(turn) + 1.5e-3 * np.sin(3 * turn))


def turning(folder: Path, screw: bool) -> None:
    rng = np.random.default_rng(4)
    c, y = rng.uniform(-720.0, 720.0, 700), rng.uniform(0.0, 300.0, 700)
    error = around(c) + NOISE * rng.normal(size=700)
    if screw:
        error += 3e-3 * np.sin(y / 70.0)
    rows = [f"{a:.5f},{b:.5f},{e:.7f}" for a, b, e in zip(c, y, error, strict=True)]
    text = "\n".join(["C.position,Y.position,Y.error", *rows])
    (folder / "turn.csv").write_text(text + "\n")


@pytest.mark.parametrize("together", [False, True], ids=["alone", "in a group"])
def test_cross_table_over_a_modulo_master_closes(
    tmp_path: Path, together: bool
) -> None:
    turning(tmp_path, together)
    text = TURNING + (SCREW if together else "")
    path = tmp_path / "job.toml"
    path.write_text(text.format(group='group = "Y"' if together else ""))
    found = run_job(path, tmp_path / "out").fits[0]
    assert isinstance(found, TableResult)
    table = -found.table[""]
    assert table[0] == table[-1]
    shown = (table - table.mean()) - (lambda e: e - e.mean())(around(found.nodes[0]))
    # 700 readings over 24 nodes: 0.07 µm each; chords of 15° lie 0.2 µm off; 4 sd.
    assert np.abs(shown).max() < 5e-4
    # Two turns either way lie on one: 700 readings tell the rms to 2.7 %, 4 of them.
    assert found.error["predicted"].sound.rms < 1.11 * NOISE
    listing = ListFile.read(tmp_path / "out" / "achskw2.lis")
    entries = list(listing.table("kw.crosscomp", "correction").values())
    assert entries[0] == entries[-1]


MOVING = """
[axes.X]
number = 1
[axes.Y]
number = 2
[axes.Z]
number = 3
[measurements.log]
file = "log.csv"
remove = "offset"
"""
OF_Y = """
[[fits]]
compensation = "{kind}"
axis = "Y"
measurement = "log"
group = "Y"
{keys}
"""
GRID = "start = 0.0\ninterval = 50.0\npoints = {}\n"


@pytest.mark.slow
def test_crosstalk_backlash_and_tables_come_out_of_one_log_in_motion(
    tmp_path: Path,
) -> None:
    work = machine_with_everything()
    log = record(work, work_programme(150.0, seed=0), seed=1).every(18)
    columns = {"time": log.time, "Y.actual": log.actual["Y"]}
    columns |= {f"{axis}.encoder": log.encoder[axis] for axis in "XYZ"}
    np.savetxt(
        tmp_path / "log.csv", np.column_stack(list(columns.values())), delimiter=",",
        header=",".join(columns), comments="", fmt="%.7f",
    )  # fmt: skip
    path = tmp_path / "job.toml"
    path.write_text(
        MOVING
        + OF_Y.format(kind="leadscrew", keys=GRID.format(9))
        + OF_Y.format(kind="backlash", keys="")
        + OF_Y.format(kind="cross", keys='master = "X"\n' + GRID.format(17))
        + OF_Y.format(kind="crosstalk", keys='master = "X"\nadaptation = "Z"\n')
    )
    found = run_job(path, tmp_path / "out")
    one = found.groups[0].axes[0]
    # 0.5 µm of noise, a drift of the instrument beside, and 4 % for the rms itself.
    assert one.error["predicted"].sound.rms < 7e-4
    assert one.error["from_file"].sound.rms < 7e-4
    play = next(fit for fit in found.fits if fit.compensation == "backlash")
    # As the machine was made: 6 µm; a few hundred reversals of 0.5 µm readings.
    assert play.details()["parameters"]["backlash"] == pytest.approx(6e-3, abs=4e-4)
    crosstalk = found.fits[3]
    assert isinstance(crosstalk, CrosstalkResult)
    assert crosstalk.entries.size
    assert crosstalk.error["from_file"].sound.rms < crosstalk.error["before"].sound.rms
    words = " ".join(remark.message for remark in found.groups[0].remarks)
    moved = "Y was moving: its error is that of the reference"
    assert moved in words
    # Once for the group, not in each of its four fits.
    texts = [remark.message for fit in found.fits for remark in fit.remarks]
    assert not any(moved in text for text in texts)


def test_rows_of_a_batch_hold_every_fit_of_a_group(tmp_path: Path) -> None:
    m.probe(300).write(tmp_path)
    run_job(m.job(tmp_path, m.LEADSCREW + m.BACKLASH), tmp_path / "out")
    stored = json.loads((tmp_path / "out" / "result.json").read_text())
    rows = rows_of("job", "lists/job", False, "ab", stored)
    assert [row["compensation"] for row in rows] == ["leadscrew", "backlash"]
    assert all(row["passed"] for row in rows)
    stored["groups"][0]["remarks"].append({"level": "error", "message": "Not told."})
    rows = rows_of("job", "lists/job", False, "ab", stored)
    assert not any(row["passed"] for row in rows)
    assert all("Not told." in row["warnings"] for row in rows)
