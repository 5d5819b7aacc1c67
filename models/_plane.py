"""Plane compensation: an offset over the positions of two master axes."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._lookup import AbstractLookup
from ._nodes import AbstractNodes, EquidistantNodes, Values, float_array
from ._primitive import interpolate
from ._stencil import Stencil, linear_stencil


@final
class Plane(AbstractLookup):
    """Plane compensation of one slave axis.

    Bilinear between the four nodes of a cell (S-16); outside, the edge is held. Units:
    mm (rotary masters: °) in, mm out.

    The derivative with respect to a position is the right-hand one: at a node that of
    the cell which begins there, 0 outside and from the last node on.
    """

    nodes1: AbstractNodes
    """Nodes along master 1."""
    nodes2: AbstractNodes
    """Nodes along master 2."""
    values: Float[Values, "j i"] = eqx.field(converter=float_array)
    """Table entries in mm, ``[j, i]`` with j along master 2 (S-17)."""
    sign: float = eqx.field(default=1.0, static=True)
    """Offset per entry: +1 or −1 (S-11)."""

    def __check_init__(self) -> None:
        expected = (self.nodes2.count, self.nodes1.count)
        if self.values.shape != expected:
            msg = (
                f"values must have one row per node of master 2 and one column per "
                f"node of master 1, {expected}, got shape {self.values.shape}."
            )
            raise ValueError(msg)

    @classmethod
    def quadratic(
        cls,
        start: tuple[float, float],
        interval: float,
        values: Float[Array | np.ndarray, "j i"],
        sign: float = 1.0,
    ) -> "Plane":
        """Return a plane with one interval for both masters (grid QUADRATIC)."""
        return cls.rectangular(start, (interval, interval), values, sign)

    @classmethod
    def rectangular(
        cls,
        start: tuple[float, float],
        interval: tuple[float, float],
        values: Float[Array | np.ndarray, "j i"],
        sign: float = 1.0,
    ) -> "Plane":
        """Return a plane with an interval per master, master 1 first (RECTANGULAR)."""
        nodes1, nodes2 = (
            EquidistantNodes(float_array(first), float_array(step), count)
            for first, step, count in zip(
                start, interval, reversed(values.shape), strict=True
            )
        )
        return cls(
            nodes1=nodes1,
            nodes2=nodes2,
            values=float_array(values),
            sign=sign,
        )

    @property
    def ways(self) -> tuple[AbstractNodes, ...]:
        return self.nodes1, self.nodes2

    @property
    def tables(self) -> tuple[Float[Array | np.ndarray, "j i"], ...]:
        return (self.values,)

    def looked_up(
        self,
        positions: Float[Array | np.ndarray, "t d"],
        direction: Int[Array | np.ndarray, " t"],
    ) -> tuple[Array | np.ndarray, ...]:
        return (positions[:, :2],)

    @eqx.filter_jit
    def entry(self, positions: Float[Array | np.ndarray, "t 2"]) -> Float[Array, " t"]:
        """Return the table's value in mm at positions (master 1, master 2) in mm."""
        return interpolate(
            self.values.reshape(-1), self._coordinates(positions), self._shape
        )

    def offset(self, positions: Float[Array | np.ndarray, "t 2"]) -> Float[Array, " t"]:
        """Return what the controller adds to the slave axis, in mm."""
        return self.sign * self.entry(positions)

    @eqx.filter_jit
    def stencil(self, positions: Float[Array | np.ndarray, "t 2"]) -> Stencil:
        """Return the 4 nodes that each position touches, ``j * count1 + i``."""
        return linear_stencil(self._coordinates(positions), self._shape)

    @property
    def _shape(self) -> tuple[int, int]:
        return self.nodes2.count, self.nodes1.count

    def _coordinates(
        self, positions: Float[Array | np.ndarray, "t 2"]
    ) -> tuple[Float[Array, " t"], Float[Array, " t"]]:
        place = jnp.asarray(positions, dtype=jnp.float64)
        return self.nodes2.coordinate(place[:, 1]), self.nodes1.coordinate(place[:, 0])
