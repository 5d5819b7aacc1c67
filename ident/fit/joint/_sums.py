"""What the rows of one axis say about its unknowns, whatever was measured in them."""

import dataclasses
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float

from ._design import Design

_REACHED = 0.1
"""Sum of squared shares, in readings, from which on an unknown counts as measured."""


@dataclasses.dataclass(frozen=True, eq=False)
class Information:
    """Information matrix of the columns of one axis, for what data can tell.

    Attributes:
        design: Columns.
        matrix: Σ x xᵀ, shape ``(n, n)``, sparse.
    """

    design: Design
    matrix: sp.csr_array

    @classmethod
    def of(cls, design: Design) -> "Information":
        """Return the information of all rows."""
        return cls(design, sp.csr_array(design.columns.T @ design.columns))

    @property
    def count(self) -> int:
        """Number of readings."""
        return len(self.design.rows)

    @cached_property
    def diagonal(self) -> Float[np.ndarray, " n"]:
        """Information on each unknown alone."""
        return np.asarray(self.matrix.diagonal())

    @cached_property
    def reached(self) -> Bool[np.ndarray, " n"]:
        """Unknowns that readings tell anything of: more than the noise of a position does."""
        least = np.full(self.design.size, _REACHED)
        for component in self.design.components:
            if component.kind in ("temperature coefficient", "delay"):
                # Their columns are no shares from 0 to 1, but lengths and speeds.
                part = np.abs(self.design.columns[:, component.places])
                top = np.asarray(part.max(axis=0).todense()).reshape(-1)
                whole = top if component.kind == "delay" else top.max()
                least[component.places] *= np.maximum(whole, 1e-300) ** 2
        return np.asarray(self.diagonal >= least)

    def over(self, shapes: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "m m"]:
        """Return the information on mixtures of the unknowns, one per column."""
        some = sp.csr_array(shapes)
        return np.asarray((some.T @ self.matrix @ some).todense())
