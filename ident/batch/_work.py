"""What a worker does: jobs one after the other, their files published.

A job writes into a folder of its own under ``.work/``; when all of it is there the folder
is moved to its place at once. So a list either is there, complete, or it is not.
"""

import contextlib
import dataclasses
import errno
import functools
import json
import os
import shutil
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from itertools import count
from pathlib import Path

from ...data.errors import AxcompError
from ...data.files import sha256, sync_folder
from ._collect import Task
from ._folder import BatchError
from ._rows import Row, hash_of_inputs, identity_in, rows_of

WORK = ".work"
_KINDS = {"lists": True, "unverified": False}
"""Folders of what is done, and whether the rules are verified by which it is."""
_EARLIER = "earlier"
"""Folder of what was in its place before: numbered where there is more than one."""
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS}
_LATE = 83
"""Exit status of a worker that a job did not let go on."""
_LOOK = 1.0
"""Seconds after which a thread looks at the latest whether it is still needed."""
_clock = time.monotonic
_PUBLISHING = 4
"""Jobs whose files are on their way to the disk at the same time."""
_DRAWING = threading.Lock()
"""matplotlib draws one figure at a time."""


@dataclasses.dataclass(frozen=True)
class Order:
    """What holds for all jobs of a batch.

    Attributes:
        out: Folder of the batch.
        token: Of this run of it: no two runs share a folder under ``.work/``.
        reports: Reports for all jobs and not only for those that did not pass.
        limit: Seconds that a job may keep others waiting, or None.
    """

    out: str
    token: str
    reports: bool = False
    limit: float | None = None

    @functools.cached_property
    def work(self) -> Path:
        """Folder for what is not finished."""
        return Path(self.out) / WORK / self.token


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a job; ``full`` where there was no room to write it."""

    name: str
    rows: list[Row]
    full: bool = False


def examine(tasks: Sequence[Task], order: Order) -> list[Outcome]:
    """Return the outcomes of those jobs that cannot run.

    What an earlier run wrote for such a one is moved away.
    """
    from ..job import load_job

    outcomes = []
    for task in tasks:
        reason = task.fault
        try:
            if reason is None:
                load_job(task.path)
                continue
        except (AxcompError, OSError) as error:
            reason = str(error)
        try:
            for kind in _KINDS:
                _take_away(Path(order.out) / kind / task.name)
        except BatchError as error:
            reason = f"{reason}; {error}"
        outcomes.append(failed(task, reason))
    return outcomes


def run_chunk(tasks: Sequence[Task], order: Order) -> list[Outcome]:
    """Run some jobs one after the other; whatever goes wrong with one is its row.

    Threads wait for the disk to take the files of a job while the next ones run.
    """
    start_worker()
    watch, outcomes = _Watch(order), list[Outcome | Future[Outcome]]()
    try:
        with ThreadPoolExecutor(_PUBLISHING) as disk:
            for task in tasks:
                watch.begin(task)
                outcomes.append(_start(task, order, disk))
    finally:
        watch.running = None
    return [
        outcome if isinstance(outcome, Outcome) else outcome.result()
        for outcome in outcomes
    ]


@dataclasses.dataclass
class _Watch:
    """Ends this process where a job takes too long; another process takes the rest.

    One thread for all jobs of a chunk: to start one takes as long as a good part of a job.

    Attributes:
        order: What holds for all jobs.
        running: The job that runs, and when it is given up; None: none does any more.
    """

    order: Order
    running: tuple[Task, float] | None = None

    def begin(self, task: Task) -> None:
        """Watch a job from now on, in place of the one before."""
        if self.order.limit is None:
            return
        first, self.running = not self.running, (task, _clock() + self.order.limit)
        if first:
            threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while self.running is not None:
            task, end = self.running
            if (remaining := end - _clock()) <= 0.0:
                late = self.order.work / "late"
                late.mkdir(parents=True, exist_ok=True)
                (late / task.name).touch()
                os._exit(_LATE)
            time.sleep(min(remaining, _LOOK))


@functools.cache
def start_worker() -> None:
    """Prepare a process for many jobs."""
    import gc

    from ..job import use_compilation_cache

    use_compilation_cache()
    # What was imported lives on; looking through it again and again costs a tenth.
    gc.freeze()
    gc.set_threshold(200_000, 20, 20)


def _start(task: Task, order: Order, disk: Executor) -> Outcome | Future[Outcome]:
    try:
        rows = published(task, order)
    except (AxcompError, OSError) as error:
        return failed(task, str(error))
    if rows is not None:
        return Outcome(task.name, rows)
    if (order.work / "late" / task.name).exists():
        words = f"took more than {order.limit:g} s (--time-limit) and was given up"
        return failed(task, words)
    stage = order.work / task.name
    if stage.exists():
        shutil.rmtree(stage, ignore_errors=True)
    outcome = _guarded(task, stage, lambda: _job_outcome(task, order, stage))
    folder = outcome.rows[0].get("folder")
    if folder is None:  # it failed
        return outcome
    place = Path(order.out) / folder

    def move() -> Outcome:
        _move(stage, place)
        return outcome

    return disk.submit(_guarded, task, stage, move)


def _guarded(task: Task, stage: Path, work: Callable[[], Outcome]) -> Outcome:
    try:
        return work()
    except (AxcompError, OSError) as error:
        reason, full = str(error), _is_full(error)
    except Exception as error:  # a batch goes on, whatever one job meets
        reason, full = f"unexpected {type(error).__name__}: {error}", False
    shutil.rmtree(stage, ignore_errors=True)
    return dataclasses.replace(failed(task, reason), full=full)


def failed(task: Task, reason: str) -> Outcome:
    """Return the outcome of a job that wrote no list."""
    row = identity_in(task.path) | {
        "job": task.name,
        "state": "failed",
        "reason": " ".join(reason.split()),
        "passed": False,
        "job_sha256": task.sha256,
        "inputs_sha256": inputs_hash(task.path),
    }
    return Outcome(task.name, [row])


def inputs_hash(path: Path) -> str:
    """Return one hash for all files that a job reads, as far as they are there."""
    from ..job import load_job

    try:
        return hash_of_inputs(load_job(path).hashes())
    except (AxcompError, OSError) as error:
        # Once what is missing or wrong has changed, this is another hash.
        return hash_of_inputs({path.name: " ".join(str(error).split())})


def _is_full(error: BaseException | None) -> bool:
    """Tell whether an error, or what it came from, is a disk without room."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in _FULL:
            return True
        error = error.__cause__ or error.__context__
    return False


def _job_outcome(task: Task, order: Order, stage: Path) -> Outcome:
    """Run a job into a folder; its rows name the one that its files are to be moved to."""
    from ..job import run_job

    result = run_job(task.path, stage, sync=False)
    if not all((stage / file).is_file() for file in result.files):
        # The batch that this worker belonged to ended and took its work away.
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(stage))
    if order.reports or not result.passed:
        from ..report import write_report  # takes long to load

        with _DRAWING:
            write_report(result, stage)
    # The rules that a verdict asks for; by the others no list is unproven.
    verified = all(
        rule.state == "verified"
        for fit in result.fits
        for rule in fit.rules
        if rule.decides
    )
    # What lies there says what the result does: no need to read it back.
    folder = f"{'lists' if verified else 'unverified'}/{task.name}"
    rows = rows_of(task.name, folder, verified, task.sha256, result.tree)
    return Outcome(task.name, rows)


def _move(stage: Path, place: Path) -> None:
    """Move finished files to their place, once the disk has taken them."""
    place.parent.mkdir(exist_ok=True)
    sync_folder(stage)
    try:
        stage.rename(place)
    except OSError:
        # A worker that was believed dead was faster: its files are whole as well.
        if not place.is_dir():
            raise
        shutil.rmtree(stage, ignore_errors=True)


def published(task: Task, order: Order) -> list[Row] | None:
    """Return the rows of a job whose files lie in their place, made of what is there now.

    None where there are none, of a job that was changed since, or of a worker that was
    stopped: what lies there then is moved away.

    Raises:
        AxcompError: If it cannot be moved away: no other list may be told of then.
    """
    for kind, verified in _KINDS.items():
        folder = Path(order.out) / kind / task.name
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            result = json.loads((folder / "result.json").read_bytes())
            inputs = result["inputs"]
            digests = result["digests"].items()
            if (
                task.sha256 in inputs.values()
                and hash_of_inputs(inputs) == inputs_hash(task.path)
                and all((folder / file).is_file() for file in result["files"])
                # A list that somebody has changed is no longer what its result says.
                and all(sha256(folder / name) == digest for name, digest in digests)
            ):
                place = f"{kind}/{task.name}"
                return rows_of(task.name, place, verified, task.sha256, result)
        if folder.exists():
            _refuse_own(task, folder)
        _take_away(folder)
    return None


def _refuse_own(task: Task, folder: Path) -> None:
    """Refuse a job that reads what an earlier run of it wrote, with a `BatchError`."""
    from ..job import load_job

    job = load_job(task.path)
    for file in (*job.inputs, *job.second_inputs):
        if folder.resolve() in file.resolve().parents:
            reason = (
                "the job reads it, and would replace it: found it among the results of the"
                " batch, expected a copy elsewhere"
            )
            raise BatchError(str(file), reason)


def _take_away(folder: Path) -> None:
    """Move what an earlier run of the batch wrote for a job into ``earlier/``, or raise."""
    if not folder.exists():
        return
    earlier = folder.parent.parent / _EARLIER
    places = (earlier / f"{folder.name}{f'.{k}' if k else ''}" for k in count())
    try:
        earlier.mkdir(exist_ok=True)
        folder.rename(next(place for place in places if not place.exists()))
    except OSError as error:
        reason = f"the lists of an earlier run cannot be moved away: {error.strerror}"
        raise BatchError(str(folder), reason) from None
