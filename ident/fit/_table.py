"""The fit of one table: readings in, node values with uncertainty and support out."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Literal, final

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg
from jaxtyping import Bool, Float, Int
from scipy.ndimage import maximum, median

from .. import core
from ..core._posterior import FILL
from ..core._readings import Vector
from ._once import judge_once
from ._reconsider import at_medians, crowded, lost, reconsidered
from ._result import (
    ALIKE,
    doubt_of_curves,
    nearest_nodes,
    none_left_out,
    residual_of,
    result_of,
    runs_apart,
    suspect_runs,
    wild_readings,
)
from ._steps import Steps
from ._types import Extent, Samples, Smoothness, TableFit

RunEffects = Literal["none", "offset", "drift"]
"""What every run has of its own; they need runs, and a drift needs places within them."""

_DENSE = 60
"""Unknowns of a table up to which dense algebra is faster than a band."""
_RIDGE, _EXACT, _HARDLY = 1e-9, 1e-6, 0.05
"""Holds nodes without readings; shares of an offset and of a drift, that a table leaves of it, up
to which the table does it as well."""
_FIRST = 9
"""Readings that tell where to begin."""
TOO_MANY = 0.1
"""Share of wild readings from which on not the readings are at fault but the table."""
_GARBAGE = 0.5
"""Share of wild readings from which on a run is at fault."""


@core.one_blas_thread()
def fit_table(
    layout: core.TableEffect,
    samples: Samples,
    *,
    smoothness: Smoothness = "auto",
    loss: str = "student",
    run_effects: RunEffects = "none",
    allow_gaps: bool = False,
) -> TableFit:
    r"""Fit the node values of a table to readings of the error.

    The table is a Gaussian field: readings
    $e_t = \sum_k w_{tk}\theta_k + \text{run} + \varepsilon_t$ over the stencil of the
    controller's own interpolation, prior by differences of neighbouring nodes.

    Args:
        layout: Where the nodes lie.
        samples: Readings in mm or °.
        smoothness: ``"auto"`` lets the evidence choose weights of second and fourth differences
            per axis, and the noise; a number ≥ 0 is the weight of the squared second
            differences per node distance, relative to 1/noise².
        loss: ``"student"`` and ``"huber"`` resist wild readings, ``"gauss"`` is least squares.
        run_effects: ``"offset"`` or ``"drift"`` (offset and linear drift) lets every run have
            its own, summing to zero over the runs; with a robust loss not over those far off.
        allow_gaps: Accept fewer readings than nodes; the prior fills in.

    Raises:
        FitError: If the readings cannot determine the table or an option is unknown.
    """
    layout.check()
    extent = Extent.of(layout, samples)
    fit_to = _InMemory(layout, samples, smoothness, run_effects, allow_gaps)
    extent.check(layout, fit_to.stack(()).free, allow_gaps)
    fit = fit_to(loss, ())
    far = fit.suspect_runs if loss != "gauss" else ()
    if far:
        # A run that contradicts the others must not pull their mean.
        fit = fit_to(loss, far)
    off = fit.wild
    if loss == "student" and not _too_many(off, fit, samples):
        off = off | fit_to.steps.off_the_most(fit.residual)[0]
        if off.any():
            off = off & (runs_apart(fit, samples, fit_to.nearest)[0] == 0.0)
    divided = loss == "student" and _too_many(off, fit, samples)
    if divided:
        words = none_left_out(float(off.mean()))
        fit = fit_to("huber", far)
        told, none = f"{fit.message} {words}", np.zeros(len(off), bool)
        fit = dataclasses.replace(fit, message=told, wild=none)
    # Where the user sets the smoothness, or readings are held out, nothing is to be judged.
    judged = isinstance(smoothness, str) and not allow_gaps
    fit = judge_once(fit, samples) if judged else fit
    if not (divided or fit.wild.any()) and samples.run is None:
        return fit
    node = fit_to.nearest
    curves = doubt_of_curves(fit, samples, node)
    if curves.any():
        fit = dataclasses.replace(fit, message=f"{fit.message} {ALIKE}")
    shift = lost(layout, node, fit.residual, fit.wild)
    if divided:
        # The table may have gone with either side.
        middle = np.abs(fit_to.steps.off_the_most(fit.residual)[1])
        shift += maximum(middle, node, np.arange(len(shift)))
    apart, doubt = runs_apart(fit, samples, node)
    fit = dataclasses.replace(fit, apart=apart)
    return fit.doubted(curves + np.square(shift) + doubt)


def fit_values(
    layout: core.TableEffect, samples: Samples, *, smoothness: float
) -> Float[np.ndarray, "..."]:
    """Return the node values that minimise the penalised squares, and nothing else.

    The fast path for very many readings; `axcomp.fit_linear` gives derivatives. Smoothness as
    for `fit_table`, but not ``"auto"``.

    Raises:
        FitError: If the readings do not determine the table.
    """
    stack = core.Stack((layout,))
    with core.one_blas_thread():
        zero = np.zeros(stack.size)
        sums, _ = core.sums_of(stack, samples.readings, zero, core.Loss())
        problem = core.Problem.of(sums, zero)
        weights = fixed_weights(smoothness)
        assert weights is not None  # a number
        values = problem.values_at(weights(problem))
    if values is None:
        raise core.FitError(core.NOT_DETERMINED)
    return layout.to_table(values)


def level_of(error: Float[np.ndarray, " t"]) -> float:
    """Return about where readings lie, in mm or °: where a fit begins."""
    return float(np.median(error[:_FIRST]))


def fixed_weights(smoothness: Smoothness) -> Callable[[core.Problem], Vector] | None:
    """Return the weights that were asked for, given the sums; None for ``"auto"``.

    Of all second differences, without fourth ones; those that are given none fill gaps.

    Raises:
        FitError: If it is no smoothness.
    """
    if smoothness == "auto":
        return None
    if isinstance(smoothness, str) or not 0.0 <= smoothness < np.inf:
        msg = f"smoothness: found {smoothness!r}, expected 'auto' or a number >= 0."
        raise core.FitError(msg)

    def weights(problem: core.Problem) -> Vector:
        second = np.where(problem.stack.optional, 0.0, 1.0)
        return np.asarray(second * np.maximum(smoothness, FILL * problem.density))

    return weights


@final
@dataclasses.dataclass(frozen=True, eq=False)
class _InMemory:
    """A fit of readings in memory, by the arguments of `fit_table`; a call makes it by one loss."""

    layout: core.TableEffect
    samples: Samples
    smoothness: Smoothness
    run_effects: RunEffects
    allow_gaps: bool

    @cached_property
    def labels(self) -> Int[np.ndarray, " r"]:
        """Runs that have effects of their own."""
        run = self.samples.run
        labels = np.unique([] if run is None or self.run_effects == "none" else run)
        return (labels if len(labels) > 1 else labels[:0]).astype(np.int64)

    @cached_property
    def steps(self) -> Steps:
        """Steps in which the instrument reads; places differ by direction, too."""
        branches = [] if self.samples.branch is None else [self.samples.branch]
        return Steps.of(self.samples.error, [*self.samples.positions.T, *branches])

    @cached_property
    def nearest(self) -> Int[np.ndarray, " t"]:
        """Unknown of the table that each reading has the largest share in."""
        return nearest_nodes(core.Stack((self.layout,)), self.samples.readings)

    def stack(self, far: Sequence[int]) -> core.Stack:
        """Return the table, and effects of the runs; some do not count in their mean."""
        table, counted = self.layout, ~np.isin(self.labels, far)
        trend = "order" if self.run_effects == "drift" else None
        runs = (core.GroupEffect(counted, trend, self.kept),) if len(counted) else ()
        return core.Stack((table, *runs), table.size > _DENSE)

    @cached_property
    def kept(self) -> Float[np.ndarray, "pg k"]:
        """Effects of the runs that the table does as well."""
        drift = self.run_effects == "drift"
        return _kept_by_table(self.layout, self.samples.readings, drift)

    def __call__(self, loss: str, far: Sequence[int]) -> TableFit:
        """Return the fit by one loss, some runs left out of the mean of all."""
        stack, readings = self.stack(far), self.samples.readings
        error, effect = readings.value, stack.effects[-1]
        start = np.full(stack.size, level_of(error))
        if isinstance(effect, core.GroupEffect):
            runs = np.arange(len(self.labels))
            offset = median(error, readings.inputs["run"], runs) - start[0]
            start[stack.here(-1)] = effect.by_group[: len(offset)].T @ offset
        over, weights = core.memory(stack, readings), fixed_weights(self.smoothness)
        # A reading that is off by a step of the instrument is none that is wild.
        floor = max(core.least_scale(error), self.steps.size)
        passes = core.Passes(stack, over, loss, weights, floor)
        fitted = passes.run(start)
        if loss == "huber" and not fitted.converged:
            # Readings of a node that contradict all others pull evenly from any distance.
            fitted = passes.run(near=at_medians(stack, readings, fitted))
        wild, nodes = wild_readings(stack, readings, fitted.about, fitted.loss)
        if loss == "student" and crowded(nodes).any():
            fitted = reconsidered(passes, readings, fitted)
            wild, nodes = wild_readings(stack, readings, fitted.about, fitted.loss)
        fit = result_of(
            self.layout,
            fitted,
            loss,
            count=len(error),
            spread=np.inf if self.allow_gaps else float(np.ptp(error)),
            runs=self.labels.tolist(),
            nodes=nodes,
        )
        residual = residual_of(stack, readings, fitted.values)
        return dataclasses.replace(
            fit.doubted(self.steps.common(residual, wild)),
            residual=residual,
            wild=wild,
            suspect_runs=suspect_runs(fit.runs, residual, self.samples.run),
        )


def _kept_by_table(
    table: core.TableEffect, readings: core.Readings, drift: bool
) -> Float[np.ndarray, "pg k"]:
    """Return the offsets, then drifts, of runs that a table does as well, orthonormal columns.

    A mean offset is the constant of the table, and offsets of lines that grow from line to line
    are a slope of it; its smoothness tells those of set-ups that adjoin. A drift that all runs
    share is a slope where all go the same way over their places; where they go there and back it
    is that slope upward and its opposite downward. What readings hardly tell apart the table keeps.

    Args:
        table: Beside the runs.
        readings: With the number of the run of each, and its place within it for drifts.
        drift: Whether the runs have one.
    """
    run, nodes = readings.inputs["run"], core.Stack((table,)).matrix(readings)
    each = sp.csr_array((np.ones(len(run)), (np.arange(len(run)), run)))
    # What smoothness does not see of the table.
    straight = scipy.linalg.orth(nodes @ table.prior.straight)
    shared, alike = each.T @ straight, (each.T @ each).toarray()
    offsets = _null(alike, alike - shared @ shared.T, _EXACT)
    if not drift:
        return offsets
    place = sp.csr_array(each * readings.inputs["order"][:, None])
    columns = sp.csr_array(sp.hstack([each, place]))
    normal = sp.csc_array(nodes.T @ nodes + _RIDGE * sp.eye_array(table.size))
    own, shared = (columns.T @ columns).toarray(), (nodes.T @ columns).toarray()
    left = own - shared.T @ scipy.sparse.linalg.splu(normal).solve(shared)
    # What table and offsets leave of the drifts.
    half = len(own) // 2
    first, last = slice(half), slice(half, None)
    inverse = np.linalg.pinv(left[first, first], rcond=_EXACT, hermitian=True)
    beyond = left[last, last] - left[last, first] @ inverse @ left[first, last]
    drifts = _null(own[last, last], beyond, _HARDLY)
    return np.asarray(scipy.linalg.block_diag(offsets, drifts))


def _null(
    own: Float[np.ndarray, "g g"], left: Float[np.ndarray, "g g"], least: float
) -> Float[np.ndarray, "g k"]:
    """Return the orthonormal combinations of columns of which less than a share is left."""
    shares, vectors = scipy.linalg.eigh(left, own + _RIDGE * np.eye(len(own)))
    return np.linalg.qr(vectors[:, shares < least])[0]


def _too_many(wild: Bool[np.ndarray, " t"], fit: TableFit, samples: Samples) -> bool:
    """Tell whether so many readings are wild that it must be the table that is wrong."""
    if wild.any() and samples.run is not None:
        labels, index = np.unique(samples.run), samples.readings.inputs["run"]
        share = np.bincount(index, wild) / np.bincount(index)
        # A run of garbage is at fault itself.
        garbage = (share > _GARBAGE) | np.isin(labels, fit.suspect_runs)
        wild = wild[~garbage[index]]
    return bool(len(wild) and wild.mean() > TOO_MANY)
