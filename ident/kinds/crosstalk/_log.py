"""What the log of a crosstalk tells beside the tests: events by the others, and a delay."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ...fit import FitError
from . import BRANCHES
from ._events import CrosstalkReadings, shares_of, window_of
from .effect import CrosstalkFit, fit_crosstalk, full_offsets

_FOLDS = 5
_FARTHEST = 0.02
"""s: a delay beyond this is another event."""
_MOST_ROWS = 25
_MOST_EVENTS = 60
_GAIN = 0.05
"""Relative fall of the residual's standard deviation below which there is no delay."""


def held_out_events(
    found: CrosstalkFit, options: Mapping[str, Any]
) -> Float[np.ndarray, " n"]:
    """Return what lists fitted to the other events leave of each; NaN where there is none.

    Nothing is chosen anew but where the tests stand.

    Args:
        found: What all events tell.
        options: Of `fit_crosstalk`.
    """
    events, branch, form = found.events, found.events.branch, found.effect
    same = {"mode": form.mode, "velocity_dependent": form.velocity_dependent}
    left, fold = np.full(len(events), np.nan), np.zeros(len(events), dtype=np.int64)
    for row in range(len(BRANCHES)):
        # Dealt out by sign and direction, so that none is left without.
        own = np.flatnonzero(branch == row)
        fold[own] = np.arange(len(own)) % _FOLDS
    for each in np.unique(fold):
        out = fold == each
        try:
            model = fit_crosstalk(
                events.take(~out), form, form.adaptation, **{**options, **same}
            ).compensation()
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
    share, label = shares_of(readings, fit.effect)
    step = float(np.median(np.diff(readings.time)))
    reach = min(math.ceil(_FARTHEST / step), _MOST_ROWS)
    lags = np.arange(-reach, reach + 1)
    # The log with as many missing rows before and after it as the error is moved by.
    padded = np.pad(readings.error, reach, constant_values=np.nan)
    cost = np.zeros(len(lags))
    rows_in_all = 0
    for start, stop in zip(chosen.start, chosen.stop, strict=True):
        rows, events, line = window_of(readings, label, share, start, stop)
        shifted = padded[rows[:, None] + reach + lags]
        known = np.isfinite(shifted).all(axis=1)
        shifted = shifted[known]
        design = np.hstack([events * share[rows, None], line])[known]
        if len(shifted) <= 2 * design.shape[1]:
            continue
        base, _ = np.linalg.qr(design)
        left = shifted - base @ (base.T @ shifted)
        spread = np.maximum((left**2).mean(axis=0), 1e-24)
        cost += 0.5 * len(shifted) * np.log(spread)
        rows_in_all += len(shifted)
    if not rows_in_all:
        return readings, 0.0
    best = int(np.argmin(cost))
    # Mean fall of the logarithm of the standard deviation.
    gain, late = (cost[reach] - cost[best]) / rows_in_all, int(lags[best])
    if not late or gain <= _GAIN:
        return readings, 0.0
    error = padded[reach + late :][: len(readings.error)]
    return dataclasses.replace(readings, error=error), late * step
