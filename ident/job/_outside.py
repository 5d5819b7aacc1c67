"""What instruments outside of the controller measured: all axes of a job, no fits."""

from collections.abc import Iterator, Mapping

import numpy as np

from ...data.measurements import (
    DirectionUnknown,
    Measurement,
    MissingRole,
    derive_error,
    explain_direction,
    measurement,
    reduce_length,
    with_error,
    without_motion,
)
from ..proof import Measured
from ._load import Job
from ._remove import without_zero
from ._schema import MeasurementSpec
from ._source import Tables, refuse_absurd

_SENSOR = "temperature."


def read_outside(job: Job) -> tuple[Measured, ...]:
    """Return the errors of every axis that the measurements of a job hold.

    Measurements without any error, such as the current of a drive, are left out.

    Raises:
        MeasurementError: If a file holds nothing usable, or none an error of any axis.
        JobError: If a measurement does not suit.
    """
    tables = Tables(job)
    found: list[Measured] = []
    for name, measured, axes in _measurements(tables):
        spec = job.spec.measurements[name]
        found += [_outside(job, _standing(measured, axis), spec, axis) for axis in axes]
    if not found:
        name, spec = next(iter(job.spec.measurements.items()))
        first = spec.axis or next(iter(job.spec.axes))
        derive_error(_measurement(tables, name, spec), first)  # raises: what is missing
    return tuple(found)


def errors_in(tables: Tables) -> dict[str, tuple[str, ...]]:
    """Return the axes whose error each measurement of a job holds, by its name.

    Raises:
        MeasurementError: If a file holds nothing usable.
    """
    return {name: axes for name, _, axes in _measurements(tables)}


def _measurements(
    tables: Tables,
) -> Iterator[tuple[str, Measurement, tuple[str, ...]]]:
    """Yield each measurement of a job with its name and the axes whose error it holds."""
    for name, spec in tables.job.spec.measurements.items():
        measured = _measurement(tables, name, spec)
        axes = tuple(a for a in tables.job.spec.axes if has_error(measured, a))
        yield name, measured, axes


def read_error(
    tables: Tables, name: str, axis: str
) -> tuple[Measured, Mapping[str, np.ndarray]]:
    """Return the error of one axis in one measurement, and the temperatures, by sensor.

    Raises:
        MeasurementError: If the file holds nothing usable, or no error of the axis.
        JobError: If the measurement does not suit.
    """
    spec = tables.job.spec.measurements[name]
    measured = _standing(_measurement(tables, name, spec), axis)
    warmth = {
        role.removeprefix(_SENSOR): np.asarray(measured.values[role], dtype=float)
        for role in measured.values
        if role.startswith(_SENSOR)
    }
    return _outside(tables.job, measured, spec, axis), warmth


def _standing(measured: Measurement, axis: str) -> Measurement:
    """Return the readings that tell the error of an axis."""
    return with_error(without_motion(measured, [axis]), axis)


def _measurement(tables: Tables, name: str, spec: MeasurementSpec) -> Measurement:
    axes = tables.job.spec.axes
    only = next(iter(axes)) if len(axes) == 1 else None
    return measurement(
        tables.table(name),
        tables.columns(name),
        axis=spec.axis or only,
        increments={
            key: axis.increment
            for key, axis in axes.items()
            if axis.increment is not None
        },
        rotary=[key for key, axis in axes.items() if axis.kind != "linear"],
        name=name,
    )


def has_error(measured: Measurement, axis: str) -> bool:
    """Return whether the error of an axis was recorded, or what it is derived from."""
    there = measured.values
    if f"{axis}.error" in there:
        return True
    others = (f"{axis}.position", f"{axis}.encoder")
    return f"{axis}.actual" in there and any(role in there for role in others)


def _outside(
    job: Job, measured: Measurement, spec: MeasurementSpec, axis: str
) -> Measured:
    axes = job.spec.axes
    error = np.asarray(derive_error(measured, axis), dtype=float)
    refuse_absurd(measured, f"{axis}.error", error)
    positions = positions_of(job, measured)
    if spec.expansion is not None and axes[axis].number in positions:
        error = length_at_reference(measured, spec, positions[axes[axis].number], error)
    if positions:
        error = without_zero(
            error, np.stack(list(positions.values()), axis=1), spec.remove
        )
    direction: np.ndarray | None = None
    try:
        direction = explain_direction(measured, axis).values
    except (DirectionUnknown, MissingRole):
        pass
    return Measured(
        axis=axes[axis].number,
        positions=positions,
        error=error,
        direction=direction,
        active=frozenset(spec.active),
        line=spec.remove == "line",
    )


def positions_of(job: Job, measured: Measurement) -> dict[int, np.ndarray]:
    """Return the positions of all axes that a measurement has, by logical number."""
    positions: dict[int, np.ndarray] = {}
    for name, one in job.spec.axes.items():
        place = measured.get(f"{name}.position")
        if place is None:
            continue
        place = np.asarray(place, dtype=float)
        refuse_absurd(measured, f"{name}.position", place)
        if one.modulo is not None:
            low, high = one.modulo
            place = low + np.mod(place - low, high - low)
        positions[one.number] = place
    return positions


def length_at_reference(
    measured: Measurement,
    spec: MeasurementSpec,
    position: np.ndarray,
    error: np.ndarray,
) -> np.ndarray:
    """Return an error of length as it were at the reference temperature."""
    if spec.already_compensated or spec.material_temperature is None:
        return error
    assert spec.expansion is not None
    given = spec.material_temperature
    warmth: float | np.ndarray
    if isinstance(given, str):
        role = given if given.startswith("temperature.") else f"temperature.{given}"
        warmth = measured.require(role, "as material_temperature")
    else:
        warmth = float(given)
    at = spec.datum.at if spec.datum is not None else 0.0
    return reduce_length(
        error,
        position,
        expansion=spec.expansion,
        material_temperature=warmth,
        reference_temperature=spec.reference_temperature,
        datum=float(at if isinstance(at, float | int) else at[0]),
    )
