"""The other reading of the friction delay: values held where the motion reverses."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._nodes import float_array
from ._running import last_flagged


@final
class HoldState(eqx.Module):
    """What is carried from one piece of a log to the next."""

    last: Float[Array, ""]
    """Value of the last cycle, in the unit of the values."""
    held: Float[Array, ""]
    """Value of the cycle before the last reversal."""
    age: Int[Array, ""]
    """Cycles since the first one of the new direction, which counts 1; at most n + 1."""


@final
class ReversalHold(eqx.Module):
    """Holds a value for n cycles from each reversal on, then lets the values through.

    Held is the value of the cycle before the first one of the new direction (S-31).
    """

    cycles: int = eqx.field(static=True)
    """Number of cycles n."""

    def start(self) -> HoldState:
        """Return the state before the first cycle: nothing is held."""
        return HoldState(
            last=float_array(0.0),
            held=float_array(0.0),
            age=jnp.asarray(self.cycles + 1, dtype=jnp.int32),
        )

    def run(
        self,
        state: HoldState,
        values: Float[Array, " t"],
        reverses: Bool[Array, " t"],
    ) -> tuple[Float[Array, " t"], HoldState]:
        """Return the values as they come through, and the state after them.

        Args:
            state: Of `start` or of the piece before.
            values: One per cycle.
            reverses: Whether the cycle is the first one of a new direction.
        """
        numbers = jnp.arange(1, values.size + 1, dtype=jnp.int32)
        since = last_flagged(reverses)
        any_yet = since > 0
        before = jnp.concatenate([state.last[None], values[:-1]])
        held = jnp.where(any_yet, before[jnp.maximum(since - 1, 0)], state.held)
        age = jnp.where(any_yet, numbers - since + 1, state.age + numbers)
        result = jnp.where(age <= self.cycles, held, values)
        after = HoldState(
            last=values[-1],
            held=held[-1],
            age=jnp.minimum(age[-1], self.cycles + 1),
        )
        return result, after
