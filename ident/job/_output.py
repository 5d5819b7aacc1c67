"""The output folder: whole files or none, and no failed list that looks valid."""

import contextlib
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from ._errors import OutputError

REJECTED = "rejected"


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file so that readers, and a crash, see the old one or the new one.

    Raises:
        OSError: If it cannot be written; the old file is as it was.
    """
    draft = path.with_name(path.name + ".part")
    try:
        with draft.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    # The new name must survive a power cut as well; not every system can do that.
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


class OutFolder:
    """Where a job writes.

    Args:
        root: The folder; made where it does not exist.
        sources: Files of the user that must never be written onto.

    Raises:
        OutputError: If it cannot be made or written to.
    """

    def __init__(self, root: Path, sources: Iterable[Path]) -> None:
        self.root = root
        self.written: list[Path] = []
        self._sources = [source.resolve() for source in sources]
        try:
            root.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=root):
                pass
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(
                path=str(root), reason=f"cannot write into the output folder: {reason}"
            ) from None

    def refuse_sources(self, names: Iterable[str]) -> None:
        """Raise where a file to be written is one that the job reads.

        Raises:
            OutputError: Naming the file and what to do.
        """
        for name in names:
            target = self.root / name
            if target.resolve() in self._sources:
                raise OutputError(
                    path=str(target),
                    reason="is an input of the job and is never written onto,"
                    " expected another output folder (--out)",
                )

    def write(self, name: str, content: bytes) -> Path:
        """Write a file and return its name, relative to the folder.

        Raises:
            OutputError: If it cannot be written.
        """
        target = self.root / name
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(target, content)
        except OSError as error:
            reason = f"cannot write: {error.strerror or error}"
            raise OutputError(path=str(target), reason=reason) from None
        relative = Path(name)
        if relative not in self.written:
            self.written.append(relative)
        return relative

    def accept(self, name: str, content: bytes) -> Path:
        """Write a list that passed; what an earlier run rejected goes."""
        written = self.write(name, content)
        with contextlib.suppress(OSError):
            (self.root / REJECTED / name).unlink()
        return written

    def reject(self, name: str, content: bytes) -> tuple[Path, Path | None]:
        """Write a list that failed into ``rejected/``.

        A list of that name from an earlier run is moved there as well: beside a failed
        job it would be picked up as its result.

        Returns:
            The name of the list, and of the one that was moved, or None.
        """
        moved = self.retire(name)
        return self.write(f"{REJECTED}/{name}", content), moved

    def retire(self, name: str) -> Path | None:
        """Move a file of an earlier run into ``rejected/``, where nobody loads it from.

        Returns:
            Its new name, or None where there was none.
        """
        target = self.root / name
        if not target.exists() and not target.is_symlink():
            return None
        stem, _, tail = name.rpartition(".")
        moved = Path(REJECTED) / f"{stem}.earlier.{tail}"
        try:
            (self.root / REJECTED).mkdir(exist_ok=True)
            target.replace(self.root / moved)
        except OSError as error:
            reason = f"cannot move it into rejected/: {error.strerror or error}"
            raise OutputError(path=str(target), reason=reason) from None
        return moved
