"""Friction laws: the current that an axis needs at a velocity, as a table or in words."""

import abc
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._nodes import Setpoints, Values, float_array, is_known
from ._primitive import interpolate
from ._stencil import Stencil, linear_stencil


class AbstractFriction(eqx.Module):
    """Maps the velocity of an axis to the current that its friction takes up.

    Positive currents drive in positive direction. The sign changes hard at rest: there
    the current is 0, and so is, by rule, its derivative with respect to the velocity.
    """

    @abc.abstractmethod
    def level(
        self,
        speed: Float[Array | np.ndarray, " t"],
        direction: Float[Array | np.ndarray, " t"],
    ) -> Float[Array, " t"]:
        """Return how much current supports the motion, in drive units.

        Args:
            speed: |v| in mm/s or °/s; at 0 the limit of small speeds.
            direction: Of the motion: negative, or anything else for positive.
        """

    @abc.abstractmethod
    def numpy_level(
        self, speed: Float[np.ndarray, " t"], direction: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return what `level` does, computed by NumPy."""

    def __call__(self, velocity: Float[Array | np.ndarray, " t"]) -> Float[Array, " t"]:
        """Return the current in drive units at velocities in mm/s or °/s."""
        moving = jnp.asarray(velocity, dtype=jnp.float64)
        direction = jnp.sign(moving)
        return direction * self.level(jnp.abs(moving), direction)

    def evaluate(self, velocity: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return what a call does by NumPy: nothing is compiled for each new length."""
        direction = np.sign(velocity)
        return np.asarray(direction * self.numpy_level(np.abs(velocity), direction))


@final
class FrictionTable(AbstractFriction):
    """The table of a friction list: current over speed, the same in both directions.

    Linear in |v| between entries; below the first and above the last entry that entry
    is held (S-27). The derivative with respect to the speed is the right-hand one: at a
    node that of the cell which begins there.
    """

    nodes: Setpoints
    """Speeds of the entries in mm/s or °/s, not negative (P-COMP-00046)."""
    values: Float[Values, " p"] = eqx.field(converter=float_array)
    """Entries in drive units (P-COMP-00047)."""
    scaling: Float[Values, ""] = eqx.field(default=1.0, converter=float_array)
    """Share of the entries that acts: scaling_factor / 1000 (P-COMP-00045)."""
    held_below: bool = eqx.field(default=True, static=True)
    """Below the first entry it is held; else a line from 0 at rest leads to it."""
    held_above: bool = eqx.field(default=True, static=True)
    """Above the last entry it is held; else the last segment goes on."""

    def __check_init__(self) -> None:
        if self.values.shape != (self.nodes.count,):
            msg = (
                f"values must have one entry per node, ({self.nodes.count},), "
                f"got shape {self.values.shape}."
            )
            raise ValueError(msg)
        # By NumPy: an operation of JAX on one number takes longer than all the rest.
        if is_known(self.nodes.points) and np.asarray(self.nodes.points)[0] < 0:
            msg = f"speeds cannot be negative, got {self.nodes.points[0]!s} mm/s."
            raise ValueError(msg)

    @eqx.filter_jit
    def level(
        self,
        speed: Float[Array | np.ndarray, " t"],
        direction: Float[Array | np.ndarray, " t"],
    ) -> Float[Array, " t"]:
        """Return the scaled entry at speeds ≥ 0 in drive units, for any direction."""
        del direction
        place = jnp.asarray(speed, dtype=jnp.float64)
        count = self.nodes.count
        value = interpolate(self.values, (self.nodes.coordinate(place),), (count,))
        if not self.held_below:
            value = value * self._rise(place)
        if not self.held_above and count > 1:
            value = value + self._beyond(place) * (self.values[-1] - self.values[-2])
        return jnp.asarray(self.scaling * value)

    def numpy_level(
        self, speed: Float[np.ndarray, " t"], direction: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return what `level` does, computed by NumPy."""
        del direction
        first, weights = self.numpy_weights(speed)
        values = np.append(np.asarray(self.values), 0.0)  # a table may have one node
        return np.asarray(weights[0] * values[first] + weights[1] * values[first + 1])

    def numpy_weights(
        self, speed: Float[np.ndarray, " t"]
    ) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "2 t"]]:
        """Return the first of the 2 nodes of each speed ≥ 0 and both weights, by NumPy.

        What `stencil` gives for positive velocities.
        """
        points = np.asarray(self.nodes.points)
        first, weights = linear_weights(points, speed)
        if not self.held_below and points[0] > 0:
            weights *= np.minimum(speed / points[0], 1.0)
        if not self.held_above and len(points) > 1:
            beyond = np.maximum(speed - points[-1], 0.0) / (points[-1] - points[-2])
            weights += np.stack([-beyond, beyond])
        return first, np.asarray(self.scaling) * weights

    @eqx.filter_jit
    def stencil(self, velocity: Float[Array | np.ndarray, " t"]) -> Stencil:
        """Return the 2 nodes that each velocity touches, sign and scaling in weights.

        A call of the stencil gives what a call of the table gives; at rest its weights
        are 0.
        """
        moving = jnp.asarray(velocity, dtype=jnp.float64)
        speed = jnp.abs(moving)
        stencil = linear_stencil((self.nodes.coordinate(speed),), (self.nodes.count,))
        weights = stencil.weights
        if not self.held_below:
            weights = weights * self._rise(speed)[:, None]
        if not self.held_above and self.nodes.count > 1:
            beyond = self._beyond(speed)
            weights = weights + jnp.stack([-beyond, beyond], axis=1)
        weights = weights * (self.scaling * jnp.sign(moving))[:, None]
        return Stencil(nodes=stencil.nodes, weights=weights, size=stencil.size)

    def _rise(self, speed: Float[Array, " t"]) -> Float[Array, " t"]:
        """Return how far the line from rest to the first entry has come, up to 1."""
        first = self.nodes.points[0]
        return jnp.where(speed < first, speed / jnp.where(first > 0.0, first, 1.0), 1.0)

    def _beyond(self, speed: Float[Array, " t"]) -> Float[Array, " t"]:
        """Return how far each speed lies above the last entry, in widths of a cell."""
        last = self.nodes.points[-1]
        excess = (speed - last) / (last - self.nodes.points[-2])
        return jnp.where(speed >= last, excess, 0.0)


def linear_weights(
    points: Float[np.ndarray, " p"], position: Float[np.ndarray, " t"]
) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "2 t"]]:
    """Return the first of the 2 nodes of each position and both weights, held outside.

    What `FrictionTable.stencil` gives for positive velocities, by NumPy.
    """
    place = np.interp(position, points, np.arange(float(len(points))))
    whole = np.nan_to_num(place).astype(np.int64)  # NaN stays in the weights
    first = np.minimum(whole, max(len(points) - 2, 0))
    return first, np.stack([1.0 - (place - first), place - first])


def sample_friction(
    law: AbstractFriction, knots: Float[Array | np.ndarray, " p"]
) -> FrictionTable:
    """Return the table that takes a law's values at the given speeds.

    A list knows no direction: where the law depends on it, the mean of both directions
    is taken. The entry at speed 0 is the limit of small speeds. Differentiable in the
    parameters of the law and in the knots.

    Args:
        law: The friction law, currents in drive units.
        knots: Speeds of the entries in mm/s or °/s, ascending, not negative.
    """
    speed = jnp.asarray(knots, dtype=jnp.float64)
    forward = jnp.ones_like(speed)
    values = 0.5 * (law.level(speed, forward) + law.level(speed, -forward))
    return FrictionTable(Setpoints(speed), values)
