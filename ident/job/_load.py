"""A job file, read and checked as far as it can be before any work starts."""

import dataclasses
import hashlib
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pydantic

from ...models import ConventionError, Conventions
from ._checks import find_fault
from ._errors import JobError
from ._faults import first_fault, key_words
from ._lines import Path as KeyPath, key_lines, line_of
from ._schema import JobFile

_AT = re.compile(r"(.*?) \(at (?:line (\d+), column (\d+)|end of document)\)")


@dataclasses.dataclass(frozen=True)
class Job:
    """A job that can be run.

    Attributes:
        path: The job file, as given.
        spec: What it says.
        conventions: Rules of the controller.
        verified: Names of those that the conventions file states.
        lines: Line of every key.
        inputs: Every file that the job names, existing.
    """

    path: Path
    spec: JobFile
    conventions: Conventions
    verified: frozenset[str]
    lines: Mapping[KeyPath, int]
    inputs: tuple[Path, ...]

    def file(self, name: str) -> Path:
        """Return a path of the job, which is relative to the job file."""
        return self.path.parent / name

    def error(self, where: KeyPath, reason: str) -> JobError:
        """Return the error that a key is, ready to raise."""
        return JobError(
            str(self.path),
            line_of(dict(self.lines), where),
            f"{key_words(where)}: {reason}" if where else reason,
        )


def load_job(path: Path) -> Job:
    """Read a job file and check everything that can be checked without measurements.

    Raises:
        JobError: Naming file, line, what was found and what was expected.
        OSError: If the job file cannot be read.
    """
    text = _text(path)
    values = _parsed(path, text)
    lines = key_lines(text)
    try:
        spec = JobFile.model_validate(values)
    except pydantic.ValidationError as error:
        raise first_fault(path, error, values, lines) from None
    job = Job(path, spec, Conventions(), frozenset(), lines, ())
    if (fault := find_fault(spec)) is not None:
        raise job.error(*fault)
    inputs: list[Path] = []
    for where, name in _files(spec):
        file = job.file(name)
        if not file.is_file():
            kind = "a folder" if file.is_dir() else "no such file"
            raise job.error(where, f"found {name!r}: {kind}, expected a file")
        inputs.append(file)
    conventions, verified = Conventions(), frozenset[str]()
    if spec.machine.conventions is not None:
        conventions, verified = load_conventions(job.file(spec.machine.conventions))
    return dataclasses.replace(
        job,
        conventions=conventions,
        verified=verified,
        inputs=tuple(dict.fromkeys(inputs)),
    )


def load_conventions(path: Path) -> tuple[Conventions, frozenset[str]]:
    """Return the conventions that a file states, and which of them it names.

    The file is TOML, ``name = value``; everything that stands in it counts as verified.

    Raises:
        JobError: If it is no TOML, a name is unknown, or a value cannot be taken.
    """
    text = _text(path)
    values = _parsed(path, text)
    try:
        found = Conventions.from_dict(values)
    except ConventionError as error:
        line = line_of(key_lines(text), (error.name,))
        raise JobError(str(path), line, str(error)) from None
    return found, frozenset(values)


def sha256(path: Path) -> str:
    """Return the hash of a file, for the record."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _text(path: Path) -> str:
    raw = path.read_bytes()
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        reason = f"found byte 0x{raw[error.start]:02x}, expected UTF-8 text"
        raise JobError(str(path), line, reason) from None


def _parsed(path: Path, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = _AT.fullmatch(str(error))
        if match is None:
            raise JobError(str(path), None, f"not TOML: {error}") from None
        line = int(match[2]) if match[2] else text.count("\n") + 1
        place = f" in column {match[3]}" if match[3] else ""
        reason = f"not TOML: {match[1]}{place}"
        raise JobError(str(path), line, reason) from None


def _files(spec: JobFile) -> Iterable[tuple[KeyPath, str]]:
    """Yield every file that a job names, with its key."""
    if spec.machine.conventions is not None:
        yield ("machine", "conventions"), spec.machine.conventions
    for name, axis in spec.axes.items():
        if axis.listing is not None:
            yield ("axes", name, "list"), axis.listing
        if axis.machine_data is not None:
            yield ("axes", name, "machine_data"), axis.machine_data
    for name, measured in spec.measurements.items():
        if measured.file is not None:
            yield ("measurements", name, "file"), measured.file
