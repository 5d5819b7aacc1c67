"""The table of a grid over three axes as unknowns, and what makes it smooth."""

import dataclasses
import functools
from collections.abc import Sequence
from functools import cached_property
from typing import final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from ..core import AbstractPrior, Readings, chain
from ..core._chain import Chain
from ..core._effect import Design
from ._blocks import FRAME, AbstractBlock, Modes, Touched, polynomials


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Lattice(AbstractPrior):
    """Prior of a table over three axes: second differences along each of them.

    Attributes:
        chains: Along the axes, the slowest first.
    """

    chains: tuple[Chain, ...]

    @cached_property
    def rows(self) -> tuple[sp.csr_array, ...]:
        """See `AbstractPrior`."""
        found = []
        for own, axis in enumerate(self.chains):
            parts = [sp.eye_array(each.size) for each in self.chains]
            parts[own] = axis.rows[0]
            found.append(sp.csr_array(functools.reduce(sp.kron, parts)))
        return tuple(found)

    @cached_property
    def _sizes(self) -> Float[np.ndarray, "k n"]:
        """Eigenvalues of each term at weight 1, of the shapes that they have in common."""
        each = [axis.eigenvalues(np.array([1.0, 0.0])) for axis in self.chains]
        return np.stack([own.ravel() for own in np.meshgrid(*each, indexing="ij")])

    def logdet(
        self, weights: Float[np.ndarray, " k"]
    ) -> tuple[float, Float[np.ndarray, " k"]]:
        """See `AbstractPrior`."""
        parts = weights[:, None] * self._sizes
        total = parts.sum(axis=0)
        some = total > 0.0
        slopes = (parts[:, some] / total[some]).sum(axis=1)
        return float(np.log(total[some]).sum()), slopes

    @property
    def straight(self) -> Float[np.ndarray, "n z"]:
        """See `AbstractPrior`."""
        return functools.reduce(np.kron, [axis.straight for axis in self.chains])

    @property
    def scanned(self) -> bool:
        """See `AbstractPrior`."""
        return True

    @property
    def bounds(self) -> Float[np.ndarray, "k 2"]:
        """See `AbstractPrior`."""
        return np.stack([axis.bounds[0] for axis in self.chains])


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Table(AbstractBlock):
    """The table of one axis of a grid.

    Attributes:
        touched: The grid.
        axis: Number of the axis that it adds to.
    """

    touched: Touched
    axis: int

    @property
    def name(self) -> str:
        """See `AbstractBlock`."""
        return "XYZ"[self.axis]

    @property
    def priority(self) -> int:
        """See `AbstractBlock`."""
        return FRAME

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return int(self.touched.model.size)

    @property
    def prior(self) -> AbstractPrior:
        """See `AbstractEffect`."""
        return self._prior

    @cached_property
    def _prior(self) -> Lattice:
        nodes = reversed(self.touched.model.nodes)
        return Lattice(tuple(chain(np.asarray(each.positions)) for each in nodes))

    def design(self, readings: Readings) -> Design:
        """See `AbstractEffect`."""
        nodes, shares = self.touched.rows(readings)
        return nodes, shares * readings.inputs["along"][:, self.axis, None]

    def modes(self, most: Sequence[int]) -> Modes:
        """See `AbstractBlock`."""
        x, y, z = (
            polynomials(nodes, min(degree, 2))
            for nodes, degree in zip(self.touched.model.nodes, most, strict=True)
        )
        basis = np.kron(z, np.kron(y, x))
        shape = z.shape[1], y.shape[1], x.shape[1]
        degrees = np.indices(shape).reshape(3, -1).T[:, ::-1]
        labels = tuple(
            " and ".join(a for a, k in zip("XYZ", own, strict=True) if k) or "offset"
            for own in degrees
        )
        return Modes(basis, labels, np.asarray((degrees < 2).all(axis=1)))
