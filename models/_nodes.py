"""Where the nodes of a table lie along one axis, and in which cell a position lies."""

import abc
import functools
from typing import TYPE_CHECKING, Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from ._cells import FEWEST, among_few, cell_of
from ._kernels import take, whole
from ._stencil import Stencil, linear_stencil

_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)
"""A position may miss the node it was computed for by a few roundings of this size."""


if TYPE_CHECKING:
    Values = Any
else:
    Values = Array
"""Array of a field that converts what it is given: for a checker of types anything, so that
NumPy arrays and numbers are welcome; when run, a JAX array."""


def float_array(value: Any) -> Array:
    """Return the value as an array of 64-bit floats (converter of all model fields)."""
    if isinstance(value, Array) and value.dtype == jnp.float64:
        return value
    if isinstance(value, (float, int, np.ndarray)):
        # A type converted by JAX takes as long again as all the rest.
        return jnp.asarray(np.asarray(value, dtype=np.float64))
    return jnp.asarray(value, dtype=jnp.float64)


def is_known(array: Array) -> bool:
    """Return whether the array has values to check: not while JAX traces a function."""
    return not isinstance(array, Tracer)


class AbstractNodes(eqx.Module):
    """Node positions of a table along one axis, in mm or °."""

    # A field in one subclass, a property in others: equinox knows `AbstractVar` for it,
    # type checkers know the property.
    if TYPE_CHECKING:

        @property
        @abc.abstractmethod
        def count(self) -> int:
            """Number of nodes."""

    else:
        count: eqx.AbstractVar[int]

    @property
    @abc.abstractmethod
    def positions(self) -> Float[Array, " p"]:
        """Node positions in mm or °, ascending."""

    @abc.abstractmethod
    def coordinate(self, position: Float[Array, " t"]) -> Float[Array, " t"]:
        """Return the place of each position counted in nodes, from 0 to count − 1.

        A position outside is held at the nearest end. The derivative with respect to
        the position is the right-hand one: 0 before the first node, 1/width of the cell
        from its first node on (included) to its last (excluded), 0 from the last on.
        """

    @abc.abstractmethod
    def covers(self, position: Float[Array, " t"]) -> Bool[Array, " t"]:
        """Return whether each position lies in the table, both ends included."""

    def locate(
        self, position: Float[Array, " t"]
    ) -> tuple[Int[Array, " t"], Float[Array, " t"]]:
        """Return each position's cell and where in it the position lies, from 0 to 1.

        The last node belongs to the last cell, at 1. A single node is a cell at 0.
        """
        place = self.coordinate(position)
        cell = jnp.minimum(jnp.floor(place), float(max(self.count - 2, 0)))
        return whole(cell), place - cell

    def stencil(self, position: Float[Array, " t"]) -> Stencil:
        """Return the 2 nodes that each position touches, the ends held."""
        return linear_stencil((self.coordinate(position),), (self.count,))


@final
class EquidistantNodes(AbstractNodes):
    """Nodes at ``start + i · interval``, ``i = 0 … count − 1``."""

    start: Float[Values, ""] = eqx.field(converter=float_array)
    """Position of the first node in mm or °."""
    interval: Float[Values, ""] = eqx.field(converter=float_array)
    """Distance of neighbouring nodes in mm or °, positive."""
    count: int = eqx.field(  # pyright: ignore[reportIncompatibleMethodOverride]
        static=True
    )
    """Number of nodes."""

    def __check_init__(self) -> None:
        if self.count < 1:
            msg = f"A table needs at least one node, got count = {self.count!r}."
            raise ValueError(msg)
        if is_known(self.interval) and not np.all(np.asarray(self.interval) > 0):
            msg = f"interval must be positive, got {self.interval!s}."
            raise ValueError(msg)

    @property
    def positions(self) -> Float[Array, " p"]:
        """Node positions in mm or °, ascending."""
        start, interval = jnp.asarray(self.start), jnp.asarray(self.interval)
        return start + jnp.arange(self.count, dtype=jnp.float64) * interval

    def coordinate(self, position: Float[Array, " t"]) -> Float[Array, " t"]:
        """Return the place of each position counted in nodes, from 0 to count − 1.

        A position within a few roundings of a node is taken as the node itself, so that
        ``start + i * interval`` finds node i and the derivative to its right, however
        that sum was rounded.
        """
        # Not a division: XLA takes it for expensive and stores its result.
        place = (position - self.start) * (1.0 / self.interval)
        return _hold(float(self.count - 1), place, self._slack)

    def covers(self, position: Float[Array, " t"]) -> Bool[Array, " t"]:
        """Return whether each position lies in the table, both ends included."""
        place: Array = (position - self.start) / self.interval
        last = float(self.count - 1)
        return (place >= -self._slack) & (place <= last + self._slack)

    @property
    def _slack(self) -> Float[Array, ""]:
        """How far, counted in nodes, rounding may move a position off its node."""
        extent = jnp.abs(self.start / self.interval) + float(self.count)
        return _ROUNDING * extent


@final
class Setpoints(AbstractNodes):
    """Nodes at given ascending positions."""

    points: Float[Values, " p"] = eqx.field(converter=float_array)
    """Node positions in mm or °, strictly ascending."""

    def __check_init__(self) -> None:
        if self.points.ndim != 1 or self.points.size == 0:
            msg = f"points must be a list of positions, got shape {self.points.shape}."
            raise ValueError(msg)
        if is_known(self.points):
            points = np.asarray(self.points)
            falling = np.flatnonzero(~(np.diff(points) > 0))
            if falling.size:
                first = int(falling[0])
                msg = (
                    f"points must ascend, got {points[first]!s} at index {first} "
                    f"followed by {points[first + 1]!s}."
                )
                raise ValueError(msg)

    @property
    def count(self) -> int:
        """Number of nodes."""
        return int(self.points.shape[-1])

    @property
    def positions(self) -> Float[Array, " p"]:
        """Node positions in mm or °, ascending."""
        return jnp.asarray(self.points)

    def coordinate(self, position: Float[Array, " t"]) -> Float[Array, " t"]:
        """Return the place of each position counted in nodes, from 0 to count − 1."""
        if self.count == 1:
            return jnp.zeros_like(position)
        widths = jnp.diff(self.points)
        if self.count <= FEWEST:
            cell, lower, width = among_few(self.points, widths, position)
        else:
            number = cell_of(
                lax.stop_gradient(self.points), lax.stop_gradient(position)
            )
            lower, width = take(self.points[:-1], number), take(widths, number)
            cell = number.astype(jnp.float64)
        # A division and not a product: that would be fused with the sum or not, rounded
        # once or twice, depending on how many positions there are.
        place = cell + (position - lower) / width
        return _hold(float(self.count - 1), place, jnp.zeros(()))

    def covers(self, position: Float[Array, " t"]) -> Bool[Array, " t"]:
        """Return whether each position lies in the table, both ends included."""
        points = jnp.asarray(self.points)
        return (position >= points[0]) & (position <= points[-1])


@final
class ModuloNodes(AbstractNodes):
    """Nodes of a modulo axis: positions are wrapped into its range before the look-up.

    The list repeats the first value at the last point; this class does not tie the two,
    a table whose ends differ jumps at the transition as it would in the controller.
    """

    nodes: EquidistantNodes | Setpoints
    """Nodes inside the range."""
    limits: tuple[float, float] | None = eqx.field(default=None, static=True)
    """Modulo range of the axis in °; None: from the first node to the last (S-20)."""

    def __check_init__(self) -> None:
        if self.limits is not None and not self.limits[1] > self.limits[0]:
            msg = f"The modulo range must ascend, got {self.limits!r}."
            raise ValueError(msg)
        if self.limits is None and self.nodes.count < 2:
            msg = "A single node leaves the modulo range open: give its limits."
            raise ValueError(msg)

    @property
    def count(self) -> int:
        """Number of nodes, the repeated end included."""
        return self.nodes.count

    @property
    def positions(self) -> Float[Array, " p"]:
        """Node positions in °, ascending, the repeated end included."""
        return self.nodes.positions

    def wrap(self, position: Float[Array, " t"]) -> Float[Array, " t"]:
        """Return the positions wrapped into the range in °, its upper end excluded."""
        if self.limits is None:
            ends = self.nodes.positions
            lower, upper = ends[0], ends[-1]
        else:
            lower, upper = (float_array(limit) for limit in self.limits)
        span = upper - lower
        wrapped = lower + jnp.mod(position - lower, span)
        # A tiny negative remainder rounds up to the span: that is the lower end again.
        return jnp.where(wrapped >= upper, wrapped - span, wrapped)

    def coordinate(self, position: Float[Array, " t"]) -> Float[Array, " t"]:
        """Return the place of each wrapped position counted in nodes."""
        return self.nodes.coordinate(self.wrap(position))

    def covers(self, position: Float[Array, " t"]) -> Bool[Array, " t"]:
        """Return whether each wrapped position lies in the table."""
        return self.nodes.covers(self.wrap(position))


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _hold(
    last: float, place: Float[Array, " t"], slack: Float[Array, ""]
) -> Float[Array, " t"]:
    """Move places within `slack` of a node onto it, and hold both ends."""
    node = jnp.floor(place + slack)
    return jnp.clip(jnp.where(place - node <= slack, node, place), 0.0, last)


@_hold.defjvp
def _hold_jvp(
    last: float,
    primals: tuple[Float[Array, " t"], Float[Array, ""]],
    tangents: tuple[Float[Array, " t"], Float[Array, ""]],
) -> tuple[Float[Array, " t"], Float[Array, " t"]]:
    # The right-hand derivative; that of `clip` would be a half at either end.
    held = _hold(last, *primals)
    inside = (primals[0] >= 0.0) & (held < last)
    return held, jnp.where(inside, tangents[0], 0.0)
