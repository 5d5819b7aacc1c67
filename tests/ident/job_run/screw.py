"""A screw with pitch errors and lost motion, measured by a laser; and a job for it."""

from pathlib import Path

import numpy as np

from axcomp.data.lists import ListFile
from axcomp.ident.exchange import Motion, Reading, simulate
from axcomp.ident.job import JobResult
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


def laser(
    path: Path, scale: float = 1.0, runs: int = 3, offset: float | np.ndarray = 0.0
) -> None:
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
    # What a test does not state is measured with all off, zero and slope the machine's.
    for key, value in (("remove", '"none"'), ("active", "[]")):
        if f"{key} =" not in measurement:
            measurement += f"\n{key} = {value}"
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
        {} if direction is None else {axis: np.asarray(direction, np.int64)},
        None,
    )
    lists = [ListFile.read(folder / f"achskw{axis}.lis")]
    return simulate(lists, motion, Reading(Conventions()))[0].total


def grade(result: JobResult) -> dict[str, float]:
    return {name: figures.rms for name, figures in result.tables[0].error.items()}


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
