"""Run a job: measurements → fits → lists → gate → written files → proof."""

import dataclasses
import importlib.metadata
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..exchange import AbstractTable
from ..proof import GateCheck
from ._fitting import Fitted, fit_plan
from ._fragments import startup_fragment
from ._gating import cycles_for, limits_of, pass_gate
from ._json import result_json
from ._judge import judge_files
from ._lists import AxisFiles, axis_files
from ._load import Job, load_job, sha256
from ._loadsheet import load_sheet
from ._output import OutFolder
from ._plan import plan_fits
from ._prove import offset_at_readings, prove
from ._readings import read_fit
from ._result import (
    JobResult,
    Remark,
)
from ._source import Tables

_PACKAGES = ("axcomp", "numpy", "scipy", "jax", "equinox")


def run_job(
    path: Path, out: Path, progress: Callable[[str], None] | None = None
) -> JobResult:
    """Run a job file and write lists and ``result.json`` into a folder.

    A failed gate is no error: the result says so, and the list lies in ``rejected/``.

    Args:
        path: The job file.
        out: Folder to write into; made where it does not exist.
        progress: Called with a short line before each longer step.

    Returns:
        What was found; `JobResult.passed` tells whether everything is fit for use.

    Raises:
        AxcompError: If an input cannot be used or nothing can be written; nothing is
            then left half-written.
        OSError: If a file cannot be read.
    """
    start = time.perf_counter()
    say = progress or (lambda line: None)
    job = load_job(path)
    folder = OutFolder(out, [path, *job.inputs])
    try:
        folder.refuse_sources(_names(job))
        fitted = _fit_all(job, say)
    except BaseException:
        folder.drop()
        raise
    gates, cycles = [], {}
    for one in fitted:
        spread = cycles_for(job, one)
        gates.append(pass_gate(job, one, spread))
        if spread is not None:
            cycles[one.plan.fit.axis] = spread
    say("writing lists")
    axes = dict.fromkeys(one.plan.fit.axis for one in fitted)
    files = tuple(
        axis_files(
            job,
            axis,
            [one for one in fitted if one.plan.fit.axis == axis],
            cycles.get(axis),
        )
        for axis in axes
    )
    files, remarks = judge_files(job, files)
    failed = _failed(fitted, gates, files)
    written, moved = _write(job, folder, files, failed)
    results = []
    for one, gate in zip(fitted, gates, strict=True):
        axis = one.plan.fit.axis
        own = next(each for each in files if each.axis == axis)
        results.append(
            prove(job, folder, one, gate, own, written[axis], cycles.get(axis))
        )
    result = JobResult(
        title=job.spec.title or path.stem,
        machine=job.spec.machine.model_dump(mode="json", exclude_none=True),
        fits=tuple(results),
        inputs={
            str(_relative(job, file)): sha256(file) for file in (path, *job.inputs)
        },
        versions=_versions(),
        load_sheet=load_sheet(job, files, fitted, failed),
        remarks=(*remarks, *moved),
        files=(*folder.written, Path("result.json")),
        wall_time=time.perf_counter() - start,
        job=job.spec.resolved() | {"gate": dataclasses.asdict(limits_of(job))},
    )
    folder.write("result.json", result_json(result).encode())
    return result


def _names(job: Job) -> list[str]:
    """Return every name that a job may write."""
    names = ["result.json", "report.html", "hochlauf.add.lis"]
    for fit in job.spec.fits:
        number = job.spec.axes[fit.axis].number
        names += [
            f"achskw{number}.lis",
            f"achsmds{number}.lis",
            f"achsmds{number}.add.lis",
        ]
    return names


def _fit_all(job: Job, say: Callable[[str], None]) -> list[Fitted]:
    """Fit one table after the other; a later one takes what earlier ones leave."""
    tables = Tables(job)
    plans = plan_fits(job, tables)
    left: dict[tuple[str, str], Float[np.ndarray, " t"]] = {}
    fitted: list[Fitted] = []
    for plan in plans:
        spec = plan.fit
        assert isinstance(plan.table, AbstractTable)
        say(f"fitting {spec.compensation} of {spec.axis}")
        extra = {
            name: left[spec.axis, name]
            for name in spec.sources
            if (spec.axis, name) in left
        }
        readings = read_fit(tables, plan.index, spec, plan.table, extra)
        one = fit_plan(job, plan, readings)
        fitted.append(one)
        added = offset_at_readings(one, plan.table.model(one.integers)) - one.active
        for name, rows in readings.slices.items():
            key = (spec.axis, name)
            left[key] = left.get(key, np.zeros(rows.stop - rows.start)) + added[rows]
    return fitted


def _failed(
    fitted: Sequence[Fitted],
    gates: Sequence[Sequence[GateCheck]],
    files: Sequence[AxisFiles],
) -> list[str]:
    """Return the axes whose lists must not be loaded."""
    failed = [
        one.plan.fit.axis
        for one, gate in zip(fitted, gates, strict=True)
        if not all(check.passed for check in gate)
    ]
    failed += [
        one.axis for one in files if any(r.level == "error" for r in one.remarks)
    ]
    return list(dict.fromkeys(failed))


def _write(
    job: Job, folder: OutFolder, files: Sequence[AxisFiles], failed: Sequence[str]
) -> tuple[Mapping[str, tuple[Path, ...]], list[Remark]]:
    """Write all lists and return their names by axis, and what was moved away."""
    written: dict[str, tuple[Path, ...]] = {}
    retired: list[tuple[str, Path | None]] = []
    for one in files:
        pairs = (
            (one.compensation_name, one.compensation),
            (one.machine_name, one.machine),
        )
        names: list[Path] = []
        for name, listing in pairs:
            if one.axis in failed:
                rejected, earlier = folder.reject(name, listing.dumps())
                names.append(rejected)
                retired.append((name, earlier))
            else:
                names.append(folder.accept(name, listing.dumps()))
        written[one.axis] = tuple(names)
        # The other kind of axis list would contradict this one.
        number = job.spec.axes[one.axis].number
        for name in {f"achsmds{number}.lis", f"achsmds{number}.add.lis"}:
            if name != one.machine_name:
                retired.append((name, folder.retire(name)))
    fresh = [
        (one.axis, one.compensation_name)
        for one in files
        if one.is_new and one.axis not in failed
    ]
    fragment = startup_fragment(job, fresh)
    if fragment is not None:
        folder.write("hochlauf.add.lis", fragment.dumps())
    else:
        name = "hochlauf.add.lis"
        retired.append((name, folder.retire(name)))
    moved = [
        Remark(
            "warning",
            f"{name} of an earlier run was moved to {earlier}: it does not belong to"
            " the lists of this run.",
        )
        for name, earlier in retired
        if earlier is not None
    ]
    moved += [Remark("warning", words) for words in folder.remarks]
    return written, moved


def _relative(job: Job, file: Path) -> Path:
    try:
        return Path(os.path.relpath(file, job.path.parent))
    except ValueError:  # another drive
        return file


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    return found | {name: importlib.metadata.version(name) for name in _PACKAGES}
