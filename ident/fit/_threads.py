"""Linear algebra on one thread while a table is fitted.

The band matrices here are too narrow to share well, and the threads of BLAS and of XLA
fight for the same cores: one BLAS thread is faster, and much faster on a busy machine.
"""

import contextlib
import functools
import os
from collections.abc import Iterator

from threadpoolctl import ThreadpoolController


@functools.cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread inside the block."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


def cores() -> int:
    """Return the number of processors of this machine."""
    return os.cpu_count() or 1
