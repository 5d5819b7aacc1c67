"""The fit of one table: readings in, node values with uncertainty and support out."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import stdtr

from ..core import (
    Estimate,
    FitError,
    GroupEffect,
    Posterior,
    Problem,
    Readings,
    Stack,
    choose_weights,
    estimate,
    memory,
    one_blas_thread,
    sums_of,
)
from ..core._loss import Loss
from ..core._posterior import FILL
from ._checks import check_samples
from ._once import judge_once
from ._types import RunEffect, Samples, TableFit, TableLayout

Smoothness = float | str | Mapping[str, float]
"""``"auto"``, a weight, or the weights of an earlier fit by name."""

_EXACT = 1e-5
"""Smallest scatter relative to the spread of the readings."""
_THIN = 20_000
"""Readings that tell their spread."""
_DENSE = 60
"""Unknowns of a table up to which dense algebra is faster than a band."""
_FIRST = 9
"""Readings that tell where to begin."""
_NOTHING = 1e-12
"""Scatter in mm or ° that is none."""
_HOPELESS = 1e3
"""Uncertainty of a node, in ranges of the readings, that no extrapolation explains."""
TOO_MANY = 0.1
"""Share of wild readings from which on not the readings are at fault but the table."""
_GARBAGE = 0.5
"""Share of wild readings from which on a run is at fault."""
_TRUSTED = 0.5
"""A node whose nearest readings keep less than this share of their weight is named."""
_LOUD = 3.0
"""A run with this many times the scatter of the median run is named."""
_FAR = 1e-3
"""Chance of any run at all being as far off the others, below which it is named."""
FOLLOWS = (
    "The table follows every reading; the noise was judged by the smoothness that the "
    "readings suggest."
)
NONE_LEFT_OUT = (
    "Readings that agree with each other contradict a table of these nodes: none of them "
    "was left out."
)


def fit_table(
    layout: TableLayout,
    samples: Samples,
    *,
    smoothness: Smoothness = "auto",
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
            its own, summing to zero over the runs. With a robust loss a run that lies far off
            the others does not count in that mean; it is named in any case.
        allow_gaps: Accept fewer readings than nodes; the prior fills in.

    Raises:
        FitError: If the readings cannot determine the table or an option is unknown.
    """
    check_samples(layout, samples, smoothness, allow_gaps)
    labels, readings = with_runs(layout, samples, run_effects)
    options = _Options(
        layout, readings, labels, smoothness, loss, run_effects, allow_gaps
    )
    with one_blas_thread():
        fit, estimate = options.attempt(loss, ())
        apart = _far_runs(fit) if loss != "gauss" else ()
        if apart:
            # A run that contradicts the others must not pull their mean.
            fit, estimate = options.attempt(loss, apart)
        if loss == "student" and _too_many_wild(fit, samples):
            fit, estimate = options.attempt("huber", apart)
            fit = dataclasses.replace(fit, message=f"{fit.message} {NONE_LEFT_OUT}")
    fit = dataclasses.replace(fit, estimate=estimate)
    # Where the user sets the smoothness, or readings are held out, nothing is to be judged.
    judged = isinstance(smoothness, str) and not allow_gaps
    return judge_once(fit, samples) if judged else fit


def fit_values(
    layout: TableLayout,
    positions: Float[np.ndarray, "t d"],
    error: Float[np.ndarray, " t"],
    *,
    smoothness: float | Mapping[str, float],
    branch: Int[np.ndarray, " t"] | None = None,
) -> Float[np.ndarray, "..."]:
    """Return the node values that minimise the penalised squares, and nothing else.

    The fast path for very many readings; `axcomp.fit_linear` gives derivatives.

    Args:
        layout: Where the nodes lie.
        positions: In mm or °, columns in the order of `TableLayout.nodes`.
        error: Readings in mm or °.
        smoothness: As for `fit_table`, but not ``"auto"``.
        branch: 0 or 1 per reading for a table with two directions.

    Raises:
        FitError: If the readings do not determine the table.
    """
    samples = Samples(positions, error, branch)
    stack = Stack((layout.effect,))
    with one_blas_thread():
        zero = np.zeros(stack.size)
        sums, _ = sums_of(stack, layout.readings(samples), zero, Loss(), True, None)
        problem = Problem.of(sums, zero)
        found = problem.at(weights_of(stack, smoothness)(problem))
    if found is None:
        msg = "the readings do not determine the table: the normal matrix is singular."
        raise FitError(msg)
    return layout.effect.to_table(found.values)


def weights_of(
    stack: Stack, smoothness: Smoothness
) -> Callable[[Problem], Float[np.ndarray, " k"]]:
    """Return the weights of a table that the user asks for, given the sums."""

    def weights(problem: Problem) -> Float[np.ndarray, " k"]:
        if isinstance(smoothness, Mapping):
            names = stack.effects[0].prior.names
            return np.array([float(smoothness.get(name, 0.0)) for name in names])
        assert not isinstance(smoothness, str)
        second = np.maximum(float(smoothness), FILL * problem.density)
        return np.where(problem.optional, 0.0, second)

    return weights


def first_level(error: Float[np.ndarray, " t"]) -> float:
    """Return a level near the readings: of the first few, which a stream begins with, too."""
    return float(np.median(error[:_FIRST]))


def floor_of(error: Float[np.ndarray, " t"]) -> float:
    """Return the smallest scatter of readings to believe in, in mm or °.

    Without any noise the prior's own pull would make readings wild.
    """
    thin = error[:: max(1, len(error) // _THIN)]
    low, high = np.quantile(thin, (0.05, 0.95))
    return max(_EXACT * float(high - low), 1e-12)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class _Options:
    """What is asked of a fit."""

    layout: TableLayout
    readings: Readings
    labels: Int[np.ndarray, " r"]
    smoothness: Smoothness
    loss: str
    run_effects: str
    allow_gaps: bool

    def attempt(self, loss: str, apart: Sequence[int]) -> tuple[TableFit, Estimate]:
        """Return the fit by one loss, some runs left out of the mean of all."""
        error, table = self.readings.value, self.layout.effect
        stack = Stack((table,), table.size > _DENSE)
        start = np.full(table.size, first_level(error))
        if len(self.labels):
            counted = ~np.isin(self.labels, list(apart))
            trend = "order" if self.run_effects == "drift" else None
            effect = GroupEffect(counted, np.ones(len(counted), bool), "run", trend)
            stack = Stack((table, effect), stack.banded)
            middle = np.array(
                [
                    np.median(error[self.readings.inputs["run"] == k])
                    for k in range(len(self.labels))
                ]
            )
            own = np.zeros(effect.size)
            own[: effect.contrast.shape[1]] = effect.contrast.T @ (middle - start[0])
            start = np.concatenate([start, own])
        if len(error) <= stack.free:
            msg = (
                f"{len(error)} readings leave nothing to judge the noise by; "
                f"expected more than {stack.free}."
            )
            raise FitError(msg)
        over = memory(stack, self.readings)
        fixed = None
        if not isinstance(self.smoothness, str):
            fixed = weights_of(Stack((table,)), self.smoothness)
        found = estimate(
            stack, over, loss=loss, weights=fixed, floor=floor_of(error), start=start
        )
        residual = _residual(stack, self.readings, found.values)
        root = 1.0 if self.readings.weight is None else np.sqrt(self.readings.weight)
        wild = _residual(stack, self.readings, found.about) * root / found.loss.scale
        return self._result(
            found, loss, residual, residual * root, found.loss.wild(wild)
        )

    def _result(
        self,
        found: Estimate,
        loss: str,
        residual: Float[np.ndarray, " t"],
        scaled: Float[np.ndarray, " t"],
        wild: Bool[np.ndarray, " t"],
    ) -> tuple[TableFit, Estimate]:
        share = np.where(wild, 0.0, found.loss.share(scaled / found.loss.scale))
        table = self.layout.effect
        fit = table_fit(
            self.layout,
            found,
            loss,
            fixed=not isinstance(self.smoothness, str),
            count=len(residual),
            spread=np.inf if self.allow_gaps else float(np.ptp(self.readings.value)),
            labels=self.labels,
        )
        nodes, shares = table.design(self.readings)
        nearest = nodes[np.arange(len(nodes)), shares.argmax(axis=1)]
        suspects = suspect_nodes(
            np.bincount(nearest, minlength=table.size),
            np.bincount(nearest, share, table.size),
            table.to_table(np.arange(table.size)),
        )
        fit = dataclasses.replace(
            fit, residual=residual, share=share, wild=wild, suspect_nodes=suspects
        )
        if len(self.labels) < 3:
            return fit, found
        scatter = np.array(
            [
                np.median(np.abs(residual[self.readings.inputs["run"] == k]))
                for k in range(len(self.labels))
            ]
        )
        loud = self.labels[scatter > _LOUD * np.median(scatter)].tolist()
        named = tuple(sorted({*loud, *_far_runs(fit)}))
        return dataclasses.replace(fit, suspect_runs=named), found


def table_fit(
    layout: TableLayout,
    found: Estimate,
    loss: str,
    *,
    fixed: bool,
    count: int,
    spread: float,
    labels: Sequence[int] | Int[np.ndarray, " r"] = (),
) -> TableFit:
    """Return what an estimate says of a table; arrays over readings are empty.

    Args:
        layout: Where the nodes lie.
        found: The estimate; its first effect is the table.
        loss: Name of the loss.
        fixed: Whether the user set the smoothness.
        count: Number of readings.
        spread: Range of the readings in mm or °; infinite: any uncertainty is accepted.
        labels: Runs that have effects of their own.

    Raises:
        FitError: If the readings do not determine the table.
    """
    post, table = found.posterior, layout.effect
    noise, variance, message = found.noise, post.variance, ""
    if fixed:
        # A weight that the user sets says nothing about the noise: take it from the residuals,
        # or, where every node follows its own reading, from the evidence.
        free = post.problem.count - post.used
        if free >= max(3.0, 0.02 * post.problem.count):
            variance = post.residual_square / free
        else:
            chosen = choose_weights(post.problem)
            if chosen is not None:
                variance = chosen.variance
            noise, message = float(np.sqrt(variance)), FOLLOWS
    deviation = np.sqrt(np.maximum(variance * post.inverse_diagonal, 0.0))[: table.size]
    support = post.problem.sums.support[: table.size]
    worst = float(deviation[support > 0].max(initial=0.0))
    # Rounding can leave a singular matrix just definite.
    if np.isfinite(spread) and worst > _HOPELESS * max(spread, noise, _NOTHING):
        msg = (
            "the readings do not determine the table: the least known node is uncertain "
            f"by {worst:.3g}."
        )
        raise FitError(msg)
    rejected = count - int(post.problem.count)
    if not message:
        message = f"{count} readings, {post.used:.1f} effective parameters."
    if rejected:
        message += f" {rejected} wild readings were left out."
    if not found.converged:
        message += " The iterations did not settle; treat the result with care."
    names = table.prior.names
    return TableFit(
        layout=layout,
        values=table.to_table(post.values[: table.size]),
        standard_deviation=table.to_table(deviation),
        support=table.to_table(support),
        noise=noise,
        smoothness=dict(zip(names, post.weights.tolist(), strict=True)),
        loss=loss,
        residual=np.zeros(0),
        share=np.zeros(0),
        wild=np.zeros(0, bool),
        runs=_run_effects(post, labels, variance),
        suspect_nodes=(),
        suspect_runs=(),
        covariance=post.covariance(table.offsets).scaled(variance),
        converged=found.converged,
        message=message,
    )


def fold_of(fit: TableFit, post: Posterior) -> TableFit:
    """Return the table of a fold: smoothness and loss are those of the whole fit.

    Args:
        fit: Of all readings.
        post: Without some of them.
    """
    assert fit.estimate is not None
    found = dataclasses.replace(fit.estimate, posterior=post)
    effect = post.problem.stack.effects[-1]
    runs = [run.run for run in fit.runs]
    if isinstance(effect, GroupEffect):
        runs = [run for run, there in zip(runs, effect.present, strict=True) if there]
    return table_fit(
        fit.layout,
        found,
        fit.loss,
        fixed=True,
        count=int(post.problem.count),
        spread=np.inf,
        labels=runs,
    )


def _residual(
    stack: Stack, readings: Readings, theta: Float[np.ndarray, " u"]
) -> Float[np.ndarray, " t"]:
    """Return reading − fit."""
    plain = dataclasses.replace(readings, weight=None)
    return sums_of(stack, plain, theta, Loss(), False)[1]


# -------------------------------------------------------------------------------- runs


def with_runs(
    layout: TableLayout, samples: Samples, effects: str
) -> tuple[Int[np.ndarray, " r"], Readings]:
    """Return the runs that have effects of their own, and the readings."""
    readings = layout.readings(samples)
    if effects not in ("none", "offset", "drift"):
        msg = f"run_effects: found {effects!r}, expected 'none', 'offset' or 'drift'."
        raise FitError(msg)
    if effects == "none":
        return np.zeros(0, np.int64), readings
    if samples.run is None:
        msg = f"run_effects {effects!r} need the run of every reading, found none."
        raise FitError(msg)
    labels, index = np.unique(samples.run, return_inverse=True)
    inputs = {**readings.inputs, "run": index.reshape(-1)}
    if effects == "drift":
        if samples.order is None:
            msg = (
                "run_effects 'drift' need the place of every reading within its run, "
                "found none."
            )
            raise FitError(msg)
        inputs["order"] = samples.order - 0.5
    if len(labels) < 2:
        labels = labels[:0]
    return labels.astype(np.int64), dataclasses.replace(readings, inputs=inputs)


def _run_effects(
    post: Posterior, labels: Sequence[int] | Int[np.ndarray, " r"], variance: float
) -> tuple[RunEffect, ...]:
    """Return offset and drift of every run with their deviations."""
    effect = post.problem.stack.effects[-1]
    if not isinstance(effect, GroupEffect):
        return ()
    stack = post.problem.stack
    values = effect.by_group(post.values[stack.here(-1)])
    own = slice(stack.here(-1).start - stack.band, None)
    inverse = post.factor.border_inverse[own, own]
    spread = np.sqrt(variance * effect.variances(inverse))
    columns = [column for pair in zip(values, spread, strict=True) for column in pair]
    columns += [np.zeros_like(values[0])] * (4 - len(columns))
    rows = np.column_stack(columns)[effect.present].tolist()
    return tuple(
        RunEffect(int(run), *row) for run, row in zip(labels, rows, strict=True)
    )


def _far_runs(fit: TableFit) -> tuple[int, ...]:
    """Return runs that lie further off the others than runs of one machine ever do.

    Each offset against mean and scatter of the others, by Student's t; a run counts as far
    where not even one of a thousand machines would have any run like it.
    """
    count = len(fit.runs)
    if count < 3:
        return ()
    offset = np.array([run.offset for run in fit.runs])
    own = np.array([run.offset_sd for run in fit.runs])
    found = []
    for k, run in enumerate(fit.runs):
        others = np.delete(offset, k)
        scatter = max(float(np.std(others, ddof=1)), float(own[k]))
        t = abs(offset[k] - others.mean()) / (
            scatter * np.sqrt(1.0 + 1.0 / len(others))
        )
        # Of two others the scatter is hardly known: as if of three.
        if 2.0 * stdtr(max(count - 2, 2), -t) < _FAR / count:
            found.append(run.run)
    return tuple(found)


# ---------------------------------------------------------------------------- suspects


def suspect_nodes(
    count: Int[np.ndarray, " n"],
    kept: Float[np.ndarray, " n"],
    place: Int[np.ndarray, "..."],
) -> tuple[int, ...]:
    """Return flat table indices of nodes whose nearest readings were mostly set aside.

    Args:
        count: Readings next to each unknown.
        kept: Sum of the weight that the loss leaves them.
        place: Unknown at each place of the table.
    """
    # A share of 0.5 is the Student weight at two scales; a lone reading must be further off.
    limit = np.where(count > 1, _TRUSTED, 0.5 * _TRUSTED) * count
    doubted = (count > 0) & (kept < limit)
    if not doubted.any():
        return ()
    return tuple(np.flatnonzero(doubted[place.reshape(-1)]).tolist())


def _too_many_wild(fit: TableFit, samples: Samples) -> bool:
    """Tell whether so many readings are wild that it must be the table that is wrong."""
    wild = fit.wild
    if not wild.any():
        return False
    if samples.run is not None:
        labels, index = np.unique(samples.run, return_inverse=True)
        index = index.reshape(-1)
        lost = np.bincount(index, wild) / np.bincount(index)
        # A run of garbage is at fault itself.
        garbage = (lost > _GARBAGE) | np.isin(labels, fit.suspect_runs)
        wild = wild[~garbage[index]]
    return bool(len(wild) and wild.mean() > TOO_MANY)
