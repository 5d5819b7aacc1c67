"""Linear algebra on one thread while something is fitted.

The band matrices here are too narrow to share well, and the threads of BLAS and of XLA
fight for the same cores: one BLAS thread is faster, and much faster on a busy machine.
"""

import contextlib
import functools
import threading
from collections.abc import Iterator
from typing import Any

from threadpoolctl import OpenBLASController, ThreadpoolController

_controller = functools.cache(ThreadpoolController)


class _Limit:
    """The limit on BLAS threads, shared by all fits that overlap in time.

    The first fit sets it and the last one lifts it: a fit that restored what it found
    would leave the limit of another one behind for ever. threadpoolctl listens to the
    thread that set a limit only; the last fit may run in another one.
    """

    lock = threading.Lock()
    users = 0
    limiter: Any = None


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread inside the block, in whatever threads blocks overlap."""
    with _Limit.lock:
        if _Limit.users == 0:
            OpenBLASController.clear_controlling_thread(force=True)
            _Limit.limiter = _controller().limit(limits=1, user_api="blas")
        _Limit.users += 1
    try:
        yield
    finally:
        with _Limit.lock:
            _Limit.users -= 1
            if _Limit.users == 0:
                OpenBLASController.clear_controlling_thread(force=True)
                _Limit.limiter.restore_original_limits()
                OpenBLASController.clear_controlling_thread(force=True)
