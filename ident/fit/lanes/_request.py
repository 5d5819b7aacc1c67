"""What is asked of a table fit, as one value that can wait its turn."""

import dataclasses
from collections.abc import Mapping

from .._types import Samples, TableLayout

_SIZE, _WORK = 120, 200_000
"""Unknown node values, and readings × unknowns, up to which dense lanes are the fast way."""


@dataclasses.dataclass(frozen=True)
class TableRequest:
    """Arguments of `fit_table`, see there."""

    layout: TableLayout
    samples: Samples
    smoothness: float | str | Mapping[str, float] = "auto"
    loss: str = "student"
    run_effects: str = "none"
    allow_gaps: bool = False

    @property
    def small(self) -> bool:
        """Whether the table is one for the lanes: along one axis, and not too large."""
        if len(self.layout.nodes) != 1:
            return False
        nodes = len(self.layout.nodes[0]) - int(self.layout.periodic)
        size = nodes * self.layout.branches
        return 3 <= nodes and size <= _SIZE and size * len(self.samples.error) <= _WORK
