"""A planned backlash, fitted alone or in a group: judged, written into the axis list, read back."""

import dataclasses
from typing import TYPE_CHECKING, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .... import models
from ....data.lists import Value
from ..._recording import JointData
from ...exchange import REVERSAL_CYCLES
from ...fit.joint import Backlash
from ...job._draft import AbstractDraft, AbstractPlan, Foreseen
from ...job._gating import spread_over
from ...job.result._result import staged
from ...job.result._second import LeftTrend, SecondMeasurement
from ...job.table._plan import was_active
from ...proof import GateCheck, reversal_checks
from ...proof.axis import check_switching
from ...readings import Tables
from .._keys import FitSpec
from ._result import (
    FLANK,
    BacklashResult,
    Sides,
    change_along,
    drift_remark,
    is_sure,
    remarks_of,
)
from .entries import backlash_from_list, entries_of_backlash
from .keys import Spec

if TYPE_CHECKING:
    from ...job.joint._recording import GroupRecording
    from ...job.joint._share import Share
    from ...job.write._lists import AxisFiles

_FLANK_ALONE = 0.25
"""Share of the width up to which the axis lies nowhere else than on one of its flanks."""
_TARGETS = 60
"""Different positions up to which each has an error of its own."""
_NODES = 24
"""Nodes of the error along the axis where the positions are all different."""


def plan(tables: Tables, index: int, fit: Spec) -> "BacklashPlan":
    """Plan a backlash fit.

    Raises:
        JobError: If the axis list cannot be read, or does not hold what was active.
    """
    job, old, holder = tables.job, None, None
    machine = job.lists[fit.axis].machine
    if machine is not None:
        with job.blaming(("fits", index)):
            old = backlash_from_list(machine, job.conventions)
        if old is not None and float(old.width) != 0.0:
            holder = machine.source
    active = was_active(job, index, fit, holder)
    if active and old is None:
        raise job.error(
            ("axes", fit.axis, "machine_data"),
            "backlash was active while measuring, but no axis list that switches it on"
            " is given, expected machine_data = the file that was loaded",
        )
    return BacklashPlan(job, index, fit, old, active)


@final
@dataclasses.dataclass(frozen=True)
class BacklashPlan(AbstractPlan):
    """A backlash.

    Attributes:
        old: Entries of the axis list, or None.
        active: Whether they acted while measuring.
    """

    fit: Spec
    old: models.Backlash | None
    active: bool

    @property
    def reference(self) -> int:
        """Direction in which the axis is right without it."""
        return 1 if self.old is None else self.old.reference

    @property
    def acting(self) -> float:
        """Width that acted while measuring, in mm or °."""
        return float(self.old.width) if self.active and self.old is not None else 0.0

    @property
    def inputs(self) -> dict[str, tuple[str, ...]]:
        return dict.fromkeys(("position", "direction"), (self.axis,))

    def nodes_beside(self, data: JointData) -> Float[np.ndarray, " n"]:
        # What both directions share is free along the axis.
        place = data.position[self.axis]
        place = place[np.isfinite(place) & np.isfinite(data.error[self.axis])]
        targets = np.unique(place)
        if len(targets) <= _TARGETS and 2 * len(targets) <= len(place):
            return targets
        count = int(np.clip(len(place) // 10, 2, _NODES))
        return np.linspace(targets[0], targets[-1], count)

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> Backlash:
        return Backlash(self.axis, reference=self.reference)

    def draft(self, share: "Share") -> "BacklashDraft":
        return BacklashDraft(self.job, self.index, self.fit, self, share)


def sides_of(share: "Share") -> Sides:
    """Return the readings of a fitted backlash about the mean of both directions."""
    axis, rows, data = share.axis, share.rows, share.recording.data
    position, direction = data.position[axis][rows], data.direction[axis][rows]
    width = float(share.part.values[0])
    half = share.fit.residual[axis][rows] - 0.5 * direction * width
    return Sides(position, direction.astype(np.int64), half, share.wild)


@final
@dataclasses.dataclass(frozen=True)
class BacklashDraft(AbstractDraft):
    """A fitted backlash.

    Attributes:
        plan: What the axis list holds.
        share: Its part of the joint fit.
    """

    plan: BacklashPlan
    share: "Share"

    @property
    def needs(self) -> str:
        return "Works from start-up on, referenced or not"

    @property
    def width(self) -> float:
        """What is written, in mm or °."""
        return float(self.share.part.values[0]) + self.plan.acting

    @property
    def written(self) -> bool:
        return is_sure(self.share.part)

    @property
    def converged(self) -> bool:
        return self.share.fit.converged

    @property
    def cycles(self) -> int | None:
        machine = self.lists.machine
        return spread_over(self.job, self.jump, machine, REVERSAL_CYCLES, switched=True)

    @property
    def jump(self) -> float:
        return abs(self.width)

    def machine_entries(self, cycles: int | None) -> dict[str, Value]:
        width = jnp.asarray(self.width)
        model = models.Backlash(width, self.plan.reference, cycles or 0)
        return dict(entries_of_backlash(model, target=self.target))

    @property
    def foreseen(self) -> Foreseen:
        share, run = self.share, self.share.recording.data.run
        # Under a fit to the others, about the middle of each run.
        predicted = np.array(share.predicted[share.rows])
        if run is not None:
            run = run[share.rows]
            for label in np.unique(run):
                predicted[run == label] -= np.median(predicted[run == label])
        sides = sides_of(share)
        return Foreseen(sides.before, predicted, sides.wild)

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        job, jump, spread = self.job, self.jump, cycles or 0
        limits, unit = job.spec.gate, job.spec.axes[self.axis].unit
        lines = [
            *reversal_checks(
                jump, spread, job.spec.controller.cycle_time, limits, unit,
                ("at every reversal", f"spread over {spread} cycles"),
            ),
            check_switching(
                jump, spread, limits, unit, REVERSAL_CYCLES, "start-up or COMP ON/OFF"
            ),
        ]  # fmt: skip
        old = self.plan.old
        if limits.max_change is not None and old is not None:
            change = abs(self.width - float(old.width))
            words = "against the axis list"
            lines.append(limits.check("max_change", change, unit, words))
        return tuple(lines)

    def second_measurement(
        self, tables: Tables, fit: FitSpec
    ) -> SecondMeasurement | None:
        assert isinstance(fit, Spec)
        plan = dataclasses.replace(self.plan, job=tables.job, fit=fit)
        draft = plan.fit_single(tables, {})
        assert isinstance(draft, BacklashDraft)  # its own
        sides, width = sides_of(draft.share), float(self.share.part.values[0])
        error, trend, moved = sides.before, None, self._moved(draft)
        unsettled = moved is None and FLANK not in self.job.verified
        if moved is not None and abs(moved) > 0.5 * abs(width):
            # Nearer to what the other flank as the right one does.
            words = (
                f"a constant of {self.small(moved, '+.3g')} of both directions: as if it were"
                f" right in {'−' if self.plan.reference > 0 else '+'} direction"
                " (anwahl_losekomp)"
            )
            rest = float(np.sqrt(np.mean(sides.before[~sides.wild] ** 2)))
            error, trend = error + moved, LeftTrend(words, rest, owned=True, fault=True)
        return SecondMeasurement(
            ", ".join(fit.sources),
            sides.position[:, None],
            error,
            sides.direction,
            wild=sides.wild,
            added=0.5 * abs(width),
            unseen={"zero": FLANK} if unsettled else {},
            trend=trend,
            zero=moved is not None and trend is None,
        )

    def _moved(self, again: "BacklashDraft") -> float | None:
        """Return by how much the middle of both directions lies beside where it should, in mm.

        It moves by half of the width, to the side that is right. None where readings do not tell
        where the axis lies. Beside other lists of the axis that act as they say nothing is left,
        or the width alone; where more is, theirs have to tell.
        """
        drafts = (self, again)
        specs = [
            one.job.spec.measurements[k] for one in drafts for k in one.fit.sources
        ]
        owned = all(one.remove == "none" and one.datum is None for one in specs)
        acting = {frozenset({*one.active} - {self.compensation}) for one in specs}
        before, after = (one.middle for one in drafts)
        width = float(self.share.part.values[0])
        alone = [fit.axis for fit in self.job.spec.fits].count(self.axis) == 1
        if owned and not alone:
            # The other flank puts both directions there.
            flank = min(abs(after), abs(after - self.plan.reference * width))
            sure = max(flank, again.uneven) < _FLANK_ALONE * abs(width)
            return after if sure else None
        if not owned or len(acting) > 1:
            return None
        return after - (before - 0.5 * self.plan.reference * width)

    @property
    def middle(self) -> float:
        """Mean of what both directions show as they were measured, in mm or °."""
        data = self.share.recording.data
        rows = np.flatnonzero(self.share.rows)[~self.share.wild]
        error, way = data.error[self.axis][rows], data.direction[self.axis][rows]
        return 0.5 * float(sum(np.median(error[way == sign]) for sign in (1, -1)))

    @property
    def uneven(self) -> float:
        """How the readings of both directions change along the axis, rms in mm or °."""
        data = self.share.recording.data
        rows = np.flatnonzero(self.share.rows)[~self.share.wild]
        place, error = data.position[self.axis][rows], data.error[self.axis][rows]
        at = np.unique(place.round(2), return_inverse=True)[1].reshape(-1)
        means = np.bincount(at, error) / np.bincount(at)
        return float(np.std(means))

    def prove(self, done: "AxisFiles") -> BacklashResult:
        share, sides = self.share, sides_of(self.share)
        before, predicted, wild = self.foreseen
        read = self.plan.old
        if done.machine is not None:
            read = backlash_from_list(done.machine, self.job.conventions)
        # About the mean of both directions, which the tables of the axis look after.
        width = 0.0 if read is None else float(read.width)
        added = 0.5 * sides.direction * (width - self.plan.acting)
        from_file = sides.before + added
        result = BacklashResult(
            **self.frame(done),
            error=staged(before, predicted, from_file, wild),
            remarks=(),
            held_out=share.recording.held_out,
            width=self.width if self.written else 0.0,
            reference=self.plan.reference,
            cycles=done.cycles or 0,
            fit=share.part,
            noise=share.noise,
            sides=sides,
            from_file=from_file,
            dependence=change_along(float(share.part.values[0]), sides),
        )
        fit_remarks = remarks_of(result, self.plan.old is not None, self.plan.active)
        nodes = self.plan.nodes_beside(share.recording.data)
        drifts = drift_remark(share, nodes, self.job.spec.axes[self.axis].small_unit)
        remarks = (*share.remarks(), *fit_remarks, *drifts)
        return dataclasses.replace(result, remarks=remarks)
