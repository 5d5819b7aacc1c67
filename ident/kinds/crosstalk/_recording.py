"""What was measured for a crosstalk: motion of the master, error of the slave."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ....data.measurements import (
    Measurement,
    MeasurementError,
    MissingRole,
    derive_error,
    derive_motion,
)
from ...job._result import Remark
from ...readings import POSITION_ORDER, Rows, Tables
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
    """

    readings: CrosstalkReadings
    adaptation: tuple[str, ...]
    remarks: tuple[Remark, ...]


def read_crosstalk(tables: Tables, fit: Spec) -> CrosstalkRecording:
    """Return the logs of a crosstalk fit, all its measurements joined.

    Raises:
        MeasurementError: If a role is missing, the motion of the master cannot be
            derived, or time does not ascend.
    """
    names = fit.adapts_to
    parts: list[CrosstalkReadings] = []
    remarks: list[Remark] = []
    for name in fit.sources:
        measured = tables.measured(name, fit.axis, names or (fit.master,))
        rows = Rows(tables.job, name, measured)
        parts.append(_part(rows, fit))
        remarks += map(Remark.info, rows.remarks)
    return CrosstalkRecording(joined_logs(parts), names, tuple(remarks))


def _part(rows: Rows, fit: Spec) -> CrosstalkReadings:
    why, rules = f"for the crosstalk fit of {fit.axis}", rows.job.conventions
    time = np.asarray(rows.measured.require("time", why), dtype=float)
    back = np.flatnonzero(np.diff(time) <= 0)
    if back.size:
        reason = (
            f"line {rows.measured.lines[int(back[0]) + 1]}: found time that does not"
            " ascend, expected a log in the order of time"
        )
        raise MeasurementError(str(rows.measured.source), reason)
    order = POSITION_ORDER[rules.crosstalk_input]
    turning = fit.axis if rules.crosstalk_velocity == "slave" else fit.master
    places = [rows.position(axis, why, order) for axis in fit.adapts_to]
    return CrosstalkReadings(
        time=time,
        acceleration=rows.motion(fit.master, "acceleration"),
        velocity=rows.motion(turning, "velocity"),
        error=_error(rows, fit.axis),
        positions=np.stack(places, axis=1) if places else np.zeros((len(time), 0)),
    )


def _error(rows: Rows, axis: str) -> Float[np.ndarray, " t"]:
    """Return the error of the slave, NaN where it was missed or moves by itself."""
    known = rows.measured.with_gaps()
    if f"{axis}.error" in known.values:
        return derive_error(known, axis)
    kinds = ("encoder", "position")
    other = next((kind for kind in kinds if f"{axis}.{kind}" in known.values), None)
    if f"{axis}.actual" not in known.values or other is None:
        why = f"or '{axis}.actual' and '{axis}.encoder'"
        raise MissingRole(str(known.source), f"{axis}.error", why, tuple(known.values))
    own = known.require(f"{axis}.{other}")
    error = np.asarray(known.require(f"{axis}.actual") - own, dtype=float)
    still = _still(rows.measured, axis)
    if still.all():
        return error
    rows.remarks.append(
        f"{axis} itself moves in {1 - still.mean():.0%} of the {len(rows)} readings:"
        " these are left out, since what its motion adds is no crosstalk."
    )
    return np.where(still, error, np.nan)


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
