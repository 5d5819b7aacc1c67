"""A cross table of a group."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float

from ...fit.joint import Cross
from ...job._draft import AxisLists
from ...job._load import Job
from ...job._plan import plan_fit
from ...job._source import Tables
from ...job.joint._recording import GroupRecording
from ...job.joint._table import AbstractTableMember
from .keys import Spec


def member(
    job: Job, tables: Tables, index: int, fit: Spec, lists: AxisLists
) -> "CrossMember":
    """Plan a cross table of a group.

    Raises:
        JobError: If nodes, masters or existing lists do not suit.
    """
    planned = plan_fit(job, tables, index, fit, lists)
    return CrossMember(index, fit, lists, planned)


@final
@dataclasses.dataclass(frozen=True)
class CrossMember(AbstractTableMember):
    """A cross table of a group."""

    fit: Spec

    def effect(
        self,
        job: Job,
        recording: GroupRecording,
        left: Float[np.ndarray, " t"] | None,
    ) -> Cross:
        table = self.plan.table
        return Cross(
            self.axis,
            master=self.fit.master,
            setpoints=table.nodes[0].positions,
            modulo=table.periodic,
        )
