"""What the controller answers to the offsets of an external compensation."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ._nodes import Values, float_array, is_known

WARNED = 70583
EXCEEDED = 70584
UNLIMITED = 70585
TOO_FAST = 70586


@final
class LimitState(eqx.Module):
    """What the controller remembers of the cycles before."""

    last: Float[Array, "2 a"]
    """Offsets of the last two cycles in mm or °, the older one first."""
    above: Bool[Array, " a"]
    """Whether the last cycle was above the warning limit."""
    active: Bool[Array, ""]
    """Whether the compensation is on: an error switches it off for good."""


@final
class Answer(eqx.Module):
    """What the controller reports, cycle by cycle."""

    codes: Int[Array, "t a"]
    """Number of the report per axis, 0 where there is none. The gravest of a cycle:
    limits missing (70585), limit exceeded (70584), too fast (70586), warning (70583)."""
    active: Bool[Array, " t"]
    """Whether the offsets of the cycle act: not from the first error of any axis on."""


@final
class ExternalLimits(eqx.Module):
    """Limits per axis of what an external compensation may do (P-AXIS-00743 … 745).

    A warning comes when its limit is passed, and again only when it is passed again. An
    error stops the controller and switches the compensation off, for all axes. An error
    limit or an acceleration of 0, as in an axis list that states none, is no limit but
    the report that limits are missing (S-55).
    """

    warning: Float[Values, " a"] = eqx.field(converter=float_array)
    """P-AXIS-00743 in mm or °; 0: no warning."""
    error: Float[Values, " a"] = eqx.field(converter=float_array)
    """P-AXIS-00744 in mm or °."""
    acceleration: Float[Values, " a"] = eqx.field(converter=float_array)
    """P-AXIS-00745 in mm/s² or °/s²."""
    of_change: bool = eqx.field(default=False, static=True)
    """Whether the first two limit the change per cycle instead of the offset (S-54)."""

    def __check_init__(self) -> None:
        shape = self.warning.shape
        if len(shape) != 1 or {self.error.shape, self.acceleration.shape} != {shape}:
            msg = (
                "Limits must have one number per axis, got shapes "
                f"{shape}, {self.error.shape}, {self.acceleration.shape}."
            )
            raise ValueError(msg)
        for name in ("warning", "error", "acceleration"):
            values = getattr(self, name)
            if is_known(values) and not np.all(np.asarray(values) >= 0.0):
                msg = f"{name} must not be negative, got {np.asarray(values)!s}."
                raise ValueError(msg)

    def start(self, offsets: Float[Array | np.ndarray, " a"]) -> LimitState:
        """Return the state in which the compensation is switched on.

        Args:
            offsets: The start offsets in mm or °: nothing moves at that moment.
        """
        first = jnp.asarray(offsets, dtype=jnp.float64)
        return LimitState(
            last=jnp.stack([first, first]),
            above=jnp.zeros(first.shape, dtype=bool),
            active=jnp.ones((), dtype=bool),
        )

    @eqx.filter_jit
    def run(
        self,
        state: LimitState,
        offsets: Float[Array | np.ndarray, "t a"],
        cycle_time: float | Float[Array, ""],
    ) -> tuple[Answer, LimitState]:
        """Return what the controller reports, and the state after it.

        Args:
            state: From `start` or the piece before.
            offsets: In mm or °, one row per cycle.
            cycle_time: In s.
        """
        history = jnp.concatenate([state.last, jnp.asarray(offsets, jnp.float64)])
        now, before, earlier = history[2:], history[1:-1], history[:-2]
        judged = jnp.abs(now - before if self.of_change else now)
        rate = jnp.abs(now - 2.0 * before + earlier) / cycle_time**2
        warning = self.warning[None]
        high = (judged > warning) & (warning > 0.0)
        above = jnp.concatenate([state.above[None], high])
        missing = (self.error == 0.0) | (self.acceleration == 0.0)
        exceeded = judged > self.error[None]
        fast = rate > self.acceleration[None]
        failed = jnp.any(missing[None] | exceeded | fast, axis=1)
        # Reports come up to the first error; it is the first cycle that does not act.
        ended = lax.cummax(failed.astype(jnp.int32)) > 0
        active = state.active & ~ended
        stopped = jnp.concatenate([jnp.zeros(1, dtype=bool), ended])[:-1]
        heard = state.active & ~stopped
        code = jnp.where(high & ~above[:-1], WARNED, 0)
        code = jnp.where(fast, TOO_FAST, code)
        code = jnp.where(exceeded, EXCEEDED, code)
        code = jnp.where(missing[None], UNLIMITED, code)
        after = LimitState(
            last=history[-2:],
            above=above[-1],
            active=state.active & ~jnp.any(failed),
        )
        return Answer(jnp.where(heard[:, None], code, 0), active), after
