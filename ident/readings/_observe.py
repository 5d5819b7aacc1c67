"""All that the measurements of a job hold, of every axis and for no fit in particular."""

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ...data.measurements import MeasurementError, is_log
from ..discover import Observed, stack
from ._rows import PLACES, POSITION_ORDER, Rows, first_motion, has_error
from ._tables import Tables

if TYPE_CHECKING:
    from ..job.file._load import Job

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


def observe(job: "Job") -> Observation:
    """Return the readings of all measurements of a job.

    Raises:
        MeasurementError: If a file holds nothing usable.
        JobError: If a measurement does not suit.
    """
    tables, names = Tables(job), tuple(job.spec.measurements)
    parts: list[Observed] = []
    remarks: list[str] = []
    unzeroed: set[str] = set()
    for name in names:
        measured = tables.measured(name)
        asked = [axis for axis in job.spec.axes if has_error(measured, axis)]
        rows = Rows(job, name, measured, asked, gaps=True)
        parts.append(_observed(rows, asked))
        remarks += rows.remarks
        if rows.moving and any(map(_is_far, parts[-1].error.values())):
            unzeroed.add(name)
    return Observation(
        stack(parts), names, tuple(dict.fromkeys(remarks)), frozenset(unzeroed)
    )


def _observed(rows: Rows, asked: list[str]) -> Observed:
    """Return the columns of a measurement."""
    axes, run, none = rows.job.spec.axes, rows.run, np.zeros(len(rows), dtype=np.int64)
    position = rows.positions(PLACES)
    currents = {axis: rows.current(axis) for axis in axes}
    return Observed(
        time=rows.time,
        run=none if run is None else run,
        source=none,
        position=position,
        error={axis: rows.error(axis, position) for axis in asked},
        direction=dict(_directions(rows, position)),
        velocity=dict(_motions(rows, "velocity")),
        acceleration=dict(_motions(rows, "acceleration")),
        temperature={sensor: rows.temperature(sensor) for sensor in rows.sensors},
        current={axis: one for axis, one in currents.items() if one is not None},
        rotary=frozenset(name for name, axis in axes.items() if axis.kind != "linear"),
        modulo={
            name: (axis.modulo[0], axis.modulo[1])
            for name, axis in axes.items()
            if axis.modulo is not None
        },
    )


def _is_far(error: Float[np.ndarray, " t"]) -> bool:
    known = error[np.isfinite(error)]
    if not known.size:
        return False
    low, middle, high = np.percentile(known, [16.0, 50.0, 84.0])
    return bool(abs(middle) > _FAR * 0.5 * (high - low))


def _directions(
    rows: Rows, position: dict[str, Float[np.ndarray, " t"]]
) -> Iterator[tuple[str, Float[np.ndarray, " t"]]]:
    for axis, place in position.items():
        way = rows.direction(axis)
        if way is not None:
            known = way.astype(float)
            if is_log(rows.measured, axis):
                known[: first_motion(place)] = np.nan
            yield axis, known


def _motions(rows: Rows, what: str) -> Iterator[tuple[str, Float[np.ndarray, " t"]]]:
    """Yield velocities or accelerations, as recorded or else derived from logs."""
    for axis in rows.job.spec.axes:
        if f"{axis}.{what}" in rows.measured.values or is_log(rows.measured, axis):
            try:
                yield axis, rows.motion(axis, what, POSITION_ORDER["actual"])
            except MeasurementError as error:
                rows.remarks.append(f"No {what} of {axis}: {error}")
