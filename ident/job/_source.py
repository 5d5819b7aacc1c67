"""One measurement for one fit: its file, roles, units and reductions."""

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np

from ...data.measurements import (
    ColumnSpec,
    DirectionUnknown,
    LargeFile,
    Lines,
    Measurement,
    MeasurementError,
    PlainRows,
    Table,
    derive_error,
    derive_motion,
    explain_direction,
    measurement,
    open_large,
    read_table,
    with_error,
    without_motion,
)
from ...models import Conventions
from ..kinds._keys import FitSpec
from ._clocks import ClockState
from ._joined import JoinedFiles, column_spec, join_files
from ._load import Job
from ._reference import (
    Wanted as Wanted,
    at_reference as at_reference,
    reduced_to_reference,
    wanted_by as wanted_by,
    words_of_reference,
)
from ._remove import without_zero
from ._schema import MeasurementSpec

POSITION_ORDER = {
    "command": ("position", "encoder", "actual"),
    "actual": ("encoder", "actual", "position"),
}
"""Roles that tell where an axis is, the first that is there, by `crosstalk_input`."""
PROFILE_FORMATS = ("Klipper bed mesh",)
"""Formats of which one file may hold several surfaces, by name."""

ABSURD = 1e9
"""mm or °: a thousand kilometres, or some million turns."""


@dataclasses.dataclass(frozen=True)
class Part:
    """The readings of one measurement; ``change`` by a reduction to a temperature, mm.

    ``measured`` are all columns of the same rows, ``late`` what one standard deviation of
    the instrument's delay makes of the error of an axis in motion.
    """

    positions: np.ndarray
    error: np.ndarray
    direction: np.ndarray | None
    run: np.ndarray | None
    time: np.ndarray | None
    remarks: tuple[str, ...]
    change: float | None = None
    measured: Measurement | None = None
    late: np.ndarray | None = None


def lines_of(spec: MeasurementSpec) -> Lines | None:
    """Return what a job says of the lines of a measurement's files, or None."""
    rows = None if spec.rows is None else (spec.rows[0], spec.rows[1])
    return Lines.of(spec.skip, spec.header, rows)


class Tables:
    """Measurement files, each read once for all the fits of a job."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self._read: dict[str, Table] = {}
        self._joined: dict[str, JoinedFiles] = {}
        self._large: dict[str, LargeFile | None] = {}

    @functools.cached_property
    def _plain_rows(self) -> PlainRows | None:
        """What reads plain rows fast: machine code, where a fit of the job needs it anyway."""
        if not any(fit.kind.compiles for fit in self.job.spec.fits):
            return None
        from ._plain_rows import plain_rows  # takes long to load

        return plain_rows

    @property
    def clocks(self) -> tuple[ClockState, ...]:
        """How the files of each measurement that was read were put onto one clock."""
        return tuple(each for one in self._joined.values() for each in one.clocks)

    def columns(self, name: str) -> dict[str, ColumnSpec]:
        """Return the column of each role of a measurement; empty: as the file says.

        Raises:
            MeasurementError: If there are several files and one holds nothing usable.
            JobError: If they cannot be put onto one clock.
        """
        spec = self.job.spec.measurements[name]
        if spec.files is not None:
            self.table(name)
            return dict(self._joined[name].columns)
        return {role: column_spec(one) for role, one in spec.columns.items()}

    def large(self, name: str) -> LargeFile | None:
        """Return the file of a measurement to be read in pieces; None where it cannot be.

        Raises:
            MeasurementError: If it is damaged.
        """
        spec = self.job.spec.measurements[name]
        if name not in self._large:
            found = None
            plain = lines_of(spec) is None and not any(
                one.parts or one.value is not None
                for one in map(column_spec, spec.columns.values())
            )
            if spec.file is not None and spec.profile is None and plain:
                least = 0 if spec.stream is True else None
                found = open_large(self.job.file(spec.file), least)
            self._large[name] = found
        return self._large[name]

    def table(self, name: str) -> Table:
        """Return what the file of a measurement holds, or its files on one clock.

        Raises:
            MeasurementError: If it holds nothing usable.
            JobError: If the job names a profile and the file knows no such thing, or
                several files cannot be put onto one clock.
        """
        spec = self.job.spec.measurements[name]
        lines = lines_of(spec)
        if name not in self._read and spec.files is not None:
            files = [
                read_table(
                    self.job.file(file), lines=lines, plain_rows=self._plain_rows
                )
                for file in spec.files
            ]
            self._joined[name] = join_files(self.job, name, spec, files)
            self._read[name] = self._joined[name].table
        if name not in self._read:
            file = spec.file
            assert file is not None  # `find_fault` has seen to it
            profile = spec.profile
            table = read_table(
                self.job.file(file),
                profile=profile,
                lines=lines,
                plain_rows=self._plain_rows,
            )
            if profile is not None and table.format not in PROFILE_FORMATS:
                raise self.job.error(
                    ("measurements", name, "profile"),
                    f"found {table.format} in {file}, expected one of"
                    f" {', '.join(PROFILE_FORMATS)}: only these hold profiles",
                )
            self._read[name] = table
        return self._read[name]


def measured_for(
    tables: Tables, name: str, fit: FitSpec, masters: tuple[str, ...]
) -> Measurement:
    """Return a measurement with its roles, in the units of the library.

    Raises:
        MeasurementError: If a column is missing or a value cannot be used.
    """
    table, columns = tables.table(name), tables.columns(name)
    return measured_from(tables.job, name, table, columns, fit, masters)


def measured_from(
    job: Job,
    name: str,
    table: Table,
    columns: Mapping[str, ColumnSpec],
    fit: FitSpec,
    masters: tuple[str, ...],
) -> Measurement:
    """Return what a table holds of a measurement: all of its rows, or some of them.

    Raises:
        MeasurementError: If a column is missing or a value cannot be used.
    """
    spec, axes = job.spec.measurements[name], job.spec.axes
    return measurement(
        table,
        columns,
        axis=spec.axis or fit.axis,
        masters=masters,
        increments={
            key: axis.increment
            for key, axis in axes.items()
            if axis.increment is not None
        },
        rotary=[key for key, axis in axes.items() if axis.kind != "linear"],
        name=name,
    )


def read_part(tables: Tables, name: str, fit: FitSpec, wanted: Wanted) -> Part:
    """Return the readings of one measurement for a fit.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
    """
    job = tables.job
    measured = measured_for(tables, name, fit, wanted.masters)
    part = read_rows(job, name, measured, fit, wanted)
    remarks = part.remarks
    if job.spec.measurements[name].expansion is not None:
        remarks = (*remarks, words_of_reference(job, name, fit, wanted, part.change))
    kind = job.spec.measurements[name].remove
    error = without_zero(part.error, part.positions, kind)
    return dataclasses.replace(part, error=error, remarks=remarks)


def read_rows(
    job: Job, name: str, measured: Measurement, fit: FitSpec, wanted: Wanted
) -> Part:
    """Return readings for a fit, each as its own row tells: nothing is removed yet.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
    """
    spec, axes = job.spec.measurements[name], job.spec.axes
    masters = wanted.masters
    measured = with_error(without_motion(measured, [fit.axis]), fit.axis)
    why = f"for the {fit.compensation} fit of {fit.axis}"
    columns_of = [measured.require(f"{axis}.position", why) for axis in masters]
    positions = np.stack(columns_of, axis=1).astype(float)
    error = np.asarray(derive_error(measured, fit.axis), dtype=float)
    for k, axis in enumerate(masters):
        refuse_absurd(measured, f"{axis}.position", positions[:, k])
    refuse_absurd(measured, f"{fit.axis}.error", error)
    for k, axis in enumerate(masters):
        if (span := axes[axis].modulo) is not None:
            turn = span[1] - span[0]
            positions[:, k] = span[0] + np.mod(positions[:, k] - span[0], turn)
    remarks = list(measured.remarks)
    change = None
    if spec.expansion is not None:
        error, change = reduced_to_reference(
            job, name, measured, wanted, positions, error
        )
    direction, words = _direction(measured, fit, wanted)
    remarks += words
    run = measured.get("run")
    time = measured.get("time")
    late = measured.late.get(fit.axis)
    return Part(
        positions, error, direction, run, time, tuple(remarks), change, measured, late
    )


def motion_of(
    measured: Measurement, axis: str, what: str, rules: Conventions
) -> tuple[np.ndarray, list[str]]:
    """Return velocity or acceleration as recorded, else derived, and what to say of it."""
    given = measured.get(f"{axis}.{what}")
    if given is not None:
        return np.asarray(given, dtype=float), []
    motion = derive_motion(measured, axis, order=POSITION_ORDER[rules.crosstalk_input])
    words = (
        f"The {what} of {axis} was not recorded: it is derived from the position, up to"
        f" {motion.bandwidth:.3g} Hz."
    )
    return np.asarray(getattr(motion, what), dtype=float), [words]


def refuse_absurd(measured: Measurement, role: str, values: np.ndarray) -> None:
    """Raise at a length or angle that no machine has: a marker for "no reading".

    Its square may be beyond floating point, so that no robust loss could set it aside.

    Raises:
        MeasurementError: Naming its line.
    """
    wrong = np.flatnonzero(np.abs(values) > ABSURD)
    if wrong.size:
        at = int(wrong[0])
        reason = (
            f"line {measured.lines[at]}: found {values[at]:g} mm or ° for {role},"
            f" expected less than {ABSURD:g}"
        )
        raise MeasurementError(str(measured.source), reason)


def _direction(
    measured: Measurement, fit: FitSpec, wanted: Wanted
) -> tuple[np.ndarray | None, list[str]]:
    """Return directions where the fit needs them, or where they can be had."""
    if wanted.direction == "no":
        return None, []
    try:
        found = explain_direction(measured, fit.axis)
    except DirectionUnknown:
        if wanted.direction == "needed":
            raise
        return None, []
    return found.values, list(found.remarks) if wanted.direction == "needed" else []
