"""What `axcomp demo` does: measure, fit, load the lists, measure again, compare; then work."""

import dataclasses
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ....data.lists import ListFile
from ....data.measurements import measurement, read_table, with_error, without_motion
from ....data.signals import wild_readings
from ....models import Conventions, TemperatureLine
from ...job import (
    FrictionResult,
    JobResult,
    TableResult,
    TemperatureResult,
    run_job,
    write_atomically,
)
from ...kinds import kind
from ...kinds.friction.entries import friction_from_list
from ...kinds.temperature.entries import read_temperature_table
from ...machine import (
    VirtualMachine,
    WorkingMachine,
    example_drive,
    example_machine,
    machine_with_everything,
    record,
    record_drive,
    work_programme,
    write_motion_log,
)
from ...proof import circular_test
from ...report import write_report
from . import _files as files

_SEED = 20261120
_SECONDS = 120.0
_EVERY = 20
"""Cycles per row of the log: 50 rows a second."""
_PACE = 0.15
"""It warms and cools that much faster than in half an hour of work."""
_SECOND_LOAD = 0.8
"""Heat of the second run: a thermal law ends where the temperatures of the first one did."""
_AXES = ("X", "Y", "Z")


Stages = Mapping[str, float]
"""Errors ``before``, ``predicted`` and ``verified``, in mm."""


@dataclasses.dataclass(frozen=True)
class DemoResult:
    """Everything that the demo did.

    Attributes:
        job: Result of the job on the first measurement.
        spikes: Largest deviation of a circle by friction: without a list on the machine as it
            is, with the list by the law that was fitted, with the written list on the machine.
        work: What was found while the machine worked, all faults at once.
        work_rms: Its errors by axis, rms without wild readings.
        report: The page.
        wall_time: Of the whole demo in seconds, without starting Python.
    """

    job: JobResult
    spikes: Stages
    work: JobResult
    work_rms: Mapping[str, Stages]
    report: Path
    wall_time: float


def run_demo(out: Path, say: Callable[[str], None]) -> DemoResult:
    """Run the whole demo into a folder, empty, missing, or left by an earlier demo.

    Says a short line before each step; refuses a folder that holds what no demo made.
    """
    start = time.perf_counter()
    files.claim_folder(out)
    machine = example_machine()
    say("measuring a machine with known faults")
    _write_inputs(out, machine)
    files.seal_folder(out)
    first = run_job(out / "job.toml", out / "result", say)
    say("loading the lists and measuring again")
    loaded = machine.with_lists(
        ListFile.read(out / "result" / fit.files[0])
        for fit in first.fits
        if isinstance(fit, TableResult)
    )
    second = out / "second"
    files.write_measurements(second, loaded, _SEED + 100)
    # It takes the instruments' zeros off exactly as the first job does.
    write_atomically(second / "job.toml", files.text_of("second.toml"))
    after = second / "job.toml"
    job = run_job(out / "job.toml", out / "result", say, after=after)
    say("drawing the report")
    page, *_ = write_report(job, out / "result")
    work, work_rms = _run_work(out / "work", _SEED + 14, say)
    say("drawing the report of the working machine")
    write_report(work, out / "work" / "result")
    files.seal_folder(out)
    return DemoResult(
        job=job,
        spikes=_spikes(job, out / "result"),
        work=work,
        work_rms=work_rms,
        report=page,
        wall_time=time.perf_counter() - start,
    )


def _spikes(job: JobResult, folder: Path) -> Stages:
    """Draw circles on the machine as it is, without and with the written list."""
    fit = next(fit for fit in job.fits if isinstance(fit, FrictionResult))
    drive = example_drive()
    listing = friction_from_list(ListFile.read(folder / fit.files[0]), Conventions())
    unit = drive.rated_current * drive.torque_unit
    true = circular_test(drive.law, drive.inertia, listing, out_unit=unit)
    assert fit.circle is not None  # mass, law and list of the demo are known
    before, verified = true.spikes[:2]
    return {"before": before, "predicted": fit.circle.spikes[1], "verified": verified}


def _write_inputs(out: Path, machine: VirtualMachine) -> None:
    """Write everything that a user would bring: measurements, old list, job."""
    files.write_measurements(out / "measurements", machine, _SEED)
    record_drive(out / "measurements" / "drive_x.csv", example_drive(), _SEED + 7)
    (out / "machine").mkdir(exist_ok=True)
    # The list that the machine came with: the beam has sagged further since.
    write_atomically(out / "machine" / "achskw2.lis", files.text_of("achskw2.lis"))
    for name in ("job.toml", "README.txt"):
        write_atomically(out / name, files.text_of(name))


def _run_work(
    folder: Path, seed: int, say: Callable[[str], None]
) -> tuple[JobResult, dict[str, Stages]]:
    """Record the mill at work, find its faults, load the lists, record it again."""
    folder.mkdir(exist_ok=True)
    say("working with all faults at once")
    mill = machine_with_everything(pace=_PACE)
    _record(mill, folder / "log.csv", seed)
    write_atomically(folder / "job.toml", files.text_of("work.toml"))
    job = run_job(folder / "job.toml", folder / "result", say)
    say("loading all lists and working again")
    loaded = _loaded(mill, job, folder / "result")
    second = folder / "second"
    second.mkdir(exist_ok=True)
    _record(loaded, second / "log.csv", seed + 100)
    before, after = _rms_errors(folder / "log.csv"), _rms_errors(second / "log.csv")
    predicted = {
        fit.axis: fit.error["predicted"].sound.rms
        for fit in job.fits
        if kind(fit.compensation).table
    }
    stages = {"before": before, "predicted": predicted, "verified": after}
    return job, {axis: {k: v[axis] for k, v in stages.items()} for axis in _AXES}


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
        sensor, name = next(iter(fit.fit.sensors)), f"achsmds{number}.add.lis"
        listing = next(file for file in lists if file.source.endswith(name))
        lines[number] = read_temperature_table(
            folder / table, mill.sensors, (sensor,), Conventions(), listing
        )
        lags[sensor] = max((lag.time_constant for lag in fit.fit.lags), default=0.0)
    machine = mill.machine.with_lists(lists, lines)
    parts = tuple(
        dataclasses.replace(part, rise=_SECOND_LOAD * part.rise) for part in mill.parts
    )
    return dataclasses.replace(mill, machine=machine, parts=parts, plc_lags=lags)


def _rms_errors(path: Path) -> dict[str, float]:
    """Return the error of each axis that a log shows, in mm rms, wild readings aside."""
    measured, sizes = without_motion(measurement(read_table(path)), _AXES), {}
    for axis in _AXES:
        error = with_error(measured, axis).values[f"{axis}.error"]
        sizes[axis] = float(np.std(error[~wild_readings(error)]))
    return sizes
