"""What is asked of a fit over a stream, and what it gives."""

import dataclasses
from collections.abc import Mapping

from ._grid import Grid
from ._logs import fixed_smoothness
from ._prior import Smoothness, TablePrior
from ._streamed_looks import Rule
from ._types import TableFit


@dataclasses.dataclass(frozen=True)
class Options:
    """What is asked of a fit.

    Attributes:
        grid: Nodes.
        prior: Smoothness prior.
        smoothness: As for `fit_table`.
        loss: As for `fit_table`.
        allow_gaps: Accept fewer readings than nodes.
    """

    grid: Grid
    prior: TablePrior
    smoothness: float | str | Mapping[str, float]
    loss: str
    allow_gaps: bool = False

    @property
    def fixed(self) -> bool:
        """Whether the smoothness is given."""
        return not isinstance(self.smoothness, str)

    def of_fold(self, fit: TableFit) -> "Options":
        """Return what is asked of a fit without some of the readings."""
        return dataclasses.replace(
            self, smoothness=dict(fit.smoothness), loss=fit.loss, allow_gaps=True
        )

    def start(self, density: float, count: int) -> Smoothness:
        """Return the smoothness of the first steps, which is the last one where it is given."""
        if not isinstance(self.smoothness, str):
            return fixed_smoothness(self.smoothness, density, self.grid)
        plenty = count >= 10 * self.grid.size
        weight = density * (1e-2 if plenty else 1.0)
        return Smoothness(
            (weight, 0.0), (weight, 0.0) if self.grid.planar else (0.0, 0.0)
        )


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A table, and which readings it rests on.

    Attributes:
        fit: The table.
        count: Number of readings.
        wild: How many are wild.
        rule: By what they are; None where none is.
        crowded: Nodes at which wild readings stand side by side.
        last: Table, in the order of the fit, and loss by which the others counted; None: all
            of them in full.
    """

    fit: TableFit
    count: int
    wild: int = 0
    rule: Rule | None = None
    crowded: int = 0
    last: Rule | None = None
