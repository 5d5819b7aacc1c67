"""Where to begin with the smoothness: each table alone, the other effects taken as known."""

import numpy as np
from jaxtyping import Float

from .._evidence import choose_smoothness
from .._grid import Grid
from .._information import Normal
from .._logs import LOW
from .._prior import TablePrior
from .._problem import Problem
from ._design import Component
from ._problem import Solution
from ._tables import CrossEffect, LeadscrewEffect, PlaneEffect


def logs_alone(solution: Solution) -> Float[np.ndarray, " k"]:
    """Return logarithms of the weights that suit each table alone.

    Fourth differences are with or without, two valleys; here both are tried.

    Args:
        solution: A light fit, its values in the stated gauge.
    """
    problem = solution.problem
    weights = problem.weights
    logs = solution.logs.copy()
    step = solution.theta - problem.theta
    vector = problem.vector - problem.sums.apply(step)
    for number, table in enumerate(weights.tables):
        if table.effect < 0:
            continue
        effect = problem.sums.design.effects[table.effect]
        assert isinstance(effect, LeadscrewEffect | CrossEffect | PlaneEffect)
        grid = Grid(effect.layout)
        own = _alone(solution, table, grid, vector)
        found = choose_smoothness(own)
        if found is None:
            continue
        kinds = (*found.smoothness.slow, *found.smoothness.fast)
        for k, part in enumerate(weights.parts):
            if part.table == number:
                value = kinds[part.kind]
                logs[k] = np.log(value / weights.density[number]) if value > 0 else LOW
    return np.asarray(np.clip(logs, weights.low, weights.high))


def _alone(
    solution: Solution,
    table: Component,
    grid: Grid,
    vector: Float[np.ndarray, " n"],
) -> Problem:
    """Return the problem of one table about its present values."""
    places = table.grid_places
    matrix = solution.problem.sums.matrix[places][:, places]
    shape = (grid.slow, grid.fast)
    index = np.arange(grid.size).reshape(shape)
    steps = (
        [(0, 0), (0, 1), (1, 0), (1, 1), (1, -1)] if grid.planar else [(0, 0), (1, 0)]
    )
    entries = matrix.tocoo()
    row, column = entries.coords
    dense_key = row.astype(np.int64) * grid.size + column
    order = np.argsort(dense_key)
    keys, data = dense_key[order], entries.data[order]
    diagonals = {}
    for dl, ds in steps:
        other = np.full(shape, -1)
        if grid.layout.periodic:
            other[:] = np.roll(index, -dl, axis=0)
        else:
            rows = slice(0, grid.slow - dl)
            columns = slice(max(0, -ds), grid.fast - max(0, ds))
            other[rows, columns] = index[dl:, max(0, ds) : grid.fast - max(0, -ds)]
        wanted = index.reshape(-1) * grid.size + other.reshape(-1)
        at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        hit = (keys[at] == wanted) & (other.reshape(-1) >= 0)
        diagonals[dl, ds] = np.where(hit, data[at], 0.0).reshape(shape)
    assert isinstance(table.prior, TablePrior)
    return Problem(
        normal=Normal(grid, diagonals),
        prior=table.prior,
        vector=vector[places].reshape(shape),
        square=solution.residual_square,
        count=solution.problem.sums.count,
        values=solution.theta[places].reshape(shape),
        effects=np.zeros(0),
    )
