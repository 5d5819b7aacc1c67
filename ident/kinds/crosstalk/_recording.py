"""What was measured for a crosstalk: motion of the master, error of the slave."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.measurements import (
    Measurement,
    MeasurementError,
    MissingRole,
    derive_motion,
    wrap_degrees,
)
from ....models import Conventions
from ...job._result import Remark
from ...job._source import POSITION_ORDER, Tables, measured_for, motion_of
from .effect import CrosstalkReadings
from .keys import Spec

_STILL = 2.0
"""mm/s: a slave that its encoder shows slower than this is not commanded to move."""
_COMMANDED = 1e-3
"""mm/s: the same where the command itself was recorded."""
_QUIET = 0.02
"""Share of the largest acceleration up to which the master does not accelerate."""


@dataclasses.dataclass(frozen=True)
class CrosstalkRecording:
    """Logs of master and slave, one after the other.

    Attributes:
        readings: For the estimator; positions have one column per adaptation axis.
        adaptation: Names of these axes.
        remarks: What was taken for granted.
        rows: Row of the group's recording that each reading is, −1 between logs; None
            where it is no group.
    """

    readings: CrosstalkReadings
    adaptation: tuple[str, ...]
    remarks: tuple[Remark, ...]
    rows: Int[np.ndarray, " t"] | None = None

    @property
    def span(self) -> Float[np.ndarray, "k 2"]:
        """From where to where each adaptation axis went, in mm."""
        places = self.readings.positions
        return np.stack([places.min(axis=0), places.max(axis=0)], axis=1)


def read_crosstalk(tables: Tables, fit: Spec) -> CrosstalkRecording:
    """Return the logs of a crosstalk fit, all its measurements joined.

    Raises:
        MeasurementError: If a role is missing, the motion of the master cannot be
            derived, or time does not ascend.
    """
    rules = tables.job.conventions
    names = fit.adapts_to
    parts: list[CrosstalkReadings] = []
    remarks: list[Remark] = []
    for name in fit.sources:
        measured = measured_for(tables, name, fit, names or (fit.master,))
        part, words = _part(measured, fit, names, rules)
        parts.append(part)
        remarks += [Remark.info(each) for each in (*measured.remarks, *words)]
    return CrosstalkRecording(joined_logs(parts), names, tuple(remarks))


def _part(
    measured: Measurement,
    fit: Spec,
    names: tuple[str, ...],
    rules: Conventions,
) -> tuple[CrosstalkReadings, list[str]]:
    why = f"for the crosstalk fit of {fit.axis}"
    time = np.asarray(measured.require("time", why), dtype=float)
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        reason = (
            f"line {measured.lines[int(back[0]) + 1]}: found time that does not"
            " ascend, expected a log in the order of time"
        )
        raise MeasurementError(str(measured.source), reason)
    order = POSITION_ORDER[rules.crosstalk_input]
    acceleration, words = motion_of(measured, fit.master, "acceleration", rules)
    turning = fit.axis if rules.crosstalk_velocity == "slave" else fit.master
    velocity, more = motion_of(measured, turning, "velocity", rules)
    places = [_place(measured, axis, order, why) for axis in names]
    error, said = _error(measured, fit.axis, len(time))
    readings = CrosstalkReadings(
        time=time,
        acceleration=acceleration,
        velocity=velocity,
        error=error,
        positions=np.stack(places, axis=1) if places else np.zeros((len(time), 0)),
    )
    return readings, [*words, *more, *said]


def _place(
    measured: Measurement, axis: str, order: tuple[str, ...], why: str
) -> Float[np.ndarray, " t"]:
    known = [f"{axis}.{kind}" for kind in order if f"{axis}.{kind}" in measured.values]
    role = known[0] if known else f"{axis}.position"
    return np.asarray(measured.require(role, why), dtype=float)


def _error(
    measured: Measurement, axis: str, rows: int
) -> tuple[Float[np.ndarray, " t"], list[str]]:
    """Return the error of the slave, NaN where it was missed or moves by itself."""
    known = measured.with_gaps()
    error = known.get(f"{axis}.error")
    if error is not None:
        error = np.asarray(error, dtype=float)
        rotary = measured.units[f"{axis}.error"] == "deg"
        return (wrap_degrees(error) if rotary else error), []
    actual = known.get(f"{axis}.actual")
    other = next(
        (kind for kind in ("encoder", "position") if f"{axis}.{kind}" in known.values),
        None,
    )
    if actual is None or other is None:
        why = f"or '{axis}.actual' and '{axis}.encoder'"
        raise MissingRole(
            str(measured.source), f"{axis}.error", why, tuple(measured.values)
        )
    own = np.asarray(known.require(f"{axis}.{other}"), dtype=float)
    error = np.asarray(actual, dtype=float) - own
    still = _still(measured, axis)
    words = []
    if not still.all():
        error = np.where(still, error, np.nan)
        words.append(
            f"{axis} itself moves in {1 - still.mean():.0%} of the {rows} readings:"
            " these are left out, since what its motion adds is no crosstalk."
        )
    return error, words


def _still(measured: Measurement, axis: str) -> Bool[np.ndarray, " t"]:
    """Return where an axis is not commanded to move."""
    if f"{axis}.position" in measured.values:
        place = np.asarray(measured.require(f"{axis}.position"), dtype=float)
        time = np.asarray(measured.require("time"), dtype=float)
        speed = np.diff(place) / np.diff(time)
        still = np.abs(speed) <= _COMMANDED
        # A row stands still where the steps to both neighbours do.
        edge = np.ones(1, dtype=bool)
        return np.asarray(np.concatenate([edge, still]) & np.concatenate([still, edge]))
    return np.asarray(np.abs(derive_motion(measured, axis).velocity) <= _STILL)


def joined_logs(parts: list[CrosstalkReadings]) -> CrosstalkReadings:
    """Put logs one after the other, far enough apart that no event sees another log."""
    result = parts[0]
    for part in parts[1:]:
        gap = 1 + max(_longest(result), _longest(part))
        step = float(np.median(np.diff(part.time)))
        between = result.time[-1] + step * np.arange(1, gap + 1)
        later = part.time - part.time[0] + between[-1] + step
        empty = np.zeros(gap)
        held = np.repeat(result.positions[-1:], gap, axis=0)
        result = CrosstalkReadings(
            time=np.concatenate([result.time, between, later]),
            acceleration=np.concatenate(
                [result.acceleration, empty, part.acceleration]
            ),
            velocity=np.concatenate([result.velocity, empty, part.velocity]),
            error=np.concatenate([result.error, np.full(gap, np.nan), part.error]),
            positions=np.concatenate([result.positions, held, part.positions]),
        )
    return result


def _longest(part: CrosstalkReadings) -> int:
    """Return the rows of the longest acceleration of one sign."""
    a = part.acceleration
    sign = np.sign(a) * (np.abs(a) > _QUIET * np.abs(a).max(initial=0.0))
    edges = np.flatnonzero(np.diff(sign, prepend=np.nan, append=np.nan) != 0)
    runs = np.diff(edges)
    return int(runs[sign[edges[:-1]] != 0].max(initial=0))
