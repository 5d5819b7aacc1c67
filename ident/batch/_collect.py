"""Which jobs a batch has: job files, patterns, and tables with one job per row."""

import dataclasses
import glob
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from ._errors import BatchError
from ._job_table import read_job_table

_TABLES = (".csv", ".parquet", ".pq")


@dataclasses.dataclass(frozen=True)
class JobItem:
    """One job of a batch.

    Attributes:
        name: Unique in the batch; the folder that it writes carries it.
        path: The job file.
        text: What goes into the job file where it comes from a table, else None.
    """

    name: str
    path: Path
    text: str | None = None


def collect_jobs(arguments: Sequence[str | Path], out: Path) -> tuple[JobItem, ...]:
    """Return the jobs that a command line names, in order, each once.

    Args:
        arguments: Job files, patterns (``fleet/*.toml``), tables of jobs.
        out: Folder of the batch, where the job files of tables go.

    Raises:
        BatchError: If something does not exist, or there is no job at all.
    """
    files: dict[Path, None] = {}
    items: list[JobItem] = []
    for argument in arguments:
        for path in _files(str(argument)):
            if path.suffix.lower() in _TABLES:
                jobs = out / "jobs"
                items += [
                    JobItem(name, jobs / f"{name}.toml", text)
                    for name, text in read_job_table(path, jobs)
                ]
            else:
                files.setdefault(path)
    items += [
        JobItem(name, path)
        for name, path in zip(_names(list(files)), files, strict=True)
    ]
    twins = [name for name, n in Counter(item.name for item in items).items() if n > 1]
    if twins:
        raise BatchError(
            where=", ".join(map(str, arguments)),
            reason=f"found two jobs named {twins[0]!r}, expected names of their own (in a"
            " table the column job)",
        )
    return tuple(items)


def _files(argument: str) -> list[Path]:
    path = Path(argument)
    if path.is_file():
        return [path]
    if path.is_dir():
        raise BatchError(
            where=argument,
            reason=f"found a folder, expected files; for all jobs in it: {argument}/*.toml",
        )
    # An absolute pattern is one that `Path.glob` does not take.
    found = sorted(map(Path, glob.glob(argument, recursive=True)))  # noqa: PTH207
    if not found:
        raise BatchError(
            where=argument, reason="found no such file, expected job files or tables"
        )
    return [path for path in found if path.is_file()]


def _names(paths: list[Path]) -> list[str]:
    """Return a name for each job file: its stem, or as much of its path as it takes."""
    for depth in range(1, 1 + max((len(path.parts) for path in paths), default=0)):
        names = ["-".join(path.with_suffix("").parts[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return [name.replace("/", "").replace("\\", "") for name in names]
    return [f"{path.stem}-{k}" for k, path in enumerate(paths)]
