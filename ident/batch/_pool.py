"""Chunks of jobs on workers that may die, and a scheduler that may get lost."""

from collections.abc import Iterator, Sequence
from typing import Any

from ._errors import BatchError
from ._rows import failed_row
from ._work import Order, Outcome, Task, run_chunk


def run_chunks(
    client: Any, tasks: Sequence[Task], order: Order, size: int
) -> Iterator[list[Outcome]]:
    """Yield the outcomes of jobs as they come, those of a chunk together.

    A chunk that loses its workers again and again is run job by job; a job that then does so
    too is the one at fault.

    Args:
        client: Of the workers.
        tasks: The jobs.
        order: What holds for all of them.
        size: Jobs of a chunk.

    Raises:
        BatchError: If the scheduler is lost.
    """
    import distributed

    chunks: dict[Any, list[Task]] = {}
    running = distributed.as_completed([], raise_errors=False)  # type: ignore[no-untyped-call]

    def submit(chunk: list[Task]) -> None:
        future = client.submit(run_chunk, chunk, order, pure=False)
        chunks[future] = chunk
        running.add(future)  # type: ignore[no-untyped-call]

    try:
        for start in range(0, len(tasks), size):
            submit(list(tasks[start : start + size]))
        for future in running:
            chunk = chunks.pop(future)
            if future.status == "finished":
                yield future.result()
            elif future.cancelled() or client.status != "running":
                where = str(getattr(client.scheduler, "address", "scheduler"))
                raise BatchError(where=where, reason="the scheduler was lost")
            elif len(chunk) > 1:
                for task in chunk:
                    submit([task])
            else:
                yield [_at_fault(chunk[0], future.exception())]
    finally:
        if chunks and client.status == "running":
            client.cancel(list(chunks), force=True)


def _at_fault(task: Task, error: BaseException) -> Outcome:
    """Return the row of a job that its workers died of."""
    died = type(error).__name__ == "KilledWorker"
    words = "the worker died while it ran" if died else " ".join(str(error).split())
    return Outcome(task.name, [failed_row(task.name, words, job_sha256=task.sha256)])
