"""What all tables over positions have in common: plane, cross and leadscrew."""

import abc
from typing import TYPE_CHECKING

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from ._nodes import AbstractNodes


class AbstractLookup(eqx.Module):
    """A table over the positions of its masters: sign · a weighted sum of few entries.

    Each has `stencil`, which gives these entries and weights, and `offset`, the sum; both
    take what `looked_up` returns.
    """

    # As in `AbstractNodes`: a field for equinox, a property for type checkers.
    if TYPE_CHECKING:

        @property
        @abc.abstractmethod
        def sign(self) -> float:
            """Offset per entry: +1 or −1."""

    else:
        sign: eqx.AbstractVar[float]

    @property
    @abc.abstractmethod
    def ways(self) -> tuple[AbstractNodes, ...]:
        """Nodes along each master, master 1 first."""

    @property
    @abc.abstractmethod
    def tables(self) -> tuple[Float[Array | np.ndarray, "..."], ...]:
        """Entries in mm or °, in the order in which stencils count them."""

    @abc.abstractmethod
    def looked_up(
        self,
        positions: Float[Array | np.ndarray, "t d"],
        direction: Int[Array | np.ndarray, " t"],
    ) -> tuple[Array | np.ndarray, ...]:
        """Return what the look-up depends on.

        Args:
            positions: One column per master, in mm or °; further ones are left out.
            direction: Of the axis itself, ±1 per row.
        """
