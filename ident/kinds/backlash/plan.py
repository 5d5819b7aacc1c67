"""A planned backlash: fitted alone, or in a group."""

import dataclasses
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float

from ...fit import DriftNoise, FitError
from ...job._draft import Leftovers
from ...job._fit_plan import AbstractPlan
from ...readings import Tables
from ._draft import BacklashDraft, KnownBacklash, known_backlash
from ._recording import Recording, read_recording
from .effect import BacklashFit
from .keys import Spec

if TYPE_CHECKING:
    from ...fit.joint import Backlash
    from ...job.joint._recording import GroupRecording
    from ...job.joint._share import Share

_MOST = 5_000
"""Readings that are enough to see whether a backlash changes along the axis."""


def plan(tables: Tables, index: int, fit: Spec) -> "BacklashPlan":
    """Plan a backlash fit.

    Raises:
        JobError: If existing lists do not suit.
    """
    known = known_backlash(tables.job, index, fit)
    return BacklashPlan(tables.job, index, fit, known)


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
        recording = read_recording(tables, self.fit)
        found = recording.fit(self.fit.loss)
        job, index = self.job, self.index
        return BacklashDraft(job, index, self.fit, recording, found, self.known)

    @property
    def positions(self) -> tuple[str, ...]:
        return (self.axis,)

    @property
    def turning(self) -> tuple[str, ...]:
        return (self.axis,)

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> "Backlash":
        from ...fit.joint import Backlash  # takes long to load

        return Backlash(self.axis, reference=self.known.reference)

    def draft(self, share: "Share") -> BacklashDraft:
        part = share.part
        way = share.column("direction", self.axis)
        width, deviation = float(part.values[0]), float(part.standard_deviation[0])
        # Both directions about their mean: what lies between them is not the backlash's.
        middle = 0.5 * self.known.reference * width
        run = share.recording.data.run
        data = Recording(
            position=share.column("position", self.axis),
            error=share.error - middle,
            direction=way.astype(np.int64),
            run=None if run is None else run[share.rows],
            time=share.time,
            reach=0.0,
            rotary=self.job.spec.axes[self.axis].kind != "linear",
            slices=share.slices(),
            remarks=tuple(share.remarks()),
        )
        alone = _alone(data, self.fit.loss)
        found = BacklashFit(
            width=width,
            standard_deviation=deviation,
            noise=DriftNoise(share.noise),
            independent=float(np.sum(~share.wild)),
            support=(int(np.sum(way > 0)), int(np.sum(way < 0))),
            dependence=None if alone is None else alone.dependence,
            residual=share.left,
            wild=share.wild,
            converged=share.fit.converged,
        )
        return BacklashDraft(
            job=self.job,
            index=self.index,
            fit=self.fit,
            recording=data,
            found=found,
            known=self.known,
            held_out=(share.predicted[share.rows], share.recording.by_run),
        )


def _alone(recording: Recording, loss: str) -> BacklashFit | None:
    """Return the backlash of what the other effects leave, fitted alone, or None."""
    count = len(recording.error)
    keep = np.zeros(count, dtype=bool)
    keep[:: max(count // _MOST, 1)] = True
    try:
        return recording.fit(loss, keep)
    except FitError:
        return None
