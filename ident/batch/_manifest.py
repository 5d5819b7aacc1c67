"""What a batch consists of: jobs with hashes, versions, when it ran."""

import dataclasses
import datetime
import importlib.metadata
import json
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...data.files import write_atomically
from ._errors import BatchError
from ._rows import Row
from ._schema import VERSION
from ._work import Task

NAME = "batch.json"


@dataclasses.dataclass(frozen=True)
class Manifest:
    """The file ``batch.json``.

    Attributes:
        arguments: What was asked for.
        jobs: Hash of every job file, by name of the job.
        started: When the batch first began.
    """

    arguments: tuple[str, ...]
    jobs: Mapping[str, str]
    started: str

    @classmethod
    def of(cls, arguments: Sequence[str | Path], tasks: Sequence[Task]) -> "Manifest":
        """Return the manifest of a batch that begins now."""
        return cls(
            tuple(map(str, arguments)),
            {task.name: task.sha256 for task in tasks},
            datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        )

    def refuse_used(self, folder: Path) -> None:
        """Raise where the folder holds a batch already.

        Raises:
            BatchError: Naming what to do.
        """
        if (folder / NAME).exists():
            raise BatchError(
                where=str(folder),
                reason="found a batch in it, expected --resume to go on with it, or"
                " another folder (--out)",
            )
        for kind in ("lists", "unverified"):
            if (folder / kind).exists():
                raise BatchError(
                    where=str(folder / kind),
                    reason="found files of something else, expected an empty folder"
                    " (--out)",
                )

    def resumed(
        self, folder: Path, rows: Mapping[str, list[Row]]
    ) -> dict[str, list[Row]]:
        """Return the rows of jobs that are done; those whose file changed are not.

        Raises:
            BatchError: If the folder holds a batch of other jobs.
        """
        try:
            before = json.loads((folder / NAME).read_bytes())["jobs"]
        except FileNotFoundError:
            return {}
        except (ValueError, KeyError):
            reason = "found no manifest of a batch, expected one"
            raise BatchError(where=str(folder / NAME), reason=reason) from None
        lost = [name for name in before if name not in self.jobs]
        if lost:
            raise BatchError(
                where=str(folder),
                reason=f"found a batch with the job {lost[0]!r}, which is not among the"
                f" {len(self.jobs)} given now, expected the same jobs (or more)",
            )
        return {
            name: own
            for name, own in rows.items()
            if before.get(name) == self.jobs.get(name)
        }

    def write(self, folder: Path) -> None:
        """Write it, before any job runs."""
        write_atomically(folder / NAME, self._text({}))

    def finish(self, folder: Path, seconds: float) -> None:
        """Write it once more, with the end of the batch."""
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        write_atomically(
            folder / NAME, self._text({"finished": now, "seconds": round(seconds, 1)})
        )

    def _text(self, end: Mapping[str, Any]) -> bytes:
        packages = ("axcomp", "numpy", "scipy", "jax", "distributed", "pyarrow")
        tree = {
            "schema": VERSION,
            "arguments": list(self.arguments),
            "started": self.started,
            **end,
            "versions": {"python": platform.python_version()}
            | {name: importlib.metadata.version(name) for name in packages},
            "jobs": dict(self.jobs),
        }
        return (json.dumps(tree, indent=1) + "\n").encode()
