"""Polylines as columns: the share of each of their nodes at given places."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...models import Setpoints
from ._readings import filled

_PLACES, _NODES = 1 << 12, 12
"""Up to so many places, nodes are filled up to so many: compiled code is shared."""


@jax.jit
def _shares(nodes: Float[Array, " n"], places: Float[Array, " t"]) -> Array:
    return Setpoints(nodes).stencil(places).matrix()


def node_shares(
    places: Float[np.ndarray, " t"], nodes: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "t n"]:
    """Return the share of each node at each place, NaN where that is NaN.

    Those of all laws of `axcomp.models` over given points: linear between, the ends held.
    """
    count, size, finite = len(places), len(nodes), np.isfinite(places)
    # Held here, since further nodes stand behind the last one.
    clipped = np.clip(np.where(finite, places, nodes[0]), nodes[0], nodes[-1])
    # Many places outweigh a compilation, and their columns the memory.
    width = max(size, _NODES if count <= _PLACES else 0)
    beyond = nodes[-1] + max(1.0, abs(nodes[-1])) * np.arange(1, width - size + 1)
    line = jnp.asarray(np.concatenate([nodes, beyond]))
    result = np.array(_shares(line, jnp.asarray(filled(clipped))))[:count, :size]
    result[~finite] = np.nan
    return result
