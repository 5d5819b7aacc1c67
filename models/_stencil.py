"""The few nodes that each sample touches, and their weights."""

import math
from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ._kernels import corners, distances


@final
class Stencil(eqx.Module):
    """Weights of table nodes per sample: a sparse matrix with k entries per row.

    Evaluation, the derivative with respect to the values and the sums of a fit are all
    sums over it. The weights are differentiable in the positions that the stencil was
    made from (at nodes: the right-hand derivative). `interpolate` gives the same values
    without storing the stencil.
    """

    nodes: Int[Array, "t k"]
    """Index into the flattened table; in a table of one node that node twice."""
    weights: Float[Array, "t k"]
    """Share of each node, 0 to 1; they sum up to 1 wherever the table has an effect."""
    size: int = eqx.field(static=True)
    """Number of nodes of the whole table, all branches together."""

    def __call__(self, values: Float[Array, " n"]) -> Float[Array, " t"]:
        """Return the table's value per sample, from its flattened values.

        Raises:
            ValueError: If there is not one value per node.
        """
        if values.shape != (self.size,):
            msg = f"Expected {self.size} values in a row, got shape {values.shape}."
            raise ValueError(msg)
        return jnp.sum(self.weights * values[self.nodes], axis=1)

    def spread(self, amounts: Float[Array, " t"]) -> Float[Array, " n"]:
        """Return the sum of weight · amount at each node (the transpose of a call)."""
        empty = jnp.zeros(self.size, dtype=self.weights.dtype)
        return empty.at[self.nodes].add(self.weights * amounts[:, None])

    def matrix(self) -> Float[Array, "t n"]:
        """Return the weights as a dense matrix, for tables of few nodes."""
        # Comparing with each node takes a tenth of the time of a scatter.
        node = jnp.arange(self.size, dtype=self.nodes.dtype)
        touched = self.nodes[:, :, None] == node[None, None, :]
        return jnp.sum(jnp.where(touched, self.weights[:, :, None], 0.0), axis=1)


def linear_stencil(
    coordinates: Sequence[Float[Array, " t"]],
    shape: tuple[int, ...],
    table: Int[Array, " t"] | None = None,
    tables: int = 1,
) -> Stencil:
    """Return the stencil of (bi)linear interpolation; arguments as in `corners`."""
    first, weights = corners(coordinates, shape, table)
    return Stencil(
        nodes=jnp.stack([first + distance for distance in distances(shape)], axis=1),
        weights=jnp.stack(weights, axis=1),
        size=tables * math.prod(shape),
    )
