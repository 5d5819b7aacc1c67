"""A planned crosstalk: fitted alone, or in a group."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Float

from ...fit import FitError
from ...fit.joint import Crosstalk
from ...job._draft import AbstractPlan, Leftovers
from ...job.joint._recording import read_group
from ...job.result._result import Remark
from ...readings import Tables
from . import SAFE_TESTS
from ._draft import CrosstalkDraft, Existing, existing_crosstalk
from ._events import CrosstalkReadings, cut_events, specified, without_delay
from .effect import CrosstalkFit, are_among, fit_crosstalk
from .keys import Spec

if TYPE_CHECKING:
    from ...fit.joint import JointFit, Part
    from ...job.joint._recording import GroupRecording
    from ...job.joint._share import Share


def plan(tables: Tables, index: int, fit: Spec) -> "CrosstalkPlan":
    """Plan a crosstalk fit.

    Raises:
        JobError: If existing lists do not suit.
    """
    old = existing_crosstalk(tables.job, index, fit)
    return CrosstalkPlan(tables.job, index, fit, old)


@final
@dataclasses.dataclass(frozen=True)
class CrosstalkPlan(AbstractPlan):
    """A crosstalk.

    Attributes:
        old: Crosstalk of the list that is there.
    """

    fit: Spec
    old: Existing

    @property
    def mover(self) -> str:
        """Axis whose direction of motion counts."""
        return self.fit.mover(self.job.conventions)

    @functools.cached_property
    def rates(self) -> tuple[float | None, float | None]:
        """Specified acceleration and deceleration in mm/s²; None = as measured."""
        active = self.old.active
        if active is None:
            return self.fit.acceleration, self.fit.deceleration
        return float(active.acceleration), float(active.deceleration)

    @functools.cached_property
    def options(self) -> dict[str, Any]:
        """What the job leaves open of the tests, as options of `fit_crosstalk`.

        Raises:
            FitError: If keys contradict each other.
        """
        fit, points = self.fit, self._tests
        mode: int | str = fit.mode if points is None else 1 + points.shape[1]
        if fit.mode not in ("auto", mode):
            msg = (
                f"mode: found {fit.mode}, expected {mode} as the tests that are given."
            )
            raise FitError(msg)
        apart = fit.velocity_dependent
        return {
            "velocity_dependent": "auto" if apart is None else apart,
            "most_tests": min(fit.max_points or SAFE_TESTS, SAFE_TESTS),
            "loss": fit.loss,
            "mode": mode,
            "positions": points,
        }

    @property
    def _tests(self) -> Float[np.ndarray, "p k"] | None:
        """Where the tests are to stand: at those of the active list, or at more than these.

        Raises:
            FitError: If the wished ones lack one of these.
        """
        wished = self.fit.positions
        points = None if wished is None else np.array(wished, dtype=float)
        if self.old.active is None:
            return points
        own = np.asarray(self.old.active.surface.points, dtype=float)
        if points is None:
            return own
        if points.shape[1] == own.shape[1] and are_among(own, points).all():
            return points
        msg = (
            "positions: found others than the tests of the list that was active while"
            " measuring, expected those and, if you like, more."
        )
        raise FitError(msg)

    def _found(
        self, log: CrosstalkReadings, form: Crosstalk | None = None
    ) -> CrosstalkFit:
        """Return the fit to a log of all axes that the tests may adapt to.

        Args:
            log: Of master and slave.
            form: Where it is known: then the log has its adaptation axes only.
        """
        fit, rules, options = self.fit, self.job.conventions, self.options
        names = fit.adapts_to
        if form is None:
            rates = specified(log, *self.rates)
            form = Crosstalk(fit.axis, fit.master, *rates, conventions=rules)
        else:
            names = form.adaptation
            apart = {"velocity_dependent": form.velocity_dependent}
            options = {**options, "positions": form.points, **apart}
        return fit_crosstalk(cut_events(log, form), form, names, **options)

    def alone(self, tables: Tables, left: Leftovers) -> CrosstalkDraft:
        recording = read_group(tables, [self])
        log = self._log(recording, recording.data.error[self.axis])
        found = self._found(log)
        log, delay = without_delay(log, found.effect)
        if delay:
            found = self._found(log)
        return self._draft(recording, log.error, found, recording.remarks, delay)

    def draft(self, share: "Share") -> CrosstalkDraft:
        part, form, rows = share.part, share.part.effect, share.rows
        assert isinstance(form, Crosstalk)  # of `effect`
        error = np.full(len(rows), np.nan)
        error[rows] = share.error
        log = self._log(share.recording, error, form.adaptation)
        found = self._found(log, form)
        told = form.table(part.determined.astype(float)) > 0.5
        values = np.where(told, found.values, np.nan)
        deviation = np.where(told, found.standard_deviation, np.inf)
        found = dataclasses.replace(found, values=values, standard_deviation=deviation)
        return self._draft(share.recording, error, found, share.remarks())

    def _draft(
        self,
        recording: "GroupRecording",
        error: Float[np.ndarray, " t"],
        found: CrosstalkFit,
        remarks: Sequence[Remark],
        delay: float = 0.0,
    ) -> CrosstalkDraft:
        log = self._log(recording, error, found.effect.adaptation)
        # What a list adds beside an event is that of the direction of the event.
        log = log.directed(found.effect)
        return CrosstalkDraft(
            self.job, self.index, self.fit, tuple(remarks), found, log, self.old, delay
        )

    @property
    def positions(self) -> tuple[str, ...]:
        return self.fit.adapts_to

    @property
    def accelerating(self) -> tuple[str, ...]:
        return (self.fit.master, self.mover)

    def unfit(self, recording: "GroupRecording") -> str:
        rate = recording.data.acceleration[self.fit.master]
        known = np.isfinite(recording.data.error[self.axis]) & np.isfinite(rate)
        for sign, words in ((1.0, "speeds up"), (-1.0, "slows down")):
            if not (sign * rate[known] > 0).any():
                return (
                    f"{self.fit.master} never {words} in these readings, expected"
                    " accelerations of both signs."
                )
        return ""

    def may_be_written(self, part: "Part", fit: "JointFit") -> bool:
        # Written test by test: those that are told.
        return bool(part.effect.table(part.determined.astype(float)).all(axis=0).any())

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> "Crosstalk | None":
        options, names = self.options, self.fit.adapts_to
        (up, down), points = self.rates, options["positions"]
        apart, mode = options["velocity_dependent"], options["mode"]
        # A list is written with all four entries of a test (S-35).
        rules = dataclasses.replace(self.job.conventions, crosstalk_undirected="own")
        plain = apart != "auto" and (mode == 1 or points is not None)
        if plain and up is not None and down is not None:
            return Crosstalk(
                self.axis, self.fit.master, up, down, names[: mode - 1], points,
                bool(apart), rules,
            )  # fmt: skip
        if left is None:
            return None
        # The form is that of a fit to what the other effects leave.
        form = self._found(self._log(recording, left)).effect
        return dataclasses.replace(form, conventions=rules)

    def _log(
        self,
        recording: "GroupRecording",
        error: Float[np.ndarray, " t"],
        adaptation: tuple[str, ...] | None = None,
    ) -> CrosstalkReadings:
        """Return the recording as logs of one axis, one per measurement.

        Args:
            recording: What was measured.
            error: Of the axis, or what other effects leave of it, in mm.
            adaptation: Axes whose positions count; None: all that may.
        """
        data, master = recording.data, self.fit.master
        if data.time is None:
            msg = "expected the time of every reading, found none."
            raise FitError(msg)
        names = self.fit.adapts_to if adaptation is None else adaptation
        places = [data.position[name] for name in names]
        counts = [rows.stop - rows.start for rows in recording.slices.values()]
        return CrosstalkReadings(
            time=data.time,
            acceleration=data.acceleration[master],
            velocity=data.velocity[self.mover],
            error=np.asarray(error, dtype=float),
            positions=np.column_stack([np.zeros((len(data), 0)), *places]),
            log=np.repeat(np.arange(len(counts)), counts),
        )
