"""Volumetric compensation: offsets of up to three axes over the positions of three."""

import math
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._nodes import AbstractNodes, EquidistantNodes, Values, float_array
from ._primitive import interpolate
from ._stencil import Stencil, linear_stencil


@final
class VolumetricGrid(eqx.Module):
    """Offsets of up to three axes on a regular grid over X, Y and Z.

    Trilinear between the eight nodes of a cell; outside, the edge is held. Units: mm in,
    mm out. No list holds such a grid: it acts as an external compensation
    (``ExternalCompensation(grid.offset)``).

    The derivative with respect to a position is the right-hand one: at a node that of
    the cell which begins there, 0 outside and from the last node on.
    """

    nodes: tuple[AbstractNodes, AbstractNodes, AbstractNodes]
    """Nodes along X, Y and Z."""
    values: Float[Values, "c k j i"] = eqx.field(converter=float_array)
    """Entries in mm: one table per axis in `axes`, with k along Z, j along Y, i along X."""
    axes: tuple[int, ...] = eqx.field(default=(0, 1, 2), static=True)
    """Axis that each table adds to: 0 for X, 1 for Y, 2 for Z."""
    sign: float = eqx.field(default=1.0, static=True)
    """Offset per entry: +1 or −1."""

    def __check_init__(self) -> None:
        if sorted(set(self.axes)) != list(self.axes) or not set(self.axes) <= {0, 1, 2}:
            msg = f"axes must ascend from 0, 1, 2, each once, got {self.axes!r}."
            raise ValueError(msg)
        expected = (len(self.axes), *self._shape)
        if self.values.shape != expected:
            msg = (
                "values must have one table per axis, with one entry per node of Z, Y "
                f"and X, {expected}, got shape {self.values.shape}."
            )
            raise ValueError(msg)

    @classmethod
    def regular(
        cls,
        start: tuple[float, float, float],
        interval: tuple[float, float, float],
        values: Float[Array | np.ndarray, "c k j i"],
        axes: tuple[int, ...] = (0, 1, 2),
        sign: float = 1.0,
    ) -> "VolumetricGrid":
        """Return a grid with an interval in mm per axis, X first."""
        counts = reversed(values.shape[1:])
        x, y, z = (
            EquidistantNodes(float_array(first), float_array(step), count)
            for first, step, count in zip(start, interval, counts, strict=True)
        )
        return cls((x, y, z), float_array(values), axes, sign)

    @eqx.filter_jit
    def entry(self, positions: Float[Array | np.ndarray, "t 3"]) -> Float[Array, "t c"]:
        """Return the value of each table in mm at positions (X, Y, Z) in mm."""
        coordinates = self._coordinates(positions)

        def table(values: Float[Array, "k j i"]) -> Float[Array, " t"]:
            return interpolate(values.reshape(-1), coordinates, self._shape)

        return jax.vmap(table, out_axes=1)(self.values)

    def offset(
        self, positions: Float[Array | np.ndarray, "t 3"]
    ) -> Float[Array, "t 3"]:
        """Return what is added to X, Y and Z, in mm; 0 for an axis without a table."""
        entry = self.sign * self.entry(positions)
        empty = jnp.zeros((entry.shape[0], 3))
        return empty.at[:, np.array(self.axes)].set(entry)

    @eqx.filter_jit
    def stencil(self, positions: Float[Array | np.ndarray, "t 3"]) -> Stencil:
        """Return the 8 nodes of one table that each position touches, in its order.

        Node (k, j, i) has the number ``(k · count of Y + j) · count of X + i``.
        """
        return linear_stencil(self._coordinates(positions), self._shape)

    @property
    def size(self) -> int:
        """Number of nodes of one table."""
        return math.prod(self._shape)

    @property
    def _shape(self) -> tuple[int, int, int]:
        x, y, z = self.nodes
        return z.count, y.count, x.count

    def _coordinates(
        self, positions: Float[Array | np.ndarray, "t 3"]
    ) -> tuple[Float[Array, " t"], ...]:
        place = jnp.asarray(positions, dtype=jnp.float64)
        return tuple(self.nodes[axis].coordinate(place[:, axis]) for axis in (2, 1, 0))
