"""One measurement for one fit: its file, roles, units and reductions."""

import dataclasses
from typing import Literal

import numpy as np

from ...data.measurements import (
    ColumnSpec,
    DirectionUnknown,
    Measurement,
    MeasurementError,
    Table,
    derive_error,
    explain_direction,
    measurement,
    read_table,
    reduce_length,
    with_error,
    without_motion,
)
from ..exchange import AbstractTable
from ._clocks import ClockState
from ._fit_schema import (
    CrossSpec,
    FitSpec,
    LeadscrewSpec,
    PlaneSpec,
    TableSpec,
)
from ._joined import JoinedFiles, join_files
from ._load import Job
from ._remove import without_zero

PROFILE_FORMATS = ("Klipper bed mesh",)
"""Formats of which one file may hold several surfaces, by name."""

_ABSURD = 1e9
"""mm or °: a thousand kilometres, or some million turns."""


@dataclasses.dataclass(frozen=True)
class Part:
    """The readings of one measurement."""

    positions: np.ndarray
    error: np.ndarray
    direction: np.ndarray | None
    run: np.ndarray | None
    time: np.ndarray | None
    remarks: tuple[str, ...]


class Tables:
    """Measurement files, each read once for all the fits of a job."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self._read: dict[str, Table] = {}
        self._joined: dict[str, JoinedFiles] = {}

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
        return {
            role: ColumnSpec(column)
            if isinstance(column, str)
            else ColumnSpec(column.column, column.unit)
            for role, column in spec.columns.items()
        }

    def table(self, name: str) -> Table:
        """Return what the file of a measurement holds, or its files on one clock.

        Raises:
            MeasurementError: If it holds nothing usable.
            JobError: If the job names a profile and the file knows no such thing, or
                several files cannot be put onto one clock.
        """
        spec = self.job.spec.measurements[name]
        if name not in self._read and spec.files is not None:
            files = [read_table(self.job.file(file)) for file in spec.files]
            self._joined[name] = join_files(self.job, name, spec, files)
            self._read[name] = self._joined[name].table
        if name not in self._read:
            file = spec.file
            assert file is not None  # `find_fault` has seen to it
            profile = spec.profile
            table = read_table(self.job.file(file), profile=profile)
            if profile is not None and table.format not in PROFILE_FORMATS:
                raise self.job.error(
                    ("measurements", name, "profile"),
                    f"found {table.format} in {file}, expected one of"
                    f" {', '.join(PROFILE_FORMATS)}: only these hold profiles",
                )
            self._read[name] = table
        return self._read[name]


@dataclasses.dataclass(frozen=True)
class Wanted:
    """What a fit takes from its measurements.

    Attributes:
        masters: Axes whose positions it needs, master 1 first.
        direction: ``needed``, ``welcome`` or ``no``.
        lengths: The error is one of length along the axis itself, so that it grows with
            the temperature of the scale.
    """

    masters: tuple[str, ...]
    direction: Literal["needed", "welcome", "no"]
    lengths: bool


def wanted_by(fit: TableSpec, table: AbstractTable) -> Wanted:
    """Return what a table fit takes from its measurements."""
    own = isinstance(fit, LeadscrewSpec)
    way: Literal["needed", "welcome", "no"] = "welcome" if own else "no"
    return Wanted(masters_of(fit), "needed" if table.branches == 2 else way, own)


def masters_of(fit: TableSpec) -> tuple[str, ...]:
    """Return the axes whose positions enter a table, master 1 first."""
    if isinstance(fit, PlaneSpec):
        return (fit.masters[0], fit.masters[1])
    return (fit.master,) if isinstance(fit, CrossSpec) else (fit.axis,)


def measured_for(
    tables: Tables, name: str, fit: FitSpec, masters: tuple[str, ...]
) -> Measurement:
    """Return a measurement with its roles, in the units of the library.

    Raises:
        MeasurementError: If a column is missing or a value cannot be used.
    """
    job = tables.job
    spec, axes = job.spec.measurements[name], job.spec.axes
    return measurement(
        tables.table(name),
        tables.columns(name),
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
    spec, axes = job.spec.measurements[name], job.spec.axes
    masters = wanted.masters
    measured = measured_for(tables, name, fit, masters)
    measured = with_error(without_motion(measured, [fit.axis]), fit.axis)
    why = f"for the {fit.compensation} fit of {fit.axis}"
    columns_of = [measured.require(f"{axis}.position", why) for axis in masters]
    positions = np.stack(columns_of, axis=1).astype(float)
    error = np.asarray(derive_error(measured, fit.axis), dtype=float)
    for k, axis in enumerate(masters):
        _refuse_absurd(measured, f"{axis}.position", positions[:, k])
    _refuse_absurd(measured, f"{fit.axis}.error", error)
    for k, axis in enumerate(masters):
        if (span := axes[axis].modulo) is not None:
            turn = span[1] - span[0]
            positions[:, k] = span[0] + np.mod(positions[:, k] - span[0], turn)
    remarks = list(measured.remarks)
    if spec.expansion is not None:
        error, note = at_reference(job, name, measured, fit, wanted, positions, error)
        remarks.append(note)
    direction, words = _direction(measured, fit, wanted)
    remarks += words
    error = without_zero(error, positions, spec.remove)
    run = measured.get("run")
    time = measured.get("time")
    return Part(positions, error, direction, run, time, tuple(remarks))


def _refuse_absurd(measured: Measurement, role: str, values: np.ndarray) -> None:
    """Raise at a length or angle that no machine has: a marker for "no reading".

    Its square may be beyond floating point, so that no robust loss could set it aside.

    Raises:
        MeasurementError: Naming its line.
    """
    wrong = np.flatnonzero(np.abs(values) > _ABSURD)
    if wrong.size:
        at = int(wrong[0])
        reason = (
            f"line {measured.lines[at]}: found {values[at]:g} mm or ° for {role},"
            f" expected less than {_ABSURD:g}"
        )
        raise MeasurementError(str(measured.source), reason)


def at_reference(
    job: Job,
    name: str,
    measured: Measurement,
    fit: FitSpec,
    wanted: Wanted,
    positions: np.ndarray,
    error: np.ndarray,
) -> tuple[np.ndarray, str]:
    """Return errors of length at the reference temperature, and what was done.

    Args:
        job: The job.
        name: Of the measurement, whose specification states an expansion.
        measured: The measurement.
        fit: What it is for.
        wanted: Whether that is about lengths.
        positions: Of the masters, the axis itself first.
        error: As measured.
    """
    spec = job.spec.measurements[name]
    assert spec.expansion is not None
    if not wanted.lengths:
        return error, (
            f"expansion of measurement {name!r} concerns lengths along an axis; the"
            f" error of {fit.axis} over other axes is taken as it is."
        )
    if spec.already_compensated:
        return error, f"Measurement {name!r} refers to 20 °C as it is."
    given = spec.material_temperature
    assert given is not None  # `find_fault` has seen to it
    warmth: float | np.ndarray
    if isinstance(given, str):
        role = given if given.startswith("temperature.") else f"temperature.{given}"
        warmth = measured.require(role, "as material_temperature")
    else:
        warmth = float(given)
    at = spec.datum.at if spec.datum is not None else 0.0
    datum = at if isinstance(at, float | int) else at[0]
    reduced = reduce_length(
        error,
        positions[:, 0],
        expansion=spec.expansion,
        material_temperature=warmth,
        reference_temperature=spec.reference_temperature,
        datum=float(datum),
    )
    change = 1e3 * float(np.max(np.abs(reduced - error)))
    return reduced, (
        f"Measurement {name!r} was reduced to {spec.reference_temperature:g} °C; that"
        f" changed readings by up to {change:.1f} µm."
    )


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
