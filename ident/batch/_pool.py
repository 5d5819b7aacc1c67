"""Chunks of jobs on workers that may die, and a scheduler that may get lost."""

import dataclasses
import queue
import time
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

from ._errors import BatchError
from ._rows import failed_row
from ._work import Order, Outcome, Task, run_chunk

_IN_FLIGHT = 2
"""Chunks per worker that are submitted at once: one to do, one to follow."""
_SILENCE = 10.0
"""Seconds without a connection after which the scheduler counts as lost."""
_TRIES = 2
"""Workers that may die of a job on its own before it is given up."""


@dataclasses.dataclass
class _Chunk:
    tasks: Sequence[Task]
    tries: int = 0


def run_chunks(
    client: Any, chunks: Sequence[Sequence[Task]], order: Order
) -> Iterator[list[Outcome]]:
    """Yield the outcomes of chunks as they come.

    A chunk that loses its workers is run again job by job; a job that then does so too is
    the one at fault.

    Raises:
        BatchError: If the scheduler is lost.
    """
    waiting = deque(_Chunk(tasks) for tasks in chunks)
    running: dict[Any, _Chunk] = {}
    finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
    lost_since: float | None = None
    try:
        while waiting or running:
            room = _IN_FLIGHT * max(_workers(client), 1)
            while waiting and len(running) < room:
                chunk = waiting.popleft()
                future = client.submit(
                    run_chunk, list(chunk.tasks), order, pure=False, retries=0
                )
                running[future] = chunk
                future.add_done_callback(finished.put)
            try:
                future = finished.get(timeout=0.5)
            except queue.Empty:
                lost_since = _refuse_lost(client, lost_since)
                continue
            found = running.pop(future, None)
            if found is None:
                continue
            if future.status == "finished":
                yield future.result()
            elif future.status == "cancelled" or client.status != "running":
                running[future] = found
                _refuse_lost(client, time.monotonic() - 2 * _SILENCE)
            else:
                yield from _once_more(found, future, waiting)
    finally:
        if running and client.status == "running":
            client.cancel(list(running), force=True)


def _workers(client: Any) -> int:
    try:
        return len(client.scheduler_info(n_workers=-1)["workers"])
    except (OSError, KeyError, TypeError):
        return 1


def _refuse_lost(client: Any, since: float | None) -> float | None:
    """Raise where there has been no connection for too long; return since when."""
    if client.status == "running":
        return None
    now = time.monotonic()
    since = now if since is None else since
    if now - since > _SILENCE or client.status in ("closed", "closing"):
        raise BatchError(
            where=str(getattr(client.scheduler, "address", "scheduler")),
            reason="the scheduler was lost",
        )
    return since


def _once_more(
    chunk: _Chunk, future: Any, waiting: deque[_Chunk]
) -> Iterator[list[Outcome]]:
    """Take a chunk whose workers died apart, or give its only job up."""
    if len(chunk.tasks) > 1:
        waiting.extendleft(_Chunk([task]) for task in reversed(chunk.tasks))
        return
    chunk.tries += 1
    if chunk.tries < _TRIES:
        waiting.appendleft(chunk)
        return
    (task,) = chunk.tasks
    error = future.exception()
    kind = type(error).__name__
    words = "the worker died while it ran" if kind == "KilledWorker" else f"{error}"
    row = failed_row(task.name, " ".join(words.split()), job_sha256=task.sha256)
    yield [Outcome(task.name, [row])]
