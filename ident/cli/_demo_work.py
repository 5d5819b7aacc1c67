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
from ..kinds.temperature.entries import read_temperature_table
from ..machine.motion import (
    WorkingMachine,
    machine_with_everything,
    record,
    work_programme,
    write_motion_log,
)
from ._demo_files import text_of

_SECONDS = 120.0
_EVERY = 20
"""Cycles per row of the log: 50 rows a second."""
_PACE = 0.15
"""It warms and cools that much faster than in half an hour of work."""
_SECOND_LOAD = 0.8
"""Heat of the second run: a thermal law ends where the temperatures of the first one did."""
_WILD = 6.0
_AXES = ("X", "Y", "Z")


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
    write_atomically(folder / "job.toml", text_of("work.toml"))
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
    stages = {"before": before, "predicted": predicted, "verified": after}
    rms = {
        axis: {stage: sizes[axis] for stage, sizes in stages.items()} for axis in _AXES
    }
    return WorkResult(job, rms)


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
