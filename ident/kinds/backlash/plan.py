"""A planned backlash: fitted alone, or in a group."""

import dataclasses
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float

from .... import models
from ..._recording import JointData
from ...fit.joint import Backlash
from ...job._draft import AbstractPlan
from ...job.table._plan import was_active
from ...readings import Tables
from ._draft import BacklashDraft
from .entries import backlash_from_list
from .keys import Spec

if TYPE_CHECKING:
    from ...job.joint._recording import GroupRecording
    from ...job.joint._share import Share

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
    def positions(self) -> tuple[str, ...]:
        return (self.axis,)

    @property
    def turning(self) -> tuple[str, ...]:
        return (self.axis,)

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

    def draft(self, share: "Share") -> BacklashDraft:
        return BacklashDraft(self.job, self.index, self.fit, self, share)
