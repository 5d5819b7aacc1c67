"""Run a batch: collect, check all jobs, run them on workers, write tables and summary."""

import dataclasses
import datetime
import secrets
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path

from ._collect import Task, collect_jobs
from ._folder import BatchError, begin, end, locked
from ._rows import Row
from ._summary import Summary, summarise
from ._table import read_results, write_results
from ._work import WORK, Order, examine
from ._workers import prepare_workers, run_chunks, workers_of

_CHUNK = 32
"""Jobs that go together; more would only wait longer for each other."""
_ROUNDS = 4
"""Chunks for each worker at least."""


@dataclasses.dataclass
class Progress:
    """Where a batch stands.

    Attributes:
        total: Jobs of the batch.
        done: Jobs that are done, those of earlier runs included.
    """

    total: int
    done: int = 0
    _start: float = dataclasses.field(default_factory=time.monotonic)

    def __str__(self) -> str:
        words = f"{self.done} of {self.total} jobs"
        if not self.done:
            return words
        rate = self.done / max(time.monotonic() - self._start, 1e-9)
        remaining = datetime.timedelta(seconds=round((self.total - self.done) / rate))
        return f"{words}, {rate:.1f} per second, {remaining} left"


@dataclasses.dataclass(frozen=True)
class BatchResult:
    """What a batch did.

    Attributes:
        reasons: Why jobs wrote no list, by name of the job.
        rejected: How many ran and did not pass (gate, or an error in their files).
        seconds: That this run of it took.
        summary: Figures over all machines.
    """

    reasons: Mapping[str, str]
    rejected: int
    seconds: float
    summary: Summary

    @property
    def passed(self) -> bool:
        """Whether every job wrote lists that passed."""
        return not self.reasons and not self.rejected


def run_batch(
    jobs: Sequence[str | Path],
    out: Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    resume: bool = False,
    reports: bool = False,
    time_limit: float | None = None,
    history: Sequence[Path] = (),
    progress: Callable[[Progress], None] | None = None,
) -> BatchResult:
    """Run many jobs: one list each, one table of all results, one summary.

    Call it from a script under ``if __name__ == "__main__"``: local workers are processes
    that import the script.

    Args:
        jobs: Job files, patterns, tables of jobs.
        out: Folder of the batch; made where it does not exist.
        scheduler: Address of a dask scheduler whose workers see the same files; processes
            of this machine where None.
        workers: Local workers; one per core where None.
        resume: Go on with the batch that the folder holds.
        reports: Draw the report of every job and not only of those that did not pass.
        time_limit: Seconds after which a job that others wait for is given up.
        history: Folders of earlier batches, for trends.
        progress: Called with where the batch stands, several times a minute.

    Raises:
        BatchError: If the batch cannot start or cannot go on; what is done stays done, and
            ``resume`` takes it up.
        OSError: If a file cannot be read or written.
    """
    start = time.monotonic()
    if time_limit is not None and not time_limit > 0.0:
        name, reason = "time_limit", f"found {time_limit:g}, expected seconds above 0"
        raise BatchError(name, reason)
    if scheduler is None:
        prepare_workers()
    for folder in history:
        read_results(folder)  # before the night, not after it
    out = out.resolve()
    if out.is_file():
        raise BatchError(str(out), "found a file, expected a folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = f"cannot write into the folder of the batch: {error.strerror}"
        raise BatchError(str(out), reason) from None
    with locked(out):
        tasks = collect_jobs(jobs, out)
        hashes = {task.name: task.sha256 for task in tasks}
        manifest = begin(out, jobs, hashes, resume=resume)
        tasks = tuple(task.as_file() for task in tasks)
        # What the summary is drawn with: half a second that need not stand at the end.
        from ..report import _style  # noqa: F401

        order = Order(str(out), secrets.token_hex(4), reports, time_limit)
        stand, done = Progress(len(tasks)), dict[str, list[Row]]()
        try:
            for name, rows in _run(tasks, order, scheduler, workers, stand):
                done[name] = rows
                if progress is not None:
                    progress(stand)
        finally:
            _take_away(out / WORK)
        ordered = [row for task in tasks for row in done[task.name]]
        write_results(out, ordered)
        summary = summarise(out, history)
        seconds = time.monotonic() - start
        end(out, manifest, seconds)
    reasons = {row["job"]: row["reason"] for row in ordered if row["state"] == "failed"}
    ran = {
        row["job"] for row in ordered if row["state"] == "done" and not row["passed"]
    }
    return BatchResult(reasons, len(ran), seconds, summary)


def _take_away(work: Path) -> None:
    """Remove the work folder; a worker that still runs finds none of its files.

    Renamed first: removed file by file, half of what such a worker wrote could still be
    moved to its place.
    """
    trash = work.with_name(f"{work.name}.{secrets.token_hex(4)}")
    try:
        work.rename(trash)
    except OSError:
        trash = work
    shutil.rmtree(trash, ignore_errors=True)


def _run(
    tasks: Sequence[Task],
    order: Order,
    scheduler: str | None,
    workers: int | None,
    stand: Progress,
) -> Iterator[tuple[str, list[Row]]]:
    """Yield the rows of every job, made of its files where these are there already."""
    try:
        with workers_of(scheduler, workers) as client:
            crew = max(workers or 0, len(client.scheduler_info()["workers"]), 1)
            size = max(1, len(tasks) // (_ROUNDS * crew))
            parts = [tasks[at : at + size] for at in range(0, len(tasks), size)]
            futures = client.map(examine, parts, order=order, pure=False)
            bad = list(chain.from_iterable(client.gather(futures)))
            names = {outcome.name for outcome in bad}
            runnable = [task for task in tasks if task.name not in names]
            # Enough chunks that nobody works on a last one while the others have none left.
            size = max(1, min(_CHUNK, -(-len(runnable) // (_ROUNDS * crew))))
            for outcomes in chain([bad], run_chunks(client, runnable, order, size)):
                kept = [outcome for outcome in outcomes if not outcome.full]
                stand.done += len(kept)
                yield from ((outcome.name, outcome.rows) for outcome in kept)
                if len(kept) < len(outcomes):
                    raise BatchError(
                        order.out, f"no room left on the disk; {_progress(stand)}"
                    )
    except OSError as error:
        # Workers that are sent away by an interrupt may not go without a noise.
        if isinstance(error.__context__, KeyboardInterrupt):
            raise KeyboardInterrupt from None
        # A broken connection is an OSError too; only files have a number of their own.
        broken = error.errno is None or isinstance(error, ConnectionError)
        text = "the scheduler was lost" if broken else f"cannot write: {error.strerror}"
        raise BatchError(
            (scheduler or "scheduler") if broken else order.out,
            f"{text}; {_progress(stand)}",
        ) from None


def _progress(stand: Progress) -> str:
    return f"{stand.done} of {stand.total} jobs are done; --resume goes on from there"
