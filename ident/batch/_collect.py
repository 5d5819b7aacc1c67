"""Which jobs a batch has: job files, patterns, and tables with one job per row.

The name of a column of such a table is the path of a key, parts joined by dots:
``machine.id``, ``axes.X.number``, ``measurements.laser.file``, ``fits.0.points``. An empty cell
leaves the key out. Three columns are not keys: ``job`` names the job, ``template`` a job file
whose keys hold where the row says nothing.
"""

import contextlib
import csv
import dataclasses
import glob
import hashlib
import io
import os
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...data.files import LONGEST_NAME
from ...data.toml import TomlError, read_toml, read_utf8
from .._job_text import job_text
from ..kinds._keys import unknown
from ._folder import BatchError

_NAMED = {"measurements": "a measurement of the template", "axes": "an axis of it"}
"""Tables of a job whose keys are names, and what one of them is."""
_TABLES = (".csv", ".parquet", ".pq")


@dataclasses.dataclass(frozen=True)
class Task:
    """One job of a batch.

    Attributes:
        name: Unique in the batch; the folder that it writes carries it.
        path: The job file.
        sha256: Hash of that.
        text: What goes into the job file where it comes from a table, else None.
        fault: Why its row of the table makes no job, or None.
    """

    name: str
    path: Path
    sha256: str
    text: str | None = None
    fault: str | None = None

    def as_file(self) -> "Task":
        """Return it as a worker needs it, the job file of a table written."""
        if self.text is None:
            return self
        self.path.parent.mkdir(exist_ok=True)
        self.path.write_bytes(self.text.encode())
        return dataclasses.replace(self, text=None)


def collect_jobs(arguments: Sequence[str | Path], out: Path) -> tuple[Task, ...]:
    """Return the jobs that a command line names, in order, each once.

    Args:
        arguments: Job files, patterns (``fleet/*.toml``), tables of jobs.
        out: Folder of the batch, where the job files of tables go.

    Raises:
        BatchError: If something does not exist, a table cannot be read, a name is no name,
            or there is no job at all.
        TomlError: If a table is no UTF-8.
    """
    files: dict[Path, Path] = {}
    tasks: list[Task] = []
    for argument in arguments:
        for path in _files(str(argument)):
            if path.suffix.lower() in _TABLES:
                rows = list(_tasks(path, out / "jobs"))
                if all(task.fault is not None for task in rows):
                    raise BatchError(str(path), str(rows[0].fault))
                tasks += rows
            else:
                # Its files lie beside it, also where it is a link to a job elsewhere.
                files.setdefault(path.parent.resolve() / path.name, path)
    for name, path in zip(_names([*files.values()]), files, strict=True):
        if any("\ud800" <= sign <= "\udfff" for sign in name):
            reason = f"found the name {name!r}, expected one that is UTF-8"
            raise BatchError(str(path.parent), reason)
        content = b""
        with contextlib.suppress(OSError):  # the job itself will say what is wrong
            content = path.read_bytes()
        tasks.append(Task(name, path, _hash(content)))
    names = [name for name, n in Counter(task.name for task in tasks).items() if n > 1]
    if names:
        raise BatchError(
            ", ".join(map(str, arguments)),
            f"found two jobs named {names[0]!r}, expected names of their own (in a"
            " table the column job)",
        )
    return tuple(tasks)


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _files(argument: str) -> list[Path]:
    path = Path(argument)
    if path.is_file():
        return [path]
    if path.is_dir():
        raise BatchError(
            argument,
            f"found a folder, expected files; for all jobs in it: {argument}/*.toml",
        )
    # An absolute pattern is one that `Path.glob` does not take.
    paths = sorted(map(Path, glob.glob(argument, recursive=True)))  # noqa: PTH207
    if not paths:
        raise BatchError(argument, "found no such file, expected job files or tables")
    return [path for path in paths if path.is_file()]


def _names(paths: list[Path]) -> list[str]:
    """Return a name for each job file: its stem, or as much of its path as it takes."""
    for depth in range(1, 1 + max((len(path.parts) for path in paths), default=0)):
        names = ["-".join(path.with_suffix("").parts[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return [name.replace("/", "").replace("\\", "") for name in names]
    return [f"{path.stem}-{k}" for k, path in enumerate(paths)]


_TEXTS = {
    *("title", "id", "conventions", "build", "name", "type", "list", "machine_data"),
    *("gantry", "file", "axis", "compensation", "master"),
    *("measurement", "sensor", "group", "method"),
}
"""Last parts of keys whose value is a text, though it may look like a number."""
_PATHS = {"conventions", "list", "machine_data", "file", "files", "job"}
_WITH_FILES = ("machine", "axes", "measurements", "verify")


def _tasks(path: Path, jobs: Path) -> Iterator[Task]:
    """Yield the job of every row of a table; that of a row that makes none has its fault.

    Paths in the table are relative to it; the job files are going to lie in a folder of jobs.
    """
    templates: dict[Path, dict[str, Any]] = {}
    for number, row in enumerate(_table_rows(path), start=1):
        given = row.pop("job", None)
        name = f"{path.stem}-{number:05d}" if given in (None, "") else str(given)
        marked = any(mark in name for mark in '/\\:*?"<>|\0')
        if not name.strip(". ") or marked or len(os.fsencode(name)) > LONGEST_NAME:
            reason = f"row {number}: found {name!r}, expected a name fit for a folder"
            raise BatchError(str(path), reason)
        tree: dict[str, Any] = {}
        fault: str | None = None
        template = row.pop("template", None)
        base = path.parent / str(template or "")
        if template:
            try:
                if base not in templates:
                    templates[base] = read_toml(base)[1]
                tree = _rebased(templates[base], base.parent, jobs)
            except TomlError as error:
                fault = f"row {number}: template {error}"
            except OSError as error:
                found = f"found {error.strerror}, expected a job file"
                fault = f"row {number}: template {base}: {found}"
        cells = {key: cell for key, cell in row.items() if cell not in (None, "")}
        for key, cell in cells.items():
            parts = key.split(".")
            keys = tuple(part for part in parts if not part.isdigit())
            value = _rebased(_value(key, cell), path.parent, jobs, keys)
            try:
                _put(tree, parts, value)
            except (AttributeError, TypeError, ValueError, IndexError):
                reason = f"{key!r} leads through a key that has a value"
                fault = fault or f"row {number}: {reason}"
        if fault is None and (known := templates.get(base)) is not None:
            wrong = _misspelt(cells, tree, known)
            fault = None if wrong is None else f"row {number}: {wrong}"
        text = job_text(tree) + "\n"
        yield Task(name, jobs / f"{name}.toml", _hash(text.encode()), text, fault)


def _misspelt(
    columns: Iterable[str], job: Mapping[str, Any], template: Mapping[str, Any]
) -> str | None:
    """Return what is wrong with a column of a measurement or an axis that is none.

    It is one of the template, or another one that the job names elsewhere.
    """
    for column in columns:
        part, _, rest = column.partition(".")
        name, known = rest.partition(".")[0], template.get(part)
        if part not in _NAMED or not isinstance(known, Mapping) or name in known:
            continue
        others = {key: each for key, each in job[part].items() if key != name}
        words = _words({**job, part: others})
        if name not in {word.partition(".")[0] for word in words}:
            return f"{column!r}: {unknown(name, known, _NAMED[part])}"
    return None


def _words(tree: Any) -> Iterator[str]:
    """Yield every key and text in a tree."""
    if isinstance(tree, str):
        yield tree
    elif isinstance(tree, Mapping | list):
        for each in tree:
            yield from _words(each)
        for value in tree.values() if isinstance(tree, Mapping) else ():
            yield from _words(value)


def _table_rows(path: Path) -> list[dict[str, Any]]:
    import pyarrow as pa
    import pyarrow.csv as pv
    import pyarrow.parquet as pq

    try:
        if path.suffix.lower() == ".csv":
            text = read_utf8(path)
            head = text.partition("\n")[0]
            mark = ";" if ";" in head and "," not in head else ","
            lines = csv.reader(io.StringIO(text, newline=""), delimiter=mark)
            types = dict.fromkeys(next(lines, []), pa.string())
            table = pv.read_csv(
                io.BytesIO(text.encode()),
                parse_options=pv.ParseOptions(delimiter=mark),
                convert_options=pv.ConvertOptions(column_types=types),
            )
        else:
            table = pq.read_table(path)
    except pa.ArrowException as error:
        reason = f"cannot read the table of jobs: {str(error).splitlines()[0]}"
        raise BatchError(str(path), reason) from None
    names = table.column_names
    twice = [name for name, n in Counter(names).items() if n > 1]
    if twice:
        reason = f"found the column {twice[0]!r} twice, expected each once"
        raise BatchError(str(path), reason)
    if not any(name.startswith("fits.") or name == "template" for name in names):
        reason = (
            f"found the columns {', '.join(names[:6])}, expected keys of a job"
            " (machine.id, measurements.laser.file, fits.0.axis) or a template"
        )
        raise BatchError(str(path), reason)
    if not table.num_rows:
        raise BatchError(str(path), "found no rows, expected one per job")
    return list(table.to_pylist())


def _value(key: str, cell: Any) -> Any:
    if not isinstance(cell, str) or key.rpartition(".")[2] in _TEXTS:
        return cell
    try:
        value = tomllib.loads(f"value = {cell}")["value"]
    except tomllib.TOMLDecodeError:
        return cell
    # A column of a file without a header is called 1.
    is_number = ".columns." in key and isinstance(value, int | float)
    return cell if is_number else value


def _put(tree: Any, parts: Sequence[str], value: Any) -> None:
    """Set a value in a tree, making tables and lists on the way."""
    key, *rest = parts
    if key == "columns" and rest:
        # Names of roles hold a dot themselves: measurements.m.columns.X.position
        rest = [".".join(rest)]
    at: Any = int(key) if isinstance(tree, list) else key
    if isinstance(tree, list) and at == len(tree):
        tree.append(None)
    if not rest:
        tree[at] = value
        return
    below = tree[at] if isinstance(tree, list) else tree.get(at)
    if below is None:
        below = tree[at] = [] if rest[0].isdigit() else {}
    _put(below, rest, value)


def _rebased(tree: Any, old: Path, new: Path, path: tuple[str, ...] = ()) -> Any:
    """Return a job, or a value of one, whose files are named relative to another folder.

    Its path is the keys that lead to it, without numbers of items.
    """
    if isinstance(tree, Mapping):
        return {k: _rebased(v, old, new, (*path, k)) for k, v in tree.items()}
    if isinstance(tree, list):
        return [_rebased(value, old, new, path) for value in tree]
    if isinstance(tree, str) and path[0] in _WITH_FILES and path[-1] in _PATHS:
        return os.path.relpath(old / tree, new)
    return tree
