"""Files that are whole, also after a crash or a power cut."""

import contextlib
import errno
import hashlib
import os
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path

_PART = 1 << 16
"""Bytes of a file that are hashed at a time: most files are no longer."""
LONGEST_NAME = 200
"""Bytes of a name to which some can be added on any file system."""


def write_atomically(path: Path, content: bytes, *, sync: bool = True) -> None:
    """Write a file so that readers, and a crash, see the old one or the new one.

    Args:
        path: The file.
        content: Of it.
        sync: False where nobody looks into the folder before `sync_folder`: then the
            file is written as it comes.

    Raises:
        OSError: If it cannot be written; the old file is as it was.
    """
    if not path.name:  # "." or "/": no name of a file, and none to make a draft's of
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not sync:
        _write(path, content)
        return
    write_together({path: content})


def write_together(contents: Mapping[Path, bytes]) -> None:
    """Write the files of one folder, each as `write_atomically` does.

    Args:
        contents: By path, all in one folder.

    Raises:
        OSError: If one cannot be written; those before it may be new.
    """
    if not contents:
        return
    drafts = {path: path.with_name(_draft_name(path.name)) for path in contents}
    path = next(iter(contents))
    try:
        with contextlib.ExitStack() as stack:
            handles = []
            for path, content in contents.items():
                handles.append(stack.enter_context(drafts[path].open("wb")))
                handles[-1].write(content)
                handles[-1].flush()
            _sync([handle.fileno() for handle in handles])
        for path, draft in drafts.items():
            draft.replace(path)
    except BaseException as error:
        for draft in drafts.values():
            with contextlib.suppress(OSError):
                draft.unlink()
        if isinstance(error, OSError) and error.errno is not None:
            # Of the draft nobody knows anything.
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise
    _sync_folder(path.parent)


def keep_copy(path: Path, folder: Path) -> Path | None:
    """Copy a file into a folder, by another name where its own is taken.

    Args:
        path: The file.
        folder: Made where it is missing.

    Returns:
        The copy; None where the folder held one already.

    Raises:
        OSError: If it cannot be read or copied.
    """
    content = path.read_bytes()
    names = (f"{path.stem}.{k}{path.suffix}" if k else path.name for k in count())
    for copy in map(folder.joinpath, names):
        if not copy.exists():
            folder.mkdir(parents=True, exist_ok=True)
            write_atomically(copy, content)
            return copy
        if copy.read_bytes() == content:
            return None
    raise AssertionError  # names never end


def write_keeping(path: Path, content: bytes) -> Path | None:
    """Write a file; what it held before is copied into ``kept/`` beside it.

    Args:
        path: The file.
        content: Of it.

    Returns:
        The copy; None where there was nothing else to keep.

    Raises:
        OSError: If it cannot be copied or written.
    """
    is_other = path.is_file() and path.read_bytes() != content
    copy = keep_copy(path, path.parent / "kept") if is_other else None
    write_atomically(path, content)
    return copy


def sha256(path: Path) -> str:
    """Return the hash of a file, for the record."""
    digest = hashlib.sha256()
    with path.open("rb", buffering=0) as file:
        while part := file.read(_PART):
            digest.update(part)
    return digest.hexdigest()


def _write(path: Path, content: bytes) -> None:
    # Without a buffer in between, which would ask the system what kind of file it is.
    with path.open("wb", buffering=0) as file:
        remaining = memoryview(content)
        while remaining:
            remaining = remaining[file.write(remaining) :]


def sync_folder(folder: Path) -> None:
    """Make a folder of written files survive a power cut.

    Args:
        folder: The folder, with all that lies in it.

    Raises:
        OSError: If the disk does not take them.
    """
    with contextlib.ExitStack() as stack:
        files: list[int] = []
        folders: list[int] = []
        for parent, _, names in os.walk(folder):
            for name in names:
                files.append(os.open(os.path.join(parent, name), os.O_RDWR))  # noqa: PTH118
                stack.callback(os.close, files[-1])
            # The new names must survive as well; not every system can do that.
            with contextlib.suppress(OSError):
                folders.append(os.open(parent, os.O_RDONLY))
                stack.callback(os.close, folders[-1])
        _sync(files)
        for handle in folders:
            with contextlib.suppress(OSError):
                os.fsync(handle)


def _sync(files: Sequence[int]) -> None:
    """Wait until the disk has taken open files."""
    # Once all are on their way to it, waiting takes little more than for one; Linux sends
    # them off when it hears that nobody will read them soon.
    if hasattr(os, "posix_fadvise"):
        for file in files:
            os.posix_fadvise(file, 0, 0, os.POSIX_FADV_DONTNEED)
    for file in files:
        os.fsync(file)


def _draft_name(name: str) -> str:
    raw = os.fsencode(name)
    if len(raw) <= LONGEST_NAME:
        return f"{name}.part"
    # Beside a name as long as a file system takes there is no room for more.
    return f"{hashlib.sha256(raw).hexdigest()[:32]}.part"


def _sync_folder(folder: Path) -> None:
    # The new name must survive a power cut as well; not every system can do that.
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
