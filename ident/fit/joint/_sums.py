"""Information sums of one axis: what the readings say about all unknowns, once for all."""

import dataclasses
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float

from ._design import Design

_REACHED = 0.1
"""Sum of squared weights, in readings, from which on an unknown counts as measured."""


@dataclasses.dataclass(frozen=True)
class Sums:
    """Normal matrix of the active readings.

    Attributes:
        design: Columns.
        matrix: Σ x xᵀ, shape ``(n, n)``, sparse.
        active: Readings that are counted.
    """

    design: Design
    matrix: sp.csr_array
    active: Bool[np.ndarray, " r"]

    @property
    def count(self) -> int:
        """Number of active readings."""
        return int(self.active.sum())

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
                # Their columns are no weights from 0 to 1, but lengths and speeds.
                part = np.abs(self.design.columns[:, component.places])
                top = np.asarray(part.max(axis=0).todense()).reshape(-1)
                whole = top if component.kind == "delay" else top.max()
                least[component.places] *= np.maximum(whole, 1e-300) ** 2
        return np.asarray(self.diagonal >= least)

    @cached_property
    def band(self) -> sp.csr_array:
        """Leading block, sparse."""
        count = self.design.banded
        return sp.csr_array(self.matrix[:count, :count])

    @cached_property
    def beside(self) -> Float[np.ndarray, "b d"]:
        """Coupling of the leading block to all others."""
        count = self.design.banded
        return np.asarray(self.matrix[:count, count:].toarray())

    @cached_property
    def dense(self) -> Float[np.ndarray, "d d"]:
        """Block of all others."""
        count = self.design.banded
        return np.asarray(self.matrix[count:, count:].toarray())

    def apply(self, values: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """Return matrix × values."""
        return np.asarray(self.matrix @ values)

    def changed(self, active: Bool[np.ndarray, " r"]) -> "Sums":
        """Return the sums over other readings, by the difference where it is small."""
        rows = np.flatnonzero(active != self.active)
        if len(rows) > 0.2 * len(active):
            return sums_of(self.design, active)
        part = self.design.columns[rows]
        sign = np.where(active[rows], 1.0, -1.0)
        moved = sp.csr_array(part.T @ sp.csr_array(sp.diags_array(sign) @ part))
        return Sums(self.design, sp.csr_array(self.matrix + moved), active)


def sums_of(design: Design, active: Bool[np.ndarray, " r"] | None = None) -> Sums:
    """Return the sums over all readings, or over those that are active."""
    if active is None:
        active = np.ones(len(design.rows), bool)
    columns = design.columns if active.all() else design.columns[active]
    return Sums(design, sp.csr_array(columns.T @ columns), active)
