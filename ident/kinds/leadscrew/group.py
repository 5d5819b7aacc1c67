"""A leadscrew table of a group."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float

from ...fit.joint import Leadscrew
from ...job._draft import AxisLists
from ...job._load import Job
from ...job._plan import plan_fit
from ...job._source import Tables
from ...job.joint._recording import GroupRecording
from ...job.joint._table import AbstractTableMember
from .keys import Spec


def member(
    job: Job, tables: Tables, index: int, fit: Spec, lists: AxisLists
) -> "LeadscrewMember":
    """Plan a leadscrew table of a group.

    Raises:
        JobError: If nodes, masters or existing lists do not suit.
    """
    planned = plan_fit(job, tables, index, fit, lists)
    return LeadscrewMember(index, fit, lists, planned)


@final
@dataclasses.dataclass(frozen=True)
class LeadscrewMember(AbstractTableMember):
    """A leadscrew table of a group."""

    fit: Spec

    @property
    def takes_line(self) -> bool:
        return True

    def effect(
        self,
        job: Job,
        recording: GroupRecording,
        left: Float[np.ndarray, " t"] | None,
    ) -> Leadscrew:
        table = self.plan.table
        return Leadscrew(
            self.axis,
            table.nodes[0].positions,
            bilateral=self.fit.bilateral,
            modulo=table.periodic,
        )
