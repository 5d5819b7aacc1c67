"""Which way an axis moves, cycle by cycle: the direction of its last step."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ._kernels import take
from ._nodes import Values, float_array
from ._running import last_flagged


@final
class DirectionState(eqx.Module):
    """Where an axis stands and which way it went last."""

    direction: Float[Values, ""] = eqx.field(converter=float_array)
    """Of the last step, ±1; before the first one the direction to start from (S-21)."""
    position: Float[Values, ""] = eqx.field(converter=float_array)
    """In the last cycle, in mm or °; without a meaning before the first cycle."""
    begun: Bool[Array, ""]
    """Whether there was a cycle: the first position of all is no step."""
    moved: Bool[Array, ""]
    """Whether there was a step: by it the first motion of all is recognised (S-28)."""

    @classmethod
    def start(cls, direction: int = 1) -> "DirectionState":
        """Return the state before the first cycle (`Conventions.start_direction`)."""
        return cls(
            direction=float_array(direction),
            position=float_array(0.0),
            begun=jnp.zeros((), dtype=bool),
            moved=jnp.zeros((), dtype=bool),
        )


@eqx.filter_jit
def directions(
    state: DirectionState, position: Float[Array, " t"]
) -> tuple[Float[Array, " t"], Bool[Array, " t"], DirectionState]:
    """Return the direction ±1 per cycle, where it reverses, and the state after.

    The direction is that of the last step that was one: at standstill it stays what it
    was. It reverses in the first cycle of the new direction, however long the axis
    stood before; the first motion of all reverses the direction to start from, if it
    goes against it (`first_motion` marks its cycle in either case). Nothing of it
    depends on position by a derivative.
    """
    if position.size == 0:
        return position, jnp.zeros(0, dtype=bool), state
    step = _steps(state, position)
    direction = last_of(jnp.sign(step), state.direction)
    before = jnp.concatenate([state.direction[None], direction[:-1]])
    after = DirectionState(
        direction=direction[-1],
        position=position[-1],
        begun=jnp.ones((), dtype=bool),
        moved=state.moved | jnp.any(step != 0.0),
    )
    return direction, direction != before, lax.stop_gradient(after)


@eqx.filter_jit
def last_of(marks: Float[Array, " t"], start: Float[Array, ""]) -> Float[Array, " t"]:
    """Return the last mark up to each cycle that is not 0; before the first `start`."""

    def fill(marks: Array) -> Array:
        last = last_flagged(marks != 0.0)
        return jnp.where(last > 0, take(marks, jnp.maximum(last - 1, 0)), start)

    # Mostly there is none that is 0. XLA also stores what a condition gives, else it
    # would work it out again in every place where it is used.
    filled: Array = lax.cond(jnp.any(marks == 0.0), fill, lambda marks: marks, marks)
    return filled


def first_motion(
    state: DirectionState, position: Float[Array, " t"]
) -> Bool[Array, " t"]:
    """Return whether the first step of all comes in this cycle (at most one does)."""
    moving = _steps(state, position) != 0.0
    first = jnp.arange(position.size) == jnp.argmax(moving)
    return moving & first & ~state.moved


def _steps(state: DirectionState, position: Float[Array, " t"]) -> Float[Array, " t"]:
    """Return the change of position since the cycle before, in mm or °."""
    place = lax.stop_gradient(position)
    before = jnp.where(state.begun, state.position, place[0])
    return place - jnp.concatenate([before[None], place[:-1]])
