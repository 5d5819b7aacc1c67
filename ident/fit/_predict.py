"""What a fitted table says elsewhere, and what it says without some of its readings."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ..core._errors import FitError
from ._grid import Grid, Located
from ._information import evaluate
from ._table import fit_tables
from ._types import Samples, TableFit, TableLayout
from .lanes import TableRequest


def predict(
    fit: TableFit,
    positions: Float[np.ndarray, "t d"],
    branch: Int[np.ndarray, " t"] | None = None,
) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    """Return error and its standard deviation at positions, the edge held, in mm or °.

    The deviation is that of the table; a reading there scatters by `TableFit.noise` on top.
    """
    grid = Grid(fit.layout)
    place = grid.locate(Samples(positions, np.zeros(len(positions)), branch))
    mean = evaluate(grid, place, grid.from_table(fit.values))
    return mean, np.sqrt(np.maximum(_variance(grid, place, fit.covariance), 0.0))


def deviations(
    fits: Sequence[TableFit],
    which: Int[np.ndarray, " t"],
    positions: Float[np.ndarray, "t d"],
    branch: Int[np.ndarray, " t"] | None = None,
) -> Float[np.ndarray, " t"]:
    """Return the standard deviation of one of several tables at each position, in mm or °.

    Args:
        fits: Tables of one layout.
        which: Table that is asked at each position.
        positions: As for `predict`.
        branch: As for `predict`.
    """
    grid = Grid(fits[0].layout)
    place = grid.locate(Samples(positions, np.zeros(len(positions)), branch))
    together = {
        step: np.stack([fit.covariance[step] for fit in fits])
        for step in fits[0].covariance
    }
    variance = _variance(grid, place, together, (which,))
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _variance(
    grid: Grid,
    place: Located,
    cov: Mapping[tuple[int, int], np.ndarray],
    at: tuple[Int[np.ndarray, " t"], ...] = (),
) -> Float[np.ndarray, " t"]:
    """Return the variance at places in cells.

    Args:
        grid: The nodes.
        place: Cells and where in them.
        cov: Covariance between neighbouring nodes, of one table or of a stack of them.
        at: Of a stack: the table that is asked at each place.
    """
    l, s, u, v = place.l, place.s, place.u, place.v
    above = grid.neighbour(l) if grid.slow > 1 else l
    right = np.minimum(s + 1, grid.fast - 1)
    low, high = (1 - u), u
    if not grid.planar:
        own = cov[0, 0]
        variance = low**2 * own[(*at, l, s)] + high**2 * own[(*at, above, s)]
        if (1, 0) in cov:
            variance = variance + 2 * low * high * cov[1, 0][(*at, l, s)]
        return np.asarray(variance)
    weights = {
        (0, 0): low * (1 - v),
        (0, 1): low * v,
        (1, 0): high * (1 - v),
        (1, 1): high * v,
    }
    nodes = {
        (0, 0): (l, s),
        (0, 1): (l, right),
        (1, 0): (above, s),
        (1, 1): (above, right),
    }
    variance = np.zeros(len(l))
    corners = list(weights)
    for i, first in enumerate(corners):
        for second in corners[i:]:
            step = (second[0] - first[0], second[1] - first[1])
            # Coupling (dl, ds) is stored at the node that it starts from.
            if step not in cov:
                continue
            share = weights[first] * weights[second] * (1.0 if first == second else 2.0)
            variance += share * cov[step][(*at, *nodes[first])]
    return variance


def leave_out(
    layout: TableLayout,
    samples: Samples,
    groups: Int[np.ndarray, " t"],
    fit: TableFit,
    *,
    run_effects: str = "none",
) -> Iterator[tuple[int, TableFit]]:
    """Yield for each group the table fitted to all the others.

    Smoothness weights and loss are those of ``fit``; noise and run effects are estimated anew.

    Raises:
        FitError: If there are fewer than two groups.
    """
    labels = np.unique(groups)
    if len(labels) < 2:
        msg = "leaving out needs at least two groups of readings, found one."
        raise FitError(msg)
    rests = [np.flatnonzero(groups != label) for label in labels]
    weights = dict(fit.smoothness)
    fits = fit_tables(
        [
            TableRequest(layout, samples, weights, fit.loss, run_effects, True, rest)
            for rest in rests
        ]
    )
    for label, fold in zip(labels, fits, strict=True):
        yield int(label), fold


def spatial_blocks(
    layout: TableLayout, samples: Samples, count: int = 8, seed: int = 0
) -> Int[np.ndarray, " t"]:
    """Return a group for each reading: interleaved blocks of neighbouring cells.

    For data without runs. Each axis is cut into about four blocks per group so that what is
    left out is bridged from around it and not extrapolated.
    """
    grid = Grid(layout)
    place = grid.locate(samples)
    rng = np.random.default_rng(seed)
    slow_blocks = min(max(grid.slow - 1, 1), 4 * count)
    slow = place.l * slow_blocks // max(grid.slow - 1, 1)
    if grid.planar:
        fast_blocks = min(max(grid.fast - 1, 1), 4 * count)
        fast = place.s * fast_blocks // max(grid.fast - 1, 1)
    else:
        fast_blocks, fast = 1, np.zeros(len(slow), np.int64)
    block = slow * fast_blocks + fast
    total = slow_blocks * fast_blocks
    # Every group gets the same number of blocks, in random places.
    group = rng.permutation(np.arange(total) % max(min(count, total), 1))
    return np.asarray(group[np.minimum(block, total - 1)], np.int64)
