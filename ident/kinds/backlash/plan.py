"""A planned backlash: fitted alone, or in a group."""

import dataclasses
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float

from ...fit import DriftNoise, FitError
from ...fit.joint import Backlash
from ...job._draft import AbstractPlan, Leftovers
from ...job.table._plan import was_active
from ...readings import Readings, Tables
from ._draft import BacklashDraft, KnownBacklash
from ._recording import fit_readings, read_backlash
from .effect import BacklashFit, Dependence, Sides
from .entries import backlash_from_list
from .keys import Spec

if TYPE_CHECKING:
    from ...job.joint._recording import GroupRecording
    from ...job.joint._share import Share

_MOST = 5_000
"""Readings that are enough to see whether a backlash changes along the axis."""


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
    return BacklashPlan(job, index, fit, KnownBacklash(old, active))


@final
@dataclasses.dataclass(frozen=True)
class BacklashPlan(AbstractPlan):
    """A backlash.

    Attributes:
        known: What the axis list holds.
    """

    fit: Spec
    known: KnownBacklash

    def alone(self, tables: Tables, left: Leftovers) -> BacklashDraft:
        readings, remarks = read_backlash(tables, self)
        found = fit_readings(readings, self.fit.loss)
        job, index = self.job, self.index
        return BacklashDraft(job, index, self.fit, readings, remarks, found, self.known)

    @property
    def positions(self) -> tuple[str, ...]:
        return (self.axis,)

    @property
    def turning(self) -> tuple[str, ...]:
        return (self.axis,)

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> Backlash:
        return Backlash(self.axis, reference=self.known.reference)

    def draft(self, share: "Share") -> BacklashDraft:
        readings, part = share.readings((self.axis,), turns=True), share.part
        width, way = float(part.values[0]), readings.direction
        assert way is not None  # it was asked for
        # Both directions about their mean: what lies between them is not the backlash's.
        middle = 0.5 * self.known.reference * width
        readings = dataclasses.replace(readings, error=readings.error - middle)
        found = BacklashFit(
            width=width,
            standard_deviation=float(part.standard_deviation[0]),
            noise=DriftNoise(share.noise),
            independent=float(np.sum(~share.wild)),
            support=(int(np.sum(way > 0)), int(np.sum(way < 0))),
            dependence=self._dependence(readings),
            sides=Sides(
                readings.positions[:, 0],
                way,
                share.left - 0.5 * way * width,
                share.wild,
            ),
            converged=share.fit.converged,
        )
        left_out = share.predicted[share.rows], share.recording.by_run
        remarks, job = tuple(share.remarks()), self.job
        return BacklashDraft(
            job, self.index, self.fit, readings, remarks, found, self.known, left_out
        )

    def _dependence(self, readings: Readings) -> Dependence | None:
        """Return how the width changes along the axis in what the other effects leave."""
        few = slice(None, None, max(len(readings.error) // _MOST, 1))
        try:
            return fit_readings(readings, self.fit.loss, few).dependence
        except FitError:
            return None
