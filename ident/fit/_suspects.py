"""Nodes and runs that contradict the rest: named for the user, never dropped."""

from statistics import median

import numpy as np
from jaxtyping import Float, Int

from ._grid import Grid, Located
from ._runs import RunDesign, medians
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
    # A share of 0.5 is the Student weight at two scales; a lone reading must be further off.
    limit = np.where(count > 1, _TRUSTED, 0.5 * _TRUSTED) * count
    named = ((count > 0) & (kept < limit)).reshape(grid.slow, grid.fast)
    return tuple(int(index) for index in np.flatnonzero(grid.to_table(named)))


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
    loud = scatter > _LOUD * median(scatter.tolist())
    offset = np.array([effect.offset for effect in effects])
    error = np.array([effect.offset_sd for effect in effects])
    away = np.abs(offset - median(offset.tolist()))
    far = (away > _FAR * median(away.tolist())) & (away > _FAR * error)
    return tuple(int(label) for label in design.labels[loud | far])
