"""A leadscrew table of a group."""

import dataclasses
from typing import final

from ...fit.joint import Leadscrew
from ...job.joint._table import AbstractTableMember
from .keys import Spec


@final
@dataclasses.dataclass(frozen=True)
class LeadscrewMember(AbstractTableMember):
    """A leadscrew table of a group."""

    fit: Spec

    @property
    def takes_line(self) -> bool:
        return True

    def table_effect(self) -> Leadscrew:
        table = self.plan.table
        return Leadscrew(
            self.axis,
            table.nodes[0].positions,
            bilateral=self.fit.bilateral,
            modulo=table.periodic,
        )


member = LeadscrewMember.planned
