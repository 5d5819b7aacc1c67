"""From the measurements of a job to tests, and each event predicted by the others."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtri  # scipy.stats takes long to load

from ....data.measurements import (
    Measurement,
    MeasurementError,
    MissingRole,
    derive_error,
    derive_motion,
)
from ....models import Conventions, Crosstalk
from ...fit import FitError
from ...readings import POSITION_ORDER, Rows, Tables
from . import SAFE_TESTS
from ._events import joined_logs, shares_of
from .effect import (
    BRANCHES,
    CrosstalkFit,
    CrosstalkReadings,
    are_among,
    fit_crosstalk,
    fit_events,
    full_offsets,
)
from .keys import Spec

_STILL = 2.0
"""mm/s: a slave that its encoder shows slower than this is not commanded to move."""
_COMMANDED = 1e-3
"""mm/s: the same where the command itself was recorded."""
_FOLDS = 5
_SURE = 0.0027
"""Probability of three standard deviations, shared by all values that are looked at."""
_FARTHEST = 0.02
"""s: a delay beyond this is another event."""
_MOST_ROWS = 25
_MOST_EVENTS = 60
_GAIN = 0.05
"""Relative fall of the residual's standard deviation below which there is no delay."""


@dataclasses.dataclass(frozen=True)
class Identified:
    """A fit and how it predicts.

    Attributes:
        fit: The estimate.
        readings: What it saw: positions of its own adaptation axes only, no delay.
        masters: Names of these axes.
        held_out: Value of each event in mm under the list fitted without its fold.
        judged: Events whose fold left enough to predict them.
        delay: By how much the error follows the acceleration, in s; taken off.
    """

    fit: CrosstalkFit
    readings: CrosstalkReadings
    masters: tuple[str, ...]
    held_out: Float[np.ndarray, " n"]
    judged: Bool[np.ndarray, " n"]
    delay: float

    @property
    def significant(self) -> bool:
        """Whether any value is more than chance over all of them would show."""
        fit = self.fit
        rows = slice(None) if fit.velocity_dependent else slice(0, 4, 2)
        value, spread = fit.values[rows], fit.standard_deviation[rows]
        known = np.isfinite(value) & np.isfinite(spread)
        if not known.any():
            return False
        limit = -float(ndtri(0.5 * _SURE / int(known.sum())))
        return bool((np.abs(value[known]) > limit * spread[known]).any())


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


def options_of(
    fit: Spec, active: Crosstalk | None, rules: Conventions
) -> dict[str, Any]:
    """Return what a job leaves open of the tests, as options of `fit_crosstalk`.

    Args:
        fit: Keys of the job.
        active: The list that was active while measuring: its tests stay; or None.
        rules: Of the controller.

    Raises:
        FitError: If keys contradict each other.
    """
    points = None if fit.positions is None else np.array(fit.positions, dtype=float)
    rates = fit.acceleration, fit.deceleration
    if active is not None:
        points = _more_tests(active, points)
        rates = float(active.acceleration), float(active.deceleration)
    mode: int | str = fit.mode if points is None else 1 + points.shape[1]
    if fit.mode not in ("auto", mode):
        msg = f"mode: found {fit.mode}, expected {mode} as the tests that are given."
        raise FitError(msg)
    apart = fit.velocity_dependent
    return {
        "acceleration": rates[0],
        "deceleration": rates[1],
        "velocity_dependent": "auto" if apart is None else apart,
        "most_tests": min(fit.max_points or SAFE_TESTS, SAFE_TESTS),
        "conventions": rules,
        "loss": fit.loss,
        "mode": mode,
        "positions": points,
    }


def _more_tests(
    active: Crosstalk, wished: Float[np.ndarray, "q k"] | None
) -> Float[np.ndarray, "q k"]:
    """Return the tests of the list that follows an active one: its own, or more.

    Raises:
        FitError: If the wished ones lack one of these.
    """
    own = np.asarray(active.surface.points, dtype=float)
    if wished is None:
        return own
    if wished.shape[1] == own.shape[1] and are_among(own, wished).all():
        return wished
    msg = (
        "positions: found others than the tests of the list that was active while"
        " measuring, expected those and, if you like, more."
    )
    raise FitError(msg)


def identify(
    whole: CrosstalkReadings, fit: Spec, active: Crosstalk | None, rules: Conventions
) -> Identified:
    """Fit the tests of a list and hold events out.

    Args:
        whole: What was measured.
        fit: Keys of the job.
        active: The list that was active while measuring, or None.
        rules: Of the controller.

    Raises:
        FitError: If there are no events or the keys cannot be met.
    """
    options = options_of(fit, active, rules)
    _refuse_still(options, whole, fit.adapts_to)
    found = fit_crosstalk(whole, **options)
    late = instrument_delay(whole, found)
    if late:
        whole = without_delay(whole, late)
        found = fit_crosstalk(whole, **options)
    # What a list adds beside an event is that of the direction of the event.
    whole = whole.directed(found.acceleration, found.deceleration)
    axes, events = list(found.axes), found.events
    found = dataclasses.replace(
        found, events=dataclasses.replace(events, positions=events.positions[:, axes])
    )
    held_out, judged = _held_out(found, options)
    return Identified(
        found,
        dataclasses.replace(whole, positions=whole.positions[:, axes]),
        tuple(fit.adapts_to[k] for k in axes),
        held_out,
        judged,
        late * float(np.median(np.diff(whole.time))),
    )


def _refuse_still(
    options: Mapping[str, Any], readings: CrosstalkReadings, adaptation: tuple[str, ...]
) -> None:
    """Raise where an axis that the tests are to adapt to never moved."""
    mode = options["mode"]
    if not isinstance(mode, int) or options["positions"] is not None:
        return
    names = adaptation[: mode - 1]
    for name, column in zip(names, readings.positions.T, strict=False):
        known = column[np.isfinite(column)]
        if known.size and not np.ptp(known) > 0:
            msg = (
                f"{name} stands at {known[0]:g} in all readings: mode {mode} needs"
                f" accelerations at two places of {name} or more."
            )
            raise FitError(msg)


def _held_out(
    found: CrosstalkFit, options: Mapping[str, Any]
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Return what lists fitted to the other events leave of each, and which had one.

    Nothing is chosen anew but where the tests stand.
    """
    events, branch = found.events, found.events.branch
    left, judged = events.value.copy(), np.zeros(len(events), dtype=bool)
    fold = np.zeros(len(events), dtype=np.int64)
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
        if model is None:
            continue
        added = full_offsets(model, model, events.positions[out])
        left[out] += added[branch[out], np.arange(int(out.sum()))]
        judged[out] = True
    return left, judged


def instrument_delay(readings: CrosstalkReadings, fit: CrosstalkFit) -> int:
    """Return by how many rows the error is late, 0 where that does not show.

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
        return 0
    best = int(np.argmin(cost))
    # Mean fall of the logarithm of the standard deviation.
    gain = (cost[reach] - cost[best]) / rows_in_all
    return int(lags[best]) if gain > _GAIN else 0


def without_delay(readings: CrosstalkReadings, rows: int) -> CrosstalkReadings:
    """Return a log with the error moved back in time by this many rows."""
    error = np.full(len(readings.error), np.nan)
    if rows > 0:
        error[:-rows] = readings.error[rows:]
    else:
        error[-rows:] = readings.error[:rows]
    return dataclasses.replace(readings, error=error)
