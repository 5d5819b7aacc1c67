"""All that the measurements of a job hold, of every axis and for no fit in particular.

For `discover` every column, for `doctor` and the whole axis the errors that an instrument saw.
"""

import dataclasses
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from ...data.measurements import MeasurementError, derive_error, is_log
from ..proof import Measured
from ._rows import PLACES, POSITION_ORDER, Rows, has_error
from ._tables import Tables

if TYPE_CHECKING:
    from ..discover import Observed
    from ..exchange import Motion
    from ..job.file._load import Job

_FAR = 3.0
"""Mean of an error, in standard deviations, that is the zero of an instrument."""
_ACCELERATES = 0.1
"""Share of its largest acceleration from which on an axis accelerates."""


@dataclasses.dataclass(frozen=True)
class Observation:
    """What a job has been measured with.

    Attributes:
        data: All readings, measurements one after the other.
        names: Of the measurements, by the number of their source.
        remarks: What was taken for granted.
        unzeroed: Measurements in motion with errors far from zero, as an instrument
            whose zero is arbitrary shows them.
    """

    data: "Observed"
    names: tuple[str, ...]
    remarks: tuple[str, ...]
    unzeroed: frozenset[str] = frozenset()


def observe(job: "Job") -> Observation:
    """Return the readings of all measurements of a job.

    Raises:
        MeasurementError: If a file holds nothing usable, or its clock begins anew beside a
            temperature.
        JobError: If a measurement does not suit.
    """
    from ..discover import Observed, stack  # takes long to load

    tables, axes, names = Tables(job), job.spec.axes, tuple(job.spec.measurements)
    parts: list[Observed] = []
    remarks: list[str] = []
    unzeroed: set[str] = set()
    for name in names:
        measured = tables.measured(name)
        with_error = [axis for axis in axes if has_error(measured, axis)]
        rows = Rows(job, name, measured, with_error, gaps=True)
        if rows.sensors:
            rows.refuse_restart()
        run, zeros = rows.run, np.zeros(len(rows), dtype=np.int64)
        position = rows.positions(PLACES)
        currents = {axis: rows.current(axis) for axis in axes}
        ways = {axis: rows.way(axis) for axis in position}
        parts.append(
            Observed(
                time=rows.time,
                run=zeros if run is None else run,
                source=zeros,
                position=position,
                error={axis: rows.error(axis, position) for axis in with_error},
                direction={axis: one for axis, one in ways.items() if one is not None},
                velocity=dict(_motions(rows, "velocity", axes)),
                acceleration=dict(_motions(rows, "acceleration", axes)),
                temperature={name: rows.temperature(name) for name in rows.sensors},
                current={axis: c for axis, c in currents.items() if c is not None},
                rotary=frozenset(
                    k for k, axis in axes.items() if axis.kind != "linear"
                ),
                modulo={
                    key: (axis.modulo[0], axis.modulo[1])
                    for key, axis in axes.items()
                    if axis.modulo is not None
                },
            )
        )
        remarks += rows.remarks
        if rows.moving and any(map(_is_far, parts[-1].error.values())):
            unzeroed.add(name)
    return Observation(
        stack(parts), names, tuple(dict.fromkeys(remarks)), frozenset(unzeroed)
    )


def _is_far(error: Float[np.ndarray, " t"]) -> bool:
    finite = error[np.isfinite(error)]
    if not finite.size:
        return False
    low, middle, high = np.percentile(finite, [16.0, 50.0, 84.0])
    return bool(abs(middle) > _FAR * 0.5 * (high - low))


def _motions(
    rows: Rows, kind: str, axes: Iterable[str]
) -> Iterator[tuple[str, Float[np.ndarray, " t"]]]:
    """Yield velocities or accelerations of axes, as recorded or else derived from logs."""
    for axis in axes:
        if f"{axis}.{kind}" in rows.measured.values or is_log(rows.measured, axis):
            try:
                yield axis, rows.motion(axis, kind, POSITION_ORDER["actual"])
            except MeasurementError as error:
                rows.remarks.append(f"No {kind} of {axis}: {error}")


def read_outside(
    job: "Job", driving: Mapping[int, Collection[int]] | None = None
) -> tuple[Measured, ...]:
    """Return the errors of every axis that the measurements of a job hold.

    Measurements without any error, such as the current of a drive, are left out.

    Args:
        job: The job.
        driving: Axes whose acceleration moves an axis, by the number of the latter.

    Raises:
        MeasurementError: If a file holds nothing usable, or none an error of any axis.
        JobError: If a measurement does not suit.
    """
    tables = Tables(job)
    numbers = {name: axis.number for name, axis in job.spec.axes.items()}
    measured = tuple(
        read_error(tables, name, axis, (driving or {}).get(numbers[axis], ()))[0]
        for name, axes in errors_in(tables).items()
        for axis in axes
    )
    if not measured:
        name, spec = next(iter(job.spec.measurements.items()))
        first = spec.axis or next(iter(job.spec.axes))
        derive_error(tables.measured(name), first)  # raises: what is missing
    return measured


def errors_in(tables: Tables) -> dict[str, tuple[str, ...]]:
    """Return the axes whose error each measurement of a job holds, by its name.

    Raises:
        MeasurementError: If a file holds nothing usable.
    """
    spec = tables.job.spec
    measured = {name: tables.measured(name) for name in spec.measurements}
    return {
        name: tuple(axis for axis in spec.axes if has_error(values, axis))
        for name, values in measured.items()
    }


def read_error(
    tables: Tables, name: str, axis: str, driving: Collection[int] = ()
) -> "tuple[Measured, Motion]":
    """Return the error of one axis in one measurement, and where all axes were.

    Args:
        tables: Files of a job.
        name: Of the measurement.
        axis: Its name.
        driving: Numbers of the axes whose acceleration moves it.

    Raises:
        MeasurementError: If the file holds nothing usable, or no error of the axis.
        JobError: If the measurement does not suit.
    """
    rows = Rows(tables.job, name, tables.measured(name), [axis])
    places, axes = rows.positions(), rows.job.spec.axes
    measured = Measured(
        axis=axes[axis].number,
        positions={axes[key].number: place for key, place in places.items()},
        error=rows.error(axis, places),
        direction=rows.direction(axis),
        active=rows.spec.stated_active,
        line=rows.spec.remove == "line",
        late=rows.measured.late.get(axis),
        time=rows.time,
        own_zero=rows.spec.remove != "none" or rows.spec.datum is not None,
        driven=_accelerating(
            rows, [key for key in axes if axes[key].number in driving]
        ),
    )
    return measured, rows.standing(axis)


def _accelerating(rows: Rows, axes: Iterable[str]) -> Bool[np.ndarray, " t"] | None:
    """Return the readings in which one of these axes accelerates; None: not known of any."""
    sizes = [np.abs(motion) for _, motion in _motions(rows, "acceleration", axes)]
    moved = [size > _ACCELERATES * np.max(size, initial=0.0) for size in sizes]
    return np.logical_or.reduce(moved) if moved else None
