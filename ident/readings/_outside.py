"""What instruments outside of the controller measured: all axes of a job, no fits."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ...data.measurements import Measurement, derive_error
from ..proof import Measured
from ._rows import Rows, has_error
from ._tables import Tables

if TYPE_CHECKING:
    from ..exchange import Motion
    from ..job.file._load import Job


def read_outside(job: "Job") -> tuple[Measured, ...]:
    """Return the errors of every axis that the measurements of a job hold.

    Measurements without any error, such as the current of a drive, are left out.

    Raises:
        MeasurementError: If a file holds nothing usable, or none an error of any axis.
        JobError: If a measurement does not suit.
    """
    tables, found = Tables(job), list[Measured]()
    for name, measured, axes in _errors_in(tables):
        found += [_outside(Rows(job, name, measured, [axis]), axis) for axis in axes]
    if not found:
        name, spec = next(iter(job.spec.measurements.items()))
        first = spec.axis or next(iter(job.spec.axes))
        derive_error(tables.measured(name), first)  # raises: what is missing
    return tuple(found)


def errors_in(tables: Tables) -> dict[str, tuple[str, ...]]:
    """Return the axes whose error each measurement of a job holds, by its name.

    Raises:
        MeasurementError: If a file holds nothing usable.
    """
    return {name: axes for name, _, axes in _errors_in(tables)}


def _errors_in(
    tables: Tables,
) -> Iterator[tuple[str, Measurement, tuple[str, ...]]]:
    """Yield each measurement of a job by name, and the axes whose error it holds."""
    spec = tables.job.spec
    for name in spec.measurements:
        measured = tables.measured(name)
        axes = tuple(axis for axis in spec.axes if has_error(measured, axis))
        yield name, measured, axes


def read_error(tables: Tables, name: str, axis: str) -> "tuple[Measured, Motion]":
    """Return the error of one axis in one measurement, and where all axes were.

    Raises:
        MeasurementError: If the file holds nothing usable, or no error of the axis.
        JobError: If the measurement does not suit.
    """
    rows = Rows(tables.job, name, tables.measured(name), [axis])
    return _outside(rows, axis), rows.standing(axis)


def _outside(rows: Rows, axis: str) -> Measured:
    places, axes = rows.positions(), rows.job.spec.axes
    return Measured(
        axis=axes[axis].number,
        positions={axes[key].number: place for key, place in places.items()},
        error=rows.error(axis, places),
        direction=rows.direction(axis),
        active=frozenset(rows.spec.active),
        line=rows.spec.remove == "line",
    )
