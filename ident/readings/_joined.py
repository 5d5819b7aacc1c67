"""The files of one measurement on one clock: which column is where, and the offsets."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ...data.measurements import (
    Column,
    ColumnError,
    ColumnSpec,
    MeasurementError,
    Table,
    find_role,
    measurement,
)
from ..core import FitError
from ._clocks import ClockState, find_offset

if TYPE_CHECKING:
    from ..job.file._load import Job
    from ..job.file._schema import MeasurementSpec

_PLACES = ("position", "encoder", "actual", "drive_position")
"""Kinds of role that show the motion of an axis."""
_CLOCK = "time"
"""Name of the common clock among the columns of joined files."""
_OFFSET_WORDS = "or offsets = the known differences of their clocks in s"


@dataclasses.dataclass(frozen=True)
class _File:
    """One of the files.

    Attributes:
        name: As the job names it.
        table: As read.
        time: Of its rows in s.
        roles: Column per role, in this file.
    """

    name: str
    table: Table
    time: Float[np.ndarray, " t"]
    roles: Mapping[str, ColumnSpec]

    def values(self, role: str) -> Float[np.ndarray, " t"]:
        """Return a role in the unit of the file, NaN where there is no sample."""
        column = self.table.column(self.roles[role].column)
        if column.present is None:
            return column.values
        return np.where(column.present, column.values, np.nan)


def join_files(
    job: "Job", name: str, spec: "MeasurementSpec", tables: Sequence[Table]
) -> tuple[Table, Mapping[str, ColumnSpec], tuple[ClockState, ...]]:
    """Put the files of a measurement onto the clock of the first one.

    Returns:
        Them as one, the column of each role in it, and how each further file was put onto
        that clock.

    Raises:
        JobError: If a column is in none of them, or the offset cannot be told.
        MeasurementError: If a file has no time that ascends.
    """
    key = ("measurements", name, "files")
    assert spec.files is not None  # asked for only then
    files = [
        _file(label, table, spec)
        for label, table in zip(spec.files, tables, strict=True)
    ]
    _refuse_missing(files, spec)
    shifts, clocks = [0.0], list[ClockState]()
    for k, further in enumerate(files[1:]):
        if spec.offsets is not None:
            clock = ClockState(
                name, further.name, spec.offsets[k], None, "the job", None
            )
        else:
            try:
                clock = _offset(name, files[0], further)
            except FitError as error:
                reason = (
                    f"{further.name} beside {files[0].name}: {error} Expected a signal"
                    f" that tells how far their clocks are apart, {_OFFSET_WORDS}"
                )
                raise job.error(key, reason) from None
        _refuse_apart(job, name, files[0], further, clock)
        shifts.append(clock.offset)
        clocks.append(clock)
    table, columns = _side_by_side(files, shifts)
    pairs = zip(clocks, files[1:], strict=True)
    remarks = (
        *table.remarks,
        *(_words(clock, files[0], file) for clock, file in pairs),
    )
    return dataclasses.replace(table, remarks=remarks), columns, tuple(clocks)


def _side_by_side(
    files: Sequence[_File], shifts: Sequence[float]
) -> tuple[Table, dict[str, ColumnSpec]]:
    """Return the columns of several files on one clock, and which of them has each role.

    There is one row per row of each file, in order of time; a column has samples in the
    rows of its own file only, so that `measurement` brings the channels together as it does
    for channels of several sample times. Where several files have a role the first one
    counts, and a name that several use is followed by that of the file.
    """
    tables = [file.table for file in files]
    names = [column.name for table in tables for column in table.columns]
    time = np.concatenate(
        [file.time + shift for file, shift in zip(files, shifts, strict=True)]
    )
    order = np.argsort(time, kind="stable")
    columns = [Column(_CLOCK, "time", "s", time[order], header=_CLOCK)]
    roles = {"time": ColumnSpec(_CLOCK)}
    ends = np.cumsum([table.rows for table in tables])
    for file, end in zip(files, ends, strict=True):
        rows = slice(end - file.table.rows, end)
        for role, spec in file.roles.items():
            column = file.table.column(spec.column)
            if role in roles or column.text is not None:
                continue
            name = column.name
            if names.count(name) > 1 or name == _CLOCK:
                name = f"{name} ({file.table.path.name})"
            roles[role] = dataclasses.replace(spec, column=name)
            if any(name == joined_column.name for joined_column in columns):
                continue  # two roles of one column
            values, present = np.full(len(time), np.nan), np.zeros(len(time), bool)
            values[rows] = column.values
            present[rows] = True if column.present is None else column.present
            columns.append(
                dataclasses.replace(
                    column,
                    name=name,
                    header=name,
                    values=values[order],
                    present=present[order],
                )
            )
    path = tables[0].path.with_name(" + ".join(table.path.name for table in tables))
    joined = Table(
        path=path,
        format=tables[0].format,
        columns=tuple(columns),
        rows=len(time),
        lines=np.concatenate([table.lines for table in tables])[order],
        skipped=tuple(row for table in tables for row in table.skipped),
        remarks=tuple(remark for table in tables for remark in table.remarks),
    )
    return joined, roles


def _file(label: str, table: Table, spec: "MeasurementSpec") -> _File:
    named = {c.role: ColumnSpec(c.header or c.name) for c in table.columns if c.role}
    roles = {role: one for role, one in named.items() if find_role(role) is not None}
    if spec.columns:
        wished = {
            role: one
            for role, one in spec.column_specs.items()
            if spec.file_of(role) in (None, label) and _holds(table, one)
        }
        roles = {"time": named["time"]} | wished if "time" in named else wished
    clock = roles.pop("time", None)
    if clock is None:
        names = ", ".join(column.name for column in table.columns[:12])
        reason = f"found columns {names}, expected one for the role time in each of the files"
        raise MeasurementError(str(table.path), reason)
    time = measurement(table, {"time": clock}).require("time")
    back = np.flatnonzero(np.diff(time) < 0)
    if back.size:
        reason = (
            f"line {table.lines[int(back[0]) + 1]}: found time that goes back, expected"
            " a log in the order of time"
        )
        raise MeasurementError(str(table.path), reason)
    return _File(label, table, np.asarray(time, dtype=float), roles)


def _holds(table: Table, spec: ColumnSpec) -> bool:
    try:
        table.column(spec.column)
    except ColumnError:
        return False
    return True


def _refuse_missing(files: Sequence[_File], spec: "MeasurementSpec") -> None:
    roles = {role for file in files for role in file.roles} | {"time"}
    for role, stated in spec.column_specs.items():
        if role not in roles:
            names = [c.name for file in files for c in file.table.columns]
            listed = " + ".join(file.name for file in files)
            raise ColumnError(listed, stated.column, names, None)


def _offset(name: str, first: _File, other: _File) -> ClockState:
    """Return the offset of a file, from the first pair of signals that determines it."""
    pairs = [*_pairs(first, other)]
    if not pairs:
        msg = (
            "found no column that both hold, no position of one axis in both, and no"
            " error beside a temperature."
        )
        raise FitError(msg)
    failed, kept = [], None
    for words, mine, theirs, place in pairs:
        try:
            signal = first.values(mine)
            away = None if place is None else first.values(place)
            state = find_offset(
                first.time, signal, other.time, other.values(theirs), away
            )
        except FitError as error:
            failed.append(f"by {words}: {error}")
            continue
        found = ClockState(
            name,
            other.name,
            state.seconds,
            state.standard_deviation,
            words,
            state.explained,
        )
        if state.standard_deviation is not None:
            return found
        kept = kept or found
    if kept is not None:
        return kept
    raise FitError(failed[0])


def _pairs(first: _File, other: _File) -> Iterator[tuple[str, str, str, str | None]]:
    """Return what both files saw, best first: words, role here, role there, place."""
    yield from [
        (role, role, role, None)
        for role in first.roles
        if role in other.roles and role != "run" and not role.endswith(".direction")
    ]
    mine, theirs = _by_axis(first), _by_axis(other)
    for axis in (axis for axis in mine if axis in theirs):
        a, b = mine[axis], theirs[axis]
        yield (f"{a} and {b}", a, b, None)
    errors = [role for role in first.roles if role.endswith(".error")]
    warm = [role for role in other.roles if role.startswith("temperature.")]
    for error in errors:
        place = error.removesuffix("error") + "position"
        for sensor in warm:
            yield (
                f"{error}, which follows {sensor}",
                error,
                sensor,
                place if place in first.roles else None,
            )


def _by_axis(file: _File) -> dict[str, str]:
    files: dict[str, str] = {}
    for kind in _PLACES:
        for text in file.roles:
            role = find_role(text)
            if role is not None and role.axis is not None and role.kind == kind:
                files.setdefault(role.axis, text)
    return files


def _refuse_apart(
    job: "Job", name: str, first: _File, other: _File, clock: ClockState
) -> None:
    begin, end = other.time[0] + clock.offset, other.time[-1] + clock.offset
    if begin > first.time[-1] or end < first.time[0]:
        reason = (
            f"{other.name} beside {first.name}: found no common time ({begin:g} to"
            f" {end:g} s and {first.time[0]:g} to {first.time[-1]:g} s), expected logs"
            " taken together"
        )
        raise job.error(("measurements", name, "files"), reason)


def _words(clock: ClockState, first: _File, other: _File) -> str:
    begin, end = other.time[0] + clock.offset, other.time[-1] + clock.offset
    lost = np.count_nonzero((first.time < begin) | (first.time > end))
    beyond = (
        f" {lost} of {len(first.time)} rows of {first.name} lie outside its time."
        if lost
        else ""
    )
    if clock.explained is None:
        return (
            f"{clock.file} is put onto the clock of the first file by"
            f" {clock.offset:+g} s, as the job says (offsets).{beyond}"
        )
    explained = f"of whose scatter it explains {100 * clock.explained:.0f} %.{beyond}"
    if clock.standard_deviation is None:
        return (
            f"{clock.file} keeps its clock, which fits that of the first file as it is:"
            f" the offset between them is not determined by {clock.by}, {explained}"
            " If it is known, state it as offsets of the measurement."
        )
    return (
        f"{clock.file} is put onto the clock of the first file by"
        f" {clock.offset:+.4g} s ± {clock.standard_deviation:.2g} s (1 sd), from"
        f" {clock.by}, {explained}"
    )
