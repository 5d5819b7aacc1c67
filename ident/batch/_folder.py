"""The folder of a batch: its manifest, and who works in it."""

import contextlib
import datetime
import importlib.metadata
import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...data.errors import SourceError
from ...data.files import write_atomically
from ._rows import VERSION


class BatchError(SourceError, RuntimeError):
    """A batch that cannot start or go on: where, what was found and what was expected."""


_MANIFEST = "batch.json"


def begin(
    folder: Path,
    arguments: Sequence[str | Path],
    jobs: Mapping[str, str],
    *,
    resume: bool,
) -> dict[str, Any]:
    """Write ``batch.json`` for a batch that begins now, and return what it says.

    Beside the arguments it holds the hash of every job file, by name of the job. To resume is
    to go on with the batch in the folder; without one, to begin.

    Raises:
        BatchError: If the folder holds something else: a batch that was not to be gone on
            with, or one of other jobs.
    """
    path = folder / _MANIFEST
    if path.exists() and not resume:
        raise BatchError(
            str(folder),
            "found a batch in it, expected --resume to go on with it, or"
            " another folder (--out)",
        )
    for kind in () if resume else ("lists", "unverified"):
        if (folder / kind).exists():
            raise BatchError(
                str(folder / kind),
                "found files of something else, expected an empty folder (--out)",
            )
    if path.exists():
        try:
            before = json.loads(path.read_bytes())["jobs"]
        except (ValueError, KeyError):
            reason = "found no manifest of a batch, expected one"
            raise BatchError(str(path), reason) from None
        missing = [name for name in before if name not in jobs]
        if missing:
            raise BatchError(
                str(folder),
                f"found a batch with the job {missing[0]!r}, which is not among the"
                f" {len(jobs)} given now, expected the same jobs (or more; files of one name"
                " are told apart by their folders)",
            )
    packages = ("axcomp", "numpy", "scipy", "jax", "distributed", "pyarrow")
    manifest = {
        "schema": VERSION,
        "arguments": [str(argument) for argument in arguments],
        "started": _now(),
        "versions": {"python": platform.python_version()}
        | {name: importlib.metadata.version(name) for name in packages},
        "jobs": dict(jobs),
    }
    _write(path, manifest)
    return manifest


def end(folder: Path, manifest: Mapping[str, Any], seconds: float) -> None:
    """Write ``batch.json`` once more when all jobs are done."""
    ending = {"finished": _now(), "seconds": round(seconds, 1)}
    _write(folder / _MANIFEST, {**manifest, **ending})


def _write(path: Path, manifest: Mapping[str, Any]) -> None:
    write_atomically(path, (json.dumps(manifest, indent=1) + "\n").encode())


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


_LOCK = "batch.lock"


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder for this process; the system lets go when the process ends.

    Raises:
        BatchError: If another process holds it.
        OSError: If the lock cannot be made.
    """
    path = folder / _LOCK
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            _take(handle)
        except OSError:
            owner = os.read(handle, 64).decode(errors="replace").strip()
            raise BatchError(
                str(folder),
                f"found another batch running in it (process {owner or '?'}),"
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
