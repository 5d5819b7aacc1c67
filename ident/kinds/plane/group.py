"""A plane of a group."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float

from ...fit.joint import JointData, Plane
from ...job._draft import AxisLists
from ...job._load import Job
from ...job._plan import plan_fit
from ...job._source import Tables
from ...job.joint._recording import GroupRecording
from ...job.joint._table import AbstractTableMember
from .keys import Spec

_TOGETHER = 0.99
"""Correlation of two masters from which on a plane is told on a line only."""


def member(
    job: Job, tables: Tables, index: int, fit: Spec, lists: AxisLists
) -> "PlaneMember":
    """Plan a plane table of a group.

    Raises:
        JobError: If nodes, masters or existing lists do not suit.
    """
    planned = plan_fit(job, tables, index, fit, lists)
    return PlaneMember(index, fit, lists, planned)


@final
@dataclasses.dataclass(frozen=True)
class PlaneMember(AbstractTableMember):
    """A plane of a group."""

    fit: Spec

    def undetermined(self, data: JointData) -> str:
        first, second = (data.position[name] for name in self.fit.masters)
        known = np.isfinite(first) & np.isfinite(second)
        known &= np.isfinite(data.error[self.axis])
        x, y = first[known], second[known]
        if len(x) < 3 or not np.ptp(x) > 0 or not np.ptp(y) > 0:
            return ""
        alike = float(np.corrcoef(x, y)[0, 1])
        if abs(alike) < _TOGETHER:
            return ""
        names = " and ".join(self.fit.masters)
        return (
            f"{names} moved together (correlation {alike:.4f}): beside the line on which"
            " they went nothing was measured. Move each of them while the other stands"
            " still."
        )

    def effect(
        self,
        job: Job,
        recording: GroupRecording,
        left: Float[np.ndarray, " t"] | None,
    ) -> Plane:
        first, second = self.fit.over
        nodes = [each.positions for each in self.plan.table.nodes]
        return Plane(self.axis, (first, second), (nodes[0], nodes[1]))
