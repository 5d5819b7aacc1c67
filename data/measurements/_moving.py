"""An axis in motion: its error as a standstill would show it, following error aside."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ..signals import (
    AlignedError,
    InstrumentClock,
    SignalError,
    aligned_error,
    encoder_spline,
    estimate_instrument,
    first_motion,
    motion_of,
    noise_of,
    scatter_of,
    standing,
    travel_direction,
)
from ._derive import on_even_clock
from ._errors import MeasurementError
from ._measurement import Measurement, RoleValues

_SLOW = 0.5
"""s: nobody reads targets at standstill faster than that."""
_LEAST = 20
"""Rows of a log, and of standstill windows, at least."""
_APART = 1e-4
"""s: instruments whose delays differ by less show the same instant."""
_NOISY = 0.01
"""Share of the largest acceleration that noise may be in what a spline tells of it."""
_TOLD = 5e-4
"""Share of rows left out from which on it is told."""
_LATE = 5.0
"""Standard deviations from which on a delay of stated errors is one."""
_STILL, _FLICKER = 0.02, 12.0
"""mm or °, and deviations of its noise, within which an axis stands, however it flickers."""
_AT_REST = 1e-3
"""mm/s or °/s: an axis that never moves faster stands."""


def is_log(measurement: Measurement, axis: str) -> bool:
    """Return whether an axis was recorded in motion: fast rows, its position changing.

    Readings at standstill have no time, or seconds between them.
    """
    time = measurement.get("time")
    if time is None or time.size < _LEAST:
        return False
    steps = np.diff(time)
    rising = steps[steps > 0]
    if not rising.size or float(np.median(rising)) > _SLOW:
        return False
    place = _place(measurement, axis)
    if place is None:
        return False
    finite = place[np.isfinite(place)]
    span = float(np.ptp(finite)) if finite.size > _LEAST else np.inf
    if span < _STILL and span <= _FLICKER * scatter_of(finite):
        return False  # an encoder that flickers about one place
    fast = np.abs(np.diff(place)) > _AT_REST * np.maximum(steps, 1e-9)
    # A target at standstill changes in one row and holds for many.
    return bool(fast.any())


def without_motion(measurement: Measurement, axes: Sequence[str]) -> Measurement:
    r"""Return a log with the errors of axes as a standstill would show them.

    The error is reference − encoder, not − command: what the axis lags behind its command
    is no error that a table could correct. The external instrument is late besides; its
    delay and the rate of its clock are found from changes of speed
    (`estimate_instrument`) and taken off. All columns are then those of the instants
    that the instrument's readings belong to: positions are the encoders', velocities,
    accelerations and directions of motion are derived from them.

    Without an encoder, or where the delay cannot be told, only rows at standstill count.

    The errors of a column of its own, which a logger took, may be late as well: what shows for
    certain is taken off them likewise.

    A measurement that is no log of these axes stays as it is.
    Rows stay; where an error is not known it is NaN (`with_error` drops them).

    Args:
        measurement: Any.
        axes: Whose errors are asked for.

    Raises:
        MeasurementError: If an axis moves all the time and its error cannot be told
            from what it lags behind, or times do not ascend.
    """
    moving = [axis for axis in axes if _moves(measurement, axis)]
    for axis in axes:
        if is_log(measurement.with_gaps(), axis):
            measurement = on_even_clock(measurement, axis)
    gappy = measurement.with_gaps()
    late_errors = {axis: found for axis in axes if (found := _late_error(gappy, axis))}
    if not moving and not late_errors:
        return measurement
    time = np.asarray(measurement.require("time"), dtype=float)
    if np.any(np.diff(time) <= 0):
        at = 1 + int(np.flatnonzero(np.diff(time) <= 0)[0])
        reason = (
            f"line {measurement.lines[at]}: found time that does not ascend, expected a"
            " log in the order of time"
        )
        raise MeasurementError(str(measurement.source), reason)
    errors = {axis: _error_of(gappy, axis, time) for axis in moving}
    errors |= late_errors
    common = next((part.instants for part in errors.values() if part.clock), time)
    values = _at(measurement, time, common)
    for axis in moving:
        # Of all rows: an overrun, which is in motion, tells from which side a target came.
        place = _place(measurement, axis)
        if f"{axis}.direction" not in values and place is not None:
            way = travel_direction(place)
            values[f"{axis}.direction"] = np.where(way == 0, 1, way)
    remarks = list(measurement.remarks)
    units = dict(measurement.units)
    gaps = {}
    for axis, part in errors.items():
        error = part.error
        if np.abs(part.instants - common).max() > _APART:
            error = np.interp(common, part.instants, error)
        gaps[f"{axis}.error"] = error
        kind = "error" if axis in late_errors else "actual"
        units[f"{axis}.error"] = measurement.units[f"{axis}.{kind}"]
        remarks.append(part.words)
    for role in values:
        units.setdefault(role, _unit(role, units))
    late = {
        axis: part.clock.standard_deviation * values[f"{axis}.velocity"]
        for axis, part in errors.items()
        if part.clock is not None and f"{axis}.velocity" in values
    }
    # What was shown is late and in motion: it is no second word on the error.
    shown = {f"{axis}.actual" for axis in errors}
    kept = {role: column for role, column in values.items() if role not in shown}
    return dataclasses.replace(
        measurement,
        values=RoleValues(kept | gaps),
        units=units,
        remarks=tuple(remarks),
        late=late,
    )


def standstill_words(measurement: Measurement, axis: str) -> str:
    """Return why of a log only the rows count in which an axis stands; empty where others do."""
    try:
        if not _moves(measurement, axis):
            return ""
        gappy = on_even_clock(measurement, axis).with_gaps()
        time = np.asarray(gappy.require("time"), dtype=float)
        found = _error_of(gappy, axis, time)
    except MeasurementError:
        return ""
    return found.words if found.clock is None else ""


def with_error(measurement: Measurement, axis: str) -> Measurement:
    """Return the rows of a log in which the error of an axis is known."""
    role = f"{axis}.error"
    if role not in measurement.values:
        return measurement
    finite = np.isfinite(measurement.values[role])
    if finite.all():
        return measurement
    values = {name: measurement.values[name][finite] for name in measurement.values}
    return dataclasses.replace(
        measurement,
        values=RoleValues(values),
        rows=int(finite.sum()),
        lines=measurement.lines[finite],
        late={name: delay[finite] for name, delay in measurement.late.items()},
    )


def _unit(role: str, units: Mapping[str, str]) -> str:
    """Return the unit of a column that was derived from an encoder."""
    axis, _, kind = role.partition(".")
    length = units.get(f"{axis}.encoder", "mm")
    return {
        "position": length,
        "velocity": f"{length}/s",
        "acceleration": f"{length}/s2",
    }.get(kind, "")


@dataclasses.dataclass(frozen=True)
class _Found:
    """Error of one axis at the instants of its instrument."""

    instants: Float[np.ndarray, " t"]
    error: Float[np.ndarray, " t"]
    clock: InstrumentClock | None
    words: str


def _moves(measurement: Measurement, axis: str) -> bool:
    values = measurement.values
    is_missing = f"{axis}.error" not in values and f"{axis}.actual" in values
    return is_missing and is_log(measurement, axis)


def _place(measurement: Measurement, axis: str) -> np.ndarray | None:
    for kind in ("encoder", "position"):
        if f"{axis}.{kind}" in measurement.values:
            return np.asarray(measurement.values[f"{axis}.{kind}"], dtype=float)
    return None


def _error_of(
    measurement: Measurement, axis: str, time: Float[np.ndarray, " t"]
) -> _Found:
    actual = np.asarray(measurement.require(f"{axis}.actual"), dtype=float)
    encoder = measurement.get(f"{axis}.encoder")
    place = encoder if encoder is not None else measurement.require(f"{axis}.position")
    place = np.asarray(place, dtype=float)
    reason = "its encoder was not recorded"
    # From which side the axis came before its first motion, nobody knows.
    since = time >= time[first_motion(time, place)]
    if encoder is not None:
        try:
            others = _others(measurement, axis)
            clock = estimate_instrument(time, place, actual, others=others)
        except SignalError as fault:
            raise MeasurementError(str(measurement.source), str(fault)) from fault
        if clock.determined:
            aligned = aligned_error(time, place, actual, clock)
            return _Found(
                aligned.instants,
                np.where(since, aligned.error, np.nan),
                clock,
                _aligned_words(axis, clock, aligned),
            )
        reason = clock.statement
    standstill = standing(time, place)
    # A rest that is most of the log was no start: another axis moved meanwhile.
    if 2 * (standstill & since).sum() > standstill.sum():
        standstill = standstill & since
    error = np.where(standstill, actual - place, np.nan)
    count = int(np.isfinite(error).sum())
    if count < _LEAST:
        moving = int(np.flatnonzero(~standstill)[0])
        why = (
            f"line {measurement.lines[moving]}: found {axis} moving, and {reason};"
            f" expected '{axis}.actual' and '{axis}.encoder' of a motion at changing"
            f" speeds, pauses of half a second, or an '{axis}.error' column: in motion"
            " actual − position contains the following error"
        )
        raise MeasurementError(str(measurement.source), why)
    words = (
        f"{axis} was moving: only the {count} of {len(time)} rows at standstill count,"
        f" since {reason}."
    )
    return _Found(time, error, None, words)


def _late_error(measurement: Measurement, axis: str) -> _Found | None:
    """Return the error of a column without the delay of its instrument, where one shows."""
    place, time = _place(measurement, axis), measurement.get("time")
    error = measurement.get(f"{axis}.error")
    if place is None or time is None or error is None or not is_log(measurement, axis):
        return None
    if not np.all(np.diff(time) > 0) or not np.isfinite(place).all():
        return None
    reference = place + np.asarray(error, dtype=float)
    try:
        others = _others(measurement, axis)
        clock = estimate_instrument(time, place, reference, others=others)
    except SignalError:
        return None
    if not clock.determined or abs(clock.delay) < _LATE * clock.standard_deviation:
        return None
    aligned = aligned_error(time, place, reference, clock)
    words = (
        f"The error of {axis} was taken in motion and follows its velocity:"
        f" {clock.statement}, which was taken off."
    )
    return _Found(aligned.instants, aligned.error, clock, words)


def _others(measurement: Measurement, axis: str) -> np.ndarray | None:
    """Return where the other axes are, a column each; None where there is none."""
    places = [
        place
        for name in measurement.axes
        if name != axis and (place := _place(measurement, name)) is not None
    ]
    complete = [place for place in places if np.isfinite(place).all()]
    return np.stack(complete, axis=1) if complete else None


def _aligned_words(axis: str, clock: InstrumentClock, aligned: AlignedError) -> str:
    lost = 1.0 - float(aligned.valid.mean())
    words = (
        f"{axis} was moving: its error is that of the reference against the encoder, not"
        f" against the command; {clock.statement}, which was taken off."
    )
    if lost >= _TOLD:
        words += (
            f" {lost:.1%} of the rows are left out, where the samples of the encoder are too far"
            " apart, or too noisy, to say where the axis was between them."
        )
    return words


def _at(
    measurement: Measurement,
    time: Float[np.ndarray, " t"],
    instants: Float[np.ndarray, " t"],
) -> dict[str, np.ndarray]:
    """Return all columns at the instants; positions are those of the encoders."""
    gappy = measurement.with_gaps()
    shifted = instants is not time
    columns: dict[str, np.ndarray] = {}
    for role in gappy.values:
        column = np.asarray(gappy.values[role])
        if shifted and column.dtype.kind == "f" and role != "run":
            column = np.interp(instants, time, column)
        columns[role] = column
    columns["time"] = instants
    for axis in measurement.axes:
        encoder = gappy.get(f"{axis}.encoder")
        if encoder is None or not np.isfinite(encoder).all():
            continue
        place, speed, rate = _motion(time, np.asarray(encoder, dtype=float), instants)
        columns[f"{axis}.encoder"] = columns[f"{axis}.position"] = place
        columns[f"{axis}.velocity"], columns[f"{axis}.acceleration"] = speed, rate
        before = np.searchsorted(time, instants, side="right") - 1
        way = travel_direction(np.asarray(encoder, dtype=float))
        columns[f"{axis}.direction"] = np.where(way == 0, 1, way)[np.maximum(before, 0)]
    return columns


def _motion(
    time: Float[np.ndarray, " t"],
    encoder: Float[np.ndarray, " t"],
    instants: Float[np.ndarray, " t"],
) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    """Return position, velocity and acceleration of an encoder at the instants."""
    spline = encoder_spline(time, encoder)
    if spline is None:
        zeros = np.zeros(len(time))
        return encoder, zeros, zeros.copy()
    place, speed, rate = (np.asarray(spline(instants, k)) for k in range(3))
    step = float(np.median(np.diff(time)))
    noise = 3.0 * noise_of(encoder) / step**2
    if noise > _NOISY * float(np.percentile(np.abs(rate), 99.9)):
        smooth = motion_of(time, encoder, cutoff=min(0.1 / step, 100.0))
        speed = np.interp(instants, time, smooth.velocity)
        rate = np.interp(instants, time, smooth.acceleration)
    return place, speed, rate
