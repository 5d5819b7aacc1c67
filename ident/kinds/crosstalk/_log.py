"""From the measurements of a job to a log, and what the log tells beside the tests."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ....data.measurements import (
    Measurement,
    MeasurementError,
    MissingRole,
    derive_error,
    derive_motion,
)
from ...fit import FitError
from ...readings import POSITION_ORDER, Rows, Tables
from ._events import joined_logs, shares_of
from .effect import BRANCHES, CrosstalkFit, CrosstalkReadings, fit_events, full_offsets
from .keys import Spec

_STILL = 2.0
"""mm/s: a slave that its encoder shows slower than this is not commanded to move."""
_COMMANDED = 1e-3
"""mm/s: the same where the command itself was recorded."""
_FOLDS = 5
_FARTHEST = 0.02
"""s: a delay beyond this is another event."""
_MOST_ROWS = 25
_MOST_EVENTS = 60
_GAIN = 0.05
"""Relative fall of the residual's standard deviation below which there is no delay."""


def read_crosstalk(
    tables: Tables, fit: Spec
) -> tuple[CrosstalkReadings, tuple[str, ...]]:
    """Return the logs of a fit, all its measurements joined, and what was taken for granted.

    Raises:
        MeasurementError: If a role is missing, the motion of the master cannot be
            derived, or time does not ascend.
    """
    masters = fit.adapts_to or (fit.master,)
    logs = [
        Rows(tables.job, name, tables.measured(name, fit.axis, masters))
        for name in fit.sources
    ]
    joined = joined_logs([_part(rows, fit) for rows in logs])
    return joined, tuple(words for rows in logs for words in rows.remarks)


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
    places = [rows.position(axis, why, order) for axis in fit.adapts_to]
    return CrosstalkReadings(
        time=time,
        acceleration=rows.motion(fit.master, "acceleration"),
        velocity=rows.motion(fit.mover(rules), "velocity"),
        error=_error(rows, fit.axis),
        positions=np.column_stack([np.zeros((len(time), 0)), *places]),
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


def held_out_events(
    found: CrosstalkFit, options: Mapping[str, Any]
) -> Float[np.ndarray, " n"]:
    """Return what lists fitted to the other events leave of each; NaN where there is none.

    Nothing is chosen anew but where the tests stand.
    """
    events, branch = found.events, found.events.branch
    left, fold = np.full(len(events), np.nan), np.zeros(len(events), dtype=np.int64)
    for row in range(len(BRANCHES)):
        # Dealt out by sign and direction, so that none is left without.
        own = np.flatnonzero(branch == row)
        fold[own] = np.arange(len(own)) % _FOLDS
    for each in np.unique(fold):
        out = fold == each
        try:
            model = fit_events(
                events.take(~out), (found.acceleration, found.deceleration),
                found.conventions, mode=found.mode, positions=options["positions"],
                loss=options["loss"], velocity_dependent=found.velocity_dependent,
                most_tests=options["most_tests"],
            ).compensation()  # fmt: skip
        except FitError:
            continue
        if model is not None:
            added = full_offsets(model, model, events.positions[out])
            value = events.value[out]
            left[out] = value + added[branch[out], np.arange(len(value))]
    return left


def without_delay(
    readings: CrosstalkReadings, fit: CrosstalkFit
) -> tuple[CrosstalkReadings, float]:
    """Return a log whose error is not late, and by how many s it was; 0 if that is not seen.

    The same line per event as `cut_events` fits it, with the error moved against the
    motion; the events' residuals together say which delay is right. Other delays have an
    estimate each, since each shows in something else: that of an instrument against the
    encoder of the same axis (`data.signals.estimate_instrument`, taken off before any fit),
    and what it leaves along the axis's own velocity (`fit.joint.Delay`). This one is that of
    an error that was recorded as such beside a slave that stands still.

    Args:
        readings: Log of master and slave.
        fit: What was found without a delay.
    """
    sound = fit.events.take(~fit.events.wild)
    picks = np.linspace(0, len(sound) - 1, min(len(sound), _MOST_EVENTS))
    chosen = sound.take(np.unique(picks.astype(int)))
    rates = fit.acceleration, fit.deceleration
    share, branch = shares_of(readings, *rates, fit.conventions)
    columns = np.where(branch[:, None] == np.arange(4), share[:, None], 0.0)
    step = float(np.median(np.diff(readings.time)))
    reach = min(math.ceil(_FARTHEST / step), _MOST_ROWS)
    lags = np.arange(-reach, reach + 1)
    cost = np.zeros(len(lags))
    rows_in_all = 0
    for start, stop in zip(chosen.start, chosen.stop, strict=True):
        first, last = max(2 * start - stop, reach), 2 * stop - start
        rows = np.arange(first, min(last, len(share) - reach))
        rows = rows[np.isfinite(readings.error[rows[:, None] + lags]).all(axis=1)]
        own, clock = columns[rows], readings.time[rows] - readings.time[start]
        line = np.ones(len(rows)), clock
        design = np.column_stack([own[:, own.any(axis=0)], *line])
        if len(rows) <= 2 * design.shape[1]:
            continue
        shifted = readings.error[rows[:, None] + lags]
        base, _ = np.linalg.qr(design)
        left = shifted - base @ (base.T @ shifted)
        spread = np.maximum((left**2).mean(axis=0), 1e-24)
        cost += 0.5 * len(rows) * np.log(spread)
        rows_in_all += len(rows)
    if not rows_in_all:
        return readings, 0.0
    best = int(np.argmin(cost))
    # Mean fall of the logarithm of the standard deviation.
    gain, late = (cost[reach] - cost[best]) / rows_in_all, int(lags[best])
    if not late or gain <= _GAIN:
        return readings, 0.0
    back = np.arange(len(readings.error)) + late
    known = (back >= 0) & (back < len(back))
    error = np.where(known, readings.error[np.where(known, back, 0)], np.nan)
    return dataclasses.replace(readings, error=error), late * step
