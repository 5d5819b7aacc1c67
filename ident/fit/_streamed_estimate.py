"""The iterations of a table fit over a stream: `_estimate` and `_table`, asking for passes."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from ..core._errors import FitError
from ..core._loss import AbstractLoss, choose_loss
from ._estimate import PASSES, ROUGHLY, SAME, SETTLED, solved
from ._evidence import choose_smoothness
from ._passes import Asking
from ._posterior import Posterior, about
from ._prior import Smoothness
from ._problem import Problem
from ._reconsider import crowded
from ._streamed_asked import Estimate, Options
from ._streamed_looks import Judge, Judged, Rule, Thin
from ._streamed_sums import Half, Sums, SumUp
from ._suspects import distrusted
from ._types import TableFit
from ._verdict import (
    FOLLOWS,
    NONE_LEFT_OUT,
    WILD_SHARE,
    fit_message,
    fit_remarks,
    uncertain,
)

_EXACT = 1e-5
"""Smallest scatter relative to the spread of the readings."""

Table = Float[np.ndarray, "l s"]


@dataclasses.dataclass(frozen=True)
class _State:
    posterior: Posterior
    loss: AbstractLoss
    rule: Rule | None
    support: Int[np.ndarray, "l s"]
    converged: bool


def least_squares(
    options: Options, sums: Half, values: Table, spread: float
) -> Estimate:
    """Return the fit in which every reading counts in full, from the sums about a table.

    Args:
        options: What is asked.
        sums: About ``values``.
        values: Any table near the readings.
        spread: Range of the readings.

    Raises:
        FitError: If the readings do not determine the table.
    """
    if sums.count <= options.prior.null:
        msg = f"found {sums.count} readings, expected more than {options.prior.null}."
        raise FitError(msg)
    problem = _problem(options, sums, values, 1.0)
    if options.fixed:
        start = options.start(sums.normal.density, sums.count)
        posterior = solved(problem, start)
    else:
        choice = _chosen(problem)
        # About its own table the last digits are right, however stiff it is.
        posterior = solved(about(choice), choice.smoothness, choice)
    square = posterior.residual_square
    fit = _result(options, posterior, sums.support, square, sums.count, spread, True)
    return Estimate(fit, sums.count)


def closely(options: Options, thin: Thin) -> Asking[Estimate]:
    """Ask for the passes of a robust fit, and return it.

    Args:
        options: What is asked.
        thin: Readings that tell about all: where they lie, and how they scatter.

    Raises:
        FitError: If the readings do not determine the table.
    """
    found = yield from _attempt(options, thin)
    if options.loss != "student" or found.wild <= WILD_SHARE * found.count:
        return found
    found = yield from _attempt(dataclasses.replace(options, loss="huber"), thin)
    message = f"{found.fit.message} {NONE_LEFT_OUT}"
    return dataclasses.replace(
        found, fit=dataclasses.replace(found.fit, message=message)
    )


def _attempt(options: Options, thin: Thin) -> Asking[Estimate]:
    grid = options.grid
    centre = float(np.median(thin.error))
    values = np.full((grid.slow, grid.fast), centre)
    scaled = thin.residual(grid, values) * np.sqrt(thin.weight)
    loss = choose_loss(options.loss, scaled, 1.0, _floor(thin))
    first: Sums = yield SumUp(values, loss, None, True)
    current = options.start(first.held.normal.density, thin.count)
    tolerance = SETTLED if options.fixed else ROUGHLY
    state = yield from _robust(options, thin, current, values, None, tolerance, first)
    if not options.fixed:
        state = yield from _refined(options, thin, state)
    posterior = state.posterior
    judged: Judged = yield Judge(posterior.values, state.loss, state.rule)
    wild = thin.count - posterior.problem.count
    fit = _result(
        options, posterior, state.support, judged.inner, thin.count,
        float(np.ptp(thin.error)), state.converged,
    )  # fmt: skip
    suspects = distrusted(grid, judged.near, judged.kept)
    side_by_side = int(crowded(judged.near, judged.wild).sum()) if wild else 0
    return Estimate(
        dataclasses.replace(fit, suspect_nodes=suspects),
        thin.count,
        wild,
        state.rule if wild else None,
        side_by_side,
        (posterior.values, state.loss),
    )


def _floor(thin: Thin) -> float:
    # Without any noise the prior's own pull would make readings wild.
    return max(_EXACT * float(np.ptp(np.quantile(thin.error, (0.05, 0.95)))), 1e-12)


def _robust(
    options: Options,
    thin: Thin,
    smoothness: Smoothness,
    values: Table,
    rule: Rule | None,
    tolerance: float,
    first: Sums | None = None,
) -> Asking[_State]:
    """Iterate pseudo-readings and solution at fixed smoothness (`_estimate._robust`).

    ``first`` are the sums about a table that is still far off; None: it is near.
    """
    grid, floor = options.grid, _floor(thin)
    inflation = 1.0
    state: _State | None = None
    for step in range(PASSES):
        scaled = thin.residual(grid, values) * np.sqrt(thin.weight)
        loss = choose_loss(options.loss, scaled, inflation, floor)
        far = step == 0 and first is not None
        total: Sums
        if far and first is not None:
            total = first
        else:
            total = yield SumUp(values, loss, rule, False)
        sums = total.held
        if step <= 8 and total.changed > 1e-4 * thin.count:
            rule, sums = (values, loss), total.now
        steep = 1.0 if far else max(sums.slope / max(sums.count, 1), 0.1)
        problem = _problem(options, sums, values, steep)
        posterior = solved(problem, smoothness)
        move = float(np.abs(posterior.values - values).max())
        values = posterior.values
        scale = np.sqrt(max(posterior.variance, floor**2) / sums.normal.density)
        settled = bool(not far and move <= tolerance * scale)
        state = _State(posterior, loss, rule, sums.support, settled)
        if settled:
            break
        plenty = problem.count >= 20 * grid.size
        used = grid.size if plenty else posterior.used
        free = max(problem.count - used, 0.05 * problem.count)
        inflation = float(np.sqrt(problem.count / free))
    assert state is not None
    return state


def _refined(options: Options, thin: Thin, state: _State) -> Asking[_State]:
    """Choose the smoothness and weigh the readings anew until neither moves the table."""
    density = state.posterior.problem.normal.density
    for _ in range(8):
        choice = _chosen(state.posterior.problem)
        state = yield from _robust(
            options, thin, choice.smoothness, choice.values, state.rule, SETTLED
        )
        shift = float(np.std(state.posterior.values - choice.values))
        spread = np.sqrt(state.posterior.variance / density)
        if shift <= SAME * spread:
            return state
    return dataclasses.replace(state, converged=False)


def _chosen(problem: Problem) -> Posterior:
    choice = choose_smoothness(problem)
    if choice is None:
        msg = "no smoothness gives a table: the readings are degenerate."
        raise FitError(msg)
    return choice


def _problem(options: Options, sums: Half, values: Table, steep: float) -> Problem:
    return Problem(
        normal=sums.normal,
        prior=options.prior,
        vector=sums.vector / steep,
        square=sums.square / steep**2,
        count=sums.count,
        values=values,
        effects=np.zeros(0),
    )


def _result(
    options: Options,
    posterior: Posterior,
    support: Int[np.ndarray, "l s"],
    square: float,
    count: int,
    spread: float,
    converged: bool,
) -> TableFit:
    """Return the fit; ``square`` is Σ w r² of the readings that count."""
    grid, problem = options.grid, posterior.problem
    free = problem.count - posterior.used
    variance, message = posterior.variance, ""
    if options.fixed:
        if free >= max(3.0, 0.02 * problem.count):
            variance = posterior.residual_square / free
        else:
            choice = choose_smoothness(problem)
            if choice is not None:
                variance = choice.variance
            message = FOLLOWS
    noise = float(np.sqrt(variance if message else square / max(free, 1e-9)))
    deviation = np.sqrt(np.maximum(variance * posterior.inverse[0, 0], 0.0))
    worst = uncertain(deviation, support, spread, noise)
    if worst and not options.allow_gaps:
        msg = (
            "the readings do not determine the table: the least known node is uncertain "
            f"by {worst:.3g}."
        )
        raise FitError(msg)
    rejected = count - problem.count
    if message:
        message += fit_remarks(rejected, converged)
    else:
        message = fit_message(count, posterior.used, rejected, converged)
    return TableFit(
        layout=grid.layout,
        values=grid.to_table(posterior.values),
        standard_deviation=grid.to_table(deviation),
        support=grid.to_table(support),
        noise=noise,
        smoothness=posterior.smoothness.names(grid.slow_column + 1),
        loss=options.loss,
        residual=np.zeros(0),
        share=np.zeros(0),
        wild=np.zeros(0, bool),
        runs=(),
        suspect_nodes=(),
        suspect_runs=(),
        covariance={
            key: variance * posterior.inverse[key]
            for key in ((0, 0), (1, 0), (0, 1), (1, 1), (1, -1))
            if key in posterior.inverse
        },
        converged=converged,
        message=message,
    )
