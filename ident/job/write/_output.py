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
"""Where files go that lay in the folder and are not of an earlier run of the job."""
RESULT, REPORT = "result.json", "report.html"
"""What a run writes last; the report is drawn of the result, which does not name it."""


class OutputError(AxcompError, OSError):
    """A folder or file that cannot be written."""

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(path, reason)
        self.path, self.reason = path, reason

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}"


def _files_of(result: Path, job: Path) -> frozenset[str]:
    """Return what an earlier run of a job wrote, as its result says; else nothing."""
    try:
        tree = json.loads(result.read_bytes())
        own = job.name in tree["inputs"] and "load_sheet" in tree
        files = [str(Path(file)) for file in tree["files"]] if own else []
    except (OSError, ValueError, KeyError, TypeError):
        return frozenset()
    return frozenset([*files, REPORT] if files else [])


class OutFolder:
    """Where a job writes.

    Args:
        root: The folder; made where it does not exist.
        job: The job file.
        sources: Other files of the user that must never be written onto.
        sync: Every file survives a power cut from the moment it is there. False for a
            folder that nobody looks at before `sync_folder` was called.

    Raises:
        OutputError: If it cannot be made or written to.
    """

    def __init__(
        self, root: Path, job: Path, sources: Iterable[Path], *, sync: bool = True
    ) -> None:
        self.root = root
        self._sync = sync
        self._written: dict[str, Path] = {}
        self.remarks: list[str] = []
        self._sources = (job, *sources)
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
        # What may be written over.
        self._own = set() if self._made else set(_files_of(root / RESULT, job))

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
        """Return whether a file lies in the folder that no run of the job wrote."""
        return not self._made and (self.root / name).is_file() and name not in self._own

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
                    reason="is an input and is never written onto,"
                    " expected another output folder (--out)",
                )

    def write(self, name: str, content: bytes) -> Path:
        """Write a file and return its name, relative to the folder.

        A file of the user's own that has this name is kept in ``kept/``.

        Raises:
            OutputError: If it cannot be written.
        """
        self.keep(name, content)
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
        """Write a list that passed; what an earlier run rejected goes."""
        written = self.write(name, content)
        if (rejected := f"{REJECTED}/{name}") in self._own:
            with contextlib.suppress(OSError):
                (self.root / rejected).unlink()
        return written

    def renew(self, names: Iterable[str], contents: Mapping[str, bytes]) -> None:
        """Write those of some files that have contents; of the others an earlier run's go."""
        for name in names:
            if name in contents:
                self.accept(name, contents[name])
            else:
                self.retire(name)

    def keep(self, name: str, content: bytes | None = None) -> None:
        """Copy a file into ``kept/`` that no run of the job wrote; then it may be written over.

        Args:
            name: Of the file.
            content: What will be written there.

        Raises:
            OutputError: If it cannot be copied.
        """
        is_lost = self._is_strange(name) and (self.root / name).read_bytes() != content
        self._own.add(name)
        if not is_lost:
            return
        stem, _, tail = name.rpartition(".")
        names = (f"{stem}.{k}.{tail}" if k else name for k in itertools.count())
        kept = next(
            Path(KEPT) / n for n in names if not (self.root / KEPT / n).exists()
        )
        target = self.root / name
        try:
            (self.root / kept).parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self.root / kept, target.read_bytes())
        except OSError as error:
            reason = f"cannot keep a copy of it in {KEPT}/: {error.strerror or error}"
            raise OutputError(path=str(target), reason=reason) from None
        self.remarks.append(
            f"{name} lay in the output folder and is none of what was written there"
            f" before: it was kept as {kept}."
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
