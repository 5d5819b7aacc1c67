"""What tables add at given positions, NumPy to NumPy."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ...models import AbstractLookup
from ..core import touched


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
    # Further columns are other axes.
    own = np.asarray(positions[:, : len(model.ways)], dtype=np.float64)
    nodes, weights = touched(model, own, direction)
    table: Any = model
    # One by one, which takes less memory.
    return np.stack(
        [table.sign * (row[nodes] * weights).sum(axis=1) for row in entries]
    )
