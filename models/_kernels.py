r"""Linear interpolation in tables, and its transpose, over the corners of cells.

Each sample lies in a cell of the table and touches its $2^d$ corners, with the weights
of (bi)linear interpolation. The evaluation is a gather, fused by XLA into one pass. Its
transpose, the derivative with respect to the table, is a scatter. What XLA makes of a
transposed gather writes all weights of all samples to memory first; going through the
samples in chunks takes a third of the time.
"""

import functools
import itertools
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int, Num

CHUNK = 1 << 16
"""Samples per pass of the scatter: index and weights of one pass stay in the cache."""


def corners(
    coordinates: Sequence[Float[Array, " t"]],
    shape: tuple[int, ...],
    table: Int[Array, " t"] | None = None,
) -> tuple[Int[Array, " t"], tuple[Float[Array, " t"], ...]]:
    """Return the first corner of each sample's cell, and the weights of all corners.

    Args:
        coordinates: Per axis the place of each sample counted in nodes.
        shape: Number of nodes per axis.
        table: Which one of a stack of tables each sample uses; None: there is only one.

    The flat index of corner k is ``first + distances(shape)[k]``. Along an axis with a
    single node both corners are that node, the second one with weight 0.
    """
    # Summed up as a float, exact below 2**52: one conversion to integers, not two.
    flat: Float[Array, " t"] | float = 0.0
    sides = []
    for coordinate, count, stride in zip(
        coordinates, shape, _strides(shape), strict=True
    ):
        cell = jnp.minimum(jnp.floor(coordinate), float(max(count - 2, 0)))
        share = coordinate - cell
        flat = flat + cell * float(stride)
        sides.append((1.0 - share, share))
    first = whole(jnp.asarray(flat))
    if table is not None:
        first = first + table.astype(jnp.int32) * math.prod(shape)
    weights = tuple(
        functools.reduce(jnp.multiply, pair) for pair in itertools.product(*sides)
    )
    return first, weights


@jax.jit  # as `cell_of`
def whole(number: Float[Array, " t"]) -> Int[Array, " t"]:
    """Return floats that are whole numbers, 0 to 2**31 − 1, as integers.

    2**52 + n has n in its last bits. XLA's own conversion takes a third of the whole
    evaluation, as it must saturate. For NaN any index comes out; XLA clamps it in
    a gather, leaves it out of a scatter, and the weights are NaN anyway.
    """
    bits = lax.bitcast_convert_type(number + 2.0**52, jnp.int64)
    return (bits & 0x7FFFFFFF).astype(jnp.int32)


def distances(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the flat distance of each corner of a cell from its first corner."""
    steps = (
        (0, stride if count > 1 else 0)
        for count, stride in zip(shape, _strides(shape), strict=True)
    )
    return tuple(sum(step) for step in itertools.product(*steps))


def _strides(shape: tuple[int, ...]) -> list[int]:
    return [math.prod(shape[axis + 1 :]) for axis in range(len(shape))]


def gather(
    values: Float[Array, " n"],
    coordinates: Sequence[Float[Array, " t"]],
    shape: tuple[int, ...],
    table: Int[Array, " t"] | None = None,
) -> Float[Array, " t"]:
    """Return the table's value at each sample; arguments as in `corners`."""
    first, weights = corners(coordinates, shape, table)
    offsets = distances(shape)
    length = values.size - max(offsets)
    # One view of the table per corner and the same index for all: a quarter faster than
    # one table and four indices.
    parts = (
        weight * take(values[distance : distance + length], first)
        for distance, weight in zip(offsets, weights, strict=True)
    )
    return functools.reduce(jnp.add, parts)


def take(values: Num[Array, " m"], index: Int[Array, " t"]) -> Num[Array, " t"]:
    """Return the value at each index; the indices must be those of the array."""
    return values.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)


def scatter(
    amounts: Float[Array, " t"],
    coordinates: Sequence[Float[Array, " t"]],
    shape: tuple[int, ...],
    table: Int[Array, " t"] | None = None,
    tables: int = 1,
) -> Float[Array, " n"]:
    """Return the sum of weight · amount at each node; arguments as in `corners`."""
    # One sum per corner, kept at the first corner of the cell: one index for all.
    sums = tuple(jnp.zeros(tables * math.prod(shape)) for _ in distances(shape))
    chunks, remainder = divmod(amounts.size, CHUNK)
    arrays = (
        (amounts, *coordinates) if table is None else (amounts, *coordinates, table)
    )

    def add(sums: tuple[Array, ...], pieces: Sequence[Array]) -> tuple[Array, ...]:
        amount, *places = pieces
        first, weights = corners(
            places[: len(shape)], shape, None if table is None else places[-1]
        )
        return tuple(
            total.at[first].add(
                weight * amount, mode="promise_in_bounds", wrap_negative_indices=False
            )
            for total, weight in zip(sums, weights, strict=True)
        )

    def add_chunk(number: Array, sums: tuple[Array, ...]) -> tuple[Array, ...]:
        start = (number * CHUNK,)
        return add(sums, [lax.dynamic_slice(a, start, (CHUNK,)) for a in arrays])

    if chunks:
        sums = lax.fori_loop(0, chunks, add_chunk, sums)
    if remainder:
        sums = add(sums, [array[chunks * CHUNK :] for array in arrays])
    parts = (
        jnp.pad(total[: total.size - distance], (distance, 0))
        for total, distance in zip(sums, distances(shape), strict=True)
    )
    return functools.reduce(jnp.add, parts)
