"""Run a job: measurements → fits → lists → gate → written files → proof."""

import contextlib
import dataclasses
import functools
import importlib.metadata
import platform
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...data.errors import AxcompError
from ...data.measurements import standstill_words
from ..core import FitError
from ..diagnosis import OBJECTS, SCOPE, objects_csv, observables, scope_configuration
from ..exchange import axis_file, compensation_file
from ..kinds._keys import FitSpec
from ..readings import Tables
from ._acting import hand_on, leftovers
from ._draft import AbstractDraft
from ._measure_again import measure_again, plan_second
from ._whole import judge_whole
from .file._faults import JobError
from .file._load import Job, load_job
from .result._job_result import JobResult, tree_json
from .result._result import Remark
from .write._lists import AxisFiles, files_of, judge_files, startup_fragment
from .write._loadsheet import first_run_programs, load_sheet, program_names
from .write._output import REPORT, RESULT, OutFolder

if TYPE_CHECKING:
    from .joint._group import IdentifiedGroup
    from .joint._proof import GroupResult

_PACKAGES = ("axcomp", "numpy", "scipy", "jax", "equinox")
_STARTUP = "hochlauf.add.lis"
_DIAGNOSIS = (OBJECTS, SCOPE)
"""Files that say what to look at on the controller."""


def run_job(
    path: str | Path,
    out: str | Path,
    progress: Callable[[str], None] | None = None,
    *,
    after: str | Path | None = None,
    sync: bool = True,
) -> JobResult:
    """Run a job file and write lists and ``result.json`` into a folder.

    A failed gate is no error: the result says so, and the list lies in ``rejected/``.

    Args:
        path: The job file.
        out: Folder to write into; made where it does not exist.
        progress: Called with a short line before each longer step.
        after: Job of a second measurement, made with these lists loaded; left out: the
            one that ``[verify]`` names, or that of an earlier run with the same lists.
        sync: Whether every file survives a power cut once it is there; False where the
            caller sees to it (`sync_folder`) before anybody looks.

    Returns:
        What was found; `JobResult.passed` tells whether everything is fit for use.

    Raises:
        AxcompError: If an input cannot be used or nothing can be written; nothing is
            then left half-written.
        OSError: If a file cannot be read.
    """
    start = time.perf_counter()
    say = progress or (lambda line: None)
    path, out = Path(path), Path(out)
    after = None if after is None else Path(after)
    job = load_job(path)
    machine = job.spec.machine.id
    folder = OutFolder(out, path, job.inputs, machine=machine, sync=sync)
    try:
        folder.refuse_sources(_names(job))
        tables = Tables(job)
        drafts, groups = fit_all(tables, say)
    except BaseException:
        folder.drop()
        raise
    say("writing lists")
    files, remarks = judge_files(job, files_of(job, drafts))
    files, whole = judge_whole(tables, files)
    second, outdated = plan_second(job, after, out, files)
    with _uninterrupted():
        files, notes = _write(job, folder, files)
        by_axis = {axis.axis: axis for axis in files}
        sums: list[GroupResult] = []
        if groups:
            from .joint._proof import prove_group

            sums = [prove_group(group, drafts, by_axis) for group in groups]
        together = {index: group.name for group in sums for index in group.fits}
        results = []
        for draft in drafts:
            done, group = by_axis[draft.axis], together.get(draft.index)
            proved = draft.prove(done)
            said = (*proved.remarks, *done.remarks, *draft.stays_on())
            results.append(dataclasses.replace(proved, group=group, remarks=said))
        result = JobResult(
            title=job.spec.title or job.path.stem,
            machine=job.spec.machine.model_dump(mode="json", exclude_none=True),
            fits=tuple(results),
            inputs=job.hashes(),
            versions=_versions(),
            remarks=(*remarks, *notes, *outdated, *_unused(job)),
            digests=dict(folder.digests),
            job=job.spec.model_dump(mode="json", by_alias=True, exclude_none=True)
            | {"gate": dict(job.spec.gate)},
            conventions=job.conventions.to_dict(),
            clocks=tables.clocks,
            groups=tuple(sums),
            whole=whole,
        )
        if second is not None:
            result = measure_again(job, second, drafts, result, out)
        programs = [name for name in program_names(job) if name in folder.digests]
        result = dataclasses.replace(
            result,
            load_sheet=load_sheet(job, files, result.fits, programs),
            wall_time=time.perf_counter() - start,
        )
        folder.write(RESULT, tree_json(result.tree).encode())
    return result


def fit_all(
    tables: Tables, say: Callable[[str], None]
) -> tuple[list[AbstractDraft], list["IdentifiedGroup"]]:
    """Plan all fits of a job, then fit one after the other; later ones take what is left.

    Groups come first: each explains the whole error of its measurements. Then backlash:
    it leaves the readings of both directions on the reference flank, where a table of
    one direction belongs. A short line is said before each fit.

    Returns:
        The draft of each fit, in the order of the job, and the groups.

    Raises:
        JobError: If keys, nodes, masters or existing lists do not suit, or the readings
            determine none of the fits.
        MeasurementError: If a measurement cannot be used.
    """
    job = tables.job
    fits, grouped = job.spec.fits, job.spec.grouped
    starts = [f"{fit.name} from {', '.join(fit.sources)}" for fit in fits]
    _refuse_streams(job, grouped)
    drafts: dict[int, AbstractDraft] = {}
    groups: list[IdentifiedGroup] = []
    plans = [fit.kind.planner.plan(tables, k, fit) for k, fit in enumerate(fits)]
    single = {k: plan for k, plan in enumerate(plans) if k not in grouped}
    order = sorted(single, key=lambda k: not fits[k].kind.fitted_first)
    left = leftovers(job)
    for name, indices in job.spec.groups.items():
        from .joint._group import fit_group  # takes long to load

        every = [plans[k] for k in indices]
        names = ", ".join(member.name for member in every)
        say(f"fitting group {name!r} together: {names}")
        group, shares = fit_group(tables, name, every)
        groups.append(group)
        drafts |= shares
        for member in shares.values():
            hand_on(member, order, left)
    undetermined: dict[int, FitError] = {}
    confounded: dict[int, str] = {}
    several = len({fits[k].axis for k in single}) < len(single)
    if several or any(fits[k].kind.often_open for k in single):
        from .joint._group import confounded as examined

        confounded = examined(tables, single)
    for place, k in enumerate(order):
        draft = None
        if k not in confounded or fits[k].kind.partial:
            say(f"fitting {fits[k].compensation} of {fits[k].axis}")
            try:
                with job.blaming(("fits", k), f"{starts[k]}: "):
                    draft = single[k].fit_single(tables, left)
            except JobError as error:
                reason = _with_standing(error.reason, tables, fits[k])
                raise JobError(error.source, error.line, reason) from None
            except FitError as error:
                if k not in confounded:
                    undetermined[k], confounded[k] = error, str(error)
        if draft is None or (k in confounded and draft.written and not draft.partial):
            draft = single[k].left_out(confounded[k])
        drafts[k] = draft
        hand_on(draft, order[place + 1 :], left)
    if len(undetermined) == len(fits):
        k = next(iter(undetermined))
        reason = _with_standing(str(undetermined[k]), tables, fits[k])
        raise job.error(("fits", k), f"{starts[k]}: {reason}")
    for (k, _), acting in left.items():
        beside = dict.fromkeys((*drafts[k].beside, *(each.name for each in acting)))
        drafts[k] = dataclasses.replace(drafts[k], beside=tuple(beside))
    return [drafts[k] for k in range(len(fits))], groups


def _with_standing(reason: str, tables: Tables, fit: FitSpec) -> str:
    """Return why nothing came out of a fit, and why few readings are left of its logs."""
    words = []
    for name in fit.sources:
        # What cannot be read, or not as a whole, is what the reason is about.
        with contextlib.suppress(AxcompError, OSError):
            if tables.large(name) is None:
                measured = tables.measured(name, fit.axis)
                words.append(standstill_words(measured, fit.axis))
    return ". ".join([reason, *filter(None, words)]).replace("..", ".")


def _refuse_streams(job: Job, grouped: frozenset[int]) -> None:
    """Raise where a log is to be read in pieces for a fit that needs the whole of it."""
    for index, fit in enumerate(job.spec.fits):
        if index not in grouped and fit.kind.table:
            continue
        for name in fit.sources:
            if job.spec.measurements[name].stream is True:
                words = f"the {fit.compensation} fit of {fit.axis}"
                words += " in a group" if index in grouped else ""
                raise job.error(
                    ("measurements", name, "stream"),
                    f"found true, but {words} needs its log in memory, expected it for"
                    " plane, cross and leadscrew fits of their own",
                )


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Put off an interrupt or termination until lists and result are written."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals reach the main thread only
        return
    pending: list[int] = []
    signals = signal.SIGINT, signal.SIGTERM
    before = {
        code: signal.signal(code, lambda n, _: pending.append(n)) for code in signals
    }
    try:
        yield
    finally:
        for code, handler in before.items():
            signal.signal(code, handler)
        for number in pending:
            signal.raise_signal(number)


def _unused(job: Job) -> list[Remark]:
    """Return which measurements of the job no fit reads: their names may be misspelt."""
    used = {name for fit in job.spec.fits for name in fit.sources}
    return [
        Remark.info(f"Measurement {name!r} is used by no fit.")
        for name in job.spec.measurements
        if name not in used
    ]


def _names(job: Job) -> list[str]:
    """Return every name that a job may write."""
    names = [RESULT, REPORT, _STARTUP, *_DIAGNOSIS, *program_names(job)]
    for fit in job.spec.fits:
        names += _names_of(job.spec.axes[fit.axis].number, [fit])
    return names


def _names_of(number: int, fits: Sequence[FitSpec]) -> list[str]:
    """Return every name that fits of an axis may write."""
    lists = compensation_file(number), axis_file(number), axis_file(number, whole=False)
    return [*lists, *(name for fit in fits for name in fit.plc_files)]


def _write(
    job: Job, folder: OutFolder, files: Sequence[AxisFiles]
) -> tuple[tuple[AxisFiles, ...], list[Remark]]:
    """Write all lists; return the axes with the names of their files, and remarks on old files."""
    for name in (RESULT, REPORT):  # written later, when the remarks are
        folder.keep(name)
    folder.keep_drawings()
    # Where the run is stopped, no page of other lists stands beside these.
    with contextlib.suppress(OSError):
        (folder.root / REPORT).unlink()
    axes = []
    for axis in files:
        contents = {name: listing.dumps() for name, listing in axis.lists}
        # The other kind of axis list would contradict this one.
        names = _names_of(axis.number, [draft.fit for draft in axis.drafts])
        written = folder.renew(names, contents | dict(axis.extra), failed=axis.failed)
        axes.append(axis.as_written(folder.root, written))
    folder.retire_others(_names(job))
    fragment = startup_fragment(files)
    folder.renew([_STARTUP], {} if fragment is None else {_STARTUP: fragment.dumps()})
    notes = [
        Remark.warning(
            f"{name} of an earlier run was moved to {earlier}: it does not belong to"
            " the lists of this run."
        )
        for name, earlier in folder.moved.items()
    ]
    folder.renew(_DIAGNOSIS, _diagnosis(job, files))
    programs = first_run_programs(job, files)
    folder.renew(
        program_names(job), {name: text.encode() for name, text in programs.items()}
    )
    notes += [Remark.warning(words) for words in folder.remarks]
    return tuple(axes), notes


def _diagnosis(job: Job, files: Sequence[AxisFiles]) -> dict[str, bytes]:
    """Return the objects of the compensations that are let out, and how to record them."""
    lists = [listing for axis in files if not axis.failed for _, listing in axis.lists]
    rows = observables(lists, job.conventions) if lists else ()
    if not rows:
        return {}
    controller = job.spec.controller
    stated = "cycle_time" in controller.model_fields_set
    cycle_time = controller.cycle_time if stated else None
    scope = scope_configuration(rows, cycle_time=cycle_time)
    return {OBJECTS: objects_csv(rows).encode(), SCOPE: scope}


@functools.cache
def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    return versions | {name: importlib.metadata.version(name) for name in _PACKAGES}
