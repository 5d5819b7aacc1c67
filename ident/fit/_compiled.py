"""Sums over many readings, compiled: blocks of fixed size, so that nothing is compiled twice.

Scatters are cheap on a processor, large temporaries are not: each block is scanned in
chunks that stay in cache, one scalar scatter per moment. What does not fill a block is left
to the plain NumPy code in `_information`, which gives the same sums.
"""

import functools
from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ... import models as models  # switches JAX to 64 bits
from ._grid import BLOCK

Result = TypeVar("Result")

CHUNKS = 4
CHUNK = BLOCK // CHUNKS


@functools.lru_cache(maxsize=64)
def _locator(
    size: int, equidistant: bool, ring: bool
) -> Callable[..., tuple[Array, Array]]:
    """Return a function (positions, nodes) → cell, fraction along one axis."""

    def locate(position: Array, nodes: Array) -> tuple[Array, Array]:
        first, last = nodes[0], nodes[-1]
        if ring:
            position = first + jnp.mod(position - first, last - first)
        if equidistant:
            guess = jnp.floor((position - first) * ((size - 1) / (last - first)))
            cell = jnp.clip(guess, 0, size - 2).astype(jnp.int32)
            # Rounding may miss by one: nodes decide, as they do in NumPy's search.
            cell = jnp.where(position < nodes[cell], cell - 1, cell)
            cell = jnp.where(position >= nodes[cell + 1], cell + 1, cell)
        else:
            cell = jnp.searchsorted(nodes, position, side="right").astype(jnp.int32) - 1
        cell = jnp.clip(cell, 0, size - 2)
        low = nodes[cell]
        return cell, jnp.clip((position - low) / (nodes[cell + 1] - low), 0.0, 1.0)

    return locate


@functools.lru_cache(maxsize=64)
def locate_block(
    size: int, equidistant: bool, ring: bool
) -> Callable[..., tuple[Array, Array]]:
    """Return the compiled search of one axis for a block of readings."""
    return jax.jit(_locator(size, equidistant, ring))


def _products(
    u: Array, v: Array, weight: Array, degree: int, across: int
) -> list[Array]:
    """Return weight·uᵖ·vᑫ, p slowest."""
    result = []
    along = weight
    for p in range(degree + 1):
        term = along
        for q in range(across + 1):
            result.append(term)
            term = term * v if q < across else term
        along = along * u if p < degree else along
    return result


@functools.lru_cache(maxsize=64)
def moment_block(cells: int, degree: int, planar: bool) -> Callable[..., Array]:
    """Return the compiled sums Σ weight·uᵖ·vᑫ per cell of a block, shape (powers, cells)."""
    across = degree if planar else 0
    count = (degree + 1) * (across + 1)

    @jax.jit
    def sums(
        cell: Int[Array, " t"],
        u: Float[Array, " t"],
        v: Float[Array, " t"],
        weight: Float[Array, " t"],
    ) -> Float[Array, "p c"]:
        def body(
            total: tuple[Array, ...], chunk: tuple[Array, ...]
        ) -> tuple[tuple[Array, ...], None]:
            here, u, v, weight = chunk
            terms = _products(u, v, weight, degree, across)
            return tuple(
                one.at[here].add(term, mode="promise_in_bounds")
                for one, term in zip(total, terms, strict=True)
            ), None

        start = tuple(jnp.zeros(cells) for _ in range(count))
        chunks = tuple(part.reshape(CHUNKS, CHUNK) for part in (cell, u, v, weight))
        total, _ = jax.lax.scan(body, start, chunks)
        return jnp.stack(total)

    return sums


@functools.lru_cache(maxsize=64)
def fused_block(
    slow: tuple[int, bool], fast: tuple[int, bool], columns: tuple[int, int]
) -> Callable[..., tuple[Array, Array]]:
    """Return locating and all moments of a plane in one pass.

    Args:
        slow: Number of nodes along the slow axis and whether they are equidistant.
        fast: The same along the fast axis.
        columns: Columns of the positions along the slow and the fast axis.
    """
    find_slow = _locator(*slow, ring=False)
    find_fast = _locator(*fast, ring=False)
    cells = (slow[0] - 1) * (fast[0] - 1)

    @jax.jit
    def sums(
        positions: Float[Array, "t 2"],
        error: Float[Array, " t"],
        weight: Float[Array, " t"],
        slow_nodes: Float[Array, " l"],
        fast_nodes: Float[Array, " s"],
    ) -> tuple[Float[Array, "p c"], Float[Array, "q c"]]:
        def body(
            total: tuple[Array, ...], chunk: tuple[Array, ...]
        ) -> tuple[tuple[Array, ...], None]:
            place, error, weight = chunk
            l, u = find_slow(place[:, columns[0]], slow_nodes)
            s, v = find_fast(place[:, columns[1]], fast_nodes)
            here = l * (fast[0] - 1) + s
            terms = _products(u, v, weight, 2, 2) + _products(
                u, v, weight * error, 1, 1
            )
            return tuple(
                one.at[here].add(term, mode="promise_in_bounds")
                for one, term in zip(total, terms, strict=True)
            ), None

        start = tuple(jnp.zeros(cells) for _ in range(13))
        chunks = (
            positions.reshape(CHUNKS, CHUNK, 2),
            error.reshape(CHUNKS, CHUNK),
            weight.reshape(CHUNKS, CHUNK),
        )
        total, _ = jax.lax.scan(body, start, chunks)
        return jnp.stack(total[:9]), jnp.stack(total[9:])

    return sums


@functools.lru_cache(maxsize=64)
def evaluate_block(fast: int, planar: bool) -> Callable[..., Array]:
    """Return the compiled table look-up of a block of located readings."""

    @jax.jit
    def table(
        values: Float[Array, " n"],
        l: Int[Array, " t"],
        above: Int[Array, " t"],
        s: Int[Array, " t"],
        u: Float[Array, " t"],
        v: Float[Array, " t"],
    ) -> Float[Array, " t"]:
        def at(slow: Array, across: Array) -> Array:
            return values.at[slow * fast + across].get(mode="promise_in_bounds")

        low, high = at(l, s), at(above, s)
        if planar:
            right = jnp.minimum(s + 1, fast - 1)
            low = low + v * (at(l, right) - low)
            high = high + v * (at(above, right) - high)
        return low + u * (high - low)

    return table


def over_blocks(
    call: Callable[..., Result], count: int, arrays: tuple[np.ndarray, ...]
) -> list[Result]:
    """Call a compiled block function on every full block; the calls run side by side."""
    return [
        call(*(array[start : start + BLOCK] for array in arrays))
        for start in range(0, count - count % BLOCK, BLOCK)
    ]
