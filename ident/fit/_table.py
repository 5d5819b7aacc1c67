"""The table estimator: readings in, node values with uncertainty and support out."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from ._checks import check_samples
from ._errors import FitError
from ._evidence import choose_smoothness
from ._grid import Grid
from ._information import touched
from ._loss import AbstractLoss, choose_loss
from ._posterior import Posterior, Problem, solve
from ._prior import ChainPrior, Smoothness, TablePrior
from ._readings import Readings, pseudo_readings
from ._runs import RunDesign, run_design
from ._suspects import suspect_nodes, suspect_runs
from ._threads import one_blas_thread
from ._types import RunEffect, Samples, TableFit, TableLayout

_FILL = 1e-9
"""Weight relative to the density that fills gaps where no smoothness was asked for."""
_PASSES = 40
"""Robust passes at most."""
_SETTLED, _ROUGHLY = 0.01, 0.1
"""Last move of any node, in typical standard deviations, at which the robust passes end."""
_SAME = 0.05
"""Change of the table, in typical standard deviations, that asks for no new smoothness."""


def fit_table(
    layout: TableLayout,
    samples: Samples,
    *,
    smoothness: float | str | Mapping[str, float] = "auto",
    loss: str = "student",
    run_effects: str = "none",
    allow_gaps: bool = False,
) -> TableFit:
    r"""Fit the node values of a table to readings of the error.

    The table is a Gaussian field: readings
    $e_t = \sum_k w_{tk}\theta_k + \text{run} + \varepsilon_t$ over the stencil of the
    controller's own interpolation, prior by differences of neighbouring nodes. Nodes that no
    reading reaches are filled by the prior and have support 0.

    Args:
        layout: Where the nodes lie.
        samples: Readings in mm or °.
        smoothness: ``"auto"`` lets the evidence choose weights of second and fourth differences
            per axis, and the noise; a number ≥ 0 is the weight of the squared second
            differences per node distance, relative to 1/noise²; the weights of an earlier fit
            (`TableFit.smoothness`) are taken as they are.
        loss: ``"student"`` and ``"huber"`` resist wild readings, ``"gauss"`` is least squares.
        run_effects: ``"offset"`` or ``"drift"`` (offset and linear drift) lets every run have
            its own, summing to zero over the runs.
        allow_gaps: Accept fewer readings than nodes; the prior fills in (folds of a hold-out).

    Raises:
        FitError: If the readings cannot determine the table or an option is unknown.
    """
    check_samples(layout, samples, smoothness, allow_gaps)
    grid = Grid(layout)
    design = run_design(samples, run_effects)
    count = len(samples.error)
    readings = Readings(
        grid=grid,
        located=grid.locate(samples),
        error=np.asarray(samples.error, float),
        weight=np.ones(count)
        if samples.weight is None
        else np.asarray(samples.weight, float),
        design=np.zeros((count, 0)) if design is None else design.columns(),
    )
    prior = table_prior(grid)
    if count - prior.null - readings.design.shape[1] < 1:
        msg = (
            f"{count} readings leave nothing to judge the noise by; expected more than "
            f"{prior.null + readings.design.shape[1]}."
        )
        raise FitError(msg)
    with one_blas_thread():
        state = _estimate(readings, prior, smoothness, loss)
        return _result(readings, design, state, loss, smoothness)


def table_prior(grid: Grid) -> TablePrior:
    """Return the smoothness prior of a grid."""
    return TablePrior(
        ChainPrior(grid.slow_nodes, grid.layout.periodic),
        ChainPrior(grid.fast_nodes) if grid.planar else None,
        grid.fast,
    )


@dataclasses.dataclass(frozen=True)
class _State:
    """Where the iterations stand."""

    posterior: Posterior
    loss: AbstractLoss
    active: Bool[np.ndarray, " t"]
    converged: bool


def _estimate(
    readings: Readings,
    prior: TablePrior,
    smoothness: float | str | Mapping[str, float],
    loss: str,
) -> _State:
    """Alternate robust passes at fixed smoothness with the choice of the smoothness."""
    grid = readings.grid
    centre = float(np.median(readings.error))
    values = np.full((grid.slow, grid.fast), centre)
    effects = np.zeros(readings.design.shape[1])
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
    tolerance = _SETTLED if fixed else _ROUGHLY
    state = _robust(readings, prior, current, loss, values, effects, False, tolerance)
    if fixed:
        return state
    for _ in range(8):
        choice = choose_smoothness(state.posterior.problem, None)
        if choice is None:
            msg = "no smoothness gives a table: the readings are degenerate."
            raise FitError(msg)
        state = _robust(
            readings, prior, choice.posterior.smoothness, loss,
            choice.posterior.values, choice.posterior.effects, True, _SETTLED,
        )  # fmt: skip
        shift = float(np.std(state.posterior.values - choice.posterior.values))
        spread = np.sqrt(state.posterior.variance / density)
        if loss == "gauss" or shift <= _SAME * spread:
            return state
    return dataclasses.replace(state, converged=False)


def fixed_smoothness(
    smoothness: float | Mapping[str, float], density: float, grid: Grid
) -> Smoothness:
    if isinstance(smoothness, Mapping):
        return Smoothness.named(smoothness, grid.slow_column + 1)
    weight = max(smoothness, _FILL * density)
    return Smoothness((weight, 0.0), (weight, 0.0) if grid.planar else (0.0, 0.0))


def _robust(
    readings: Readings,
    prior: TablePrior,
    smoothness: Smoothness,
    name: str,
    values: Float[np.ndarray, "l s"],
    effects: Float[np.ndarray, " r"],
    near: bool,
    tolerance: float,
) -> _State:
    """Iterate pseudo-readings and solution at fixed smoothness, from a start near or far."""
    active = np.ones(len(readings.error), bool)
    sums = readings.normal(active)
    inflation = 1.0
    span = float(np.ptp(readings.error))
    floor = max(1e-9 * span, 1e-12)
    root = np.sqrt(readings.weight)
    state: _State | None = None
    for step in range(_PASSES):
        residual = readings.residual(values, effects)
        scaled = residual * root
        thin = scaled[:: max(1, len(residual) // 20_000)]
        loss = choose_loss(name, thin, inflation, floor)
        ratio = scaled / loss.scale
        now = ~loss.wild(ratio)
        # A few readings at the edge of rejection change nothing but cost a sum over all.
        if step <= 8 and int((now != active).sum()) > 1e-4 * len(active):
            active = now
            sums = readings.normal(active)
        if step == 0 and not near:
            # Far from the table every residual is large: believe all but the hopeless ones.
            pseudo = np.where(active, residual, 0.0)
        else:
            pseudo = pseudo_readings(loss, residual, ratio, active)
        problem = readings.problem(
            prior, sums, values, effects, pseudo, int(active.sum())
        )
        posterior = _solved(problem, smoothness)
        move = float(np.abs(posterior.values - values).max())
        values, effects = posterior.values, posterior.effects
        spread = np.sqrt(max(posterior.variance, floor**2) / sums[0].density)
        settled = (step > 0 or near) and move <= tolerance * spread
        state = _State(posterior, loss, active, settled or name == "gauss")
        if state.converged:
            break
        # The exact number of parameters is dear on a large table, where it hardly matters.
        plenty = problem.count >= 20 * sums[0].grid.size
        used = sums[0].grid.size if plenty else posterior.used
        free = max(problem.count - used, 0.05 * problem.count)
        inflation = float(np.sqrt(problem.count / free))
    assert state is not None
    return state


def _solved(problem: Problem, smoothness: Smoothness) -> Posterior:
    posterior = solve(problem, smoothness)
    if posterior is None:
        msg = "the readings do not determine the table: the normal matrix is singular."
        raise FitError(msg)
    return posterior


def _result(
    readings: Readings,
    design: RunDesign | None,
    state: _State,
    loss: str,
    smoothness: float | str | Mapping[str, float],
) -> TableFit:
    posterior, grid = state.posterior, readings.grid
    residual = readings.residual(posterior.values, posterior.effects)
    ratio = residual * np.sqrt(readings.weight) / state.loss.scale
    share = np.where(state.active, state.loss.share(ratio), 0.0)
    wild = ~state.active
    inner = readings.weight * np.square(residual)
    free = posterior.problem.count - posterior.used
    variance, message = posterior.variance, ""
    if not isinstance(smoothness, str):
        # A weight that the user sets says nothing about the noise: take it from the residuals,
        # or, where every node follows its own reading, from the evidence.
        if free >= max(3.0, 0.02 * posterior.problem.count):
            variance = posterior.residual_square / free
        else:
            choice = choose_smoothness(posterior.problem)
            if choice is not None:
                variance = choice.posterior.variance
                free = choice.posterior.problem.count - choice.posterior.used
            message = (
                "The table follows every reading; the noise was judged by the smoothness "
                "that the readings suggest."
            )
    if message:
        noise = float(np.sqrt(variance))
    else:
        noise = float(np.sqrt(inner[state.active].sum() / max(free, 1e-9)))
    support = touched(grid, readings.located.take(state.active))
    deviation = np.sqrt(np.maximum(variance * posterior.inverse[0, 0], 0.0))
    effects: tuple[RunEffect, ...] = ()
    if design is not None:
        effects = design.effects(posterior.effects, variance * posterior.schur_inverse)
    rejected = int(wild.sum())
    if not message:
        message = (
            f"{len(residual)} readings, {posterior.used:.1f} effective parameters."
        )
    if rejected:
        message += f" {rejected} wild readings were left out."
    if not state.converged:
        message += " The iterations did not settle; treat the result with care."
    return TableFit(
        layout=grid.layout,
        values=grid.to_table(posterior.values),
        standard_deviation=grid.to_table(deviation),
        support=grid.to_table(support),
        noise=noise,
        smoothness=posterior.smoothness.names(grid.slow_column + 1),
        loss=loss,
        residual=residual,
        share=share,
        wild=wild,
        runs=effects,
        suspect_nodes=suspect_nodes(grid, readings.located, share),
        suspect_runs=suspect_runs(design, residual, share, effects),
        covariance={
            key: variance * posterior.inverse[key]
            for key in ((0, 0), (1, 0), (0, 1), (1, 1), (1, -1))
            if key in posterior.inverse
        },
        converged=state.converged,
        message=message,
    )
