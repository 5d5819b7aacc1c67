"""In which cell between ascending points each position lies."""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from ._kernels import take, whole

FEWEST = 4
"""Up to so many points, comparing takes the place of every look-up."""
_FEW = 12
"""Up to so many points, comparing with each of them is faster than a search."""


def among_few(
    points: Float[Array, " p"],
    widths: Float[Array, " c"],
    position: Float[Array, " t"],
) -> tuple[Float[Array, " t"], Float[Array, " t"], Float[Array, " t"]]:
    """Return the number, the first point and the width of the cell of each position.

    By comparisons alone: without a look-up the whole runs on vectors.
    """
    cell = jnp.zeros_like(position)
    start = jnp.broadcast_to(points[0], position.shape)
    width = jnp.broadcast_to(widths[0], position.shape)
    for number in range(1, widths.size):
        reached = position >= points[number]
        cell = jnp.where(reached, float(number), cell)
        start = jnp.where(reached, points[number], start)
        width = jnp.where(reached, widths[number], width)
    return cell, start, width


@jax.jit  # a call by this name in a traced model: an export puts its own search there
def cell_of(
    points: Float[Array, " p"], position: Float[Array, " t"]
) -> Int[Array, " t"]:
    """Return the cell of each position, from 0 to the number of points − 2.

    Equal buckets over the table tell where to begin, and only as many steps follow as
    the fullest bucket asks for: a third of the time of a search.
    """
    last = points.size - 2
    if points.size <= _FEW:
        count = jnp.zeros_like(position)
        for number in range(1, last + 1):
            count = jnp.where(position >= points[number], float(number), count)
        index: Array = whole(count)
        return index
    buckets = 2 * points.size
    span = points[-1] - points[0]
    # Relative to the first point, so that only roundings of the span itself matter;
    # those of a position are far below the slack.
    inner = (points[1:-1] - points[0])[:, None]
    edges = jnp.arange(buckets + 1, dtype=jnp.float64) * (span / buckets)
    slack = 1e-9 * span
    low = jnp.sum(inner < edges[None, :-1] - slack, axis=0, dtype=jnp.int32)
    high = jnp.sum(inner <= edges[None, 1:] + slack, axis=0, dtype=jnp.int32)
    largest = jnp.max(high - low)
    step = jnp.where(largest > 0, 1 << (31 - lax.clz(jnp.maximum(largest, 1))), 0)
    bucket = jnp.floor((position - points[0]) * (buckets / span))
    cell = take(low, whole(jnp.clip(bucket, 0.0, float(buckets - 1))))
    beyond = jnp.concatenate([points[:-1], jnp.full(1, jnp.inf)])

    def advance(state: tuple[Array, Array]) -> tuple[Array, Array]:
        cell, step = state
        target = cell + step
        reached = take(beyond, jnp.minimum(target, last + 1)) <= position
        return jnp.where(reached, target, cell), step >> 1

    result: Array = lax.while_loop(lambda state: state[1] > 0, advance, (cell, step))[0]
    return result
