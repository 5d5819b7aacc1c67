r"""The axis in motion: a mass with friction under a measured force, and how it depends on both.

Semi-implicit steps: viscous friction acts at the new velocity, Coulomb friction against the
old one, for as long as it takes to stop the axis; what is left of the step it either sticks
or sets off the other way. So there is no smoothed sign, and nothing depends on where in a
step a reversal falls: a rule that lets the axis stick for the rest of the step would make the
cost as bumpy as there are reversals.

The recursion itself is a scan over scalars, which costs little; carrying the derivatives along
would cost ten times that. They obey a *linear* recursion with the same factor for all
parameters, which is solved afterwards in lanes (`linear_chain`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

SUBSTEPS = 2
"""Steps of the simulation per sample."""
CANONICAL = (
    "inertia",
    "offset",
    "coulomb_positive",
    "coulomb_negative",
    "viscous_positive",
    "viscous_negative",
    "drop_positive",
    "drop_negative",
    "log_stribeck_velocity",
)
"""What every axis is made of, whatever of it is shared or left out."""
_LANES = 224
_TINY = 1e-300


class Drive(NamedTuple):
    """What acts on the axis, window by window.

    Attributes:
        force: Load in force units, held over the time step that begins with its sample.
        window: Window of each sample, from 0.
        first: Whether a window begins with this sample.
        step: Time from sample to sample in s.
    """

    force: Float[Array, " t"]
    window: Int[Array, " t"]
    first: Bool[Array, " t"]
    step: Float[Array, ""]


class Run(NamedTuple):
    """Where the axis went.

    Attributes:
        travel: Way from the start of its window to the end of each sample's step, in mm.
        velocity: At the end of each substep, in mm/s.
        slopes: Derivative of the travel with respect to each parameter, and last to the
            velocity at the start of its window.
    """

    travel: Float[Array, " t"]
    velocity: Float[Array, " n"]
    slopes: Float[Array, "t p"]


def linear_chain(
    factor: Float[Array, " n"], add: Float[Array, "n p"]
) -> Float[Array, "n p"]:
    """Return all states of $w_{k+1} = a_k w_k + b_k$ from rest, after each step.

    In lanes: every lane runs its stretch from 0 and, beside it, from 1; one short pass over
    the lanes then tells each what it really started from.
    """
    count, width = add.shape
    lanes = min(_LANES, count)
    stretch = -(-count // lanes)
    lack = lanes * stretch - count
    a = jnp.pad(factor, (0, lack)).reshape(lanes, stretch).T
    b = jnp.pad(add, ((0, lack), (0, 0))).reshape(lanes, stretch, width)
    b = b.transpose(1, 2, 0)

    def along(
        carry: tuple[Array, Array], now: tuple[Array, Array]
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        share, state = carry
        share, state = now[0] * share, now[0][None] * state + now[1]
        return (share, state), (share, state)

    start = (jnp.ones_like(a[0]), jnp.zeros_like(b[0]))
    (last_share, last), (shares, states) = lax.scan(along, start, (a, b))

    def across(state: Array, lane: tuple[Array, Array]) -> tuple[Array, Array]:
        return lane[0] * state + lane[1], state

    _, begun = lax.scan(across, jnp.zeros(width), (last_share, last.T))
    full = states + shares[:, None, :] * begun.T[None]
    return full.transpose(2, 0, 1).reshape(lanes * stretch, width)[:count]


def _after(
    parameters: Float[Array, " 9"], before: Array, force: Array, small: Array
) -> Array:
    """Return the velocities after one substep each; scalars or arrays of steps."""
    m, o, c_pos, c_neg, b_pos, b_neg, d_pos, d_neg, log_speed = parameters
    gain, push = small / m, force - o
    ahead = jnp.where(before == 0, push, before) > 0
    sign = jnp.where(ahead, 1.0, -1.0)
    decay = jnp.exp(-jnp.square(before * jnp.exp(-log_speed)))
    level = jnp.where(ahead, c_pos, c_neg) + jnp.where(ahead, d_pos, d_neg) * decay
    rate = sign * push - level
    # Speed along the old direction at the end of the step, were friction not to turn.
    speed = sign * before + gain * rate
    onward = speed / (1.0 + gain * jnp.where(ahead, b_pos, b_neg))
    goes_on = speed > 0
    # Stopped on the way: the rest of the step is left for the other direction.
    left = speed / jnp.where(goes_on, -1.0, jnp.minimum(rate, -_TINY))
    level_back = jnp.where(ahead, c_neg + d_neg, c_pos + d_pos)
    rate_back = -sign * push - level_back
    back = left * rate_back / (1.0 + left * jnp.where(ahead, b_neg, b_pos))
    turned = jnp.where(rate_back > 0, -back, 0.0)
    return sign * jnp.where(goes_on, onward, turned)


def _linearised(
    parameters: Float[Array, " 9"],
    before: Float[Array, " n"],
    force: Float[Array, " n"],
    small: Float[Array, ""],
) -> tuple[Float[Array, " n"], Float[Array, "n 9"]]:
    """Return how each step's new velocity follows from its old one and the parameters."""

    def after(given: Array, old: Array) -> Array:
        return _after(given, old, force, small)

    _, factor = jax.jvp(
        lambda old: after(parameters, old), (before,), (jnp.ones_like(before),)
    )
    return factor, jax.jacfwd(after)(parameters, before)


def simulate(
    parameters: Float[Array, " 9"],
    mixing: Float[Array, "9 p"],
    start: Float[Array, " w"],
    drive: Drive,
) -> Run:
    """Run the axis through all windows, with derivatives.

    Args:
        parameters: As in `CANONICAL`, in force units over mm/s and mm/s².
        mixing: Derivative of these with respect to what is fitted.
        start: Velocity at the start of each window in mm/s.
        drive: What acts on it.
    """
    small = drive.step / SUBSTEPS
    given = start[drive.window]

    def once(
        velocity: Array, now: tuple[Array, Array, Array]
    ) -> tuple[Array, tuple[Array, Array]]:
        force, first, begin = now
        one = _after(parameters, jnp.where(first, begin, velocity), force, small)
        two = _after(parameters, one, force, small)
        return two, (one, two)

    _, both = lax.scan(once, jnp.zeros(()), (drive.force, drive.first, given))
    velocity = jnp.stack(both, axis=1).reshape(-1)
    force = jnp.repeat(drive.force, SUBSTEPS)
    begins = jnp.zeros(force.shape, bool).at[::SUBSTEPS].set(drive.first)
    shifted = jnp.concatenate([velocity[:1], velocity[:-1]])
    before = jnp.where(begins, jnp.repeat(given, SUBSTEPS), shifted)
    factor, slopes = _linearised(parameters, before, force, small)
    # The first step of a window has no past to pass on, but a velocity that was given.
    passed, own = jnp.where(begins, 0.0, factor), jnp.where(begins, factor, 0.0)
    slopes = jnp.concatenate(
        [jnp.zeros_like(own)[:, None], slopes @ mixing, own[:, None]], axis=1
    )
    kept = jnp.where(begins, 0.0, 1.0)

    def chain(stage: Array, ways: Array) -> Array:
        # Slopes of the velocity first, then ways of both: one loop, compiled once.
        found = linear_chain(jnp.where(stage == 0, passed, kept), ways)
        return jnp.where(stage == 0, small * found.at[:, 0].set(velocity), found)

    ways = lax.fori_loop(0, 2, chain, slopes)[SUBSTEPS - 1 :: SUBSTEPS]
    return Run(ways[:, 0], velocity, ways[:, 1:])


run_axis = jax.jit(simulate)
"""`simulate`, compiled once per length and number of parameters."""
