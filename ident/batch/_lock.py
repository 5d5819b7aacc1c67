"""One batch per folder: the second one refuses, and a killed one leaves nothing locked."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from ._errors import BatchError

NAME = "batch.lock"


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder for this process; the system lets go when the process ends.

    Raises:
        BatchError: If another process holds it.
        OSError: If the lock cannot be made.
    """
    path = folder / NAME
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            _take(handle)
        except OSError:
            owner = os.read(handle, 64).decode(errors="replace").strip()
            raise BatchError(
                where=str(folder),
                reason=f"found another batch running in it (process {owner or '?'}),"
                " expected a folder of its own (--out), or its end",
            ) from None
        os.ftruncate(handle, 0)
        os.write(handle, str(os.getpid()).encode())
        yield
    finally:
        os.close(handle)


def _take(handle: int) -> None:
    if os.name == "nt":
        import msvcrt

        # Far behind the number, so that it can be read all the same.
        os.lseek(handle, 1024, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        os.lseek(handle, 0, os.SEEK_SET)
        return
    import fcntl

    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
