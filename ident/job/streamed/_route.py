"""Whether the readings of a fit are read in pieces or into memory."""

import dataclasses
from collections.abc import Iterator

from ...exchange import AbstractTable
from ...kinds._keys import TableSpec
from ...readings import Tables, wanted_by
from .._load import Job
from .._result import Remark
from ._readings import LogReadings, LogSource

LARGE = 20_000_000
"""Cells (rows × columns used) above which a log is read in pieces."""
_SHORT = 5_000
"""Rows up to which a log is not worth being read in pieces."""
_HUGE = 10 * LARGE
"""Cells above which it is even where runs then keep no effects of their own."""


@dataclasses.dataclass(frozen=True)
class _Obstacle:
    """Why a log cannot be read in pieces; ``lost``: it can, but something is lost."""

    reason: str
    lost: bool = False


def in_pieces(
    tables: Tables, index: int, fit: TableSpec, table: AbstractTable
) -> tuple[LogReadings | None, tuple[Remark, ...]]:
    """Return the readings of a fit in pieces, None where they belong into memory.

    Beside it stands what must be said of a large log that was read into memory.

    Args:
        tables: Files of the job.
        index: Of the fit in the job.
        fit: Its specification.
        table: What will be written.

    Raises:
        JobError: If the job asks for it and it cannot be done.
        MeasurementError: If a file is damaged or a column is missing.
    """
    job = tables.job
    specs = {name: job.spec.measurements[name] for name in fit.sources}
    asked = [name for name, spec in specs.items() if spec.stream is True]
    if any(spec.stream is False for spec in specs.values()):
        return None, ()
    found = {name: tables.large(name) for name in fit.sources}
    for name, file in found.items():
        if file is None and asked:
            raise job.error(
                ("measurements", asked[0], "stream"),
                f"found true, but {specs[name].file or specs[name].files} cannot be read"
                " in pieces, expected a Parquet or CSV file",
            )
    large = {name: file for name, file in found.items() if file is not None}
    if len(large) < len(found):
        return None, ()
    wanted = wanted_by(fit, table)
    sources = tuple(
        LogSource.of(tables, name, file, fit, wanted) for name, file in large.items()
    )
    cells = sum(one.file.rows * len(one.headers) for one in sources)
    if not asked and cells <= LARGE:
        return None, ()
    if sum(one.file.rows for one in sources) <= _SHORT:
        words = (
            f"{', '.join(map(repr, fit.sources))} is so short that it was read at once."
        )
        return None, (Remark.info(words),)
    readings = LogReadings(job, index, fit, table, wanted, sources)
    for obstacle in _obstacles(job, fit, readings):
        if obstacle.lost and (asked or cells > _HUGE):
            continue
        if asked:
            raise job.error(
                ("measurements", asked[0], "stream"),
                f"found true, but {obstacle.reason}",
            )
        words = (
            f"{', '.join(map(repr, fit.sources))} ({cells:.3g} cells) was read into"
            f" memory and not in pieces: {obstacle.reason}."
        )
        return None, (Remark.info(words),)
    return readings, ()


def _obstacles(job: Job, fit: TableSpec, readings: LogReadings) -> Iterator[_Obstacle]:
    """Yield what stands in the way, the worst first."""
    for k, other in enumerate(job.spec.fits):
        if k == readings.index or other.axis != fit.axis:
            continue
        if set(other.sources) & set(fit.sources):
            yield _Obstacle(f"the {other.compensation} fit of {fit.axis} shares it")
    for one in readings.sources:
        if f"{fit.axis}.error" not in one.roles and "time" in one.roles:
            yield _Obstacle(
                f"the error of {fit.axis} in {one.name!r} is not a column but rests on"
                " what its instrument lags behind, which the whole log tells"
            )
        needs_way = readings.wanted.direction == "needed"
        if needs_way and f"{fit.axis}.direction" not in one.roles:
            yield _Obstacle(
                f"{one.name!r} has no column for '{fit.axis}.direction', so that the"
                " whole log tells it"
            )
        run = one.columns.get("run")
        if run is not None and one.file.head.column(run.column).text is not None:
            yield _Obstacle(f"the runs of {one.name!r} have names and not numbers")
    if readings.has_runs:
        yield _Obstacle("each of its runs is then allowed an offset of its own", True)
