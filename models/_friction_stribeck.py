"""The Stribeck curve: friction of an axis by a handful of parameters."""

from types import ModuleType
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._friction import AbstractFriction
from ._nodes import Values, float_array, is_known

_LARGEST_POWER = 5.7
"""Logarithm of the power from which on exp(−power) is nothing beside 1. Its square is still a
normal number: processors take a hundred times as long for smaller ones."""


@final
class StribeckFriction(AbstractFriction):
    r"""Static friction curve with Stribeck effect and viscous part.

    $i(v) = \mathrm{sign}(v)\,[c + (s - c)\,e^{-(|v|/v_s)^\delta} + b\,|v|]$ with a hard
    sign: 0 at rest. See Armstrong-Hélouvry et al., Automatica 30(7), 1994.

    Each parameter is one number for both directions, or two: for positive, then for
    negative direction. Derivatives with respect to all parameters exist everywhere; at
    rest they are 0, as is that with respect to the velocity.
    """

    coulomb: Float[Values, ""] | Float[Values, " 2"] = eqx.field(converter=float_array)
    """Coulomb level $c$ in drive units."""
    breakaway: Float[Values, ""] | Float[Values, " 2"] = eqx.field(
        converter=float_array
    )
    """Break-away level $s$ in drive units, the limit of small speeds."""
    stribeck_velocity: Float[Values, ""] | Float[Values, " 2"] = eqx.field(
        converter=float_array
    )
    """Stribeck velocity $v_s$ in mm/s or °/s, positive."""
    stribeck_shape: Float[Values, ""] | Float[Values, " 2"] = eqx.field(
        converter=float_array
    )
    r"""Exponent $\delta$, positive: 1 (Tustin) and 2 (Gauss) are usual."""
    viscous: Float[Values, ""] | Float[Values, " 2"] = eqx.field(converter=float_array)
    """Viscous coefficient $b$ in drive units per mm/s or °/s."""

    def __check_init__(self) -> None:
        for name in ("stribeck_velocity", "stribeck_shape"):
            value = getattr(self, name)
            if is_known(value) and not np.all(np.asarray(value) > 0):
                msg = f"{name} must be positive, got {value!s}."
                raise ValueError(msg)

    @property
    def directional(self) -> bool:
        """Whether any parameter has a value per direction."""
        return any(
            parameter.ndim > 0
            for parameter in (
                self.coulomb,
                self.breakaway,
                self.stribeck_velocity,
                self.stribeck_shape,
                self.viscous,
            )
        )

    @eqx.filter_jit
    def level(
        self,
        speed: Float[Array | np.ndarray, " t"],
        direction: Float[Array | np.ndarray, " t"],
    ) -> Float[Array, " t"]:
        """Return the current at speeds ≥ 0 in drive units; at 0 the break-away."""
        place = jnp.asarray(speed, dtype=jnp.float64)
        current: Array = self._level(jnp, place, jnp.asarray(direction) < 0)
        return current

    def numpy_level(
        self, speed: Float[np.ndarray, " t"], direction: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return what `level` does, computed by NumPy."""
        return np.asarray(self._level(np, speed, direction < 0))

    def _level(self, xp: ModuleType, speed: Any, negative: Any) -> Any:
        def choose(parameter: Array) -> Any:
            if parameter.ndim == 0:
                return xp.asarray(parameter)
            return xp.where(negative, parameter[1], parameter[0])

        coulomb, velocity = choose(self.coulomb), choose(self.stribeck_velocity)
        decay, _, _ = _decay(xp, speed, velocity, choose(self.stribeck_shape))
        excess = choose(self.breakaway) - coulomb
        return coulomb + excess * decay + choose(self.viscous) * speed


def stribeck_columns(
    speed: Float[np.ndarray, " t"],
    velocity: float | Float[np.ndarray, "n 1"],
    shape: float | Float[np.ndarray, "n 1"],
) -> Float[np.ndarray, "3 *n t"]:
    r"""Return the column of $s - c$ in `StribeckFriction` and its derivatives, by NumPy.

    The share of the break-away excess that is left at speeds, $e^{-(|v|/v_s)^\delta}$, then its
    derivatives by $\ln v_s$ and $\ln \delta$.

    Args:
        speed: |v| in mm/s or °/s.
        velocity: Stribeck velocity $v_s$ in the same unit, or one per row of the columns.
        shape: Exponent $\delta$, likewise.
    """
    decay, power, raised = _decay(np, speed, velocity, shape)
    product = power * decay
    return np.stack([decay, shape * product, -raised * product])


def _decay(xp: ModuleType, speed: Any, velocity: Any, shape: Any) -> Any:
    """Return exp(−p), p and ln p of p = (speed / velocity) ** shape; p = 0 at rest."""
    moving = speed > 0.0
    # Neither the logarithm nor its derivative exists at rest: a stand-in goes through
    # them there, and is thrown away after.
    ratio = xp.where(moving, speed, 1.0) / velocity
    raised = xp.minimum(shape * xp.log(ratio), _LARGEST_POWER)
    power = xp.where(moving, xp.exp(raised), 0.0)
    return xp.where(moving, xp.exp(-power), 1.0), power, raised


def _choose(
    parameter: Float[Array, ""] | Float[Array, " 2"], negative: Array
) -> Float[Array, ""] | Float[Array, " t"]:
    """Return the parameter for the direction of each sample."""
    if parameter.ndim == 0:
        return parameter
    return jnp.where(negative, parameter[1], parameter[0])
