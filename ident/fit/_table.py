"""The table estimator: readings in, node values with uncertainty and support out."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ..core._errors import FitError
from ..core._threads import one_blas_thread
from ._checks import check_samples
from ._estimate import State, estimate, table_prior
from ._evidence import choose_smoothness
from ._gather import in_group
from ._grid import Grid
from ._information import touched
from ._once import judge_once
from ._readings import Readings
from ._runs import RunDesign, run_design
from ._suspects import suspect_nodes, suspect_runs
from ._types import RunEffect, Samples, TableFit, TableLayout
from ._verdict import (
    FOLLOWS,
    NONE_LEFT_OUT,
    fit_message,
    fit_remarks,
    too_many_wild,
    uncertain,
)
from .lanes import TableRequest, fit_small


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
    request = TableRequest(layout, samples, smoothness, loss, run_effects, allow_gaps)
    return fit_tables([request])[0]


def fit_tables(requests: Sequence[TableRequest]) -> list[TableFit]:
    """Fit several tables as `fit_table` does; small ones go together.

    Raises:
        FitError: For the first that cannot be fitted.
    """
    small = [k for k, request in enumerate(requests) if request.small]
    quick: dict[int, TableFit | None] = {}
    if small:
        own = [requests[k] for k in small]
        quick = dict(zip(small, in_group(fit_small, own), strict=True))
    return [quick.get(k) or _closely(request) for k, request in enumerate(requests)]


def _closely(request: TableRequest) -> TableFit:
    """Fit one table of any size, with second thoughts about its readings."""
    layout, samples, allow_gaps = request.layout, request.fitted, request.allow_gaps
    smoothness, loss = request.smoothness, request.loss
    check_samples(layout, samples, smoothness, allow_gaps)
    grid = Grid(layout)
    count = len(samples.error)
    plain = Readings(
        grid=grid,
        located=grid.locate(samples),
        error=np.asarray(samples.error, float),
        weight=np.ones(count)
        if samples.weight is None
        else np.asarray(samples.weight, float),
        design=np.zeros((count, 0)),
    )

    def attempt(loss: str, apart: Sequence[int] = ()) -> TableFit:
        design = run_design(samples, request.run_effects, apart)
        readings, start = plain, np.zeros(0)
        if design is not None:
            readings = dataclasses.replace(plain, design=design.columns())
            start = design.start(plain.error)
        prior = table_prior(grid)
        _refuse_too_few(count, prior.null + len(start))
        state = estimate(readings, prior, smoothness, loss, start)
        return _result(readings, design, state, loss, smoothness, allow_gaps)

    with one_blas_thread():
        fit = attempt(loss)
        apart = fit.suspect_runs
        if apart:
            # A run that contradicts the others must not pull their mean.
            fit = dataclasses.replace(attempt(loss, apart), suspect_runs=apart)
        if loss == "student" and too_many_wild(fit.wild, samples, fit.suspect_runs):
            fit = attempt("huber", apart)
            message = f"{fit.message} {NONE_LEFT_OUT}"
            fit = dataclasses.replace(fit, suspect_runs=apart, message=message)
    # Where the user sets the smoothness, or readings are held out, nothing is to be judged.
    judged = isinstance(smoothness, str) and not allow_gaps
    return judge_once(fit, samples) if judged else fit


def _refuse_too_few(count: int, needed: int) -> None:
    if count - needed < 1:
        msg = (
            f"{count} readings leave nothing to judge the noise by; "
            f"expected more than {needed}."
        )
        raise FitError(msg)


def _result(
    readings: Readings,
    design: RunDesign | None,
    state: State,
    loss: str,
    smoothness: float | str | Mapping[str, float],
    allow_gaps: bool,
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
                variance = choice.variance
                free = choice.problem.count - choice.used
            message = FOLLOWS
    if message:
        noise = float(np.sqrt(variance))
    else:
        noise = float(np.sqrt(inner[state.active].sum() / max(free, 1e-9)))
    support = touched(grid, readings.located.take(state.active))
    deviation = np.sqrt(np.maximum(variance * posterior.inverse[0, 0], 0.0))
    spread = float(np.ptp(readings.error))
    if not allow_gaps and (worst := uncertain(deviation, support, spread, noise)):
        msg = (
            "the readings do not determine the table: the least known node is uncertain "
            f"by {worst:.3g}."
        )
        raise FitError(msg)
    effects: tuple[RunEffect, ...] = ()
    if design is not None:
        effects = design.effects(posterior.effects, variance * posterior.schur_inverse)
    rejected = int(wild.sum())
    if message:
        message += fit_remarks(rejected, state.converged)
    else:
        count = len(residual)
        message = fit_message(count, posterior.used, rejected, state.converged)
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
