"""What was measured for a backlash: readings at standstill, or a trace in motion."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from ....data.measurements import MeasurementError, wrap_degrees
from ....data.signals import aligned_error, encoder_spline, estimate_instrument
from ...job.joint._recording import read_group
from ...job.result._result import Remark
from ...readings import Readings, Tables
from ._trace import fit_backlash_trace
from .effect import BacklashFit, fit_backlash

if TYPE_CHECKING:
    from .plan import BacklashPlan

_ROWS = 50
"""Fewer tell nothing of a delay."""
_REACH = 0.1
"""Share of the travel, to each side of a reversal, that a trace is judged by."""
_FARTHEST = 2.0
"""mm or °: more on each side tells no more of a backlash."""


def fit_readings(
    readings: Readings, loss: str, keep: Bool[np.ndarray, " t"] | slice = slice(None)
) -> BacklashFit:
    """Return the backlash of readings in both directions, or of a trace, which has none.

    Args:
        readings: Of the axis.
        loss: As for `fit_backlash`.
        keep: Those that count.

    Raises:
        FitError: If they do not determine it.
    """
    position, error = readings.positions[keep, 0], readings.error[keep]
    time = None if readings.time is None else readings.time[keep]
    if readings.direction is None:
        assert time is not None  # a trace has it
        reach = _reach(position)
        return fit_backlash_trace(time, position, error, reach=reach, loss=loss)
    run = None if readings.run is None else readings.run[keep]
    way = readings.direction[keep]
    return fit_backlash(position, error, way, run=run, time=time, loss=loss)


def read_backlash(
    tables: Tables, plan: "BacklashPlan"
) -> tuple[Readings, tuple[Remark, ...]]:
    """Return the readings of a backlash fit, all its measurements joined, with remarks.

    Raises:
        MeasurementError: If a role is missing, the directions cannot be told, or a value
            cannot be used.
    """
    fit, name = plan.fit, plan.fit.sources[0]
    measured = tables.measured(name, fit.axis, (fit.axis,))
    encoder = measured.get(f"{fit.axis}.encoder")
    actual = measured.get(f"{fit.axis}.actual")
    time = measured.get("time")
    if encoder is not None and actual is not None and time is not None:
        if len(fit.sources) > 1:
            reason = "found a trace in motion among several measurements, expected one"
            raise MeasurementError(str(measured.source), reason)
        return _trace(encoder, actual, time, tables.job.spec.axes[fit.axis].kind)
    found = read_group(tables, [plan], alone=True)
    error, every = found.data.error[fit.axis], np.ones(len(found.data), dtype=bool)
    return found.readings(plan.positions, fit.axis, error, every), found.remarks


def _trace(
    encoder: np.ndarray, actual: np.ndarray, time: np.ndarray, kind: str
) -> tuple[Readings, tuple[Remark, ...]]:
    """Return a trace in motion: reference − encoder over the time, without directions."""
    position = np.asarray(encoder, dtype=float)
    error, time = np.asarray(actual - position, dtype=float), np.asarray(time, float)
    late = ""
    clock = estimate_instrument(time, position, actual) if time.size >= _ROWS else None
    if clock is not None and clock.determined:
        # Reversals alone, at one speed, would take the delay for a part of the backlash.
        aligned = aligned_error(time, position, actual, clock)
        spline = encoder_spline(time, position)
        if spline is not None:
            position = np.asarray(spline(aligned.instants))
        time, error = aligned.instants, aligned.error
        late = (
            f" {clock.statement[:1].upper()}{clock.statement[1:]}; that is taken off."
        )
    if kind != "linear":
        error = wrap_degrees(error)
    words = (
        "The axis was moving: the error is that of the reference against the encoder,"
        f" over {_reach(position):.3g} mm (or °) on both sides of each reversal.{late}"
    )
    readings = Readings(
        positions=position[:, None],
        error=error,
        direction=None,
        run=None,
        order=time,
        timed=True,
        slices={},
    )
    return readings, (Remark.info(words),)


def _reach(position: Float[np.ndarray, " t"]) -> float:
    """Return the travel on both sides of a reversal that a trace is judged by."""
    return min(_REACH * float(np.ptp(position)), _FARTHEST)
