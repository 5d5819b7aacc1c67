"""A plane of a group."""

import dataclasses
from typing import final

import numpy as np

from ...fit.joint import JointData, Plane
from ...job.joint._table import AbstractTableMember
from .keys import Spec

_TOGETHER = 0.99
"""Correlation of two masters from which on a plane is told on a line only."""


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

    def table_effect(self) -> Plane:
        first, second = self.fit.over
        nodes = [each.positions for each in self.plan.table.nodes]
        return Plane(self.axis, (first, second), (nodes[0], nodes[1]))


member = PlaneMember.planned
