"""A small machine with every fault: its log as a job reads it, a fit, and the truth."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import (
    Measurement,
    measurement,
    read_table,
    without_motion,
)
from axcomp.ident.fit.joint import (
    AbstractEffect,
    Backlash,
    Cross,
    Crosstalk,
    Delay,
    JointData,
    JointFit,
    Leadscrew,
    Plane,
    Temperature,
    fit_joint,
)
from axcomp.ident.machine import (
    SPACE,
    MotionLog,
    State,
    WorkingMachine,
    machine_with_everything,
    record,
    work_programme,
    write_motion_log,
)

from . import whole

AXES = whole.AXES
PACE = 0.2


@pytest.fixture(scope="package")
def machine() -> WorkingMachine:
    return machine_with_everything(pace=PACE)


@pytest.fixture(scope="package")
def log(machine: WorkingMachine) -> MotionLog:
    """Four minutes of work, thinned to 50 rows a second."""
    return record(machine, work_programme(200.0, seed=3), seed=7).every(20)


@pytest.fixture(scope="package")
def measured(log: MotionLog, tmp_path_factory: pytest.TempPathFactory) -> Measurement:
    path: Path = tmp_path_factory.mktemp("whole") / "work.csv"
    write_motion_log(path, log)
    return measurement(read_table(path))


@pytest.fixture(scope="package")
def readings(measured: Measurement) -> JointData:
    """The log with the delays of its instruments found and taken off."""
    return whole.joint(without_motion(measured, AXES))


@pytest.fixture(scope="package")
def kept(readings: JointData) -> np.ndarray:
    """Rows that are fitted; every fifth second is held out."""
    assert readings.time is not None
    return np.asarray(np.floor(readings.time) % 5 != 0)


@pytest.fixture(scope="package")
def fit(readings: JointData, kept: np.ndarray) -> JointFit:
    return fit_joint(readings, effects(), use=kept, drift=2)


@pytest.fixture(scope="package")
def everywhere() -> tuple[JointData, State]:
    """Places all over the machine, warm and cold, for a fit and for the truth."""
    return whole.workspace(1)


def effects(fine: float = 1.0) -> list[AbstractEffect]:
    """Return what the machine has, with nodes as dense as asked for."""

    def nodes(axis: str, step: float) -> np.ndarray:
        return np.linspace(0.0, SPACE[axis], round(SPACE[axis] / step * fine) + 1)

    heights = np.array([[0.0], [100.0], [200.0]])
    return [
        Leadscrew("X", nodes("X", 40.0), bilateral=True),
        Temperature("X", {"coefficient": "scale"}, reference=250.0, lag=90.0 * PACE),
        Delay("X"),
        Leadscrew("Y", nodes("Y", 40.0)),
        Backlash("Y"),
        Cross("Y", master="X", setpoints=nodes("X", 20.0)),
        Crosstalk("Y", "X", 1500.0, -1500.0, ("Z",), heights),
        Delay("Y"),
        Leadscrew("Z", nodes("Z", 40.0)),
        Backlash("Z"),
        Plane("Z", ("X", "Y"), (nodes("X", 25.0), nodes("Y", 25.0))),
        Temperature("Z", {"offset": "spindle"}, lag=45.0 * PACE),
        Delay("Z"),
    ]
