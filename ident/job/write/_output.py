"""The output folder: whole files or none, and no failed list that looks valid."""

import contextlib
import hashlib
import json
import re
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from ....data.errors import SourceError
from ....data.files import keep_copy, write_atomically

REJECTED = "rejected"
KEPT = "kept"
"""Where files go that lay in the folder and are not as an earlier run of the job left them."""
PLOTS = "plots"
"""Where the drawings of the report lie."""
_DRAWN = re.compile(r"overview|(group-)?\d+-.+")
"""Their names."""
RESULT, REPORT = "result.json", "report.html"
"""What a run writes last; the report is drawn of the result, which does not name it."""
_SIGNED = "<!-- {} -->\n"
"""How pages and drawings end: with the digest of what stands before, as a comment."""


class OutputError(SourceError, OSError):
    """A folder or file that cannot be written."""


def signed(text: str, comment: str = _SIGNED) -> bytes:
    """Return a text with its digest at the end, by which it is known again."""
    # A path may hold bytes that are no UTF-8.
    content = text.encode(errors="backslashreplace")
    return content + comment.format(_digest(content)).encode()


def is_signed(content: bytes, comment: str = _SIGNED) -> bool:
    """Return whether a text is still as `signed` returned it."""
    size = len(comment.format(_digest(b"")))
    return content[-size:] == comment.format(_digest(content[:-size])).encode()


@contextlib.contextmanager
def _reported(path: Path, failure: str) -> Iterator[None]:
    """Turn an error of the system into one that says what could not be done."""
    try:
        yield
    except OSError as error:
        reason = f"{failure}: {error.strerror or error}"
        raise OutputError(str(path), reason) from None


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _digests_in(result: Path, job: Path, machine: str | None) -> dict[str, str] | None:
    """Return the digest of each file that an earlier run of a job wrote, as its result says.

    None where it is no result of this job, or of another machine's job of the same name.
    """
    try:
        tree = json.loads(result.read_bytes())
        is_its = job.name in tree["inputs"] and tree["machine"].get("id") == machine
        return dict(tree["digests"]) if is_its else None
    except (AttributeError, OSError, ValueError, KeyError, TypeError):
        return None


class OutFolder:
    """Where a job writes.

    Args:
        root: The folder; made where it does not exist.
        job: The job file.
        machine: Its machine, or None.
        sources: Other files of the user that must never be written onto.
        sync: Every file survives a power cut from the moment it is there. False for a
            folder that nobody looks at before `sync_folder` was called.

    Attributes:
        digests: SHA-256 of what was written, by its name in the folder, in order.
        remarks: What the user must know of files that were there.
        moved: Where files of an earlier run went, by name.

    Raises:
        OutputError: If it cannot be made or written to.
    """

    def __init__(
        self,
        root: Path,
        job: Path,
        sources: Iterable[Path],
        *,
        machine: str | None = None,
        sync: bool = True,
    ) -> None:
        self.root = root
        self._sync = sync
        self.digests: dict[str, str] = {}
        self.remarks: list[str] = []
        self.moved: dict[str, Path] = {}
        self._sources = (job, *sources)
        self._made = not root.exists()
        with _reported(root, "cannot write into the output folder"):
            root.mkdir(parents=True, exist_ok=True)
            if not self._made:
                tempfile.TemporaryFile(dir=root).close()
        # What an earlier run of the job wrote, and what of it may be written over by now.
        earlier = _digests_in(root / RESULT, job, machine)
        self._earlier = earlier or {}
        self._is_known = earlier is not None
        self._free = {RESULT} if self._is_known else set[str]()

    def drop(self) -> None:
        """Remove the folder where it was made for nothing."""
        if self._made:
            with contextlib.suppress(OSError):
                self.root.rmdir()

    def _is_strange(self, name: str) -> bool:
        """Return whether a file lies in the folder that no run of the job left like this."""
        if name in self._free or not (self.root / name).is_file():
            return False
        content = (self.root / name).read_bytes()
        if self._earlier.get(name) == _digest(content):
            return False
        # Pages and drawings come after the result, which cannot name them.
        return not (self._is_known and is_signed(content))

    def refuse_sources(self, names: Iterable[str]) -> None:
        """Raise where a file to be written is one that the job reads."""
        theirs = {source.resolve() for source in self._sources}
        for name in names:
            target = self.root / name
            if target.resolve() in theirs:
                reason = (
                    "is an input and is never written onto, expected another output"
                    " folder (--out)"
                )
                raise OutputError(str(target), reason)

    def write(self, name: str, content: bytes) -> Path:
        """Write a file and return its name, relative to the folder.

        A file of the user's own that has this name is kept in ``kept/``.

        Raises:
            OutputError: If it cannot be written.
        """
        self.keep(name, content)
        target = self.root / name
        with _reported(target, "cannot write"):
            target.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(target, content, sync=self._sync)
        self.digests[name] = _digest(content)
        return Path(name)

    def renew(
        self,
        names: Iterable[str],
        contents: Mapping[str, bytes],
        *,
        failed: bool = False,
    ) -> tuple[Path, ...]:
        """Write files that belong together; what an earlier run left of them goes.

        Those that failed are written into ``rejected/``: beside a failed job a list of an
        earlier run would be picked up as its result.

        Args:
            names: Of all files that a run may write there.
            contents: Of those that this run writes.
            failed: The gate has stopped them.
        """
        for name in [*contents, *sorted(set(names) - set(contents))]:
            if failed or name not in contents:
                self.retire(name)
        if failed:
            return tuple(
                self.write(f"{REJECTED}/{name}", content)
                for name, content in contents.items()
            )
        written = tuple(self.write(name, content) for name, content in contents.items())
        for name in contents:
            rejected = f"{REJECTED}/{name}"
            if rejected in self._earlier and not self._is_strange(rejected):
                with contextlib.suppress(OSError):
                    (self.root / rejected).unlink()
        return written

    def keep(self, name: str, content: bytes | None = None) -> None:
        """Copy a file into ``kept/`` that is not as a run of the job left it.

        It may be written over then, and is not kept where it has the content already.

        Raises:
            OutputError: If it cannot be copied.
        """
        target, is_strange = self.root / name, self._is_strange(name)
        self._free.add(name)
        if not is_strange or target.read_bytes() == content:
            return
        with _reported(target, f"cannot keep a copy of it in {KEPT}/"):
            copy = keep_copy(target, (self.root / KEPT / name).parent)
        if copy is None:
            return  # an earlier run has kept it
        self.remarks.append(
            f"{name} lay in the output folder and is not as an earlier run of this job left"
            f" it: it was kept as {copy.relative_to(self.root)}."
        )

    def keep_drawings(self) -> None:
        """Keep what is no drawing of a report among those that the next one replaces."""
        for path in sorted((self.root / PLOTS).glob("*.svg")):
            if _DRAWN.fullmatch(path.stem):
                self.keep(f"{PLOTS}/{path.name}")

    def retire_others(self, names: Collection[str]) -> None:
        """Retire what an earlier run of the job wrote under other names: of other axes."""
        for name in self._earlier:
            if name not in names and (self.root / name).parent == self.root:
                self.retire(name)

    def retire(self, name: str) -> None:
        """Move a file of an earlier run into ``rejected/``, where nobody loads it from.

        A file that no earlier run wrote is the user's and stays where it is.
        """
        target = self.root / name
        if self._is_strange(name):
            self.remarks.append(
                f"{name} lies in the output folder and is not of this run."
            )
            return
        if not target.exists() and not target.is_symlink():
            return
        stem, _, tail = name.rpartition(".")
        kept = Path(REJECTED) / f"{stem}.earlier.{tail}"
        with _reported(target, "cannot move it into rejected/"):
            (self.root / REJECTED).mkdir(exist_ok=True)
            target.replace(self.root / kept)
        self.moved[name] = kept
