"""What `axcomp demo` does: measure, fit, load the lists, measure again, compare."""

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path

from ...data.lists import ListFile
from ...models import Conventions
from ..job import (
    FrictionResult,
    JobResult,
    TableResult,
    begin_job,
    write_atomically,
)
from ..kinds.friction.entries import friction_from_list
from ..machine import (
    VirtualMachine,
    example_drive,
    example_machine,
    record_drive,
)
from ..proof import circular_test
from ..report import write_report
from . import _demo_files as files
from ._demo_work import WorkResult, run_work

_SEED = 20261120


@dataclasses.dataclass(frozen=True)
class Spikes:
    """Largest deviation of a circle by friction, in mm.

    Attributes:
        before: Without a list, on the machine as it is.
        predicted: With the list, by the law that was fitted.
        verified: With the written list, on the machine as it is.
    """

    before: float
    predicted: float
    verified: float


@dataclasses.dataclass(frozen=True)
class DemoResult:
    """Everything that the demo did.

    Attributes:
        spikes: What friction does to a circle.
        job: Result of the job on the first measurement.
        work: What was found while the machine worked, all faults at once.
        report: The page.
        wall_time: Of the whole demo in seconds, without starting Python.
    """

    spikes: Spikes
    job: JobResult
    work: WorkResult
    report: Path
    wall_time: float


def run_demo(out: Path, say: Callable[[str], None]) -> DemoResult:
    """Run the whole demo into a folder.

    Args:
        out: Folder; empty, missing, or left by an earlier demo.
        say: Called with a short line before each step.

    Raises:
        FolderError: If the folder holds what no demo made.
    """
    start = time.perf_counter()
    files.claim_folder(out)
    machine = example_machine()
    say("measuring a machine with known faults")
    _write_inputs(out, machine)
    files.seal_folder(out)
    run = begin_job(out / "job.toml", out / "result", say)
    say("loading the lists and measuring again")
    loaded = machine.with_lists(
        ListFile.read(out / "result" / fit.files[0])
        for fit in run.result.fits
        if isinstance(fit, TableResult)
    )
    job = run.measured_again(_measure_again(out, loaded)).finish()
    say("drawing the report")
    page, *_ = write_report(job, out / "result")
    work = run_work(out / "work", _SEED + 14, say)
    say("drawing the report of the working machine")
    write_report(work.job, out / "work" / "result")
    files.seal_folder(out)
    return DemoResult(
        spikes=_spikes(job, out / "result"),
        job=job,
        work=work,
        report=page,
        wall_time=time.perf_counter() - start,
    )


def _spikes(job: JobResult, folder: Path) -> Spikes:
    """Draw circles on the machine as it is, without and with the written list."""
    fit = next(fit for fit in job.fits if isinstance(fit, FrictionResult))
    drive = example_drive()
    listing = friction_from_list(ListFile.read(folder / fit.files[0]), Conventions())
    unit = drive.rated_current * drive.torque_unit
    true = circular_test(drive.law, drive.inertia, listing, out_unit=unit)
    assert fit.circle is not None  # mass, law and list of the demo are known
    return Spikes(true.spikes[0], fit.circle.spikes[1], true.spikes[1])


def _write_inputs(out: Path, machine: VirtualMachine) -> None:
    """Write everything that a user would bring: measurements, old list, job."""
    files.write_measurements(out / "measurements", machine, _SEED)
    record_drive(out / "measurements" / "drive_x.csv", example_drive(), _SEED + 7)
    (out / "machine").mkdir(exist_ok=True)
    # The list that the machine came with: the beam has sagged further since.
    write_atomically(out / "machine" / "achskw2.lis", files.text_of("achskw2.lis"))
    for name in ("job.toml", "README.txt"):
        write_atomically(out / name, files.text_of(name))


def _measure_again(out: Path, machine: VirtualMachine) -> Path:
    """Measure with the lists active, and return the job that says so.

    The instruments' zeros are taken off exactly as they were the first time.
    """
    folder = out / "second"
    files.write_measurements(folder, machine, _SEED + 100)
    write_atomically(folder / "job.toml", files.text_of("second.toml"))
    return folder / "job.toml"
