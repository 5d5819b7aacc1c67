"""Nodes and runs that contradict the rest: named for the user, never dropped."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ._grid import Grid, Located
from ._runs import RunDesign, medians, row_medians
from ._types import RunEffect

_TRUSTED = 0.5
"""A node whose nearest readings keep less than this share of their weight is named."""
_LOUD = 3.0
"""A run with this many times the scatter of the median run is named."""
_FAR = 6.0
"""A run whose offset lies this many typical offsets away is named."""


def nearest(grid: Grid, located: Located) -> Int[np.ndarray, " t"]:
    """Return the node next to each reading, as flat index over (slow, fast)."""
    upper = located.u >= 0.5
    slow = np.where(upper & (grid.slow > 1), grid.neighbour(located.l), located.l)
    fast = np.where(
        located.v >= 0.5, np.minimum(located.s + 1, grid.fast - 1), located.s
    )
    return np.asarray(slow * grid.fast + fast)


def suspect_nodes(
    grid: Grid, located: Located, share: Float[np.ndarray, " t"]
) -> tuple[int, ...]:
    """Return flat table indices of nodes whose nearest readings were mostly set aside."""
    node = nearest(grid, located)
    count = np.bincount(node, minlength=grid.size)
    return distrusted(grid, count, np.bincount(node, share, grid.size))


def distrusted(
    grid: Grid, count: Int[np.ndarray, " n"], kept: Float[np.ndarray, " n"]
) -> tuple[int, ...]:
    """Return the same from the number of the nearest readings and the weight they keep."""
    return named(grid, doubted(count, kept))


def doubted(
    count: Int[np.ndarray, "*k n"], kept: Float[np.ndarray, "*k n"]
) -> Bool[np.ndarray, "*k n"]:
    """Return whether the readings next to a node were mostly set aside."""
    # A share of 0.5 is the Student weight at two scales; a lone reading must be further off.
    limit = np.where(count > 1, _TRUSTED, 0.5 * _TRUSTED) * count
    return np.asarray((count > 0) & (kept < limit))


def named(grid: Grid, doubted: Bool[np.ndarray, " n"]) -> tuple[int, ...]:
    """Return flat table indices of nodes that are told as flat index over (slow, fast)."""
    if not doubted.any():
        return ()
    table = grid.to_table(doubted.reshape(grid.slow, grid.fast))
    return tuple(int(index) for index in np.flatnonzero(table))


def suspect_runs(
    design: RunDesign | None,
    residual: Float[np.ndarray, " t"],
    share: Float[np.ndarray, " t"],
    effects: tuple[RunEffect, ...],
) -> tuple[int, ...]:
    """Return the runs that scatter far more than the others or lie far off them."""
    if design is None or len(design.labels) < 3:
        return ()
    scatter = medians(design.index, np.abs(residual), len(design.labels))
    found = contradicting(
        scatter[None],
        np.array([[effect.offset for effect in effects]]),
        np.array([[effect.offset_sd for effect in effects]]),
    )[0]
    return tuple(effects[place].run for place in np.flatnonzero(found))


def contradicting(
    scatter: Float[np.ndarray, "k r"],
    offset: Float[np.ndarray, "k r"],
    deviation: Float[np.ndarray, "k r"],
) -> Bool[np.ndarray, "k r"]:
    """Return which runs contradict the others, for several fits with as many runs.

    Args:
        scatter: Median size of the residuals of each run.
        offset: Of each run.
        deviation: Standard deviation of the offset.
    """
    if scatter.shape[1] < 3:
        return np.zeros(scatter.shape, bool)
    quiet = _LOUD * row_medians(scatter)[:, None]
    away = np.abs(offset - row_medians(offset)[:, None])
    near = _FAR * row_medians(away)[:, None]
    far = (away > near) & (away > _FAR * deviation)
    return np.asarray((scatter > quiet) | far)
