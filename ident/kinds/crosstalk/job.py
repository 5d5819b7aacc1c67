"""The crosstalk of one axis: fitted, judged, written into its list, read back."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Bool, Float

from ....data.lists import ListFile, Value
from ....models import Crosstalk, surface_through
from ...exchange import ExchangeError
from ...job._draft import AbstractDraft, AxisLists, Leftovers, Planned, Written
from ...job._gating import limits_of, spread_over
from ...job._load import Job
from ...job._result import Remark, staged
from ...proof import GateCheck, error_figures
from ...readings import Tables
from ._identify import Identified, identify
from ._list import (
    Existing,
    coverage_of,
    events_under,
    existing_crosstalk,
    four_offsets,
    full_offsets,
    judge_crosstalk,
    kept_tests,
    largest_jump,
    list_model,
)
from ._recording import read_crosstalk
from ._result import CrosstalkResult, remarks_of
from .entries import crosstalk_from_list, entries_of_crosstalk
from .keys import Spec

_OLD = ("table[", "last_index", "master_ax_nr")
"""Entries of the older form, which must not stand beside the present one."""
_SIZED = ("position[", "max_points", "master_pos")
"""Entries of which a smaller list has fewer."""


def plan(job: Job, tables: Tables, index: int, fit: Spec, lists: AxisLists) -> Planned:
    """Plan a crosstalk fit; what it returns fits it.

    Raises:
        JobError: If existing lists do not suit.
        FitError: Of what it returns: if the readings do not determine it.
    """
    old = existing_crosstalk(job, index, fit, lists)

    def draft(left: Leftovers) -> AbstractDraft:
        recording = read_crosstalk(tables, fit)
        found = identify(recording, fit, old.active, job.conventions)
        return CrosstalkDraft(index, fit, lists, recording.remarks, found, old)

    return draft


@final
@dataclasses.dataclass(frozen=True)
class CrosstalkDraft(AbstractDraft):
    """A fitted crosstalk.

    Attributes:
        remarks: What was taken for granted while reading.
        found: The estimate and its proof.
        old: Crosstalk of the list that is there.
    """

    fit: Spec
    remarks: tuple[Remark, ...]
    found: Identified
    old: Existing

    @property
    def kept(self) -> Bool[np.ndarray, " p"]:
        """Tests that are written: all four values measured, or known from before."""
        return kept_tests(self.found.fit, self.old.active)

    @property
    def written(self) -> bool:
        """Whether there is anything to write."""
        fit = self.found.fit
        if not (self.found.significant and fit.complete.any()):
            return False
        try:
            surface_through(fit.points[self.kept])
        except ValueError:
            return False
        return True

    def model(self, job: Job) -> Crosstalk:
        """Return the list as the controller runs it."""
        model = list_model(self.found.fit, self.old.active, job.conventions)
        if self.fit.n_cycles is not None:
            return dataclasses.replace(model, cycles=self.fit.n_cycles)
        jump = largest_jump(full_offsets(model), model.by_speed)
        listing, entry = self.lists.compensation, f"{self.kind.prefix}.n_cycles"
        cycles = spread_over(job, jump, listing, entry)
        return dataclasses.replace(model, cycles=cycles)

    @property
    def needs(self) -> str:
        if not self.found.masters:
            return "Works from start-up on"
        return f"Works once {' and '.join(self.found.masters)} are referenced"

    @property
    def replaces(self) -> tuple[str, ...]:
        return tuple(f"{self.kind.prefix}.{name}" for name in (*_OLD, *_SIZED))

    def entries(self, job: Job) -> dict[str, Value]:
        axes = job.spec.axes
        masters = (self.fit.master, *self.found.masters)
        try:
            entries: dict[str, Value] = dict(
                entries_of_crosstalk(
                    self.model(job), tuple(axes[name].number for name in masters)
                )
            )
        except ExchangeError as error:
            raise job.error(("fits", self.index), str(error)) from None
        if self.fit.manual_activation is not None:
            entries[f"{self.kind.prefix}.manual_activation"] = int(
                self.fit.manual_activation
            )
        return entries

    def gate(self, job: Job, cycles: int | None) -> tuple[GateCheck, ...]:
        return judge_crosstalk(
            self.model(job),
            self.found.masters,
            job.spec.controller.cycle_time,
            limits_of(job),
            self._change(job),
        )

    def _change(self, job: Job) -> Float[np.ndarray, "4 p"] | None:
        """Return what the new list adds beyond the old one, where both can be compared."""
        axes, old, fit = job.spec.axes, self.old, self.found.fit
        names = (self.fit.master, *self.found.masters)
        same = old.masters == tuple(axes[name].number for name in names)
        if old.model is None or not same:
            return None
        model = self.model(job)
        points = np.asarray(model.surface.points)
        rates = fit.acceleration, fit.deceleration
        before = four_offsets(old.model, rates, model.by_speed, points)
        return np.asarray(full_offsets(model) - before)

    def refuse_misread(self, job: Job, listing: ListFile) -> None:
        parsed = ListFile.parse(listing.dumps(), listing.source)
        for name, value in self.entries(job).items():
            if parsed.integer(name) != value:
                raise job.error(
                    ("fits", self.index),
                    f"found {parsed.integer(name)} for {name} in {listing.source} when"
                    f" it was read back, expected {value}",
                )

    def prove(self, done: Written) -> CrosstalkResult:
        job = done.job
        found, fit = self.found, self.found.fit
        added = self.added_to_log(done)
        left = events_under(
            found.readings, added, fit.acceleration, fit.deceleration, fit.conventions
        )
        before, wild = fit.of_events("value"), fit.of_events("wild").astype(bool)
        workspace = self._workspace(job)
        shown = self.kept if self.written else np.zeros(len(fit.points), dtype=bool)
        coverage = 0.0
        entries = np.zeros((4, 0))
        model = self.model(job) if self.written else None
        if model is not None:
            entries = np.asarray(model.values)
            coverage = coverage_of(model, workspace)
        error, judged = staged(before, before, left, wild), found.judged
        if judged.any():
            predicted = error_figures(found.held_out[judged], wild=wild[judged])
            error["predicted"] = predicted
        return CrosstalkResult(
            **self.frame(done),
            error=error,
            remarks=(
                *self.remarks,
                *remarks_of(
                    self.fit,
                    found,
                    self.written,
                    model,
                    coverage,
                    job.spec.controller.cycle_time,
                    job.verified,
                ),
                *self._about_the_old(),
                *done.files.remarks,
            ),
            files=done.names if self.written else (),
            held_out="event",
            master=self.fit.master,
            adaptation=found.masters,
            points=fit.points[shown],
            entries=entries,
            standard_deviation=fit.standard_deviation[:, shown],
            support=fit.support[:, shown],
            cycles=0 if model is None else model.cycles,
            coverage=coverage,
            workspace=workspace,
            fit=fit,
            predicted=found.held_out,
            from_file=left,
            readings=found.readings,
            added=added,
        )

    def added_to_log(self, done: Written) -> Float[np.ndarray, " t"]:
        """Return what the written file adds in each row beyond what acted already."""
        readings, job, listing = self.found.readings, done.job, done.compensation
        motion = readings.acceleration, readings.velocity, readings.positions
        if not self.written or listing is None:
            return np.zeros(len(readings.time))
        model = crosstalk_from_list(listing, job.conventions)
        added = np.asarray(model.offset(*motion))
        if self.old.active is not None:
            added = added - np.asarray(self.old.active.offset(*motion))
        return added

    def _workspace(self, job: Job) -> Float[np.ndarray, "k 2"]:
        """Return where the adaptation axes go: software limits, else as measured."""
        places = self.found.readings.positions
        spans = [
            job.spec.axes[name].limits or [float(column.min()), float(column.max())]
            for name, column in zip(self.found.masters, places.T, strict=True)
        ]
        return np.array(spans, dtype=float).reshape(-1, 2)

    def _about_the_old(self) -> list[Remark]:
        if self.old.unread:
            why = self.old.unread
            words = f"The new crosstalk replaces one that cannot be read: {why}"
            return [Remark.warning(words)]
        if self.old.model is None:
            return []
        words = "off while measuring: the new one replaces it."
        if self.old.active is not None:
            words = "active while measuring: the new one is old + residual."
        return [Remark.info(f"The old crosstalk was {words}")]
