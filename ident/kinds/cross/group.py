"""A cross table of a group."""

import dataclasses
from typing import final

from ...fit.joint import Cross
from ...job.joint._table import AbstractTableMember
from .keys import Spec


@final
@dataclasses.dataclass(frozen=True)
class CrossMember(AbstractTableMember):
    """A cross table of a group."""

    fit: Spec

    def table_effect(self) -> Cross:
        table = self.plan.table
        return Cross(
            self.axis,
            master=self.fit.master,
            setpoints=table.nodes[0].positions,
            modulo=table.periodic,
        )


member = CrossMember.planned
