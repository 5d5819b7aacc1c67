"""A job file, read and checked as far as it can be before any work starts."""

import contextlib
import dataclasses
import functools
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pydantic

from ....data.files import sha256
from ....data.lists import ListFile
from ....data.toml import read_toml
from ....models import Conventions
from ...exchange import (
    AxisLists,
    ExchangeError,
    Motion,
    Reading,
    StoredConventions,
    axis_number,
    is_to_add,
    read_conventions,
)
from ...kinds._keys import KeyPath
from ._checks import find_fault
from ._faults import JobError, MissingFileError, error_at, first_fault
from ._schema import JobFile

_TABLES = ("kw.", "frict_comp.")
"""What only a compensation list holds."""
_COMMENT = r"$|[#;(]|/[/*]"
"""How a line begins that says nothing."""
_NAMED = re.compile(r"achs(kw|mds)[0-9]+\.lis", re.IGNORECASE)
"""File names by which the controller knows the axis of a list."""


@dataclasses.dataclass(frozen=True)
class Job:
    """A job that can be run.

    Attributes:
        spec: What it says.
        text: What stands in the file.
        verified: Names of those that a log or a second measurement has settled.
        inputs: Every file that the job names, existing.
    """

    path: Path
    spec: JobFile
    text: str = ""
    conventions: Conventions = dataclasses.field(default_factory=Conventions)
    verified: frozenset[str] = frozenset()
    inputs: tuple[Path, ...] = ()

    @functools.cached_property
    def lists(self) -> Mapping[str, AxisLists]:
        """The lists that the axes have already, by axis.

        Raises:
            JobError: If a file is another kind of list, or that of another axis.
        """
        lists = {}
        for name, axis in self.spec.axes.items():
            read: dict[str, ListFile] = {}
            for key, file in axis.files.items():
                read[key] = ListFile.read(self.file(file))
                _refuse_other_kind(self, name, key, read[key])
                _refuse_other_axis(self, name, key, read[key])
            both = read.get("list"), read.get("machine_data")
            lists[name] = AxisLists(axis.number, *both, self.reading)
        return lists

    @property
    def reading(self) -> Reading:
        """How lists are read, what waits for COMP ON as switched on."""
        return Reading(self.conventions, self.increments, self.ranges, commanded=True)

    def standing(self, **columns: Mapping[str, np.ndarray]) -> Motion:
        """Return readings as the controller takes them: each a position of its own.

        Args:
            columns: Those of a `Motion`, by name of the axis (of the sensor).
        """
        axes = self.spec.axes
        numbers = {name: axis.number for name, axis in axes.items()}
        tables: dict[str, Any] = {
            key: {numbers.get(name, name): values for name, values in table.items()}
            for key, table in columns.items()
        }
        return Motion(**tables, time=None)

    @property
    def increments(self) -> dict[int, float]:
        """Worth of an encoder increment in mm or °, by logical number of the axis."""
        axes = self.spec.axes.values()
        return {a.number: a.increment for a in axes if a.increment is not None}

    @property
    def ranges(self) -> dict[int, tuple[float, float]]:
        """Range in ° of the axes that turn, by logical number."""
        axes = self.spec.axes.values()
        return {a.number: (a.modulo[0], a.modulo[1]) for a in axes if a.modulo}

    @contextlib.contextmanager
    def blaming(self, where: KeyPath, start: str = "") -> Iterator[None]:
        """Turn what fits no list into the error that a key is."""
        try:
            yield
        except ExchangeError as error:
            raise self.error(where, f"{start}{error}") from None

    def hashes(self, without: Collection[Path] = ()) -> dict[str, str]:
        """Return the hash of the job and of each file that it names, by relative name.

        The files that the job of its second measurement names are among them.

        Raises:
            TomlError: If that job is none.
            OSError: If a file cannot be read.
        """
        files = [self.path, *self.inputs, *self.second_inputs]
        return {
            self.relative(file): sha256(file) for file in files if file not in without
        }

    @functools.cached_property
    def second_inputs(self) -> tuple[Path, ...]:
        """Files of the job that ``[verify]`` names, without the rules that a run settles."""
        # A second job may be a copy that names itself.
        if self.spec.verify is None or not self.spec.fits:
            return ()
        path = self.file(self.spec.verify.job)
        try:
            second = load_job(path, fits=False)
        except MissingFileError:
            return (path,)  # it does not count yet
        rules = second.spec.machine.conventions
        settled = None if rules is None else second.file(rules)
        return tuple(file for file in second.inputs if file != settled)

    def relative(self, file: Path) -> str:
        """Return the path of a file, seen from the job file."""
        try:
            return os.path.relpath(file, self.path.parent)
        except ValueError:  # another drive
            return str(file)

    def file(self, name: str) -> Path:
        """Return a path of the job, which is relative to the job file."""
        return self.path.parent / name

    def error(self, where: KeyPath, reason: str) -> JobError:
        """Return the error that a key is, ready to raise."""
        return error_at(self.path, self.text, where, reason)


def load_job(path: Path, *, fits: bool = True) -> Job:
    """Read a job file and check everything that can be checked without measurements.

    Args:
        path: The job file.
        fits: A job without ``[[fits]]`` is refused; else they are not looked at: a job of
            what was measured may be a copy of one that fits.

    Raises:
        TomlError: Naming file, line, what was found and what was expected.
        OSError: If the job file cannot be read.
    """
    text, values = read_toml(path)
    try:
        spec = JobFile.model_validate(values)
    except pydantic.ValidationError as error:
        raise first_fault(path, error, values, text) from None
    if not fits:
        spec = spec.model_copy(update={"fits": ()})
    job = Job(path, spec, text)
    if fits and not spec.fits:
        found = (
            "0 values, expected 1" if "fits" in values else "nothing, expected this key"
        )
        raise job.error(("fits",), f"found {found}")
    if (fault := find_fault(spec)) is not None:
        raise job.error(*fault)
    inputs: list[Path] = []
    for where, name in _files(spec):
        file = job.file(name)
        if not file.is_file():
            kind = "a folder" if file.is_dir() else "no such file"
            gone = job.error(where, f"found {name!r}: {kind}, expected a file")
            raise MissingFileError(*gone.args)
        inputs.append(file)
    rules = StoredConventions()
    if spec.machine.conventions is not None:
        rules = read_conventions(job.file(spec.machine.conventions), spec.machine.id)
    unique = tuple(dict.fromkeys(inputs))
    return Job(path, spec, text, rules.conventions, rules.verified, unique)


def _files(spec: JobFile) -> Iterable[tuple[KeyPath, str]]:
    """Yield every file that a job names, with its key."""
    if spec.machine.conventions is not None:
        yield ("machine", "conventions"), spec.machine.conventions
    if spec.verify is not None:
        yield ("verify", "job"), spec.verify.job
    for name, axis in spec.axes.items():
        for key, file in axis.files.items():
            yield ("axes", name, key), file
    for name, measured in spec.measurements.items():
        if measured.file is not None:
            yield ("measurements", name, "file"), measured.file
        for file in measured.files or ():
            yield ("measurements", name, "files"), file


def _refuse_other_kind(job: Job, name: str, key: str, listing: ListFile) -> None:
    """Raise where a file is none of the lists that the key asks for.

    An axis list edited as a compensation list, or a table of readings, would come back
    looking like a valid one. An empty list, or one of comments, is one to be filled.
    """
    expected = {"list": "compensation", "machine_data": "axis"}[key]
    if expected == "axis" and is_to_add(listing):
        # Copied over the controller's, it would lose limits, gains, and all that acts.
        raise job.error(
            ("axes", name, key),
            f"found entries to add to an axis list in {listing.source}, as axcomp writes them"
            " for want of it, expected the axis list of the controller with these set in it",
        )
    kind = listing.kind
    empty = all(re.match(_COMMENT, line.strip()) for line in listing.lines)
    # The header of an axis list alone counts as that of a compensation list, and most of its
    # entries are none that the manuals name.
    tables = any(entry.key.startswith(_TABLES) for entry in listing.entries)
    plain = expected == "axis" and kind != "startup" and listing.entries and not tables
    if kind == expected or empty or plain:
        return
    words = f"a{'n' if kind == 'axis' else ''} {kind} list"
    if kind == "unknown":
        words = "none of the entries of such a list"
    raise job.error(
        ("axes", name, key),
        f"found {words} in {listing.source}, expected a"
        f"{'n' if expected == 'axis' else ''} {expected} list",
    )


def _refuse_other_axis(job: Job, name: str, key: str, listing: ListFile) -> None:
    number = job.spec.axes[name].number
    try:
        stated = axis_number(listing)
    except ExchangeError:
        return  # The file does not say; the job does.
    says = "kopf.achs_nr"
    if listing.integer(says) is None:
        says = Path(listing.source).name
        if _NAMED.fullmatch(says) is None:
            return  # A number in another name may be that of a machine.
    if stated != number:
        raise job.error(
            ("axes", name, key),
            f"found a list of axis {stated} ({says}), expected axis {number}",
        )
