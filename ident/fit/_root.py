"""Factor of a stiff table from the roots of its parts: no digits are lost by squaring.

Stiff priors make matrices whose condition is beyond what a Cholesky factor bears: its
log-determinant, and with it the evidence, would be rounding. The differences themselves have
the square root of that condition. They are stacked with a root of the normal matrix and
brought to triangular form by reflections, a block of columns at a time.

Source: A. Björck, Numerical Methods for Least Squares Problems, 1996, section 6.2.
"""

import functools

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from ._band import BandFactor, factorise
from ._chain import ChainPrior
from ._information import Normal, assemble, half_bandwidth
from ._prior import Smoothness, TablePrior
from ._triangle import Stack

_RIDGE = 1e-13
"""Relative to the largest information on a node: makes a root where readings leave gaps."""


def stiff_factor(
    normal: Normal, prior: TablePrior, smoothness: Smoothness
) -> BandFactor | None:
    """Return the factor of normal matrix plus prior, None where it is singular."""
    grid = normal.grid
    band = half_bandwidth(grid, smoothness)
    data = _data_root(normal, prior)
    if data is None:
        return factorise(assemble(normal, prior, smoothness))
    slow = _entries(prior.slow, smoothness.slow)
    fast = np.zeros(0)
    if prior.fast is not None:
        slow = _chain_root(prior.slow, smoothness.slow).reshape(-1)
        fast = _chain_root(prior.fast, smoothness.fast).reshape(-1)
    stack = _stack_of(
        prior, grid.fast, band, bool(smoothness.slow[1]), bool(smoothness.fast[1]),
        data.shape[1],
    )  # fmt: skip
    entries = np.concatenate(
        [np.repeat(slow, grid.fast), np.tile(fast, grid.slow), data.reshape(-1)]
    )
    columns = stack.triangle(entries)
    if not (columns[:, 0] > 0).all():
        return None
    return BandFactor(columns, stiff=True)


def _data_root(normal: Normal, prior: TablePrior) -> Float[np.ndarray, "n w"] | None:
    """Return a root of the normal matrix as lower band."""
    ridge = _RIDGE * float(normal.diagonals[0, 0].max())
    for _ in range(3):
        columns = assemble(normal, prior, Smoothness((0.0, 0.0)))
        used = normal.grid.spread(1) * normal.grid.fast + int(normal.grid.planar)
        columns = columns[:, : min(used, columns.shape[1] - 1) + 1].copy()
        columns[:, 0] += ridge
        factor = factorise(columns)
        if factor is not None:
            return factor.columns
        ridge *= 100.0
    return None


def _entries(
    chain: ChainPrior, weights: tuple[float, float]
) -> Float[np.ndarray, " e"]:
    """Return the weighted differences along an axis, in the order of `_places`."""
    parts = [np.sqrt(weights[0]) * chain.second.data]
    if weights[1]:
        parts.append(np.sqrt(weights[1]) * chain.fourth.data)
    return np.concatenate(parts)


def _places(
    chain: ChainPrior, fourth: bool
) -> tuple[Int[np.ndarray, " e"], Int[np.ndarray, " e"]]:
    """Return row and column of every entry of the differences along an axis."""
    n = chain.size
    rows, columns, above = [], [], 0
    for part in (chain.second, chain.fourth) if fourth else (chain.second,):
        entries = sp.csr_array(part).tocoo()
        row, column = entries.coords
        rows.append(above + row)
        columns.append(column)
        above += part.indptr.size - 1
    column = np.concatenate(columns)
    if chain.ring:
        column = np.where(2 * column < n, 2 * column, 2 * (n - column) - 1)
    return np.concatenate(rows), column


@functools.lru_cache(maxsize=64)
def _chain_stack(chain: ChainPrior, fourth: bool) -> Stack:
    row, column = _places(chain, fourth)
    return Stack.of(row, column, chain.size, min(4 if fourth else 2, chain.size - 1))


def _chain_root(
    chain: ChainPrior, weights: tuple[float, float]
) -> Float[np.ndarray, "n w"]:
    """Return a root of the prior along one axis of a plane as lower band."""
    stack = _chain_stack(chain, bool(weights[1]))
    return stack.triangle(_entries(chain, weights))


@functools.lru_cache(maxsize=64)
def _stack_of(
    prior: TablePrior, fast: int, band: int, fourth: bool, across: bool, width: int
) -> Stack:
    """Return where the entries of slow differences, fast ones and data root go."""
    slow = prior.slow.size
    rows, columns = [], []
    above = 0

    def add(row: np.ndarray, column: np.ndarray) -> None:
        nonlocal above
        rows.append(above + row)
        columns.append(column)
        above += int(row.max(initial=-1)) + 1

    if prior.fast is None:
        row, column = _places(prior.slow, fourth)
        s = np.arange(fast)
        add(
            (row[:, None] * fast + s).reshape(-1),
            (column[:, None] * fast + s).reshape(-1),
        )
    else:
        l, s = np.divmod(np.arange(slow * fast), fast)
        reach = np.arange(_chain_stack(prior.slow, fourth).band + 1)
        # Entry (l, distance, s), as the roots of the slow axis are repeated.
        row = np.broadcast_to(
            (np.arange(slow) * fast)[:, None, None] + np.arange(fast),
            (slow, len(reach), fast),
        )
        add(row.reshape(-1), (row + reach[:, None] * fast).reshape(-1))
        reach = np.arange(_chain_stack(prior.fast, across).band + 1)
        row = np.broadcast_to((l * fast + s)[:, None], (slow * fast, len(reach)))
        add(row.reshape(-1), (row + reach).reshape(-1))
    row = np.broadcast_to(np.arange(slow * fast)[:, None], (slow * fast, width))
    add(row.reshape(-1), (row + np.arange(width)).reshape(-1))
    return Stack.of(np.concatenate(rows), np.concatenate(columns), slow * fast, band)
