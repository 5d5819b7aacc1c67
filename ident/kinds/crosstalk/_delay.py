"""How late the error of the slave follows the acceleration of the master in a log.

Three delays have an estimate each, since each shows in something else:

* `estimate_instrument` (data.signals): of an external instrument against the encoder of
  the same axis. It needs that axis to move, and is found from its changes of speed to
  a microsecond. It is taken off before any fit, here too where the slave moves.
* `Delay` (fit.joint): what that leaves, as an error along the axis's own velocity.
* This one: of an error that was recorded as such (a dial, a scale beside the slave, which
  stands still). There is no motion of the slave to compare with, and its velocity is zero:
  only the events of the master show it, to a whole row. Groups do not have it: there the
  error must be on the clock of the motion, or have an encoder beside it.
"""

import dataclasses
import math

import numpy as np
from jaxtyping import Float

from .effect import CrosstalkFit, CrosstalkReadings

_FARTHEST = 0.02
"""s: a delay beyond this is another event."""
_MOST_ROWS = 25
_MOST_EVENTS = 60
_GAIN = 0.05
"""Relative fall of the residual's standard deviation below which there is no delay."""


def instrument_delay(readings: CrosstalkReadings, fit: CrosstalkFit) -> int:
    """Return by how many rows the error is late, 0 where that does not show.

    The same line per event as `cut_events` fits it, with the error moved against the
    motion; the events' residuals together say which delay is right.

    Args:
        readings: Log of master and slave.
        fit: What was found without a delay.
    """
    events = [event for event in fit.events if not event.wild]
    picks = np.linspace(0, len(events) - 1, min(len(events), _MOST_EVENTS))
    chosen = [events[int(k)] for k in np.unique(picks.astype(int))]
    step = float(np.median(np.diff(readings.time)))
    reach = min(math.ceil(_FARTHEST / step), _MOST_ROWS)
    lags = np.arange(-reach, reach + 1)
    cost = np.zeros(len(lags))
    rows_in_all = 0
    for event in chosen:
        length = event.stop - event.start
        rows = np.arange(event.start - length, event.stop + length)
        rows = rows[(rows >= reach) & (rows < len(readings.time) - reach)]
        shifted = readings.error[rows[:, None] + lags]
        rows, shifted = (
            each[np.isfinite(shifted).all(axis=1)] for each in (rows, shifted)
        )
        design = _design(readings, fit, rows)
        if len(rows) <= 2 * design.shape[1]:
            continue
        base, _ = np.linalg.qr(design)
        left = shifted - base @ (base.T @ shifted)
        spread = np.maximum((left**2).mean(axis=0), 1e-24)
        cost += 0.5 * len(rows) * np.log(spread)
        rows_in_all += len(rows)
    if not rows_in_all:
        return 0
    best = int(np.argmin(cost))
    # Mean fall of the logarithm of the standard deviation.
    gain = (cost[reach] - cost[best]) / rows_in_all
    return int(lags[best]) if gain > _GAIN else 0


def _design(
    readings: CrosstalkReadings, fit: CrosstalkFit, rows: np.ndarray
) -> Float[np.ndarray, "r c"]:
    """Return share of the acceleration by sign and direction, level and drift."""
    a, v = readings.acceleration[rows], readings.velocity[rows]
    full = np.where(a < 0, -fit.deceleration, fit.acceleration)
    share = np.minimum(np.abs(a) / full, 1.0)
    kind = 2 * (a < 0) + (v < 0)
    columns = [np.where(kind == k, share, 0.0) for k in range(4)]
    columns = [column for column in columns if column.any()]
    clock = readings.time[rows] - readings.time[rows].mean()
    return np.column_stack([*columns, np.ones(len(rows)), clock])


def without_delay(readings: CrosstalkReadings, rows: int) -> CrosstalkReadings:
    """Return a log with the error moved back in time by this many rows."""
    error = np.full(len(readings.error), np.nan)
    if rows > 0:
        error[:-rows] = readings.error[rows:]
    else:
        error[-rows:] = readings.error[:rows]
    return dataclasses.replace(readings, error=error)
