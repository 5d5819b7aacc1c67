"""The fit of a job: tests from events, and each event predicted by the others."""

import dataclasses
import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtri  # scipy.stats takes long to load

from ....models import Conventions, Crosstalk
from ...fit import FitError
from . import SAFE_TESTS
from ._events import shares_of
from ._list import four_offsets, rates_of, wished_points
from ._recording import CrosstalkRecording
from .effect import CrosstalkFit, CrosstalkReadings, fit_crosstalk, fit_events
from .keys import Spec

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
        points = wished_points(active, points)
        rates = rates_of(active)
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


def identify(
    recording: CrosstalkRecording,
    fit: Spec,
    active: Crosstalk | None,
    rules: Conventions,
) -> Identified:
    """Fit the tests of a list and hold events out.

    Args:
        recording: What was measured.
        fit: Keys of the job.
        active: The list that was active while measuring, or None.
        rules: Of the controller.

    Raises:
        FitError: If there are no events or the keys cannot be met.
    """
    options = options_of(fit, active, rules)
    whole = recording.readings
    _refuse_still(options, recording)
    found = fit_crosstalk(whole, **options)
    late = instrument_delay(whole, found)
    if late:
        whole = without_delay(whole, late)
        found = fit_crosstalk(whole, **options)
    # What a list adds beside an event is that of the direction of the event.
    whole = whole.directed(found.acceleration, found.deceleration)
    readings = dataclasses.replace(whole, positions=whole.positions[:, found.axes])
    events = [
        dataclasses.replace(
            each, positions=tuple(each.positions[k] for k in found.axes)
        )
        for each in found.events
    ]
    found = dataclasses.replace(found, events=tuple(events))
    held_out, judged = _held_out(found, options)
    masters = tuple(recording.adaptation[k] for k in found.axes)
    delay = late * float(np.median(np.diff(whole.time)))
    return Identified(found, readings, masters, held_out, judged, delay)


def _refuse_still(options: Mapping[str, Any], recording: CrosstalkRecording) -> None:
    """Raise where an axis that the tests are to adapt to never moved."""
    mode = options["mode"]
    if not isinstance(mode, int) or options["positions"] is not None:
        return
    names = recording.adaptation[: mode - 1]
    for name, column in zip(names, recording.readings.positions.T, strict=False):
        known = column[np.isfinite(column)]
        if known.size and not np.ptp(known) > 0:
            msg = (
                f"{name} stands at {known[0]:g} in all readings: mode {mode} needs"
                f" accelerations at two places of {name} or more."
            )
            raise FitError(msg)


def _folds(found: CrosstalkFit) -> Int[np.ndarray, " n"]:
    """Deal the events of each sign and direction out, so that none is left without."""
    branch = found.of_events("branch")
    fold = np.zeros(len(branch), dtype=np.int64)
    for each in np.unique(branch):
        rows = np.flatnonzero(branch == each)
        fold[rows] = np.arange(len(rows)) % _FOLDS
    return fold


def _held_out(
    found: CrosstalkFit, options: Mapping[str, Any]
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Return what lists fitted to the other events leave of each, and which had one.

    Nothing is chosen anew but where the tests stand.
    """
    left, places = found.of_events("value"), found.of_events("positions")
    branch = found.of_events("branch")
    judged, fold = np.zeros(len(left), dtype=bool), _folds(found)
    rates = found.acceleration, found.deceleration
    for each in np.unique(fold):
        out = fold == each
        kept = itertools.compress(found.events, ~out)
        try:
            others = fit_events(
                tuple(kept), rates, found.conventions,
                mode=found.mode, positions=options["positions"], loss=options["loss"],
                velocity_dependent=found.velocity_dependent,
                most_tests=options["most_tests"],
            )  # fmt: skip
        except FitError:
            continue
        model = others.compensation()
        if model is None:
            continue
        added = four_offsets(model, rates, model.by_speed, places[out])
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
    events = [event for event in fit.events if not event.wild]
    picks = np.linspace(0, len(events) - 1, min(len(events), _MOST_EVENTS))
    chosen = [events[int(k)] for k in np.unique(picks.astype(int))]
    rates = fit.acceleration, fit.deceleration
    share, branch = shares_of(readings, *rates, fit.conventions)
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
        clock = readings.time[rows] - readings.time[rows].mean()
        columns = [np.where(branch[rows] == k, share[rows], 0.0) for k in range(4)]
        columns = [column for column in columns if column.any()]
        design = np.column_stack([*columns, np.ones(len(rows)), clock])
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


def without_delay(readings: CrosstalkReadings, rows: int) -> CrosstalkReadings:
    """Return a log with the error moved back in time by this many rows."""
    error = np.full(len(readings.error), np.nan)
    if rows > 0:
        error[:-rows] = readings.error[rows:]
    else:
        error[-rows:] = readings.error[:rows]
    return dataclasses.replace(readings, error=error)
