r"""What smooths and delays values over cycles: the sin² filter and the delay line.

Both run over a whole piece of a log at once and carry the values before it, so that a
log cut into pieces gives the same as the log at once.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._nodes import Values, float_array
from ._smoothing import smooth


@final
class Past(eqx.Module):
    """The values of the cycles before a piece of a log."""

    values: Float[Values, " m"] = eqx.field(converter=float_array)
    """Oldest first, in the unit of what is filtered."""


@final
class SineSquaredFilter(eqx.Module):
    r"""Distributes each change of a value over n cycles.

    A step that comes with cycle 1 is through by $\sin^2(\pi k / 2n)$ in cycle k, k = 1
    … n; changes that overlap are superposed (S-06). With n ≤ 1 it comes at once. A
    constant passes unchanged, to the last bit: the shares of all cycles sum up to one.
    """

    cycles: int = eqx.field(static=True)
    """Number of cycles n."""
    late: int = eqx.field(default=0, static=True)
    """Cycles after the change in which nothing comes yet (S-06): 0 or more."""

    def __check_init__(self) -> None:
        _refuse_negative(self.cycles)
        _refuse_negative(self.late)

    @property
    def response(self) -> Float[np.ndarray, " m"]:
        """How much of a step has come by each cycle from that of the step on, to 1."""
        return step_response(self.cycles, self.late)

    @property
    def memory(self) -> int:
        """How many cycles before the present one still count."""
        return self.response.size - 1

    def start(self, value: Float[Array, ""] | float = 0.0) -> Past:
        """Return the state after this value has stood for as many cycles."""
        return _constant(value, self.memory)

    def run(
        self, state: Past, values: Float[Array, " t"]
    ) -> tuple[Float[Array, " t"], Past]:
        """Return the filtered values and the state after them."""
        history = jnp.concatenate([state.values, values])
        return smooth(history, self.response), Past(history[values.size :])


@final
class Delay(eqx.Module):
    """Passes each value on a number of cycles later."""

    cycles: int = eqx.field(static=True)
    """Number of cycles; 0: at once."""

    def __check_init__(self) -> None:
        _refuse_negative(self.cycles)

    def start(self, value: Float[Array, ""] | float = 0.0) -> Past:
        """Return the state after this value has stood for as many cycles."""
        return _constant(value, self.cycles)

    def run(
        self, state: Past, values: Float[Array, " t"]
    ) -> tuple[Float[Array, " t"], Past]:
        """Return the delayed values and the state after them."""
        history = jnp.concatenate([state.values, values])
        return history[: values.size], Past(history[values.size :])


def step_response(cycles: int, delay: int = 0) -> Float[np.ndarray, " m"]:
    """Return how much of a step the sin² filter lets through by each cycle, up to 1."""
    count = max(cycles, 1)
    shares = np.sin(0.5 * np.pi * np.arange(1, count + 1) / count) ** 2
    shares[-1] = 1.0
    return np.concatenate([np.zeros(delay), shares])


def _constant(value: Float[Array, ""] | float, count: int) -> Past:
    return Past(jnp.full(count, value, dtype=jnp.float64))


def _refuse_negative(cycles: int) -> None:
    if cycles < 0:
        msg = f"A number of cycles cannot be negative, got {cycles!r}."
        raise ValueError(msg)
