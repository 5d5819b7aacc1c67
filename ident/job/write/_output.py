"""The output folder: whole files or none, and no failed list that looks valid."""

import contextlib
import itertools
import json
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

from ....data.errors import AxcompError
from ....data.files import write_atomically

REJECTED = "rejected"
KEPT = "kept"
"""Where files go that lay in the folder and are not of an earlier run."""


class OutputError(AxcompError, OSError):
    """A folder or file that cannot be written."""

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(path, reason)
        self.path, self.reason = path, reason

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}"


def _files_of(result: Path) -> frozenset[str]:
    """Return the files that an earlier run says it wrote; none where it says nothing."""
    try:
        files = json.loads(result.read_bytes())["files"]
        return frozenset(str(Path(file)) for file in files)
    except (OSError, ValueError, KeyError, TypeError):
        return frozenset()


class OutFolder:
    """Where a job writes.

    Args:
        root: The folder; made where it does not exist.
        sources: Files of the user that must never be written onto.
        sync: Every file survives a power cut from the moment it is there. False for a
            folder that nobody looks at before `sync_folder` was called.

    Raises:
        OutputError: If it cannot be made or written to.
    """

    def __init__(
        self, root: Path, sources: Iterable[Path], *, sync: bool = True
    ) -> None:
        self.root = root
        self._sync = sync
        self._written: dict[str, Path] = {}
        self.remarks: list[str] = []
        self._sources = tuple(sources)
        self._made = not root.exists()
        try:
            root.mkdir(parents=True, exist_ok=True)
            if not self._made:
                with tempfile.TemporaryFile(dir=root):
                    pass
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(
                path=str(root), reason=f"cannot write into the output folder: {reason}"
            ) from None
        self._earlier = frozenset() if self._made else _files_of(root / "result.json")

    @property
    def written(self) -> tuple[Path, ...]:
        """What was written, relative to the folder, in order."""
        return tuple(self._written.values())

    def drop(self) -> None:
        """Remove the folder where it was made for nothing."""
        if self._made:
            with contextlib.suppress(OSError):
                self.root.rmdir()

    def _is_strange(self, name: str) -> bool:
        """Return whether a file lies in the folder that no earlier run wrote."""
        return (
            not self._made
            and (self.root / name).is_file()
            and name not in self._earlier
        )

    def refuse_sources(self, names: Iterable[str]) -> None:
        """Raise where a file to be written is one that the job reads.

        Raises:
            OutputError: Naming the file and what to do.
        """
        if self._made:
            return  # nothing could lie in it before
        theirs = {source.resolve() for source in self._sources}
        for name in names:
            target = self.root / name
            if target.resolve() in theirs:
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
            if "/" in name or not self._made:
                target.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(target, content, sync=self._sync)
        except OSError as error:
            reason = f"cannot write: {error.strerror or error}"
            raise OutputError(path=str(target), reason=reason) from None
        return self._written.setdefault(name, Path(name))

    def accept(self, name: str, content: bytes) -> Path:
        """Write a list that passed; what an earlier run rejected goes.

        A list of the user's own that has this name is kept in ``kept/``.
        """
        if self._is_strange(name) and (self.root / name).read_bytes() != content:
            self._keep(name)
        written = self.write(name, content)
        if self._made:
            return written  # no earlier run has rejected anything here
        with contextlib.suppress(OSError):
            (self.root / REJECTED / name).unlink()
        return written

    def renew(self, names: Iterable[str], contents: Mapping[str, bytes]) -> None:
        """Write those of some files that have contents; of the others an earlier run's go."""
        for name in names:
            if name in contents:
                self.accept(name, contents[name])
            else:
                self.retire(name)

    def _keep(self, name: str) -> None:
        stem, _, tail = name.rpartition(".")
        names = (f"{stem}.{k}.{tail}" if k else name for k in itertools.count())
        kept = next(
            Path(KEPT) / n for n in names if not (self.root / KEPT / n).exists()
        )
        target = self.root / name
        try:
            (self.root / KEPT).mkdir(exist_ok=True)
            write_atomically(self.root / kept, target.read_bytes())
        except OSError as error:
            reason = f"cannot keep a copy of it in {KEPT}/: {error.strerror or error}"
            raise OutputError(path=str(target), reason=reason) from None
        self.remarks.append(
            f"{name} lay in the output folder and was not written by the last run:"
            f" it was kept as {kept}."
        )

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

        A file that no earlier run wrote is the user's and stays where it is.

        Returns:
            Its new name, or None where there was none.
        """
        if self._made and name not in self._written:
            return None
        target = self.root / name
        if self._is_strange(name):
            self.remarks.append(
                f"{name} lies in the output folder and is not of this run."
            )
            return None
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
