"""A planned crosstalk: fitted alone, or in a group."""

import dataclasses
import functools
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Float

from ...fit import FitError
from ...job._draft import AbstractPlan, Leftovers
from ...job.result._result import Remark
from ...readings import Tables
from . import SAFE_TESTS
from ._draft import CrosstalkDraft, Existing, existing_crosstalk
from ._events import cut_events, joined_logs
from ._log import held_out_events, read_crosstalk, without_delay
from .effect import BRANCHES, CrosstalkFit, CrosstalkReadings, are_among, fit_crosstalk
from .keys import Spec

if TYPE_CHECKING:
    from ...fit.joint import Crosstalk, JointFit, Part
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
    def options(self) -> dict[str, Any]:
        """What the job leaves open of the tests, as options of `fit_crosstalk`.

        Raises:
            FitError: If keys contradict each other.
        """
        fit, active, points = self.fit, self.old.active, self._tests
        rates = fit.acceleration, fit.deceleration
        if active is not None:
            rates = float(active.acceleration), float(active.deceleration)
        mode: int | str = fit.mode if points is None else 1 + points.shape[1]
        if fit.mode not in ("auto", mode):
            msg = (
                f"mode: found {fit.mode}, expected {mode} as the tests that are given."
            )
            raise FitError(msg)
        apart = fit.velocity_dependent
        return {
            "acceleration": rates[0],
            "deceleration": rates[1],
            "velocity_dependent": "auto" if apart is None else apart,
            "most_tests": min(fit.max_points or SAFE_TESTS, SAFE_TESTS),
            "conventions": self.job.conventions,
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

    def _refuse_still(self, log: CrosstalkReadings) -> None:
        """Raise where an axis that the tests are to adapt to never moved."""
        mode = self.options["mode"]
        if not isinstance(mode, int) or self.options["positions"] is not None:
            return
        names = self.fit.adapts_to[: mode - 1]
        for name, column in zip(names, log.positions.T, strict=False):
            known = column[np.isfinite(column)]
            if known.size and not np.ptp(known) > 0:
                msg = (
                    f"{name} stands at {known[0]:g} in all readings: mode {mode} needs"
                    f" accelerations at two places of {name} or more."
                )
                raise FitError(msg)

    def alone(self, tables: Tables, left: Leftovers) -> CrosstalkDraft:
        job, fit = self.job, self.fit
        log, words = read_crosstalk(tables, fit)
        options = self.options
        self._refuse_still(log)
        found = fit_crosstalk(log, **options)
        log, delay = without_delay(log, found)
        if delay:
            found = fit_crosstalk(log, **options)
        # What a list adds beside an event is that of the direction of the event.
        log = log.directed(found.acceleration, found.deceleration)
        axes, events = list(found.axes), found.events
        events = dataclasses.replace(events, positions=events.positions[:, axes])
        found = dataclasses.replace(found, events=events)
        return CrosstalkDraft(
            job,
            self.index,
            fit,
            tuple(map(Remark.info, words)),
            found,
            dataclasses.replace(log, positions=log.positions[:, axes]),
            tuple(fit.adapts_to[k] for k in axes),
            held_out_events(found, options),
            self.old,
            delay=delay,
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
        missing = [
            words
            for words, there in (
                ("speeds up", (rate[known] > 0).any()),
                ("slows down", (rate[known] < 0).any()),
            )
            if not there
        ]
        if not missing:
            return ""
        return (
            f"{self.fit.master} never {' and never '.join(missing)} in these readings,"
            " expected accelerations of both signs."
        )

    def may_be_written(self, part: "Part", fit: "JointFit") -> bool:
        # Written test by test: those that are told.
        return bool(part.effect.table(part.determined.astype(float)).all(axis=0).any())

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> "Crosstalk | None":
        from ...fit.joint import Crosstalk  # takes long to load

        options, names = self.options, self.fit.adapts_to
        points, mode = options["positions"], options["mode"]
        rates = options["acceleration"], options["deceleration"]
        way = options["velocity_dependent"]
        plain = mode == 1 or points is not None
        if plain and None not in rates and way != "auto":
            names = names[: mode - 1]
        elif left is None:
            return None
        else:
            # The form is that of a fit to what the other effects leave.
            found = fit_crosstalk(self._log(recording, left, names), **options)
            names = tuple(names[k] for k in found.axes)
            points = found.points if names else None
            rates = found.acceleration, found.deceleration
            way = found.velocity_dependent
        # A list is written with all four entries of a test (S-35).
        rules = dataclasses.replace(self.job.conventions, crosstalk_undirected="own")
        return Crosstalk(
            self.axis, self.fit.master, rates[0], rates[1],
            adaptation=names, positions=points,
            velocity_dependent=bool(way), conventions=rules,
        )  # fmt: skip

    def _log(
        self,
        recording: "GroupRecording",
        error: Float[np.ndarray, " t"],
        adaptation: tuple[str, ...],
    ) -> CrosstalkReadings:
        """Return the recording as logs of one axis, one measurement after the other."""
        data, master = recording.data, self.fit.master
        if data.time is None:
            msg = "expected the time of every reading, found none."
            raise FitError(msg)
        places = [data.position[name] for name in adaptation]
        whole = CrosstalkReadings(
            time=data.time,
            acceleration=data.acceleration[master],
            velocity=data.velocity[self.mover],
            error=np.asarray(error, dtype=float),
            positions=np.column_stack([np.zeros((len(data), 0)), *places]),
        )
        return joined_logs([whole.take(rows) for rows in recording.slices.values()])

    def draft(self, share: "Share") -> CrosstalkDraft:
        part, effect = share.part, share.part.effect
        from ...fit.joint import Crosstalk

        assert isinstance(effect, Crosstalk)  # of `effect`
        names, rates = effect.adaptation, (effect.acceleration, effect.deceleration)
        rules, error = self.job.conventions, np.full((2, len(share.rows)), np.nan)
        error[:, share.rows] = share.error, share.predicted[share.rows]
        logs = [
            self._log(share.recording, own, names).directed(*rates) for own in error
        ]
        events, left = (cut_events(log, *rates, conventions=rules) for log in logs)
        told = effect.table(part.determined.astype(float)) > 0.5
        scatter = [
            events.standard_deviation[events.branch == row]
            for row in range(len(BRANCHES))
        ]
        fit = CrosstalkFit(
            axes=tuple(range(len(names))),
            points=effect.points,
            values=np.where(told, part.table, np.nan),
            standard_deviation=np.where(told, part.deviation_table, np.inf),
            support=effect.table(part.support.astype(float)).astype(np.int64),
            acceleration=float(effect.acceleration),
            deceleration=float(effect.deceleration),
            velocity_dependent=effect.velocity_dependent,
            directions="given",
            noise=np.array([np.median(own) if own.size else np.nan for own in scatter]),
            events=events,
            scores=(),
            converged=share.fit.converged,
            conventions=rules,
        )
        return CrosstalkDraft(
            self.job,
            self.index,
            self.fit,
            tuple(share.remarks()),
            fit,
            logs[0],
            names,
            left.value,
            self.old,
        )
