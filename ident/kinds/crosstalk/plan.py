"""A planned crosstalk: fitted alone, or in a group."""

import dataclasses
import functools
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Float

from .... import models
from ..._recording import JointData
from ...exchange import ExchangeError
from ...fit import FitError
from ...fit.joint import Crosstalk
from ...job._draft import AbstractPlan, Leftovers
from ...job.joint._recording import read_group
from ...job.result._result import Remark
from ...job.table._plan import was_active
from ...readings import Tables
from . import SAFE_TESTS
from ._draft import CrosstalkDraft
from ._events import (
    added_by,
    cut_events,
    follows_speed,
    specified,
    without_delay,
    without_jump,
)
from .effect import CrosstalkFit, are_among, fit_crosstalk
from .entries import ENTRIES, crosstalk_from_list
from .keys import Spec

if TYPE_CHECKING:
    from ...fit.joint import JointFit, Part
    from ...job.joint._recording import GroupRecording
    from ...job.joint._share import Share


def plan(tables: Tables, index: int, fit: Spec) -> "CrosstalkPlan":
    """Plan a crosstalk fit.

    Raises:
        JobError: If crosstalk was active while measuring, and cannot be added to.
    """
    job, listing = tables.job, tables.job.lists[fit.axis].compensation
    old, masters, unread, holder = None, tuple[int, ...](), "", None
    if listing is not None and ENTRIES.is_in(listing):
        holder = job.spec.axes[fit.axis].listing
        try:
            masters = ENTRIES.named_masters(listing)
            old = crosstalk_from_list(listing, job.conventions)
        except ExchangeError as error:
            unread = str(error)
    active = was_active(job, index, fit, holder)
    planned = CrosstalkPlan(job, index, fit, old, masters, unread, active)
    if active:
        planned.refuse_unlike()
    return planned


@final
@dataclasses.dataclass(frozen=True)
class CrosstalkPlan(AbstractPlan):
    """A crosstalk.

    Attributes:
        old: Crosstalk of the list that is there as the controller runs it; None: there is
            none, or none that can be read.
        masters: Logical numbers there: the axis that accelerates, then adaptation axes.
        unread: Why it cannot be read, or nothing.
        active: Whether it was active while measuring.
    """

    fit: Spec
    old: models.Crosstalk | models.LegacyCrosstalk | None
    masters: tuple[int, ...]
    unread: str
    active: bool

    @property
    def acting(self) -> models.Crosstalk | None:
        """What acted while measuring."""
        old = self.old if self.active else None
        return old if isinstance(old, models.Crosstalk) else None

    def refuse_unlike(self) -> None:
        """Raise where what acted while measuring cannot be added to.

        Raises:
            JobError: Naming what differs.
        """
        fit, job, old, where = self.fit, self.job, self.old, ("fits", self.index)
        if old is None:
            raise job.error(
                ("axes", fit.axis, "list"),
                "crosstalk was active while measuring, but no list with its tests is"
                f" given{f' ({self.unread})' if self.unread else ''}, expected list = the"
                " file that was loaded",
            )
        if not isinstance(old, models.Crosstalk):
            raise job.error(
                where,
                "crosstalk was active by a list of the older form, to which no tests can"
                " be added, expected a measurement with COMP OFF CROSSTALK",
            )
        names = (fit.master, *fit.adapts_to)
        numbers = [job.spec.axes[name].number for name in names]
        if numbers != [*self.masters]:
            raise job.error(
                where,
                f"found master and adaptation axes {numbers}, expected {[*self.masters]} as"
                " in the list that was active",
            )
        for key in ("acceleration", "deceleration"):
            value, active = getattr(fit, key), float(getattr(old, key))
            if value is not None and value != active:
                words = f"found {value:g}, expected {active:g} as in the list that was"
                raise job.error((*where, key), f"{words} active")

    @functools.cached_property
    def rates(self) -> tuple[float | None, float | None]:
        """Specified acceleration and deceleration in mm/s²; None = as measured."""
        source = self.acting or self.fit
        rates = source.acceleration, source.deceleration
        up, down = (None if rate is None else float(rate) for rate in rates)
        return up, down

    @functools.cached_property
    def options(self) -> dict[str, Any]:
        """What the job leaves open of the tests, as options of `fit_crosstalk`.

        The tests stand where the job says, or at those of the active list.

        Raises:
            FitError: If keys contradict each other, or tests of the active list are lacking.
        """
        fit = self.fit
        points = None if fit.positions is None else np.array(fit.positions, dtype=float)
        if self.acting is not None:
            active = np.asarray(self.acting.surface.points, dtype=float)
            points = active if points is None else points
            alike = points.shape[1] == active.shape[1]
            if not (alike and are_among(active, points).all()):
                msg = (
                    "positions: found others than the tests of the list that was active while"
                    " measuring, expected those and, if you like, more."
                )
                raise FitError(msg)
        mode: int | str = fit.mode if points is None else 1 + points.shape[1]
        if fit.mode not in ("auto", mode):
            msg = (
                f"mode: found {fit.mode}, expected {mode} as the tests that are given."
            )
            raise FitError(msg)
        directed = fit.velocity_dependent
        return {
            "velocity_dependent": "auto" if directed is None else directed,
            "most_tests": fit.max_points or SAFE_TESTS,
            "loss": fit.loss,
            "mode": mode,
            "positions": points,
        }

    def _found(self, log: JointData, form: Crosstalk | None = None) -> CrosstalkFit:
        """Return the fit to a log of master and slave.

        A form that is not known is chosen, over all axes that it may adapt to.
        """
        fit, options, names = self.fit, self.options, self.fit.adapts_to
        if form is None:
            rates = specified(log.acceleration[fit.master], *self.rates)
            rules = self.job.conventions
            form = Crosstalk(fit.axis, fit.master, *rates, conventions=rules)
        else:
            names = form.adaptation
            directed = {"velocity_dependent": form.velocity_dependent}
            options = {**options, "positions": form.points, **directed}
        found = fit_crosstalk(cut_events(log, form, names), form, names, **options)
        return dataclasses.replace(found, active=self.acting)

    def fit_single(self, tables: Tables, left: Leftovers) -> CrosstalkDraft:
        recording = read_group(tables, [self])
        log = self._log(recording, recording.data.error[self.axis])
        fitted = self._found(log)
        recorded = log
        log, delay = without_delay(log, fitted.effect)
        log, jump = self._straight(log, fitted.effect)
        if delay or jump:
            fitted = self._found(log)
        remarks = (*recording.remarks, *jump)
        form, acted = fitted.effect, np.zeros(len(log))
        if self.acting is not None:
            # What the filter of an active list leaves of an event is no speed.
            acted = added_by(self.acting, log, form)
        whole, aligned = (
            dataclasses.replace(each, error={self.axis: each.error[self.axis] - acted})
            for each in (recorded, log)
        )
        if follows_speed(whole, aligned, form):
            words = (
                f"The error of {self.axis} follows the speed of {self.fit.master} better than"
                f" its acceleration: that is no crosstalk. So does what {self.axis} lags"
                " behind its command, or an instrument that is late: record"
                f" '{self.axis}.encoder' beside '{self.axis}.actual'."
            )
            remarks = (*remarks, Remark.error(words))
        base = self.job, self.index, self.fit, self
        return CrosstalkDraft(*base, fitted, log, remarks, delay)

    def _straight(
        self, log: JointData, form: Crosstalk
    ) -> tuple[JointData, tuple[Remark, ...]]:
        """Return a log without what jumps where the master turns, and what is said of it."""
        log, jump = without_jump(log, form)
        words = (
            f"The error of {self.axis} jumps by {1e3 * jump:+.2g} µm where"
            f" {self.fit.master} turns to positive direction. No acceleration makes that,"
            " and no list holds it: it was taken off. Look at the guides of both axes."
        )
        return log, (Remark.warning(words),) if jump else ()

    def draft(self, share: "Share") -> CrosstalkDraft:
        part, form, rows = share.part, share.part.effect, share.rows
        assert isinstance(form, Crosstalk)  # of `effect`
        error = np.full(len(rows), np.nan)
        error[rows] = share.error
        log, jump = self._straight(self._log(share.recording, error), form)
        fitted = self._found(log, form)
        determined = form.table(part.determined.astype(float)) > 0.5
        values = np.where(determined, fitted.values, np.nan)
        spread = np.where(determined, fitted.standard_deviation, np.inf)
        fitted = dataclasses.replace(fitted, values=values, standard_deviation=spread)
        base, remarks = (self.job, self.index, self.fit, self), share.remarks()
        return CrosstalkDraft(*base, fitted, log, (*remarks, *jump))

    @property
    def inputs(self) -> dict[str, tuple[str, ...]]:
        by_slave = self.job.conventions.crosstalk_velocity == "slave"
        driven = (self.fit.master, self.axis if by_slave else self.fit.master)
        return {"position": self.fit.adapts_to, "acceleration": driven}

    def unfit(self, recording: "GroupRecording") -> str:
        rate = recording.data.acceleration[self.fit.master]
        finite = np.isfinite(recording.data.error[self.axis]) & np.isfinite(rate)
        try:
            specified(rate[finite], None, None)
        except FitError as error:
            return str(error)
        return ""

    def may_be_written(self, part: "Part", fit: "JointFit") -> bool:
        # Written test by test: those that are told.
        return bool(part.effect.table(part.determined.astype(float)).all(axis=0).any())

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> "Crosstalk | None":
        options, names = self.options, self.fit.adapts_to
        (up, down), points = self.rates, options["positions"]
        directed, mode = options["velocity_dependent"], options["mode"]
        # A list is written with all four entries of a test (S-35).
        rules = dataclasses.replace(self.job.conventions, crosstalk_undirected="own")
        is_fixed = directed != "auto" and (mode == 1 or points is not None)
        if is_fixed and up is not None and down is not None:
            return Crosstalk(
                self.axis, self.fit.master, up, down, names[: mode - 1], points,
                bool(directed), rules,
            )  # fmt: skip
        if left is None:
            return None
        # The form is that of a fit to what the other effects leave.
        form = self._found(self._log(recording, left)).effect
        return dataclasses.replace(form, conventions=rules)

    def _log(
        self, recording: "GroupRecording", error: Float[np.ndarray, " t"]
    ) -> JointData:
        """Return the recording as logs of one axis, one per measurement.

        The error is that of the axis, or what other effects leave of it, in mm.
        """
        counts = [rows.stop - rows.start for rows in recording.slices.values()]
        return dataclasses.replace(
            recording.data,
            error={self.axis: np.asarray(error, dtype=float)},
            clock_number=np.repeat(np.arange(len(counts)), counts),
        )
