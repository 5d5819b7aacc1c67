"""Sums over many readings, compiled: blocks of fixed size, so that nothing is compiled twice.

Scatters are cheap on a processor, large temporaries are not: each block is scanned in chunks
that stay in cache, one scalar scatter per moment. The place of a reading in its cell is found
by the controller model's own nodes. The plain NumPy code in `_information` gives the same
sums; it serves few readings, for which compiling would take longer than summing. Planes that
need no weights of a loss are summed by `_kernel`, which is faster still.
"""

from collections.abc import Callable, Iterator
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...models import AbstractNodes, EquidistantNodes, ModuloNodes, Setpoints
from ._grid import spacing_of

CHUNK, CHUNKS = 32_768, 4
BLOCK = CHUNK * CHUNKS
"""Readings per compiled call; the last block is filled up with readings of weight 0."""


def axis_nodes(nodes: Float[np.ndarray, " n"], ring: bool = False) -> AbstractNodes:
    """Return the controller model's nodes for node positions along one axis."""
    interval = spacing_of(nodes)
    if interval is not None:
        result: EquidistantNodes | Setpoints = EquidistantNodes(
            jnp.asarray(nodes[0]), jnp.asarray(interval), len(nodes)
        )
    else:
        result = Setpoints(jnp.asarray(nodes))
    return ModuloNodes(result) if ring else result


def blocks_of(*arrays: np.ndarray) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield the arrays block by block, the last one filled up with zeros."""
    count = len(arrays[0])
    for start in range(0, count, BLOCK):
        parts = tuple(array[start : start + BLOCK] for array in arrays)
        lack = BLOCK - len(parts[0])
        if lack:
            parts = tuple(
                np.concatenate([part, np.zeros((lack, *part.shape[1:]), part.dtype)])
                for part in parts
            )
        yield parts


@jax.jit
def locate(
    position: Float[Array, " t"], nodes: AbstractNodes
) -> tuple[Int[Array, " t"], Float[Array, " t"]]:
    """Return cell and place within it along one axis."""
    return nodes.locate(position)


def _powers(u: Array, v: Array, weight: Array, degree: int, across: int) -> list[Array]:
    """Return weight·uᵖ·vᑫ, p slowest."""
    result = []
    for p in range(degree + 1):
        term = weight
        for q in range(across + 1):
            result.append(term)
            term = term * v if q < across else term
        weight = weight * u if p < degree else weight
    return result


def _scan(
    terms: Callable[..., tuple[Array, list[Array]]],
    arrays: tuple[Array, ...],
    cells: int,
    count: int,
) -> tuple[Array, ...]:
    """Return the sums per cell of ``count`` terms over a block, chunk by chunk."""

    def body(
        total: tuple[Array, ...], chunk: tuple[Array, ...]
    ) -> tuple[tuple[Array, ...], None]:
        cell, parts = terms(*chunk)
        return tuple(
            one.at[cell].add(part, mode="promise_in_bounds")
            for one, part in zip(total, parts, strict=True)
        ), None

    start = tuple(jnp.zeros(cells) for _ in range(count))
    chunks = tuple(array.reshape(CHUNKS, CHUNK) for array in arrays)
    return jax.lax.scan(body, start, chunks)[0]


@partial(jax.jit, static_argnames=("cells", "degree", "across"))
def moments(
    cell: Int[Array, " t"],
    u: Float[Array, " t"],
    v: Float[Array, " t"],
    weight: Float[Array, " t"],
    *,
    cells: int,
    degree: int,
    across: int,
) -> Float[Array, "p c"]:
    """Return Σ weight·uᵖ·vᑫ per cell of a block, p up to ``degree``, q up to ``across``."""

    def terms(
        cell: Array, u: Array, v: Array, weight: Array
    ) -> tuple[Array, list[Array]]:
        return cell, _powers(u, v, weight, degree, across)

    count = (degree + 1) * (across + 1)
    return jnp.stack(_scan(terms, (cell, u, v, weight), cells, count))


@partial(jax.jit, static_argnames=("fast", "planar"))
def table(
    values: Float[Array, " n"],
    l: Int[Array, " t"],
    above: Int[Array, " t"],
    s: Int[Array, " t"],
    u: Float[Array, " t"],
    v: Float[Array, " t"],
    *,
    fast: int,
    planar: bool,
) -> Float[Array, " t"]:
    """Return the table at located readings; ``values`` over (slow, fast), flattened."""

    def at(slow: Array, across: Array) -> Array:
        return values.at[slow * fast + across].get(mode="promise_in_bounds")

    low, high = at(l, s), at(above, s)
    if planar:
        right = jnp.minimum(s + 1, fast - 1)
        low = low + v * (at(l, right) - low)
        high = high + v * (at(above, right) - high)
    return low + u * (high - low)
