r"""An axis in motion: a mass with friction under a measured force, and its sensitivities.

$m\,\dot v = f - o - \mathrm{sign}(v)\,F(|v|)$ in semi-implicit steps: viscous friction acts at
the new velocity, dry friction against the old one, for as long as it takes to stop the axis. For
what is left of the step the axis either sticks or sets off the other way. There is no smoothed
sign, and the path is continuous in every parameter, wherever in a step a reversal falls.

The derivative is written by hand (`jax.custom_jvp`): each step is linearised for itself, all steps
at once, and the tangents then follow a linear recursion. Differentiation through the loop would
cost 25 times that, and take half a minute to compile.
"""

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ...models import StribeckFriction

_SHORTEST = 16384
"""Steps that every compiled simulation has room for."""
_TINY = 1e-300


@final
class Drive(eqx.Module):
    """An axis under a force: what is fitted.

    Attributes:
        inertia: Force per mm/s² of acceleration, positive.
        offset: Constant load in force units.
        law: Friction; `StribeckFriction.viscous` must not be so negative that it turns the
            inertia of a step round.
    """

    inertia: Float[Array, ""]
    offset: Float[Array, ""]
    law: StribeckFriction


@final
class Excitation(eqx.Module):
    """What drives the axis, time step by time step.

    Attributes:
        force: Held over each step, in force units.
        begins: Whether the axis is set down anew before the step.
        velocity: With which it is set down there, in mm/s; elsewhere without meaning.
        step: Length of the steps in s.
    """

    force: Float[Array, " t"]
    begins: Bool[Array, " t"]
    velocity: Float[Array, " t"]
    step: Float[Array, ""]


def padded(values: np.ndarray) -> np.ndarray:
    """Return values with zeros (or False) behind, up to a power of two and at least 16 384.

    Recordings of all lengths up to one of these meet the same compiled functions.
    """
    length = max(_SHORTEST, 1 << (len(values) - 1).bit_length())
    return np.concatenate([values, np.zeros(length - len(values), values.dtype)])


@jax.custom_jvp
def travel(drive: Drive, excitation: Excitation) -> Float[Array, " t"]:
    """Return how far the axis is at the end of each step from where it was set down, in mm.

    Differentiable (forward) with respect to the drive, the forces and the velocities.
    """
    return _simulate(drive, excitation)[2]


@travel.defjvp
def _travel_jvp(
    primals: tuple[Drive, Excitation], tangents: tuple[Drive, Excitation]
) -> tuple[Float[Array, " t"], Float[Array, " t"]]:
    drive, given = primals
    small = 0.5 * given.step
    first, second, way = _simulate(drive, given)
    before = jnp.where(given.begins, given.velocity, jnp.roll(second, 1))

    def linearised(old: Array) -> tuple[Array, Array]:
        """Return the slope of the new velocity by the old one, and its other change."""
        _, slope = jax.jvp(
            lambda v: _half_step(drive, v, given.force, small),
            (old,),
            (jnp.ones_like(old),),
        )
        _, change = jax.jvp(
            lambda d, f: _half_step(d, old, f, small),
            (drive, given.force),
            (tangents[0], tangents[1].force),
        )
        return slope, change

    def follow(
        carry: tuple[Array, Array], now: tuple[Array, ...]
    ) -> tuple[tuple[Array, Array], Array]:
        velocity, way = carry
        begins, set_down, slope, change, next_slope, next_change = now
        velocity = slope * jnp.where(begins, set_down, velocity) + change
        way = jnp.where(begins, 0.0, way) + small * velocity
        velocity = next_slope * velocity + next_change
        way = way + small * velocity
        return (velocity, way), way

    steps = (*linearised(before), *linearised(first))
    still = (jnp.zeros(()), jnp.zeros(()))
    moved = (given.begins, tangents[1].velocity, *steps)
    return way, lax.scan(follow, still, moved)[1]


def _simulate(
    drive: Drive, given: Excitation
) -> tuple[Float[Array, " t"], Float[Array, " t"], Float[Array, " t"]]:
    """Return the velocities at the middle and the end of each step, and the travel."""
    small = 0.5 * given.step

    def once(
        carry: tuple[Array, Array], now: tuple[Array, Array, Array]
    ) -> tuple[tuple[Array, Array], tuple[Array, Array, Array]]:
        velocity, way = carry
        force, begins, set_down = now
        velocity = jnp.where(begins, set_down, velocity)
        first = _half_step(drive, velocity, force, small)
        second = _half_step(drive, first, force, small)
        way = jnp.where(begins, 0.0, way) + small * (first + second)
        return (second, way), (first, second, way)

    # A law takes arrays: a step is one of a single element.
    still = (jnp.zeros(1), jnp.zeros(1))
    force, begins = given.force[:, None], given.begins[:, None]
    steps = (force, begins, given.velocity[:, None])
    first, second, way = (each[:, 0] for each in lax.scan(once, still, steps)[1])
    return first, second, way


def _half_step(
    drive: Drive,
    before: Float[Array, " t"],
    force: Float[Array, " t"],
    small: Float[Array, ""],
) -> Float[Array, " t"]:
    """Return the velocities after half a time step each."""
    law = drive.law
    dry = eqx.tree_at(lambda each: each.viscous, law, jnp.zeros(()))
    viscous = jnp.broadcast_to(law.viscous, (2,))
    gain, push = small / drive.inertia, force - drive.offset
    forward = jnp.where(before == 0, push, before) > 0
    sign = jnp.where(forward, 1.0, -1.0)
    rate = sign * push - dry.level(jnp.abs(before), sign)
    # Speed in the old direction at the end, were friction to go on in its direction.
    speed = sign * before + gain * rate
    goes_on = speed > 0
    onward = speed / (1.0 + gain * jnp.where(forward, viscous[0], viscous[1]))
    # Stopped on the way: the rest of the time is left for the other direction.
    left = speed / jnp.where(goes_on, -1.0, jnp.minimum(rate, -_TINY))
    back_rate = -sign * push - dry.level(jnp.zeros_like(before), -sign)
    back = left * back_rate / (1.0 + left * jnp.where(forward, viscous[1], viscous[0]))
    turned = jnp.where(back_rate > 0, -back, 0.0)
    return sign * jnp.where(goes_on, onward, turned)
