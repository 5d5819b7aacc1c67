"""Workers, here or anywhere: jobs in chunks, workers that die, a scheduler that gets lost."""

import contextlib
import logging
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Sequence
from typing import Any, cast

from ._collect import Task
from ._folder import BatchError
from ._work import Order, Outcome, failed, run_chunk

_CONNECT = "20s"
"""How long to wait for a scheduler."""
_ONE_THREAD = {
    **dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
    ),
    # Tables of a few nodes are no work to share out.
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}
_METHOD = "forkserver" if sys.platform == "linux" else "spawn"
"""How local workers are started: where it is safe, by forking a process that has imported all
that they need."""


def prepare_workers() -> None:
    """Begin to import what local workers need, in a process that they are forked from.

    It goes on beside this one. Without it every worker, and every one that takes the place
    of a dead one, would import all of that anew when it is started.
    """
    if _METHOD != "forkserver":
        return
    from multiprocessing import forkserver

    job = f"{(__package__ or '').rpartition('.')[0]}.job"
    multiprocessing.get_context(_METHOD).set_forkserver_preload(["distributed", job])
    before = dict(os.environ)
    os.environ.update(_ONE_THREAD | before)
    try:
        with _deaf():
            forkserver.ensure_running()
    finally:
        for name in _ONE_THREAD.keys() - before.keys():
            del os.environ[name]


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """Let processes that are started meanwhile, and theirs, not hear a Ctrl-C.

    The terminal sends it to all of them; they end with the process that they work for.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def workers_of(scheduler: str | None, count: int | None) -> Iterator[Any]:
    """Connect to a scheduler (``tcp://host:8786``), or start workers here, and yield the client.

    As many workers as cores where no count is given.

    Raises:
        BatchError: If the scheduler does not answer.
    """
    import dask.config
    import distributed

    settings = {
        "distributed.nanny.pre-spawn-environ": _ONE_THREAD,
        "distributed.worker.multiprocessing-method": _METHOD,
        "distributed.comm.timeouts.connect": _CONNECT,
        # The death of a worker counts against all that waits there for its turn.
        "distributed.scheduler.worker-saturation": 1.0,
        # It would look at the stacks of all jobs of a group a hundred times a second.
        "distributed.worker.profile.enabled": False,
        # Nobody asks how late the event loops are, fifty times a second.
        "distributed.admin.tick.interval": "1s",
        "distributed.logging.distributed": "critical",
    }
    with contextlib.ExitStack() as stack:
        stack.enter_context(_quiet())
        stack.enter_context(dask.config.set(settings))
        if scheduler is None:
            cluster: Any = stack.enter_context(
                distributed.LocalCluster(  # type: ignore[no-untyped-call]
                    n_workers=count or os.cpu_count() or 1,
                    threads_per_worker=1,
                    # A worker that is paused for its memory would never go on.
                    memory_limit=0,
                    dashboard_address=cast(str, None),  # None: no dashboard
                    silence_logs=logging.CRITICAL,
                )
            )
            yield stack.enter_context(distributed.Client(cluster))  # type: ignore[no-untyped-call]
            return
        try:
            client = distributed.Client(scheduler, timeout=_CONNECT)  # type: ignore[no-untyped-call]
        except (OSError, TimeoutError, ValueError) as error:
            raise BatchError(
                scheduler,
                f"no scheduler answers ({' '.join(str(error).split())[:120]}),"
                " expected the address of a running dask scheduler",
            ) from None
        yield stack.enter_context(client)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the libraries' logs and warnings back.

    What goes wrong is told in the rows and in one line, not in tracebacks.
    """
    theirs = ("distributed", "tornado", "asyncio")
    names = [n for n in logging.root.manager.loggerDict if n.split(".")[0] in theirs]
    levels = {logger: logger.level for logger in map(logging.getLogger, names)}
    for logger in levels:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"distributed\.|dask\.|tornado\.")
            yield
    finally:
        for logger, level in levels.items():
            logger.setLevel(level)


def run_chunks(
    client: Any, tasks: Sequence[Task], order: Order, size: int
) -> Iterator[list[Outcome]]:
    """Yield the outcomes of jobs as they come, those of a chunk together.

    A chunk that loses its workers again and again is run job by job; a job that then does so
    twice over is the one at fault.

    Raises:
        ConnectionError: If the scheduler is lost.
    """
    import distributed

    chunks: dict[Any, list[Task]] = {}
    suspected = set[str]()
    running = distributed.as_completed([], raise_errors=False)  # type: ignore[no-untyped-call]

    def submit(chunk: list[Task]) -> None:
        future = client.submit(run_chunk, chunk, order, pure=False)
        chunks[future] = chunk
        running.add(future)  # type: ignore[no-untyped-call]

    try:
        for start in range(0, len(tasks), size):
            submit(list(tasks[start : start + size]))
        for future in running:
            if future.status in ("pending", "lost"):
                # A worker died with the outcomes that it had; they are made once more.
                running.add(future)  # type: ignore[no-untyped-call]
                continue
            chunk = chunks.pop(future)
            if future.status == "finished":
                yield future.result()
            elif future.cancelled() or client.status != "running":
                raise ConnectionError
            elif len(chunk) > 1:
                for task in chunk:
                    submit([task])
            else:
                died = type(error := future.exception()).__name__ == "KilledWorker"
                if died and (task := chunk[0]).name not in suspected:
                    suspected.add(task.name)
                    submit(chunk)
                    continue
                words = "the worker died while it ran" if died else str(error)
                yield [failed(chunk[0], words)]
    finally:
        if chunks and client.status == "running":
            client.cancel(list(chunks), force=True)
