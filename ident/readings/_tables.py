"""The files of a job's measurements, each read once, their columns in mm, °, s and °C."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ...data.measurements import (
    ColumnSpec,
    LargeFile,
    Measurement,
    Table,
    measurement,
    open_large,
    read_table,
)
from ._clocks import ClockState
from ._joined import join_files

if TYPE_CHECKING:
    from ..job.file._load import Job

PROFILE_FORMATS = ("Klipper bed mesh",)
"""Formats of which one file may hold several surfaces, by name."""


class Tables:
    """Measurement files, each read once for all the fits of a job.

    Attributes:
        job: The job.
        clocks: How the files of each measurement that was read were put onto one clock.
    """

    def __init__(self, job: "Job") -> None:
        self.job = job
        self.clocks: tuple[ClockState, ...] = ()
        self._read: dict[str, Table] = {}
        self._columns: dict[str, Mapping[str, ColumnSpec]] = {}
        self._large: dict[str, LargeFile | None] = {}

    def columns(self, name: str) -> Mapping[str, ColumnSpec]:
        """Return the column of each role of a measurement; empty: as the file says.

        Raises:
            MeasurementError: If there are several files and one holds nothing usable.
            JobError: If they cannot be put onto one clock.
        """
        spec = self.job.spec.measurements[name]
        if spec.files is not None:
            self.table(name)
        return self._columns.get(name, spec.column_specs)

    def large(self, name: str) -> LargeFile | None:
        """Return the file of a measurement to be read in pieces; None where it cannot be.

        Raises:
            MeasurementError: If it is damaged.
        """
        spec = self.job.spec.measurements[name]
        if name not in self._large:
            file = None
            plain = spec.lines is None and not any(
                one.parts or one.value is not None for one in spec.column_specs.values()
            )
            if spec.file is not None and spec.profile is None and plain:
                size = 0 if spec.stream is True else None
                file = open_large(self.job.file(spec.file), size)
            self._large[name] = file
        return self._large[name]

    def table(self, name: str) -> Table:
        """Return what the file of a measurement holds, or its files on one clock.

        Raises:
            MeasurementError: If it holds nothing usable.
            JobError: If the job names a profile and the file knows no such thing, or
                several files cannot be put onto one clock.
        """
        if name not in self._read:
            spec = self.job.spec.measurements[name]
            if spec.files is None:
                assert spec.file is not None  # `find_fault` has seen to it
                self._read[name] = self._file(name, spec.file)
            else:
                files = [self._file(name, file) for file in spec.files]
                table, columns, clocks = join_files(self.job, name, spec, files)
                self._read[name], self._columns[name] = table, columns
                self.clocks += clocks
        return self._read[name]

    def _file(self, name: str, file: str) -> Table:
        spec = self.job.spec.measurements[name]
        table = read_table(
            self.job.file(file),
            profile=spec.profile,
            lines=spec.lines,
        )
        if spec.profile is not None and table.format not in PROFILE_FORMATS:
            raise self.job.error(
                ("measurements", name, "profile"),
                f"found {table.format} in {file}, expected one of"
                f" {', '.join(PROFILE_FORMATS)}: only these hold profiles",
            )
        return table

    def measured(
        self,
        name: str,
        axis: str | None = None,
        masters: Sequence[str] = (),
        rows: tuple[Table, Mapping[str, ColumnSpec]] | None = None,
    ) -> Measurement:
        """Return a measurement with its roles, in the units of the library.

        Args:
            name: Of the measurement.
            axis: Axis of columns that name none, where the job does not say it; left out:
                the only axis of the job, if it has no other.
            masters: Axes that x and y of a mesh stand for.
            rows: Some rows of a log and the column of each role; left out: all there is.

        Raises:
            MeasurementError: If a column is missing or a value cannot be used.
        """
        axes = self.job.spec.axes
        axis = axis or (next(iter(axes)) if len(axes) == 1 else None)
        table, columns = rows or (self.table(name), self.columns(name))
        return measurement(
            table,
            columns,
            axis=self.job.spec.measurements[name].axis or axis,
            masters=masters,
            increments={
                key: spec.increment
                for key, spec in axes.items()
                if spec.increment is not None
            },
            rotary=[key for key, spec in axes.items() if spec.kind != "linear"],
            turns={
                key: spec.turn for key, spec in axes.items() if spec.turn is not None
            },
            ends={
                key: (spec.limits[0], spec.limits[1])
                for key, spec in axes.items()
                if spec.limits is not None
            },
            name=name,
        )
