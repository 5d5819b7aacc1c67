"""What tables add at given positions, NumPy to NumPy."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...models import AbstractLookup, Stencil
from ..core import filled

_SMALLEST = 256
"""Positions are filled up to powers of two from here on: few shapes to compile."""


def offset_at(
    model: AbstractLookup,
    positions: Float[np.ndarray, "t d"],
    direction: Int[np.ndarray, " t"] | None = None,
) -> Float[np.ndarray, " t"]:
    """Return the offset in mm or ° that a table adds at each position.

    Args:
        model: The table.
        positions: One column per master (leadscrew: the axis itself), in mm or °.
        direction: ±1 per row for a leadscrew; positive where it is left out.
    """
    entries = np.concatenate([np.ravel(table) for table in model.tables])
    return np.asarray(offsets_at(model, entries[None], positions, direction)[0])


def offsets_at(
    model: AbstractLookup,
    entries: Float[np.ndarray, "k n"],
    positions: Float[np.ndarray, "t d"],
    direction: Int[np.ndarray, " t"] | None = None,
) -> Float[np.ndarray, "k t"]:
    """Return what several tables over the same nodes add at each position, in mm or °.

    The model says once which nodes each position touches; every table is then a handful of
    sums.

    Args:
        model: One table over these nodes.
        entries: Entries of each table in a row, as the model's stencil counts them.
        positions: One column per master (leadscrew: the axis itself), in mm or °.
        direction: ±1 per row for a leadscrew; positive where it is left out.
    """
    rows = len(positions)
    if not rows:
        return np.zeros((len(entries), 0))
    sense = np.ones(rows, dtype=np.int64) if direction is None else direction
    # Further columns are other axes.
    own = np.asarray(positions[:, : len(model.ways)], dtype=np.float64)
    ways = np.where(sense < 0, -1, 1)
    places = jnp.asarray(filled(own, _SMALLEST)), jnp.asarray(filled(ways, _SMALLEST))
    found = _stencil(model, *places)
    nodes, weights = np.asarray(found.nodes)[:rows], np.asarray(found.weights)[:rows]
    table: Any = model
    # One by one, which takes less memory.
    return np.stack(
        [table.sign * (row[nodes] * weights).sum(axis=1) for row in entries]
    )


@eqx.filter_jit
def _stencil(
    model: AbstractLookup, positions: Float[Array, "p d"], direction: Int[Array, " p"]
) -> Stencil:
    table: Any = model
    found: Stencil = table.stencil(*model.looked_up(positions, direction))
    return found
