"""All that the measurements of a job hold, of every axis and for no fit in particular."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ...data.measurements import (
    DirectionUnknown,
    MeasurementError,
    MissingRole,
    derive_error,
    derive_motion,
    explain_direction,
    is_log,
    measurement,
    without_motion,
)
from ..discover import Observed, stack
from ._load import Job
from ._outside import has_error, length_at_reference
from ._remove import without_zero
from ._source import ABSURD, Tables

_SENSOR = "temperature."
_LEFT = 1e-3
"""Share of its travel that an axis has gone when it has surely moved."""
_FAR = 3.0
"""Mean of an error, in standard deviations, that is the zero of an instrument."""


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

    data: Observed
    names: tuple[str, ...]
    remarks: tuple[str, ...]
    unzeroed: frozenset[str] = frozenset()


def observe(job: Job) -> Observation:
    """Return the readings of all measurements of a job.

    Raises:
        MeasurementError: If a file holds nothing usable.
        JobError: If a measurement does not suit.
    """
    tables = Tables(job)
    parts: list[Observed] = []
    remarks: list[str] = []
    unzeroed: set[str] = set()
    for name in job.spec.measurements:
        reader = _Reader(tables, name)
        parts.append(reader.read())
        remarks += reader.remarks
        if reader.moving and any(map(_is_far, parts[-1].error.values())):
            unzeroed.add(name)
    return Observation(
        stack(parts),
        tuple(job.spec.measurements),
        tuple(dict.fromkeys(remarks)),
        frozenset(unzeroed),
    )


def _is_far(error: Float[np.ndarray, " t"]) -> bool:
    known = error[np.isfinite(error)]
    if not known.size:
        return False
    low, middle, high = np.percentile(known, [16.0, 50.0, 84.0])
    return bool(abs(middle) > _FAR * 0.5 * (high - low))


class _Reader:
    """Reads one measurement; collects remarks."""

    def __init__(self, tables: Tables, name: str) -> None:
        self.job, self.name = tables.job, name
        self.spec, self.axes = self.job.spec.measurements[name], self.job.spec.axes
        only = next(iter(self.axes)) if len(self.axes) == 1 else None
        plain = measurement(
            tables.table(name),
            tables.columns(name),
            axis=self.spec.axis or only,
            increments={
                key: axis.increment
                for key, axis in self.axes.items()
                if axis.increment is not None
            },
            rotary=[key for key, axis in self.axes.items() if axis.kind != "linear"],
            name=name,
        )
        asked = [axis for axis in self.axes if has_error(plain, axis)]
        self.measured = without_motion(plain, asked).with_gaps()
        self.asked = asked
        self.moving = any(
            f"{axis}.error" in self.measured.values
            and f"{axis}.error" not in plain.values
            for axis in asked
        )
        self.remarks = list(self.measured.remarks)

    def read(self) -> Observed:
        """Return the columns of the measurement."""
        measured = self.measured
        position = {
            axis: place
            for axis in self.axes
            if (place := self._position(axis)) is not None
        }
        run = measured.get("run")
        time = measured.get("time")
        velocity, acceleration = self._motion("velocity"), self._motion("acceleration")
        return Observed(
            time=None if time is None else np.asarray(time, dtype=float),
            run=(
                np.zeros(measured.rows, dtype=np.int64)
                if run is None
                else np.asarray(run).astype(np.int64)
            ),
            source=np.zeros(measured.rows, dtype=np.int64),
            position=position,
            error={axis: self._error(axis, position) for axis in self.asked},
            direction={
                axis: way
                for axis in position
                if (way := self._direction(axis)) is not None
            },
            velocity=velocity,
            acceleration=acceleration,
            temperature={
                role.removeprefix(_SENSOR): np.asarray(measured.values[role], float)
                for role in measured.values
                if role.startswith(_SENSOR)
            },
            current={
                axis: np.asarray(measured.values[f"{axis}.current"], dtype=float)
                for axis in self.axes
                if f"{axis}.current" in measured.values
            },
            rotary=frozenset(
                name for name, axis in self.axes.items() if axis.kind != "linear"
            ),
            modulo={
                name: (axis.modulo[0], axis.modulo[1])
                for name, axis in self.axes.items()
                if axis.modulo is not None
            },
        )

    def _position(self, axis: str) -> Float[np.ndarray, " t"] | None:
        for kind in ("position", "encoder", "actual"):
            if f"{axis}.{kind}" in self.measured.values:
                place = np.array(self.measured.values[f"{axis}.{kind}"], dtype=float)
                break
        else:
            return None
        place[~(np.abs(place) <= ABSURD)] = np.nan
        span = self.axes[axis].modulo
        if span is not None:
            place = span[0] + np.mod(place - span[0], span[1] - span[0])
        return place

    def _error(
        self, axis: str, position: dict[str, np.ndarray]
    ) -> Float[np.ndarray, " t"]:
        error = np.array(derive_error(self.measured, axis), dtype=float)
        error[~(np.abs(error) <= ABSURD)] = np.nan
        if self.spec.expansion is not None and axis in position:
            error = length_at_reference(self.measured, self.spec, position[axis], error)
        known = np.isfinite(error)
        for place in position.values():
            known &= np.isfinite(place)
        if known.any() and position:
            places = np.stack(list(position.values()), axis=1)[known]
            error[known] = without_zero(error[known], places, self.spec.remove)
        return error

    def _direction(self, axis: str) -> Float[np.ndarray, " t"] | None:
        try:
            way = explain_direction(self.measured, axis).values.astype(float)
        except (DirectionUnknown, MissingRole):
            return None
        if is_log(self.measured, axis):
            # Whence an axis came before it first moved nobody recorded.
            place = self._position(axis)
            assert place is not None  # a log has one
            way[: _first_motion(place)] = np.nan
        return way

    def _motion(self, what: str) -> dict[str, np.ndarray]:
        """Return velocities or accelerations, as recorded or else derived."""
        found: dict[str, np.ndarray] = {}
        for axis in self.axes:
            given = self.measured.get(f"{axis}.{what}")
            if given is not None:
                found[axis] = np.asarray(given, dtype=float)
            elif is_log(self.measured, axis):
                try:
                    motion = derive_motion(self.measured, axis)
                except MeasurementError as error:
                    self.remarks.append(f"No {what} of {axis}: {error}")
                    continue
                found[axis] = np.asarray(getattr(motion, what), dtype=float)
                self.remarks.append(
                    f"The {what} of {axis} was not recorded: it is derived from the"
                    f" position, up to {motion.bandwidth:.3g} Hz."
                )
        return found


def _first_motion(place: Float[np.ndarray, " t"]) -> int:
    """Return the row with which an axis has left the place where it stood."""
    known = np.flatnonzero(np.isfinite(place))
    if not known.size:
        return len(place)
    gone = np.abs(place[known] - place[known[0]])
    far = np.flatnonzero(gone > _LEFT * float(gone.max()))
    return int(known[far[0]]) if far.size else len(place)
