"""Linear algebra on one thread while something is fitted.

The band matrices here are too narrow to share well, and the threads of BLAS and of XLA
fight for the same cores: one BLAS thread is faster, and much faster on a busy machine.
"""

import contextlib
import functools
import os
import threading
from collections.abc import Iterator
from typing import Any

from threadpoolctl import OpenBLASController, ThreadpoolController


@functools.cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


class _Limit:
    """The limit on BLAS threads, shared by all fits that overlap in time.

    The first fit sets it and the last one lifts it: a fit that restored what it found
    would leave the limit of another one behind for ever. threadpoolctl listens to the
    thread that set a limit only; the last fit may run in another one.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users = 0
        self._limiter: Any = None

    def enter(self) -> None:
        with self._lock:
            if self._users == 0:
                OpenBLASController.clear_controlling_thread(force=True)
                self._limiter = _controller().limit(limits=1, user_api="blas")
            self._users += 1

    def leave(self) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0:
                OpenBLASController.clear_controlling_thread(force=True)
                self._limiter.restore_original_limits()
                OpenBLASController.clear_controlling_thread(force=True)


_LIMIT = _Limit()


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread inside the block, in whatever threads blocks overlap."""
    _LIMIT.enter()
    try:
        yield
    finally:
        _LIMIT.leave()


def cores() -> int:
    """Return the number of processors of this machine."""
    return os.cpu_count() or 1
