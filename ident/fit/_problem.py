"""A table fit as sums over its readings: what a posterior is made of."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ._information import Normal
from ._prior import TablePrior

_SMALL = 5e6
"""Operations of one band Cholesky up to which a table is small."""


@dataclasses.dataclass(frozen=True)
class Border:
    """Run effects beside the node values: their sums, and their coupling to the nodes.

    Attributes:
        coupling: Σ w x zᵀ, shape (slow, fast, r).
        matrix: Σ w z zᵀ, shape (r, r).
        vector: Σ w z y about the current effects, shape (r,).
    """

    coupling: Float[np.ndarray, "l s r"]
    matrix: Float[np.ndarray, "r r"]
    vector: Float[np.ndarray, " r"]


@dataclasses.dataclass(frozen=True)
class Problem:
    """A table fit as sums about a current estimate, so that nothing cancels.

    Attributes:
        normal: Normal matrix of the node values.
        prior: Smoothness prior.
        vector: Σ w y x over the nodes, with y the reading minus the current estimate.
        square: Σ w y².
        count: Number of readings.
        values: Current node values over (slow, fast).
        effects: Current run effects, shape (r,).
        border: Sums of the run effects, None without them.
    """

    normal: Normal
    prior: TablePrior
    vector: Float[np.ndarray, "l s"]
    square: float
    count: int
    values: Float[np.ndarray, "l s"]
    effects: Float[np.ndarray, " r"]
    border: Border | None = None

    @property
    def small(self) -> bool:
        """Whether one factor costs next to nothing, whatever the weights."""
        grid = self.normal.grid
        return grid.size * (4.0 * grid.fast) ** 2 <= _SMALL

    @property
    def free(self) -> int:
        """Readings beyond those that the prior's null space and the run effects use up."""
        return self.count - self.prior.null - len(self.effects)
