"""Limits as a change of variables, for solvers that know none."""

from collections.abc import Callable
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

PASSES = 4
"""Solves with limits: after each, what rests on one is held there, or let go."""
_NEAR = 1e-2
"""How near to a limit that is, in steps that change the residual by its size."""
_INSIDE = 1e-3
"""How far inside its limits a start begins, in parts of their distance or of itself."""


@final
class Change(eqx.Module):
    r"""Change of variables: a step of one from the start changes the residual by its size.

    Inside limits with $\tanh$. What rests on a limit is held there: the change of
    variables would reach it after infinitely many steps.
    """

    start: Float[Array, " p"]
    unit: Float[Array, " p"]
    limits: tuple[Float[Array, " p"], Float[Array, " p"]]
    held: tuple[Bool[Array, " p"], Bool[Array, " p"]]
    """Whether a number rests on its lower, on its upper limit."""
    length: Float[Array, ""]
    """Of the residual at the start."""

    limited: bool = eqx.field(static=True)
    """Whether any number has a limit."""

    @classmethod
    def of(
        cls,
        residual: Callable[[Float[Array, " p"]], Float[Array, " r"]],
        start: Float[Array, " p"],
        limits: tuple[Float[Array, " p"], Float[Array, " p"]],
        first: Bool[Array, ""],
        limited: bool,
    ) -> "Change":
        """Return the change of variables at a start.

        Args:
            residual: Of the fit.
            start: Moved inside the limits, but for what rests on one.
            limits: Lower and upper ones.
            first: Nothing rests on a limit yet.
            limited: Whether any number has a limit.
        """
        low, high = limits
        natural = jnp.where(start != 0, jnp.abs(start), 1.0)
        width = jnp.minimum(high - low, float(np.finfo(np.float64).max))
        gap = _INSIDE * jnp.minimum(width, natural)
        inside = jnp.clip(start, low + gap, high - gap)
        at = jnp.where(first, inside, start)
        off, design = residual(at), jax.jacfwd(residual)(at)
        length = jnp.linalg.norm(off)
        length = jnp.where(length > 0, length, 1.0)
        norms = jnp.linalg.norm(design, axis=0)
        felt = jnp.isfinite(norms) & (norms > 0)
        unit = jnp.where(felt, length / jnp.where(felt, norms, 1.0), natural)
        unit, slope = jnp.minimum(unit, width), off @ design
        near = jnp.where(first, -1.0, _NEAR) * unit
        held = (at - low <= near) & (slope > 0), (high - at <= near) & (slope < 0)
        fixed = (inside, unit, limits, held, length)
        return cls(*jax.lax.stop_gradient(fixed), limited)

    def values(self, x: Float[Array, " p"]) -> Float[Array, " p"]:
        """Return the numbers of the model: inside their limits, with slope `unit` at 0."""
        low, high = self.limits
        step = self.unit * x
        if not self.limited:
            return self.start + step
        has_low, has_high = jnp.isfinite(low), jnp.isfinite(high)
        # One limit: a hyperbola between it and a straight line. What is not meant must
        # stay finite, for its derivative.
        above = jnp.where(has_low, self.start - low, 1.0)
        below = jnp.where(has_high, high - self.start, 1.0)
        only_low = self.start + above * (_hyperbola(step / above) - 1.0)
        only_high = self.start - below * (_hyperbola(-step / below) - 1.0)
        half = 0.5 * (above + below)
        place = (above - below) / (2.0 * half)
        bent = jnp.tanh(jnp.arctanh(place) + step / (half * (1.0 - place**2)))
        both = self.start + half * (bent - place)
        one = jnp.where(has_high, only_high, self.start + step)
        one = jnp.where(has_low, jnp.where(has_high, both, only_low), one)
        return jnp.where(self.held[0], low, jnp.where(self.held[1], high, one))

    def at_rest(self, slope: Float[Array, " p"]) -> Bool[Array, ""]:
        """Return whether the cost pushes all that is held against its limit."""
        low, high = self.held
        return ~jnp.any((low & (slope < 0)) | (high & (slope > 0)))


def _hyperbola(x: Float[Array, " p"]) -> Float[Array, " p"]:
    """Return a positive function with value and slope 1 at 0."""
    root = jnp.sqrt(x * x + 1.0)
    return jnp.where(x < 0, 1.0 / (root - x), x + root)
