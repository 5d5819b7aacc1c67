"""The error or the motion of an axis from what was measured, and lengths at 20 °C."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..signals import (
    Clock,
    Motion,
    SignalError,
    motion_of,
    read_clock,
)
from ._errors import CellError, MeasurementError, MissingRole
from ._measurement import Measurement

_ENOUGH, _ALIKE, _MULTIPLE = 8, 0.9, 2.0
"""Rows, and their correlation, that tell of how many times another column one is; and how many
are a contradiction: positions written with few digits follow an error badly."""
_AGAINST, _FACTOR = -0.5, 1.6
"""Correlation of a recorded motion with that of the positions from which on it has the other
sign, and how many times as large it is to have another unit: a filter leaves less of it."""
_JITTER, _SMOOTHER, _LEAST = 0.005, 0.7, 100
"""Share of a step by which a clock may be uneven unheeded; jerk with an even one, of that with the
recorded one, below which the even one is right; and samples without a jump that tell it."""
_STRETCH = 20
"""Stretches of a recording whose mean stamps must be those of its samples, where stamps repeat."""
_OWN = 0.3
"""How often samples with one stamp must differ in place, as a share of how often all others do."""
_REPEATED = 1.0 / 3.0
"""Share of samples at the instant before them from which on the clock is too coarse."""


def derive_error(
    measurement: Measurement, axis: str, against: tuple[str, ...] = ("position",)
) -> Float[np.ndarray, " t"]:
    """Return the error e = actual − commanded of an axis in mm or °.

    The error column where there is one, else actual − position at standstill. Errors of
    rotary axes are wrapped into [−180°, 180°). Where the file holds all three, the error must
    be that of the positions, but for a constant.

    Args:
        measurement: Any.
        axis: Name of the axis.
        against: Kinds of role that tell where the axis says it is, the best first.

    Raises:
        MissingRole: If neither the error nor both positions are there.
        MeasurementError: If the rows were taken in motion: actual − position then
            contains the following error, which is not to be compensated. Or if the error
            is another multiple of actual − position than one.
        CellError: If a needed column holds a cell that is no number.
    """
    error_role, actual_role = f"{axis}.error", f"{axis}.actual"
    if error_role in measurement.values:
        error = np.asarray(measurement.values[error_role], dtype=np.float64)
        unit = measurement.units[error_role]
        _refuse_contradiction(measurement, axis, against)
        _refuse_negative(measurement, axis)
    elif actual_role in measurement.values:
        recorded = [kind for kind in against if f"{axis}.{kind}" in measurement.values]
        role = f"{axis}.{[*recorded, 'position'][0]}"
        commanded = measurement.require(role, f"beside '{actual_role}'")
        _refuse_motion(measurement, axis)
        error = measurement.values[actual_role] - commanded
        unit = measurement.units[actual_role]
    else:
        why = f"or '{actual_role}' and '{axis}.position'"
        raise MissingRole(
            str(measurement.source), error_role, why, tuple(measurement.values)
        )
    return wrap_degrees(error) if unit == "deg" else error


def _refuse_contradiction(
    measurement: Measurement, axis: str, against: tuple[str, ...]
) -> None:
    """Raise where an error column has another sign or unit than the positions beside it.

    Raises:
        MeasurementError: If it is a multiple of actual − position other than one.
    """
    roles = [f"{axis}.{kind}" for kind in (*against, "position")]
    role = next((role for role in roles if role in measurement.values), None)
    actual_role = f"{axis}.actual"
    if role is None or actual_role not in measurement.values:
        return
    error = measurement.values[f"{axis}.error"]
    try:
        difference = measurement.values[actual_role] - measurement.values[role]
    except CellError:  # the error does without them
        return
    factor, alike = _times(error, difference)
    if abs(alike) >= _ALIKE and not 1.0 / _MULTIPLE < factor < _MULTIPLE:
        remedy = "sign = -1" if factor < 0 else "the unit"
        reason = (
            f"found '{axis}.error' {factor:.3g} times '{actual_role}' − '{role}', expected"
            f" once: state {remedy} of the column that is wrong (columns), or leave"
            f" '{actual_role}' out of them"
        )
        raise MeasurementError(str(measurement.source), reason)


def _refuse_negative(measurement: Measurement, axis: str) -> None:
    """Raise where the error is the command less the machine's own reading, at standstill.

    That is no accident: the reading is what the instrument showed, and the error its
    negative.

    Raises:
        MeasurementError: If it is.
    """
    roles = [f"{axis}.{kind}" for kind in ("error", "encoder", "position")]
    if "time" in measurement.values or not {*roles} <= {*measurement.values}:
        return
    error, encoder, position = roles
    try:
        difference = measurement.values[encoder] - measurement.values[position]
    except CellError:  # the error does without them
        return
    factor, alike = _times(np.asarray(measurement.values[error]), difference)
    if alike <= -_ALIKE and 1.0 / _MULTIPLE < -factor < _MULTIPLE:
        reason = (
            f"found '{error}' {factor:.3g} times '{encoder}' − '{position}', expected an"
            f" error that is actual − commanded: state sign = -1 of '{error}' (columns), or"
            f" leave '{encoder}' out of them"
        )
        raise MeasurementError(str(measurement.source), reason)


def _times(
    stated: np.ndarray, expected: Float[np.ndarray, " t"]
) -> tuple[float, float]:
    """Return how many times another column one is, and their correlation; 1 and 0: unknown."""
    both = np.stack([stated, expected]).astype(float)
    both = both[:, np.isfinite(both).all(axis=0)]
    if both.shape[1] < _ENOUGH:
        return 1.0, 0.0
    (own, product), (_, square) = np.cov(both)
    if not own * square:
        return 1.0, 0.0
    return float(product / square), float(product / np.sqrt(own * square))


def derive_motion(
    measurement: Measurement,
    axis: str,
    *,
    cutoff: float | None = None,
    share: float = 0.1,
    order: tuple[str, ...] = ("encoder", "actual", "position"),
) -> Motion:
    """Return velocity and acceleration of an axis in mm or °, per s and s².

    From the first position of the order that is recorded: the encoder, else the external
    reference, else the command; without any, from the integral of the velocity. Equal steps
    of time pass a zero-phase Butterworth filter, unequal ones a smoothing spline;
    `Motion.bandwidth` states what is left.

    Args:
        measurement: With `time` and a position of the axis.
        axis: Name of the axis.
        cutoff: Of the filter in Hz, or the bandwidth of the spline; a share of the
            sample rate, at most 100 Hz, where left out; infinity: nothing is taken out.
        share: Of the sample rate.
        order: Which positions to take, the best first.

    Raises:
        MissingRole: If there is no time, or neither a position nor a velocity.
        MeasurementError: If the record is too short, or the cutoff does not fit it.
    """
    why = f"to derive the motion of {axis}"
    time = measurement.require("time", why)
    roles = [f"{axis}.{kind}" for kind in order]
    role = next(
        (role for role in roles if role in measurement.values), f"{axis}.position"
    )
    speed = measurement.get(f"{axis}.velocity")
    if role in measurement.values or speed is None:
        position = measurement.require(role, why)
    else:
        from scipy.integrate import cumulative_trapezoid

        position = cumulative_trapezoid(speed, time, initial=0.0)
    try:
        clock = read_clock(time)
        _refuse_repeats(clock, time.size)
        if cutoff is None:  # a spline follows no more than a quarter of the rate
            share = share if clock.uniform else min(share, 0.25)
            cutoff = min(share / clock.sample_time, 100.0)
        return motion_of(time, position, cutoff=cutoff, clock=clock)
    except SignalError as error:
        raise MeasurementError(str(measurement.source), f"{role}: {error}") from error


def recorded_motion(
    measurement: Measurement,
    axis: str,
    what: str,
    order: tuple[str, ...] = ("encoder", "actual", "position"),
) -> Float[np.ndarray, " t"] | None:
    """Return the velocity or acceleration of an axis as recorded, or None.

    Args:
        measurement: Any.
        axis: Name of the axis.
        what: ``velocity`` or ``acceleration``.
        order: Positions that it must agree with where they were recorded, the best first.

    Raises:
        MeasurementError: If it has another sign or unit than the positions say.
    """
    role = f"{axis}.{what}"
    stated = measurement.get(role)
    places = [f"{axis}.{kind}" for kind in order]
    if stated is None or not any(place in measurement.values for place in places):
        return stated
    try:
        derived = getattr(derive_motion(measurement, axis, order=order), what)
    except MeasurementError:  # nothing to compare it with
        return stated
    factor, alike = _times(stated, derived)
    if alike < _AGAINST or (alike > _ALIKE and not 1 / _FACTOR < factor < _FACTOR):
        remedy = "sign = -1" if factor < 0 else "the unit"
        reason = (
            f"found '{role}' {factor:.3g} times what the positions of {axis} say, expected"
            f" once: state {remedy} of its column (columns), or leave '{role}' out of them"
        )
        raise MeasurementError(str(measurement.source), reason)
    return stated


def _refuse_repeats(clock: Clock, count: int) -> None:
    """Raise where so many samples share an instant that nothing moves between them."""
    repeats = sum(jump.kind == "repeat" for jump in clock.jumps)
    if repeats > _REPEATED * count:
        what = "clock"
        found = f"{repeats} of {count} samples at the instant before them"
        raise SignalError(what, found, "an instant of its own for each, in finer units")


def wrap_degrees(angle: Float[np.ndarray, "*t"]) -> Float[np.ndarray, "*t"]:
    """Return angles in ° shifted by whole turns into [−180, 180)."""
    # Rounding up from a tie sends +180 to −180, so that the range is half-open.
    return angle - 360.0 * np.floor(angle / 360.0 + 0.5)


def _refuse_motion(measurement: Measurement, axis: str) -> None:
    velocity = measurement.get(f"{axis}.velocity")
    if velocity is None or not np.any(velocity != 0.0):
        return
    at = int(np.flatnonzero(velocity != 0.0)[0])
    reason = (
        f"line {measurement.lines[at]}: found {axis} moving at {velocity[at]:g}/s, "
        f"expected standstill or an '{axis}.error' column: in motion actual − position "
        "contains the following error"
    )
    raise MeasurementError(str(measurement.source), reason)


def reduce_length(
    error: Float[np.ndarray, " t"],
    position: Float[np.ndarray, " t"],
    *,
    expansion: float,
    material_temperature: float | Float[np.ndarray, " t"],
    reference_temperature: float = 20.0,
    already_compensated: bool = False,
    datum: float = 0.0,
) -> Float[np.ndarray, " t"]:
    r"""Return the error in mm that the axis would show at the reference temperature.

    The axis is longer at temperature $T$: a point that is commanded $p$ from the datum
    $d$ lies at $p + \alpha (T - T_0)(p - d)$ if it lies at $p$ at $T_0$. With actual −
    commanded as the error, $e_T = e_{T_0} + \alpha (T - T_0)(p - d)$, so

    $$e_{T_0} = e_T - 10^{-6}\,\alpha\,(T - T_0)\,(p - d).$$

    Steel, 11.5 µm/m/K, at 23 °C: a perfect axis shows +34.5 µm at 1 m; that is taken
    off. See ISO 230-2:2014, 3.4 (nominal differential expansion).

    Args:
        error: Actual − commanded in mm as measured, with the air compensated.
        position: Commanded position in mm.
        expansion: Coefficient $\alpha$ in µm/m/K of what carries the length.
        material_temperature: $T$ in °C, one value or one per reading.
        reference_temperature: $T_0$ in °C.
        already_compensated: The instrument has done this; the error is returned as it
            is.
        datum: Position $d$ in mm that does not move.
    """
    if already_compensated:
        return error
    warmth = np.asarray(material_temperature, dtype=np.float64) - reference_temperature
    return error - 1e-6 * expansion * warmth * (position - datum)


def on_even_clock(
    measurement: Measurement, axis: str, *, share: float = 0.1
) -> Measurement:
    """Return a log whose samples are even in time where that is the clock they were taken by.

    A time that was rounded, or stamped when a sample arrived, makes a smooth motion jerk. Where
    samples lie within one step of an even clock, and the motion of the axis is smoother by that
    one, it is the clock of the controller. Stamps that repeat tell of no gap: all samples are of
    one clock where each stretch is within half a step in the mean.

    Args:
        measurement: Any.
        axis: Whose motion tells it.
        share: As for `derive_motion`.
    """
    try:
        time = np.asarray(measurement.require("time"), dtype=float)
        clock = read_clock(time)
        coarse = _is_coarse(measurement, axis, time)
        if clock.jitter <= _JITTER * clock.sample_time and not coarse:
            return measurement
        even = time.copy()
        for rows in (slice(None),) if coarse else clock.segments:
            count = np.arange(len(time[rows]), dtype=float)
            if len(count) > _LEAST:
                even[rows] = np.polynomial.Polynomial.fit(count, time[rows], 1)(count)
        away = np.abs(even - time)
        moved = float(away.max())
        if coarse:
            from scipy.ndimage import uniform_filter1d  # takes long to load

            # A sample that is missing moves all behind it; stamps that are late come back.
            width = max(len(time) // _STRETCH, _LEAST)
            moved = 2.0 * float(np.ptp(uniform_filter1d(even - time, width)))
        values = measurement.values.replaced("time", even)
        found = dataclasses.replace(measurement, values=values)
        # No motion follows from stamps that repeat.
        tried = (found,) if coarse else (found, measurement)
        pair = [derive_motion(one, axis, share=share) for one in tried]
    except (MissingRole, MeasurementError, SignalError):
        return measurement  # who needs it says so
    jerks = [
        float(np.std(np.diff(one.acceleration)[one.settled[1:] & one.settled[:-1]]))
        for one in pair
    ]
    step = min(clock.sample_time, float(np.ptp(time)) / (len(time) - 1))
    if moved > step or not (coarse or jerks[0] < _SMOOTHER * jerks[1]):
        return measurement
    uneven = float(np.std(np.diff(time)))
    words = (
        f"The times are uneven by {1e3 * uneven:.2g} ms a step, and the motion of {axis} is"
        f" {'known' if coarse else 'smoother'} with samples every"
        f" {1e3 * pair[0].clock.sample_time:.4g} ms: taken as these (times moved by up to"
        f" {1e3 * away.max():.2g} ms)."
    )
    return dataclasses.replace(found, remarks=(*measurement.remarks, words))


def _is_coarse(
    measurement: Measurement, axis: str, time: Float[np.ndarray, " t"]
) -> bool:
    """Return whether samples of a motion share a time stamp; rows written twice do not."""
    again = np.diff(time) == 0.0
    roles = (f"{axis}.{kind}" for kind in ("encoder", "actual", "position"))
    place = next(
        (measurement.values[r] for r in roles if r in measurement.values), None
    )
    if place is None or not again.any() or again.all():
        return False
    moves = np.diff(place) != 0.0
    return bool(moves[again].mean() > _OWN * moves[~again].mean())
