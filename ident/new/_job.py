"""From measurement files to a commented job."""

import dataclasses
import itertools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...data.errors import UsageError
from ...data.lists import ListFile
from ...data.measurements import (
    CellError,
    Column,
    ColumnError,
    ColumnSpec,
    Lines,
    MeasurementError,
    Table,
    Unit,
    advice,
    find_role,
    find_unit,
    passed_end,
    problems_of,
    read_table,
    turning_axes,
)
from ..exchange import axis_number
from ..job import Job, JobFile
from ..readings import Observation, observe
from ._columns import ROTARY, Meaning, meaning_of, own_roles
from ._fits import suggestions
from ._names import PLACES, dimension_of
from ._text import Question
from ._write import WHOLE_TURN, Axis, Contents, Source, relative, written

_DAMAGED = 20
"""Lines that a file may lack and still be measured."""
_OF_MOTORS = ("rpm", "rad/s")
"""Units of a speed that drives know of their motor, and controllers of no axis."""
_SHOWN = 12
"""Columns that a message names."""


@dataclasses.dataclass(frozen=True)
class NewJob:
    """A job as it was written.

    Attributes:
        text: The file.
        questions: What it asks, in the order of the file.
        fits: Compensation and axis of each fit that stands in it.
    """

    text: str
    questions: tuple[Question, ...]
    fits: tuple[str, ...]


def new_job(
    files: Sequence[Path],
    *,
    path: Path,
    lists: Sequence[Path] = (),
    axes: Mapping[str, int | None] | None = None,
) -> NewJob:
    """Return a commented job for measurements.

    What the files tell is filled in; what they do not tell is asked, next to the possible
    answers. Without an answer `axcomp fit` refuses the job (`Question.needed`).

    Args:
        files: Measurement files.
        path: Where the job will stand: its paths are relative to that.
        lists: Compensation or axis lists that are there already.
        axes: Number of each axis that the user names, or None; the first is the one whose
            error was measured where a file does not say.

    Raises:
        MeasurementError: If a file holds nothing usable, or no column names its role.
        UsageError: If a file is no list, or a list belongs to no axis of the job.
    """
    given = dict(axes or {})
    sources = _sources(files, tuple(given))
    known = _axes(sources, given, lists)
    job = _provisional(path, sources, known)
    observation = _observed(job, sources)
    suggested = suggestions(job, observation)
    contents = Contents(job, observation, sources, known, suggested)
    text, questions = written(contents, ", ".join(each.name for each in files))
    fits = tuple(f"{fit.compensation} of {fit.axis}" for fit in suggested if fit.plain)
    return NewJob(text, questions, fits)


def _sources(files: Sequence[Path], axes: Sequence[str]) -> list[Source]:
    sources: list[Source] = []
    for file in files:
        name = (
            re.sub(r"[^a-z0-9_-]+", "_", file.stem.casefold()).strip("_") or "readings"
        )
        taken = {each.name for each in sources}
        names = itertools.chain([name], (f"{name}_{k}" for k in itertools.count(2)))
        free = next(each for each in names if each not in taken)
        source = _source(free, file, axes)
        roles = map(find_role, source.roles)
        if not any(role is not None and role.axis is not None for role in roles):
            columns = ", ".join(c.name for c in source.table.columns[:_SHOWN])
            reason = (
                f"found columns {columns}, of which none names a role and fewer than two hold"
                " lengths; expected a header with names such as 'x [mm]' and 'dx [um]', or"
                f" the job to say in columns: {advice(source.table)}"
            )
            raise MeasurementError(str(file), reason)
        sources.append(source)
    return sources


def _source(name: str, file: Path, axes: Sequence[str]) -> Source:
    """Return a file and what it means, without its damaged lines.

    Raises:
        MeasurementError: If too many are damaged, or they cannot be left out.
    """
    table = read_table(file)
    poor = [
        (
            column,
            f"no number in {np.count_nonzero(np.isnan(column.values))} of {table.rows} rows",
        )
        for column in table.columns
        if _is_poor_sensor(column)
    ]
    meaning = _meaning_without(table, poor, axes)
    if spinning := _motor_rates(table, meaning):
        poor += spinning
        meaning = _meaning_without(table, poor, axes)
    used = {spec.column for spec in meaning.likeliest.values()}
    left_out = {column.name for column, _ in poor}
    # Which of their two words is + is asked for.
    left_out |= {
        table.column(s.column).name for s in meaning.likeliest.values() if s.positive
    }
    damaged: list[CellError] = []
    while bad := next(
        (
            each
            for each in problems_of(table)
            if (column := table.column(each.column)).name not in left_out
            and (column.role is not None or {column.name, column.header} & used)
        ),
        None,
    ):
        damaged.append(bad)
        if not bad.key or len(damaged) > _DAMAGED:
            raise damaged[0]
        lines = Lines(skip=tuple(each.line for each in damaged))
        table = dataclasses.replace(read_table(file, lines=lines), format=table.format)
    return Source(name, table, meaning, tuple(damaged))


def _is_poor_sensor(column: Column) -> bool:
    """Whether a column of temperatures lacks so many that its rows cannot be left out."""
    if dimension_of(column) != "temperature" or column.text is not None:
        return False
    return bool(np.count_nonzero(np.isnan(column.values)) > _DAMAGED)


def _motor_rates(table: Table, meaning: Meaning) -> list[tuple[Column, str]]:
    """Return columns with the speed of a motor, of axes in mm, and why they are not used.

    Raises:
        MeasurementError: If it is all that says whether an axis turns.
    """
    roles = meaning.likeliest or own_roles(table, meaning.axis)
    turning, angles, found = turning_axes(table, roles), set[str](), []
    rates: list[tuple[str, Column, Unit]] = []
    for text, spec in roles.items():
        role, unit = find_role(text), find_unit(spec.unit or "")
        if role is None or role.axis is None or unit is None:
            continue
        if unit.dimension == "angle":
            angles.add(role.axis)
        elif unit.dimension.startswith("angular"):
            rates.append((role.axis, table.column(spec.column), unit))
    for axis, column, unit in rates:
        if axis not in turning:
            found.append(
                (column, f"in {unit.name}, as of a motor, and {axis} is in mm")
            )
        elif axis not in {*angles, *ROTARY} and unit.name in _OF_MOTORS:
            reason = (
                f"column '{column.name}': found {unit.name}, as of a motor, and nothing of"
                f" {axis} in mm or deg, expected its position with a unit ('Pos [mm]'), or the"
                " speed in mm/min (rpm times the mm of a turn of the motor). An axis that"
                " turns has the name of one: --axis C"
            )
            raise MeasurementError(str(table.path), reason)
    return found


def _meaning_without(
    table: Table, poor: Sequence[tuple[Column, str]], axes: Sequence[str]
) -> Meaning:
    """Return what a file means but for some of its columns, which it says with the reason."""
    kept = tuple(
        column
        for column in table.columns
        if all(column is not each for each, _ in poor)
    )
    table = dataclasses.replace(table, columns=kept)
    meaning = meaning_of(table, axes)
    if not poor:
        return meaning
    if not meaning.likeliest:
        # Left to itself the file would name those columns as well.
        columns = own_roles(table, meaning.axis)
        meaning = dataclasses.replace(meaning, axis=None, columns=columns)
    words = [f"{column.name} ({why})" for column, why in poor]
    return dataclasses.replace(meaning, unused=(*meaning.unused, *words))


def _axes(
    sources: Sequence[Source],
    given: Mapping[str, int | None],
    lists: Sequence[Path],
) -> dict[str, Axis]:
    """Return the axes that the files name, with what is known of each.

    Raises:
        UsageError: If a file is no such list, or it is not clear whose a list is.
    """
    axes: dict[str, Axis] = {}
    for source in sources:
        turning = turning_axes(source.table, source.roles)
        for text, spec in source.roles.items():
            role, unit = find_role(text), find_unit(spec.unit or "")
            if role is None or role.axis is None:
                continue
            before = axes.get(role.axis, Axis(given.get(role.axis), {}))
            angle = unit if role.kind in PLACES and spec.column else None
            axes[role.axis] = dataclasses.replace(
                before,
                rotary=before.rotary or role.axis in turning,
                endless=before.endless or _passes_end(source.table, spec, angle),
                assumed=before.assumed or source.meaning.assumed.get(role.axis),
            )
    for name, number in given.items():
        axes.setdefault(name, Axis(number, {}))
    for path in lists:
        listing = ListFile.read(path)
        if listing.kind not in ("compensation", "axis") and (
            listing.columns or listing.remarks
        ):
            message = (
                f"--list: found {path}, which holds no entry of a compensation or axis list,"
                " expected such a list"
            )
            raise UsageError(message)
        number, name = axis_number(listing), _owner(axes, listing)
        key = "machine_data" if listing.kind == "axis" else "list"
        own = axes[name]
        axes[name] = dataclasses.replace(
            own, number=number, lists=dict(own.lists) | {key: (path, listing)}
        )
    return axes


def _passes_end(table: Table, spec: ColumnSpec, unit: Unit | None) -> bool:
    """Whether a column of positions holds angles that begin anew in motion."""
    if unit is None or unit.dimension != "angle":
        return False
    column = table.column(spec.column)
    return (
        column.text is None and passed_end(unit.to_library(column.values)) is not None
    )


def _owner(axes: Mapping[str, Axis], listing: ListFile) -> str:
    """Return whose a list is: by its number, by the name that it states, or the only axis.

    Raises:
        UsageError: If none of these tells.
    """
    number = axis_number(listing)
    for name, axis in axes.items():
        if axis.number == number:
            return name
    stated = (listing.text("kopf.log_achs_name") or "").strip().upper()
    open_ = [name for name, axis in axes.items() if axis.number is None]
    named = [name for name in open_ if re.match(rf"{name}(?![A-Z0-9])", stated)]
    if len(named) == 1:
        return named[0]
    if len(open_) == 1:
        return open_[0]
    message = (
        f"--list: found {listing.source} of axis {number}, expected to be told which of"
        f" {', '.join(axes)} it is: --axis NAME={number}"
    )
    raise UsageError(message)


def _provisional(
    path: Path, sources: Sequence[Source], axes: Mapping[str, Axis]
) -> Job:
    """Return a job of the likeliest answers, to look at the readings through."""
    values: dict[str, Any] = {"axes": {}, "measurements": {}}
    free = iter(range(65_000, 0, -1))
    for name, axis in axes.items():
        kind_of: dict[str, Any] = {"type": "rotary"} if axis.rotary else {}
        kind_of |= {"modulo": WHOLE_TURN} if axis.endless else {}
        values["axes"][name] = {"number": axis.number or next(free), **kind_of}
    for source in sources:
        columns = {
            text: each.of_job() for text, each in source.meaning.likeliest.items()
        }
        keys: dict[str, Any] = {"file": relative(source.table.path, path)}
        if source.damaged:
            keys["skip"] = sorted(each.line for each in source.damaged)
        if not columns and source.meaning.axis is not None:
            keys["axis"] = source.meaning.axis
        values["measurements"][source.name] = keys | {"columns": columns}
    spec = JobFile.model_validate(values)
    return Job(path, spec)


def _observed(job: Job, sources: Sequence[Source]) -> Observation:
    """Return the readings, seen through the likeliest answers.

    Raises:
        MeasurementError: If they are none of an axis; where no column names one, it says so.
    """
    try:
        return observe(job)
    except MeasurementError as error:
        taken = [
            f"'{column}' for {axis}"
            for source in sources
            for axis, column in source.meaning.assumed.items()
        ]
        if not taken or isinstance(error, ColumnError):
            raise
        reason = (
            "found no column that names its axis, expected names such as 'x [mm]' and 'dx [um]';"
            f" taken {' and '.join(taken)}, it says:"
            f" {str(error).removeprefix(f'{error.source}: ')}"
        )
        raise MeasurementError(error.source, reason) from error
