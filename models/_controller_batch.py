"""One law of several axes: each of them on its rows."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int


def mapped(evaluate: Callable[..., Any], laws: Sequence[Any], *arguments: Any) -> Any:
    """Return what each law makes of its row of the arguments, one below the other."""
    if len(laws) == 1:
        rows = [jax.tree.map(lambda leaf: leaf[0], argument) for argument in arguments]
        return jax.tree.map(lambda leaf: leaf[None], evaluate(laws[0], *rows))
    # A loop and not `vmap`: what one axis needs at a time fits the cache, and no table
    # has to be told from those of the others, sample by sample.
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *laws)
    return lax.map(lambda row: evaluate(*row), (stacked, *arguments))


def vectorised(
    evaluate: Callable[..., Any], laws: Sequence[Any], *arguments: Any
) -> Any:
    """Return the same, of laws without a condition: on all cores at once."""
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *laws)
    # What enters several sums is worked out once, and not in each of them.
    values = jax.vmap(evaluate)(stacked, *arguments)
    return lax.optimization_barrier(values)  # type: ignore[no-untyped-call]


def columns(
    rows: Float[Array, "a t"], numbers: Int[Array | np.ndarray, " m"]
) -> Float[Array, "t m"]:
    """Return some of the rows as columns."""
    # Row by row, as XLA then sees through to the row when a law takes a column.
    picked = [rows[numbers[place]] for place in range(numbers.shape[0])]
    return jnp.stack(picked, axis=1) if picked else jnp.zeros((rows.shape[1], 0))
