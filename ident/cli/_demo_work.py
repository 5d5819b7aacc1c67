"""The second half of `axcomp demo`: the mill at work, all its faults in one log."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...data.lists import ListFile
from ...data.measurements import measurement, read_table, with_error, without_motion
from ...models import Conventions, TemperatureLine
from ..job import JobResult, TemperatureResult, run_job, write_atomically
from ..kinds import kind
from ..kinds.temperature._plc_table import read_temperature_table
from ..machine.motion import (
    WorkingMachine,
    machine_with_everything,
    record,
    work_programme,
    write_motion_log,
)

_SECONDS = 120.0
_EVERY = 20
"""Cycles per row of the log: 50 rows a second."""
_PACE = 0.15
"""It warms and cools that much faster than in half an hour of work."""
_SECOND_LOAD = 0.8
"""Heat of the second run: a thermal law ends where the temperatures of the first one did."""
_WILD = 6.0
_AXES = ("X", "Y", "Z")

_HEAD = """\
# The mill at work: one log in motion, every fault at once, all compensations off.
# Run it again with:  axcomp fit job.toml --out result
title = "Portal mill of the demo, at work"

[machine]
id = "demo-mill"

[axes.X]
number = 1
limits = [0.0, 800.0]
[axes.Y]
number = 2
limits = [0.0, 400.0]
[axes.Z]
number = 3
limits = [0.0, 200.0]

# Two clocks: the reference is late against the encoders; that is found and taken off.
[measurements.work]
file = "log.csv"
active = []
remove = "offset"                 # the zeros of the reference are arbitrary
[measurements.work.columns]
time = "time"
"temperature.scale" = "temperature.scale"
"temperature.spindle" = "temperature.spindle"
"""

_FITS = """
[[fits]]
compensation = "leadscrew"
axis = "X"
bilateral = true
start = 0.0
interval = 40.0
points = 21

[[fits]]
compensation = "temperature"
axis = "X"
sensors = { coefficient = "scale" }
reference = 250.0

[[fits]]
compensation = "leadscrew"
axis = "Y"
start = 0.0
interval = 40.0
points = 11

[[fits]]
compensation = "backlash"
axis = "Y"

[[fits]]
compensation = "cross"
axis = "Y"
master = "X"
start = 0.0
interval = 25.0
points = 33

[[fits]]
compensation = "crosstalk"
axis = "Y"
master = "X"
adaptation = "Z"
mode = 2
acceleration = 1500.0
deceleration = -1500.0
positions = [[0.0], [100.0], [200.0]]

[[fits]]
compensation = "leadscrew"
axis = "Z"
start = 0.0
interval = 40.0
points = 6

[[fits]]
compensation = "backlash"
axis = "Z"

[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
start = [0.0, 0.0]
interval = [50.0, 25.0]
points = [17, 17]

[[fits]]
compensation = "temperature"
axis = "Z"
sensors = { offset = "spindle" }
"""


def work_job() -> str:
    """Return the job that finds everything in one log."""
    roles = [
        f'"{axis}.{kind}" = "{axis}.{kind}"'
        for axis in _AXES
        for kind in ("position", "encoder", "actual")
    ]
    group = '[[fits]]\ngroup = "work"\nmeasurement = "work"\n'
    return _HEAD + "\n".join(roles) + "\n" + _FITS.replace("[[fits]]\n", group)


@dataclasses.dataclass(frozen=True)
class WorkResult:
    """What the demo found in the log of the working mill.

    Attributes:
        job: Of the group.
        rms: By axis: error in mm before, predicted and verified, wild readings aside.
    """

    job: JobResult
    rms: Mapping[str, Mapping[str, float]]


def run_work(folder: Path, seed: int, say: Callable[[str], None]) -> WorkResult:
    """Record the mill at work, find its faults, load the lists, record it again."""
    folder.mkdir(exist_ok=True)
    say("working with all faults at once")
    mill = machine_with_everything(pace=_PACE)
    _record(mill, folder / "log.csv", seed)
    write_atomically(folder / "job.toml", work_job().encode())
    job = run_job(folder / "job.toml", folder / "result", say)
    say("loading all lists and working again")
    loaded = _loaded(mill, job, folder / "result")
    second = folder / "second"
    second.mkdir(exist_ok=True)
    _record(loaded, second / "log.csv", seed + 100)
    before, after = _left(folder / "log.csv"), _left(second / "log.csv")
    predicted = {
        fit.axis: fit.error["predicted"].sound.rms
        for fit in job.fits
        if kind(fit.compensation).table
    }
    return WorkResult(
        job,
        {
            axis: {
                "before": before[axis],
                "predicted": predicted[axis],
                "verified": after[axis],
            }
            for axis in _AXES
        },
    )


def _record(mill: WorkingMachine, path: Path, seed: int) -> None:
    log = record(mill, work_programme(_SECONDS, seed), seed)
    write_motion_log(path, log.every(_EVERY))


def _loaded(mill: WorkingMachine, job: JobResult, folder: Path) -> WorkingMachine:
    """Return the mill with every file loaded that the job wrote, its PLC included.

    It is not worked as hard as before, so that it stays within the temperatures measured.
    """
    names = dict.fromkeys(name for fit in job.fits for name in fit.files)
    lists = [ListFile.read(folder / name) for name in names if name.suffix == ".lis"]
    lines: dict[int, TemperatureLine] = {}
    lags: dict[str, float] = {}
    for fit in job.fits:
        if not isinstance(fit, TemperatureResult):
            continue
        number = mill.machine.axes[fit.axis]
        table = next(name for name in fit.files if name.suffix == ".csv")
        sensor = next(iter(fit.sensors))
        own = next(
            one for one in lists if one.source.endswith(f"achsmds{number}.add.lis")
        )
        lines[number] = read_temperature_table(
            folder / table, mill.sensors, sensor, Conventions(), own
        )
        lags[sensor] = max((lag.time_constant for lag in fit.fit.lags), default=0.0)
    machine = mill.machine.with_lists(lists, lines)
    parts = tuple(
        dataclasses.replace(part, rise=_SECOND_LOAD * part.rise) for part in mill.parts
    )
    return dataclasses.replace(mill, machine=machine, parts=parts, plc_lags=lags)


def _left(path: Path) -> dict[str, float]:
    """Return the error of each axis that a log shows, in mm rms, wild readings aside."""
    found = without_motion(measurement(read_table(path)), _AXES)
    return {
        axis: _rms(with_error(found, axis).values[f"{axis}.error"]) for axis in _AXES
    }


def _rms(error: Float[np.ndarray, " t"]) -> float:
    away = np.abs(error - np.median(error))
    sound = away <= _WILD * 1.4826 * np.median(away)
    return float(np.std(error[sound]))
