"""Workers: processes of this machine, or those of a scheduler anywhere."""

import contextlib
import logging
import os
import warnings
from collections.abc import Iterator
from typing import Any, cast

from ._errors import BatchError

_CONNECT = "20s"
"""How long to wait for a scheduler."""
_ONE_THREAD = {
    **dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
    ),
    # Tables of a few nodes are no work to share out.
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}


@contextlib.contextmanager
def workers_of(scheduler: str | None, count: int | None) -> Iterator[Any]:
    """Connect to a scheduler, or start workers here, and yield the client.

    Args:
        scheduler: Address of a running scheduler (``tcp://host:8786``), or None.
        count: Local workers; one per core where None.

    Raises:
        BatchError: If the scheduler does not answer.
    """
    import dask.config
    import distributed

    settings = {
        "distributed.nanny.pre-spawn-environ": _ONE_THREAD,
        "distributed.comm.timeouts.connect": _CONNECT,
        "distributed.worker.memory.terminate": False,
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
                where=scheduler,
                reason=f"no scheduler answers ({' '.join(str(error).split())[:120]}),"
                " expected the address of a running dask scheduler",
            ) from None
        yield stack.enter_context(client)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep the libraries' logs and warnings back.

    What goes wrong is told in the rows and in one line, not in tracebacks.
    """
    names = [name for name in logging.root.manager.loggerDict if _is_theirs(name)]
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"distributed\.|dask\.|tornado\.")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _is_theirs(name: str) -> bool:
    return name.partition(".")[0] in ("distributed", "tornado", "asyncio")
