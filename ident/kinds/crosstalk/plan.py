"""A planned crosstalk: fitted alone, or in a group."""

import dataclasses
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float

from ...fit import FitError
from ...job._draft import Leftovers
from ...job._fit_plan import AbstractPlan
from ...job.result._result import Remark
from ...readings import Tables
from ._draft import CrosstalkDraft, Existing, existing_crosstalk
from ._events import cut_events, events_under, joined_logs
from ._identify import Identified, identify, options_of, read_crosstalk
from .effect import BRANCHES, CrosstalkFit, CrosstalkReadings, fit_crosstalk
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
    job = tables.job
    old = existing_crosstalk(job, index, fit)
    return CrosstalkPlan(job, index, fit, old, fit.mover(job.conventions))


@final
@dataclasses.dataclass(frozen=True)
class CrosstalkPlan(AbstractPlan):
    """A crosstalk.

    Attributes:
        old: Crosstalk of the list that is there.
        mover: Axis whose direction of motion counts.
    """

    fit: Spec
    old: Existing
    mover: str

    def alone(self, tables: Tables, left: Leftovers) -> CrosstalkDraft:
        job, fit = self.job, self.fit
        readings, words = read_crosstalk(tables, fit)
        found = identify(readings, fit, self.old.active, job.conventions)
        remarks = tuple(map(Remark.info, words))
        return CrosstalkDraft(job, self.index, fit, remarks, found, self.old)

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

        options = options_of(self.fit, self.old.active, self.job.conventions)
        names, points, mode = self.fit.adapts_to, options["positions"], options["mode"]
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
        used = np.full(len(share.rows), np.nan)
        used[share.rows] = share.error
        log = self._log(share.recording, used, names).directed(*rates)
        events = cut_events(log, *rates, conventions=self.job.conventions)
        left = self._log(share.recording, share.predicted, names).error
        added = np.where(np.isfinite(log.error), np.nan_to_num(left - log.error), 0.0)
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
            conventions=self.job.conventions,
        )
        found = Identified(
            fit=fit,
            readings=log,
            masters=names,
            held_out=events_under(log, added, rates, self.job.conventions),
            judged=np.ones(len(events), dtype=bool),
            delay=0.0,
        )
        remarks = tuple(share.remarks())
        return CrosstalkDraft(self.job, self.index, self.fit, remarks, found, self.old)
