"""The iterations of a table fit: robust passes, choice of the smoothness, second thoughts."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from ..core._errors import FitError
from ..core._loss import AbstractLoss, choose_loss
from ._chain import chain_prior
from ._evidence import choose_smoothness
from ._grid import Grid
from ._logs import fixed_smoothness
from ._posterior import Posterior, solve
from ._prior import Smoothness, TablePrior
from ._problem import Problem
from ._readings import Readings, pseudo_readings
from ._reconsider import crowded_places, local_start, mixture_cost
from ._suspects import nearest

_LIGHT = 1e-6
"""Weight relative to the density that leaves a start at local medians where it is."""
_ROUNDS = 10
"""Rounds of medians; readings between nodes belong to two of them, so one does not do."""
THIN = 20_000
"""Readings, and up to twice as many, that judge the scale of the noise."""
PASSES = 40
"""Robust passes at most."""
_EXACT = 1e-5
"""Smallest scatter relative to the spread of the readings."""
SETTLED, ROUGHLY = 0.01, 0.1
"""Last move of any node, in typical standard deviations, at which the robust passes end."""
SAME = 0.05
"""Change of the table, in typical standard deviations, that asks for no new smoothness."""


def table_prior(grid: Grid) -> TablePrior:
    """Return the smoothness prior of a grid."""
    return TablePrior(
        chain_prior(grid.slow_nodes, grid.layout.periodic),
        chain_prior(grid.fast_nodes) if grid.planar else None,
        grid.fast,
    )


@dataclasses.dataclass(frozen=True)
class State:
    """Where the iterations stand."""

    posterior: Posterior
    loss: AbstractLoss
    active: Bool[np.ndarray, " t"]
    converged: bool


def estimate(
    readings: Readings,
    prior: TablePrior,
    smoothness: float | str | Mapping[str, float],
    loss: str,
    effects: Float[np.ndarray, " r"],
) -> State:
    """Alternate robust passes at fixed smoothness with the choice of the smoothness.

    Args:
        readings: What was measured.
        prior: Smoothness prior.
        smoothness: As for `fit_table`.
        loss: As for `fit_table`.
        effects: Run effects to begin with.
    """
    grid = readings.grid
    start = readings.error - readings.design @ effects
    centre = float(np.median(start[:: max(1, len(start) // THIN)]))
    values = np.full((grid.slow, grid.fast), centre)
    everything = np.ones(len(readings.error), bool)
    density = readings.normal(everything)[0].density
    fixed = not isinstance(smoothness, str)
    if not isinstance(smoothness, str):
        current = fixed_smoothness(smoothness, density, grid)
    else:
        # Plenty of readings per node judge each other; few need their neighbours.
        plenty = len(readings.error) >= 10 * grid.size
        weight = density * (1e-2 if plenty else 1.0)
        current = Smoothness(
            (weight, 0.0), (weight, 0.0) if grid.planar else (0.0, 0.0)
        )
    tolerance = SETTLED if fixed else ROUGHLY
    state = _robust(readings, prior, current, loss, values, effects, False, tolerance)
    if not fixed:
        state = _refined(readings, prior, state, loss)
    if state.active.all():
        return state
    node = nearest(grid, readings.located)
    if not crowded_places(node, ~state.active, grid.size).any():
        return state
    seen = state.posterior
    start = seen.values
    for _ in range(_ROUNDS):
        left = readings.residual(start, seen.effects)
        start = local_start(grid, node, start, left)
    light = current if fixed else fixed_smoothness(_LIGHT * density, density, grid)
    rival = _robust(
        readings, prior, light, loss, start, seen.effects, True, tolerance
    )  # fmt: skip
    if not fixed:
        rival = _refined(readings, prior, rival, loss)
    return min(
        (state, rival),
        key=lambda one: mixture_cost(
            readings, one.posterior, node, one.loss.limit * one.loss.scale, not fixed
        ),
    )


def _refined(readings: Readings, prior: TablePrior, state: State, loss: str) -> State:
    """Choose the smoothness and weigh the readings anew until neither moves the table."""
    density = state.posterior.problem.normal.density
    for _ in range(8):
        choice = choose_smoothness(state.posterior.problem)
        if choice is None:
            msg = "no smoothness gives a table: the readings are degenerate."
            raise FitError(msg)
        state = _robust(
            readings, prior, choice.smoothness, loss,
            choice.values, choice.effects, True, SETTLED, (state.active, choice),
        )  # fmt: skip
        shift = float(np.std(state.posterior.values - choice.values))
        spread = np.sqrt(state.posterior.variance / density)
        if loss == "gauss" or shift <= SAME * spread:
            return state
    return dataclasses.replace(state, converged=False)


def _robust(
    readings: Readings,
    prior: TablePrior,
    smoothness: Smoothness,
    name: str,
    values: Float[np.ndarray, "l s"],
    effects: Float[np.ndarray, " r"],
    near: bool,
    tolerance: float,
    last: tuple[Bool[np.ndarray, " t"], Posterior] | None = None,
) -> State:
    """Iterate pseudo-readings and solution at fixed smoothness, from a start near or far.

    ``last`` says which readings were believed last, and what they gave.
    """
    active = np.ones(len(readings.error), bool) if last is None else last[0]
    like = None if last is None else last[1]
    inflation = 1.0
    thin = readings.error[:: max(1, len(active) // THIN)]
    # Without any noise the prior's own pull would make readings wild.
    floor = max(_EXACT * float(np.ptp(np.quantile(thin, (0.05, 0.95)))), 1e-12)
    root = np.sqrt(readings.weight)
    state: State | None = None
    for step in range(PASSES):
        residual = readings.residual(values, effects)
        scaled = residual * root
        thin = scaled[:: max(1, len(residual) // THIN)]
        loss = choose_loss(name, thin, inflation, floor)
        ratio = scaled / loss.scale
        now = ~loss.wild(ratio)
        # A few readings at the edge of rejection change nothing but cost a sum over all.
        if step <= 8 and int((now != active).sum()) > 1e-4 * len(active):
            active = now
        sums = readings.normal(active)
        if step == 0 and not near:
            # Far from the table every residual is large: believe all but the hopeless ones.
            limit = np.inf if name == "gauss" else loss.limit * loss.scale
            pseudo = np.where(active, np.clip(scaled, -limit, limit) / root, 0.0)
        else:
            pseudo = pseudo_readings(loss, residual, ratio, active)
        problem = readings.problem(
            prior, sums, values, effects, pseudo, int(active.sum())
        )
        posterior = like = solved(problem, smoothness, like)
        move = float(np.abs(posterior.values - values).max())
        values, effects = posterior.values, posterior.effects
        spread = np.sqrt(max(posterior.variance, floor**2) / sums[0].density)
        settled = bool((step > 0 or near) and move <= tolerance * spread)
        state = State(posterior, loss, active, settled or name == "gauss")
        if state.converged:
            break
        # The exact number of parameters is dear on a large table, where it hardly matters.
        plenty = problem.count >= 20 * sums[0].grid.size
        used = sums[0].grid.size if plenty else posterior.used
        free = max(problem.count - used, 0.05 * problem.count)
        inflation = float(np.sqrt(problem.count / free))
    assert state is not None
    return state


def solved(
    problem: Problem, smoothness: Smoothness, like: Posterior | None = None
) -> Posterior:
    """Return `solve`, which must give something."""
    posterior = solve(problem, smoothness, like)
    if posterior is None:
        msg = "the readings do not determine the table: the normal matrix is singular."
        raise FitError(msg)
    return posterior
