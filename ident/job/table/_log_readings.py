"""A log in pieces, as readings of one fit, where it is too large for memory."""

import dataclasses
from collections.abc import Iterator, Mapping
from functools import cached_property, partial
from typing import final

import numpy as np
from jaxtyping import Float

from ....data.measurements import ColumnSpec, LargeFile, Table, TablePart, own_roles
from ...fit import Part, Samples
from ...readings import (
    Rows,
    Tables,
    Zero,
    reference_words,
    sensor_name,
    step_of,
    zero_of,
)
from .._draft import Leftovers
from ..result._result import Remark
from ._plan import Plan

_PARTS = 32
"""Parts of a log: enough to read one ahead, few enough to keep their sums."""
_ROWS = 1 << 19
"""Rows of a piece."""
LARGE = 20_000_000
"""Cells (rows × columns used) above which a log is read in pieces."""
_SHORT = 5_000
"""Rows up to which a log is not worth being read in pieces."""
_HUGE = 10 * LARGE
"""Cells above which it is even where runs then keep no effects of their own."""


@final
@dataclasses.dataclass(frozen=True)
class LogSource:
    """A log, and the columns that a fit takes from it.

    Attributes:
        name: Of the measurement.
        columns: Column of each role that is used.
        roles: Every role that the file has.
    """

    name: str
    file: LargeFile
    columns: Mapping[str, ColumnSpec]
    roles: frozenset[str]

    @cached_property
    def headers(self) -> tuple[str, ...]:
        """The columns that are used, as the file names them."""
        head = self.file.head
        columns = [head.column(column.column) for column in self.columns.values()]
        return tuple(dict.fromkeys(column.header or column.name for column in columns))


def _source_of(tables: Tables, name: str, file: LargeFile, plan: Plan) -> LogSource:
    """Return a log as a fit uses it."""
    fit, spec = plan.fit, plan.job.spec.measurements[name]
    columns = tables.columns(name) or own_roles(
        file.head, spec.axis or fit.axis, fit.over
    )
    roles = [f"{axis}.position" for axis in fit.over]
    kinds = ["error"] if f"{fit.axis}.error" in columns else ["actual", "position"]
    roles += [f"{fit.axis}.{kind}" for kind in kinds]
    if plan.table.branches == 2:
        roles.append(f"{fit.axis}.direction")
    if isinstance(spec.material_temperature, str):
        roles.append(f"temperature.{sensor_name(spec.material_temperature)}")
    used = {role: columns[role] for role in roles if role in columns}
    return LogSource(name, file, used, frozenset(columns))


@final
@dataclasses.dataclass(frozen=True)
class LogReadings:
    """The readings of a fit, piece by piece, of one log after the other."""

    tables: Tables
    plan: Plan
    sources: tuple[LogSource, ...]
    _said: dict[str, None] = dataclasses.field(default_factory=dict)
    _changes: dict[str, float] = dataclasses.field(default_factory=dict)

    @property
    def names(self) -> str:
        """The logs, in words."""
        return ", ".join(repr(source.name) for source in self.sources)

    @property
    def cells(self) -> int:
        """Rows × columns used."""
        return sum(source.file.rows * len(source.headers) for source in self.sources)

    @property
    def has_runs(self) -> bool:
        """Whether some readings belong to another run than others, as far as is known."""
        return len(self.sources) > 1 or any("run" in log.roles for log in self.sources)

    @cached_property
    def parts(self) -> list[Part]:
        """The readings, for a `Stream` on this machine."""
        return [
            partial(self._pieces, source, part)
            for source in self.sources
            for part in self._parts_of(source)
        ]

    def pieces(self) -> Iterator[Samples]:
        """Yield all readings once more."""
        for part in self.parts:
            yield from (samples for samples in part() if len(samples.error))

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What was taken for granted, once the log has been read."""
        texts, fit = list(self._said), self.plan.fit
        for name in (source.name for source in self.sources):
            spec = self.tables.job.spec.measurements[name]
            change = self._changes.get(name)
            texts += reference_words(name, spec, fit.axis, fit.lengths, change)
        return tuple(Remark.info(words) for words in texts)

    def into_memory(self, reason: str) -> Remark:
        """Return that the logs were read into memory, and why.

        Raises:
            JobError: If the job asks for pieces.
        """
        job = self.tables.job
        for source in self.sources:
            if job.spec.measurements[source.name].stream is True:
                key = ("measurements", source.name, "stream")
                raise job.error(key, f"found true, but {reason}")
        words = "was read into memory and not in pieces"
        return Remark.info(f"{self.names} ({self.cells:.3g} cells) {words}: {reason}.")

    def _parts_of(self, source: LogSource) -> list[TablePart]:
        return source.file.parts(source.headers, _PARTS, _ROWS)

    def _pieces(self, source: LogSource, part: TablePart) -> Iterator[Samples]:
        """Yield the readings of a part of a log, piece by piece."""
        for table in part.tables():
            samples = self._rows(source, table)
            if self._zero is not None:
                error = self._zero.off(samples.error, samples.positions)
                samples = dataclasses.replace(samples, error=error)
            yield samples

    def _rows(self, source: LogSource, table: Table) -> Samples:
        """Return the readings of a piece, of which nothing is removed yet."""
        job, fit, direction = self.tables.job, self.plan.fit, None
        measured = self.tables.measured(
            source.name, fit.axis, fit.over, (table, source.columns)
        )
        rows = Rows(job, source.name, measured, [fit.axis])
        why = f"for the {fit.compensation} fit of {fit.axis}"
        place = {axis: rows.position(axis, why) for axis in fit.over}
        error = rows.at_reference(fit.axis, place, lengths=fit.lengths)
        if self.plan.table.branches == 2:
            direction = rows.direction(fit.axis, needed=True)
        self._said.update(dict.fromkeys(rows.remarks))
        for change in rows.change.values():
            self._changes[source.name] = max(
                change, self._changes.get(source.name, 0.0)
            )
        positions = np.stack([*place.values()], axis=1)
        return Samples(positions, error, self.plan.branch(direction))

    @cached_property
    def _zero(self) -> Zero | None:
        """What is to be removed from a log, judged by every n-th reading; of several nothing is."""
        source = self.sources[0]
        kind = self.tables.job.spec.measurements[source.name].remove
        if kind == "none":
            return None
        count = sum(len(piece.error) for piece in self._all_rows(source))
        step, row = step_of(count), 0
        errors: list[Float[np.ndarray, " t"]] = []
        places: list[Float[np.ndarray, "t d"]] = []
        for part in self._all_rows(source):
            every = slice(-row % step, None, step)
            errors.append(part.error[every])
            places.append(part.positions[every])
            row += len(part.error)
        return zero_of(np.concatenate(errors), np.concatenate(places), kind)

    def _all_rows(self, source: LogSource) -> Iterator[Samples]:
        for part in self._parts_of(source):
            for table in part.tables():
                yield self._rows(source, table)


def in_pieces(
    tables: Tables, plan: Plan, left: Leftovers
) -> tuple[LogReadings | None, tuple[Remark, ...]]:
    """Return the readings of a fit in pieces, None where they belong into memory.

    Beside it stands what must be said of a large log that was read into memory.

    Raises:
        JobError: If the job asks for it and it cannot be done.
        MeasurementError: If a file is damaged or a column is missing.
    """
    specs = {name: tables.job.spec.measurements[name] for name in plan.fit.sources}
    streamed = [name for name, spec in specs.items() if spec.stream is True]
    if any(spec.stream is False for spec in specs.values()):
        return None, ()
    sources = list[LogSource]()
    for name, spec in specs.items():
        file = tables.large(name)
        if file is not None:
            sources.append(_source_of(tables, name, file, plan))
        elif streamed:
            words = (
                f"found true, but {spec.file or spec.files} cannot be read in pieces, expected"
                " a Parquet or CSV file"
            )
            raise tables.job.error(("measurements", streamed[0], "stream"), words)
    readings = LogReadings(tables, plan, tuple(sources))
    if len(sources) < len(specs) or not (streamed or readings.cells > LARGE):
        return None, ()
    if sum(source.file.rows for source in sources) <= _SHORT:
        words = f"{readings.names} is so short that it was read at once."
        return None, (Remark.info(words),)
    reasons = [*_obstacles(readings, left)]
    if readings.has_runs and not (streamed or readings.cells > _HUGE):
        reasons.append("each of its runs is then allowed an offset of its own")
    if reasons:
        return None, (readings.into_memory(reasons[0]),)
    return readings, ()


def _obstacles(readings: LogReadings, left: Leftovers) -> Iterator[str]:
    """Yield why a log cannot be read in pieces."""
    plan, fit = readings.plan, readings.plan.fit
    for name in fit.sources:
        for beside in left.get((plan.index, name), ()):
            yield f"{beside.words} acts beside it, and was off while measuring"
    for other in plan.job.spec.fits:
        if other is fit or other.axis != fit.axis:
            continue
        if set(other.sources) & set(fit.sources):
            yield f"the {other.compensation} fit of {fit.axis} shares it"
    specs = [plan.job.spec.measurements[name] for name in fit.sources]
    if any(spec.zeroed for spec in specs) and len(specs) > 1:
        yield (
            "only the table through all of them, in memory, tells the zero of each"
            " (remove, datum)"
        )
    for source in readings.sources:
        if f"{fit.axis}.error" not in source.roles and "time" in source.roles:
            yield (
                f"the error of {fit.axis} in {source.name!r} is not a column but rests on"
                " what its instrument lags behind, which the whole log tells"
            )
        if plan.table.branches == 2 and f"{fit.axis}.direction" not in source.roles:
            yield (
                f"{source.name!r} has no column for '{fit.axis}.direction', so that the"
                " whole log tells it"
            )
