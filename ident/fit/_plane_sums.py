"""Sums over readings and how many reach each node; of a large plane, compiled and at once."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from jaxtyping import Array, Float, Int

from ._compiled import BLOCK, axis_nodes, blocks_of, plane_classes, plane_moments
from ._grid import MANY, Grid
from ._information import (
    Normal,
    add_up,
    cells_of,
    moment_sums,
    normal_from_moments,
    touched,
    vector_from_moments,
)
from ._types import Samples


def sums_of(grid: Grid, samples: Samples) -> tuple[Normal, Float[np.ndarray, "l s"]]:
    """Return normal matrix and right-hand side of the readings, in one pass where it pays."""
    count = len(samples.error)
    if not _is_large_plane(grid, count):
        place = grid.locate(samples)
        weight = np.ones(count) if samples.weight is None else samples.weight
        return (
            normal_from_moments(grid, moment_sums(grid, place, weight, 2)),
            vector_from_moments(
                grid, moment_sums(grid, place, weight * samples.error, 1)
            ),
        )
    return _from_blocks(grid, _plane_blocks(grid, samples))


def sums_and_support(
    grid: Grid, samples: Samples
) -> tuple[Normal, Float[np.ndarray, "l s"], Int[np.ndarray, "l s"]]:
    """Return `sums_of` and `touched_by` of readings of weight 1, in one pass where it pays.

    A reading that lies within its cell touches all nodes of it: where all of a block do,
    their number is the first moment.
    """
    count = len(samples.error)
    if samples.weight is not None or not _is_large_plane(grid, count):
        return (*sums_of(grid, samples), touched_by(grid, samples))
    blocks = _plane_blocks(grid, samples, edges=True)
    full = count - count % BLOCK
    cells = np.zeros(cells_of(grid))
    result = np.zeros((grid.slow, grid.fast), np.int64)
    for place, (squares, _, edge) in zip(range(0, count, BLOCK), blocks, strict=True):
        if place < full and not bool(edge):
            cells += np.asarray(squares[0]).reshape(cells.shape)
        else:
            part = samples.positions[place : place + BLOCK]
            result += _touched_of(grid, part)
    inner = np.rint(cells).astype(np.int64)
    for slow in (slice(0, -1), slice(1, None)):
        for fast in (slice(0, -1), slice(1, None)):
            result[slow, fast] += inner
    return (*_from_blocks(grid, blocks), result)


def _is_large_plane(grid: Grid, count: int) -> bool:
    return grid.planar and count >= MANY and min(grid.slow, grid.fast) >= 2


def _plane_blocks(
    grid: Grid, samples: Samples, edges: bool = False
) -> list[tuple[Array, Array, Array]]:
    """Return `plane_moments` block by block, still being computed."""
    call = partial(
        plane_moments,
        slow=axis_nodes(grid.slow_nodes),
        fast=axis_nodes(grid.fast_nodes),
        columns=(grid.slow_column, 1 - grid.slow_column),
        edges=edges,
    )
    arrays = (samples.positions, samples.error)
    if samples.weight is not None:
        return [call(*block) for block in blocks_of(*arrays, samples.weight)]
    # Equal weights need not be read; only what fills up the last block must not count.
    count = len(samples.error)
    full = count - count % BLOCK
    blocks = blocks_of(*(array[:full] for array in arrays))
    sums = [call(*block, None) for block in blocks]
    rest = (*(array[full:] for array in arrays), np.ones(count - full))
    return sums + [call(*block) for block in blocks_of(*rest)]


def _from_blocks(
    grid: Grid, sums: Sequence[tuple[Array, Array, Array]]
) -> tuple[Normal, Float[np.ndarray, "l s"]]:
    shape = cells_of(grid)
    squares = add_up(each[0] for each in sums).reshape(3, 3, *shape)
    products = add_up(each[1] for each in sums).reshape(2, 2, *shape)
    return normal_from_moments(grid, squares), vector_from_moments(grid, products)


def touched_by(grid: Grid, samples: Samples) -> Int[np.ndarray, "l s"]:
    """Count the readings that reach each node with a weight above zero.

    `touched` with the readings located and counted at once, where that pays.
    """
    if not _is_large_plane(grid, len(samples.error)):
        return touched(grid, grid.locate(samples))
    return _touched_of(grid, samples.positions)


def _touched_of(
    grid: Grid, positions: Float[np.ndarray, "t 2"]
) -> Int[np.ndarray, "l s"]:
    call = partial(
        plane_classes,
        slow=axis_nodes(grid.slow_nodes),
        fast=axis_nodes(grid.fast_nodes),
        columns=(grid.slow_column, 1 - grid.slow_column),
    )
    found = add_up(
        call(*block) for block in blocks_of(positions, np.ones(len(positions)))
    )
    classes = np.rint(found).astype(np.int64).reshape(*cells_of(grid), 3, 3)
    result = np.zeros((grid.slow, grid.fast), np.int64)
    for end, slow in ((slice(0, -1), slice(0, 2)), (slice(1, None), slice(1, 3))):
        for side, fast in ((slice(0, -1), slice(0, 2)), (slice(1, None), slice(1, 3))):
            result[end, side] += classes[:, :, slow, fast].sum(axis=(2, 3))
    return result
