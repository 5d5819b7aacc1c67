"""What the controller adds at given positions: the models, NumPy to NumPy."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...models import Cross, Leadscrew, Plane
from ._stencils import FEW, entries_of, offsets_at, padded


@eqx.filter_jit
def _plane(model: Plane, positions: Float[Array, "t 2"]) -> Float[Array, " t"]:
    return model.offset(positions)


@eqx.filter_jit
def _cross(model: Cross, positions: Float[Array, " t"]) -> Float[Array, " t"]:
    return model.offset(positions)


@eqx.filter_jit
def _leadscrew(
    model: Leadscrew, positions: Float[Array, " t"], direction: Int[Array, " t"]
) -> Float[Array, " t"]:
    return model.offset(positions, direction)


def offset_at(
    model: Plane | Cross | Leadscrew,
    positions: Float[np.ndarray, "t d"],
    direction: Int[np.ndarray, " t"] | None = None,
) -> Float[np.ndarray, " t"]:
    """Return the offset in mm or ° that a table adds at each position.

    Args:
        model: The table.
        positions: One column per master (leadscrew: the axis itself), in mm or °.
        direction: ±1 per row for a leadscrew; positive where it is left out.
    """
    rows = len(positions)
    if rows <= FEW:
        entries = entries_of(model)[None]
        return np.asarray(offsets_at(model, entries, positions, direction)[0])
    if isinstance(model, Plane):
        found = _plane(model, jnp.asarray(padded(positions)))
    elif isinstance(model, Cross):
        found = _cross(model, jnp.asarray(padded(positions[:, 0])))
    else:
        if direction is None:
            direction = np.ones(rows, dtype=np.int64)
        # Padding has direction 0 otherwise, which is none.
        sense = np.where(padded(direction) < 0, -1, 1)
        place = jnp.asarray(padded(positions[:, 0]))
        found = _leadscrew(model, place, jnp.asarray(sense))
    return np.asarray(found)[:rows]
