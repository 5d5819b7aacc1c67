"""What is asked of a table fit, as one value that can wait its turn."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Int

from .._types import Samples, TableLayout

_SIZE, _WORK = 120, 200_000
"""Unknown node values, and readings × unknowns, up to which dense lanes are the fast way."""


@dataclasses.dataclass(frozen=True)
class TableRequest:
    """Arguments of `fit_table`, see there, and which of the readings are fitted.

    Attributes:
        rows: Readings that are fitted, ascending; None: all. Requests that name rows of the
            same samples share what is looked up for these.
    """

    layout: TableLayout
    samples: Samples
    smoothness: float | str | Mapping[str, float] = "auto"
    loss: str = "student"
    run_effects: str = "none"
    allow_gaps: bool = False
    rows: Int[np.ndarray, " n"] | None = None

    @property
    def fitted(self) -> Samples:
        """The readings that are fitted."""
        return self.samples if self.rows is None else self.samples.take(self.rows)

    @property
    def small(self) -> bool:
        """Whether the table is one for the lanes: along one axis, and not too large."""
        chosen = self.samples.error if self.rows is None else self.rows
        return is_small(self.layout, len(chosen))


def is_small(layout: TableLayout, readings: int) -> bool:
    """Return whether a table with so many readings is one for the lanes."""
    if len(layout.nodes) != 1:
        return False
    nodes = len(layout.nodes[0]) - int(layout.periodic)
    size = nodes * layout.branches
    return 3 <= nodes and size <= _SIZE and size * readings <= _WORK
