"""Leadscrew error compensation: an offset over the axis's own position."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Real

from ._lookup import AbstractLookup
from ._nodes import (
    AbstractNodes,
    EquidistantNodes,
    ModuloNodes,
    Setpoints,
    Values,
    float_array,
)
from ._primitive import interpolate
from ._stencil import Stencil, linear_stencil


def _as_floats(
    ends: tuple[float, float] | bool | None,
) -> tuple[float, float] | bool | None:
    """Return limits as numbers that are no arrays: they are static."""
    return (float(ends[0]), float(ends[1])) if isinstance(ends, tuple) else ends


@final
class Leadscrew(AbstractLookup):
    """Leadscrew error compensation of one axis, for one or for both directions.

    Linear between nodes, edges held. Entries are errors: the offset is −entry (S-18).
    Units: mm (rotary: °) in and out.

    The derivative with respect to the position is the right-hand one: at a node that of
    the cell which begins there, 0 outside and from the last node on. Across the modulo
    transition it is that of the first cell.
    """

    nodes: EquidistantNodes | Setpoints
    """Nodes along the axis, common to both directions."""
    pos: Float[Values, " p"] = eqx.field(converter=float_array)
    """Entries in mm for motion in positive direction, or for both."""
    neg: Float[Values, " p"] | None = eqx.field(
        default=None, converter=lambda neg: None if neg is None else float_array(neg)
    )
    """Entries in mm for motion in negative direction; None: unilateral."""
    modulo: tuple[float, float] | bool | None = eqx.field(
        default=None, static=True, converter=_as_floats
    )
    """Range of a modulo axis in °; True: from the first node to the last (S-20)."""
    sign: float = eqx.field(default=-1.0, static=True)
    """Offset per entry: −1 or +1 (S-18)."""

    def __check_init__(self) -> None:
        for name, values in (("pos", self.pos), ("neg", self.neg)):
            if values is not None and values.shape != (self.nodes.count,):
                msg = (
                    f"{name} must have one entry per node, ({self.nodes.count},), "
                    f"got shape {values.shape}."
                )
                raise ValueError(msg)
        _ = self.input_nodes  # refuses a modulo range that does not ascend

    @property
    def ways(self) -> tuple[AbstractNodes, ...]:
        return (self.nodes,)

    @property
    def tables(self) -> tuple[Float[Array | np.ndarray, " p"], ...]:
        return (self.pos,) if self.neg is None else (self.pos, self.neg)

    def looked_up(
        self,
        positions: Float[Array | np.ndarray, "t d"],
        direction: Int[Array | np.ndarray, " t"],
    ) -> tuple[Array | np.ndarray, ...]:
        return positions[:, 0], direction

    @property
    def bilateral(self) -> bool:
        """Whether each direction has a table of its own."""
        return self.neg is not None

    @property
    def input_nodes(self) -> AbstractNodes:
        """The nodes as the look-up uses them: with the modulo transition, if any."""
        if self.modulo is None or self.modulo is False:
            return self.nodes
        return ModuloNodes(self.nodes, None if self.modulo is True else self.modulo)

    @property
    def values(self) -> Float[Array, " n"]:
        """All entries in a row, as `stencil` counts them: pos, then neg."""
        if self.neg is None:
            return jnp.asarray(self.pos)
        return jnp.concatenate([self.pos, self.neg])

    @eqx.filter_jit
    def entry(
        self,
        position: Float[Array | np.ndarray, " t"],
        direction: Real[Array | np.ndarray, " t"] | int = 1,
    ) -> Float[Array, " t"]:
        """Return the table's value in mm at positions in mm.

        Args:
            position: Of the axis in mm or °.
            direction: Of the motion, per sample or for all: negative takes the entries
                for negative direction, all else those for positive (S-21).
        """
        place = jnp.asarray(position, dtype=jnp.float64)
        return interpolate(
            self.values,
            (self.input_nodes.coordinate(place),),
            (self.nodes.count,),
            self._branch(place, direction),
        )

    def offset(
        self,
        position: Float[Array | np.ndarray, " t"],
        direction: Real[Array | np.ndarray, " t"] | int = 1,
    ) -> Float[Array, " t"]:
        """Return what the controller adds to the axis in mm; arguments as `entry`."""
        return self.sign * self.entry(position, direction)

    def blended_offset(
        self,
        position: Float[Array | np.ndarray, " t"],
        negative_share: Float[Array | np.ndarray, " t"],
    ) -> Float[Array, " t"]:
        """Return the offset in mm while a reversal is spread over cycles (S-63).

        Args:
            position: Of the axis in mm or °.
            negative_share: How far the change to the entries for negative direction has
                come, 0 to 1.
        """
        share = jnp.asarray(negative_share, dtype=jnp.float64)
        positive, negative = self.offset(position, 1), self.offset(position, -1)
        return (1.0 - share) * positive + share * negative

    @eqx.filter_jit
    def stencil(
        self,
        position: Float[Array | np.ndarray, " t"],
        direction: Real[Array | np.ndarray, " t"] | int = 1,
    ) -> Stencil:
        """Return the 2 nodes that each position touches: ``branch * count + i``."""
        place = jnp.asarray(position, dtype=jnp.float64)
        return linear_stencil(
            (self.input_nodes.coordinate(place),),
            (self.nodes.count,),
            self._branch(place, direction),
            tables=2 if self.bilateral else 1,
        )

    def _branch(
        self,
        position: Float[Array, " t"],
        direction: Real[Array | np.ndarray, " t"] | int,
    ) -> Int[Array, " t"] | None:
        if not self.bilateral:
            return None
        negative = jnp.asarray(direction) < 0
        return jnp.broadcast_to(negative, position.shape).astype(jnp.int32)
