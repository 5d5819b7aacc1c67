"""What a batch has done so far, on disk: every line is whole, or was never written."""

import json
import os
from collections.abc import Sequence
from pathlib import Path

from ._rows import Row

NAME = "journal.jsonl"


class Journal:
    """Rows of finished jobs, in the order in which they finished.

    Args:
        folder: Of the batch.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME

    def read(self) -> dict[str, list[Row]]:
        """Return the rows by job; a line that a crash cut off is taken away."""
        found: dict[str, list[Row]] = {}
        try:
            raw = self._path.read_bytes()
        except FileNotFoundError:
            return found
        good = 0
        for line in raw.splitlines(keepends=True):
            try:
                name, rows = json.loads(line)
            except ValueError:
                break
            if not line.endswith(b"\n"):
                break
            found[name] = rows
            good += len(line)
        if good < len(raw):
            with self._path.open("r+b") as file:
                file.truncate(good)
        return found

    def add(self, entries: Sequence[tuple[str, list[Row]]]) -> None:
        """Write rows of jobs so that they survive whatever comes next.

        Raises:
            OSError: If there is no room for them; none of them counts then.
        """
        text = "".join(json.dumps(entry) + "\n" for entry in entries)
        with self._path.open("ab") as file:
            start = file.tell()
            try:
                file.write(text.encode())
                file.flush()
                os.fsync(file.fileno())
            except OSError:
                os.ftruncate(file.fileno(), start)
                raise
