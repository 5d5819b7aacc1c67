"""Cross compensation: an offset over the position of one master axis."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._lookup import AbstractLookup
from ._nodes import AbstractNodes, Values, float_array
from ._primitive import interpolate
from ._stencil import Stencil, linear_stencil


@final
class Cross(AbstractLookup):
    """Cross (sag) compensation of one slave axis.

    Linear between nodes. Outside, the manuals are silent (S-12): held by default.
    Units: mm (rotary master: °) in, mm out.

    The derivative with respect to the position is the right-hand one: at a node that of
    the cell which begins there, 0 outside and from the last node on.
    """

    nodes: AbstractNodes
    """Nodes along the master axis."""
    values: Float[Values, " p"] = eqx.field(converter=float_array)
    """Table entries in mm."""
    sign: float = eqx.field(default=1.0, static=True)
    """Offset per entry: +1 or −1 (S-11)."""
    held: bool = eqx.field(default=True, static=True)
    """Outside the table the entry of its edge is held; else nothing is added (S-12)."""

    def __check_init__(self) -> None:
        if self.values.shape != (self.nodes.count,):
            msg = (
                f"values must have one entry per node, ({self.nodes.count},), "
                f"got shape {self.values.shape}."
            )
            raise ValueError(msg)

    @property
    def ways(self) -> tuple[AbstractNodes, ...]:
        return (self.nodes,)

    @property
    def tables(self) -> tuple[Float[Array | np.ndarray, " p"], ...]:
        return (self.values,)

    def looked_up(
        self,
        positions: Float[Array | np.ndarray, "t d"],
        direction: Int[Array | np.ndarray, " t"],
    ) -> tuple[Array | np.ndarray, ...]:
        return (positions[:, 0],)

    @eqx.filter_jit
    def entry(self, position: Float[Array | np.ndarray, " t"]) -> Float[Array, " t"]:
        """Return the table's value in mm at master positions in mm."""
        place = jnp.asarray(position, dtype=jnp.float64)
        value = interpolate(
            self.values, (self.nodes.coordinate(place),), (self.nodes.count,)
        )
        if self.held:
            return value
        return jnp.where(self.nodes.covers(place) | jnp.isnan(place), value, 0.0)

    def offset(self, position: Float[Array | np.ndarray, " t"]) -> Float[Array, " t"]:
        """Return what the controller adds to the slave axis, in mm."""
        return self.sign * self.entry(position)

    @eqx.filter_jit
    def stencil(self, position: Float[Array | np.ndarray, " t"]) -> Stencil:
        """Return the 2 nodes that each position touches."""
        place = jnp.asarray(position, dtype=jnp.float64)
        stencil = linear_stencil((self.nodes.coordinate(place),), (self.nodes.count,))
        if self.held:
            return stencil
        inside = self.nodes.covers(place) | jnp.isnan(place)
        weights = jnp.where(inside[:, None], stencil.weights, 0.0)
        return Stencil(nodes=stencil.nodes, weights=weights, size=stencil.size)
