"""The fit of a job: tests from events, and each event predicted by the others."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtri  # scipy.stats takes long to load

from ....models import Conventions
from ...fit import FitError
from ._delay import instrument_delay, without_delay
from ._existing import Existing
from ._gate import events_under
from ._recording import CrosstalkRecording
from .effect import (
    CrosstalkFit,
    CrosstalkReadings,
    fit_crosstalk,
)
from .keys import MOST_TESTS, Spec

_FOLDS = 5
_SURE = 0.0027
"""Probability of three standard deviations, shared by all values that are looked at."""


@dataclasses.dataclass(frozen=True)
class Identified:
    """A fit and how it predicts.

    Attributes:
        fit: The estimate.
        readings: What it saw: positions of its own adaptation axes only, no delay.
        masters: Names of these axes.
        fold: Which events were held out together.
        held_out: Value of each event in mm under the list fitted without its fold.
        judged: Events whose fold left enough to predict them.
        delay: By how much the error follows the acceleration, in s; taken off.
    """

    fit: CrosstalkFit
    readings: CrosstalkReadings
    masters: tuple[str, ...]
    fold: Int[np.ndarray, " n"]
    held_out: Float[np.ndarray, " n"]
    judged: Bool[np.ndarray, " n"]
    delay: float

    @property
    def values(self) -> Float[np.ndarray, " n"]:
        """Error of the slave at full acceleration that each event shows, in mm."""
        return np.array([event.value for event in self.fit.events])

    @property
    def wild(self) -> Bool[np.ndarray, " n"]:
        """Events that contradict the others."""
        return np.array([event.wild for event in self.fit.events], dtype=bool)

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


@dataclasses.dataclass(frozen=True)
class Choice:
    """What a job leaves open of the tests, as the estimator takes it.

    Attributes:
        mode: 1, 2, 3 or ``auto``.
        points: Where tests are given, in mm, or None.
        options: Everything else.
    """

    mode: int | str
    points: Float[np.ndarray, "p k"] | None
    options: dict[str, Any]

    def fit(self, readings: CrosstalkReadings) -> CrosstalkFit:
        """Return tests from the events of a log.

        Raises:
            FitError: If there are no events or the keys cannot be met.
        """
        return fit_crosstalk(
            readings, mode=self.mode, positions=self.points, **self.options
        )


def choice_of(fit: Spec, existing: Existing | None, rules: Conventions) -> Choice:
    """Return what is left open: the tests of an active list stay.

    Args:
        fit: Keys of the job.
        existing: The list that was active while measuring, or None.
        rules: Of the controller.

    Raises:
        FitError: If keys contradict each other.
    """
    points = None if fit.positions is None else np.array(fit.positions, dtype=float)
    rates = fit.acceleration, fit.deceleration
    if existing is not None:
        points = existing.points_with(points)
        rates = existing.rates
    options: dict[str, Any] = {
        "acceleration": rates[0],
        "deceleration": rates[1],
        "velocity_dependent": (
            "auto" if fit.velocity_dependent is None else fit.velocity_dependent
        ),
        "most_tests": min(fit.max_points or MOST_TESTS, MOST_TESTS),
        "conventions": rules,
        "loss": fit.loss,
    }
    mode: int | str = fit.mode if points is None else 1 + points.shape[1]
    if fit.mode not in ("auto", mode):
        msg = f"mode: found {fit.mode}, expected {mode} as the tests that are given."
        raise FitError(msg)
    return Choice(mode, points, options)


def identify(
    recording: CrosstalkRecording,
    fit: Spec,
    existing: Existing | None,
    rules: Conventions,
) -> Identified:
    """Fit the tests of a list and hold events out.

    Args:
        recording: What was measured.
        fit: Keys of the job.
        existing: The list that was active while measuring, or None.
        rules: Of the controller.

    Raises:
        FitError: If there are no events or the keys cannot be met.
    """
    chosen = choice_of(fit, existing, rules)
    points, options = chosen.points, chosen.options
    whole = recording.readings
    _refuse_still(chosen, recording)
    found = chosen.fit(whole)
    late = instrument_delay(whole, found)
    if late:
        whole = without_delay(whole, late)
        found = chosen.fit(whole)
    # What a list adds beside an event is that of the direction of the event.
    whole = whole.directed(found.acceleration, found.deceleration)
    readings = dataclasses.replace(whole, positions=whole.positions[:, found.axes])
    # From here on nothing is chosen anew but where the tests stand.
    options |= {
        "acceleration": found.acceleration,
        "deceleration": found.deceleration,
        "velocity_dependent": found.velocity_dependent,
        "mode": found.mode,
        "positions": points,
    }
    fold = _folds(found)
    held_out, judged = _held_out(readings, found, fold, options)
    masters = tuple(recording.adaptation[k] for k in found.axes)
    delay = late * float(np.median(np.diff(whole.time)))
    return Identified(found, readings, masters, fold, held_out, judged, delay)


def _refuse_still(chosen: Choice, recording: CrosstalkRecording) -> None:
    """Raise where an axis that the tests are to adapt to never moved."""
    if not isinstance(chosen.mode, int) or chosen.points is not None:
        return
    names = recording.adaptation[: chosen.mode - 1]
    for name, column in zip(names, recording.readings.positions.T, strict=False):
        known = column[np.isfinite(column)]
        if known.size and not np.ptp(known) > 0:
            msg = (
                f"{name} stands at {known[0]:g} in all readings: mode {chosen.mode} needs"
                f" accelerations at two places of {name} or more."
            )
            raise FitError(msg)


def _folds(found: CrosstalkFit) -> Int[np.ndarray, " n"]:
    """Deal the events of each sign and direction out, so that none is left without."""
    branch = np.array([event.branch for event in found.events])
    fold = np.zeros(len(branch), dtype=np.int64)
    for each in np.unique(branch):
        rows = np.flatnonzero(branch == each)
        fold[rows] = np.arange(len(rows)) % _FOLDS
    return fold


def _held_out(
    readings: CrosstalkReadings,
    found: CrosstalkFit,
    fold: Int[np.ndarray, " n"],
    options: dict[str, Any],
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Return what lists fitted to the other events leave of each, and which had one."""
    left = np.array([event.value for event in found.events])
    judged = np.zeros(len(left), dtype=bool)
    for each in np.unique(fold):
        out = np.flatnonzero(fold == each)
        error = readings.error.copy()
        for k in out:
            error[found.events[k].start : found.events[k].stop] = np.nan
        try:
            others = fit_crosstalk(
                dataclasses.replace(readings, error=error), **options
            )
        except FitError:
            continue
        model = others.compensation()
        if model is None:
            continue
        places = readings.positions[:, others.axes]
        added = np.asarray(
            model.offset(readings.acceleration, readings.velocity, places)
        )
        values = events_under(
            readings,
            added,
            found.acceleration,
            found.deceleration,
            found.conventions,
        )
        left[out] = values[out]
        judged[out] = True
    return left, judged
