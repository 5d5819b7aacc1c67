"""The table fit over readings that do not fit into memory.

All that a fit needs of its readings are sums, and sums add up: over pieces of a file, over
files, over workers. Least squares takes one pass; the robust losses take one per iteration,
with the scale of the noise judged from every n-th reading, as in memory. The same steps as
`_estimate`, without its second thoughts about wild readings and without run effects.
"""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ._checks import check_samples
from ._errors import FitError
from ._estimate import PASSES, ROUGHLY, SAME, SETTLED, THIN, solved, table_prior
from ._evidence import choose_smoothness
from ._grid import Grid
from ._logs import fixed_smoothness
from ._loss import AbstractLoss, choose_loss
from ._posterior import Posterior, Problem
from ._prior import Smoothness, TablePrior
from ._streamed_sums import (
    Sums,
    Thin,
    count_readings,
    first_of,
    sum_up,
    take_every,
)
from ._threads import one_blas_thread
from ._types import Samples, TableFit, TableLayout
from ._verdict import fit_message, uncertain

Part = Callable[[], Iterable[Samples]]
"""Yields the same readings, piece by piece, every time it is called."""
Apply = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""Like `map`: here one after the other, or on workers."""

_EXACT = 1e-5
"""Smallest scatter relative to the spread of the readings."""


def fit_streamed(
    layout: TableLayout,
    parts: Sequence[Part],
    *,
    smoothness: float | str | Mapping[str, float] = "auto",
    loss: str = "gauss",
    apply: Apply = map,
) -> TableFit:
    """Fit a table to readings of any number in constant memory.

    Agrees with `fit_table` on the same readings to rounding, as long as no wild readings
    stand side by side.

    Args:
        layout: Where the nodes lie.
        parts: Readings; each part may be summed on another machine. Sums are added in this
            order, so that the result does not depend on who did which.
        smoothness: As for `fit_table`.
        loss: As for `fit_table`; ``"gauss"`` takes one pass after a first look.
        apply: How to run a function over the parts.

    Returns:
        The fit; its arrays over readings (``residual``, ``share``, ``wild``) are empty.

    Raises:
        FitError: If the readings do not determine the table or an option is unknown.
    """
    grid = Grid(layout)
    stream = _Stream(grid, table_prior(grid), parts, apply, loss)
    with one_blas_thread():
        fixed = not isinstance(smoothness, str)
        thin = stream.look(smoothness)
        centre = float(np.median(thin.error))
        values = np.full((grid.slow, grid.fast), centre)
        first = stream.sums(values, None, None, far=False)
        thin = dataclasses.replace(thin, count=first.now.count)
        _refuse_few(thin.count, stream.prior.null)
        density = first.now.normal.density
        if not isinstance(smoothness, str):
            current = fixed_smoothness(smoothness, density, grid)
        else:
            plenty = thin.count >= 10 * grid.size
            weight = density * (1e-2 if plenty else 1.0)
            current = Smoothness(
                (weight, 0.0), (weight, 0.0) if grid.planar else (0.0, 0.0)
            )
        tolerance = SETTLED if fixed else ROUGHLY
        state = stream.robust(thin, current, values, False, tolerance, first)
        if not fixed:
            state = _refined(stream, thin, state, first)
        return _result(stream, thin, state, fixed)


def _refuse_few(count: int, null: int) -> None:
    if count <= null:
        msg = f"found {count} readings, expected more than {null}."
        raise FitError(msg)


@dataclasses.dataclass(frozen=True)
class _State:
    posterior: Posterior
    loss: AbstractLoss
    rule: tuple[Float[np.ndarray, "l s"], AbstractLoss] | None
    support: Int[np.ndarray, "l s"]
    converged: bool


@dataclasses.dataclass
class _Stream:
    """The readings, as often as the loss needs them."""

    grid: Grid
    prior: TablePrior
    parts: Sequence[Part]
    apply: Apply
    loss: str
    passes: int = 0

    def look(self, smoothness: float | str | Mapping[str, float]) -> Thin:
        """Return readings that tell about all: where they lie, and how they scatter.

        Least squares only needs to know about where; the robust losses judge their scale
        by every n-th reading, which takes a pass to count and a pass to pick.
        """
        choose_loss(self.loss, np.ones(1), 1.0, 1.0)
        if self.loss == "gauss":
            part = next(filter(None, map(first_of, self.parts)), None)
            if part is None:
                _refuse_few(0, self.prior.null)
            assert part is not None
            check_samples(self.grid.layout, part, smoothness, True)
            return take_every(self.grid, (lambda: [part], 0), step=1)
        counts = list(self.apply(partial(count_readings, self.grid), self.parts))
        _refuse_few(sum(counts), self.prior.null)
        rows = [sum(counts[:k]) for k in range(len(counts))]
        step = max(1, sum(counts) // THIN)
        call = partial(take_every, self.grid, step=step)
        jobs = list(zip(self.parts, rows, strict=True))
        self.passes += 2
        return Thin.joined(list(self.apply(call, jobs)))

    def sums(
        self,
        values: Float[np.ndarray, "l s"],
        loss: AbstractLoss | None,
        before: tuple[Float[np.ndarray, "l s"], AbstractLoss] | None,
        *,
        far: bool,
    ) -> Sums:
        """Return the sums about a table; ``before`` says who was active last."""
        self.passes += 1
        call = partial(
            sum_up, self.grid, values=values, loss=loss, before=before, far=far
        )
        found: Iterator[Sums] = iter(self.apply(call, self.parts))
        total = next(found)
        for one in found:
            total = total + one
        return total

    def robust(
        self,
        thin: Thin,
        smoothness: Smoothness,
        values: Float[np.ndarray, "l s"],
        near: bool,
        tolerance: float,
        everything: Sums,
    ) -> _State:
        """Iterate pseudo-readings and solution at fixed smoothness (`_estimate._robust`)."""
        inflation = 1.0
        before: tuple[Float[np.ndarray, "l s"], AbstractLoss] | None = None
        spread = float(np.ptp(np.quantile(thin.error, (0.05, 0.95))))
        floor = max(_EXACT * spread, 1e-12)
        state: _State | None = None
        for step in range(PASSES):
            root = np.sqrt(thin.weight)
            scaled = thin.residual(self.grid, values) * root
            loss = choose_loss(self.loss, scaled, inflation, floor)
            far = step == 0 and not near
            gauss = self.loss == "gauss"
            total = (
                everything
                if gauss and step == 0 and not near
                else self.sums(values, loss, before, far=far)
            )
            sums = total.held
            if step <= 8 and total.changed > 1e-4 * thin.count:
                before, sums = (values, loss), total.now
            normal = sums.normal
            steep = 1.0
            if not (far or gauss):
                steep = max(sums.slope / max(sums.count, 1), 0.1)
            problem = Problem(
                normal=normal,
                prior=self.prior,
                vector=sums.vector / steep,
                square=sums.square / steep**2,
                count=sums.count,
                values=values,
                effects=np.zeros(0),
            )
            posterior = solved(problem, smoothness)
            move = float(np.abs(posterior.values - values).max())
            values = posterior.values
            scale = np.sqrt(max(posterior.variance, floor**2) / normal.density)
            settled = bool((step > 0 or near) and move <= tolerance * scale)
            state = _State(posterior, loss, before, sums.support, settled or gauss)
            if state.converged:
                break
            plenty = problem.count >= 20 * self.grid.size
            used = self.grid.size if plenty else posterior.used
            free = max(problem.count - used, 0.05 * problem.count)
            inflation = float(np.sqrt(problem.count / free))
        assert state is not None
        return state


def _refined(stream: _Stream, thin: Thin, state: _State, everything: Sums) -> _State:
    """Choose the smoothness and weigh the readings anew until neither moves the table."""
    density = state.posterior.problem.normal.density
    for _ in range(8):
        choice = choose_smoothness(state.posterior.problem)
        if choice is None:
            msg = "no smoothness gives a table: the readings are degenerate."
            raise FitError(msg)
        if stream.loss == "gauss":
            # Least squares about another table is the same table.
            return dataclasses.replace(state, posterior=choice)
        state = stream.robust(
            thin, choice.smoothness, choice.values, True, SETTLED, everything
        )
        shift = float(np.std(state.posterior.values - choice.values))
        spread = np.sqrt(state.posterior.variance / density)
        if shift <= SAME * spread:
            return state
    return dataclasses.replace(state, converged=False)


def _result(stream: _Stream, thin: Thin, state: _State, fixed: bool) -> TableFit:
    posterior, grid = state.posterior, stream.grid
    free = posterior.problem.count - posterior.used
    variance = posterior.variance
    square = posterior.residual_square
    if stream.loss != "gauss":
        # Of the readings themselves, not of pseudo-readings.
        last = stream.sums(posterior.values, state.loss, state.rule, far=True)
        square = last.held.inner
    if fixed:
        variance = posterior.residual_square / max(free, 1e-9)
    deviation = np.sqrt(np.maximum(variance * posterior.inverse[0, 0], 0.0))
    noise = float(np.sqrt(square / max(free, 1e-9)))
    spread = float(np.ptp(thin.error))
    if worst := uncertain(deviation, state.support, spread, noise):
        msg = (
            "the readings do not determine the table: the least known node is uncertain "
            f"by {worst:.3g}."
        )
        raise FitError(msg)
    rejected = thin.count - posterior.problem.count
    message = fit_message(thin.count, posterior.used, rejected, state.converged)
    return TableFit(
        layout=grid.layout,
        values=grid.to_table(posterior.values),
        standard_deviation=grid.to_table(deviation),
        support=grid.to_table(state.support),
        noise=noise,
        smoothness=posterior.smoothness.names(grid.slow_column + 1),
        loss=stream.loss,
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
        converged=state.converged,
        message=f"{message} Read in {stream.passes} passes.",
    )
