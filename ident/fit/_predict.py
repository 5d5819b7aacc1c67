"""What a fitted table says elsewhere, and what it says without some of its readings."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from .. import core
from ._result import folds_of, residual_of, result_of
from ._types import Samples, TableFit


def predict(
    fit: TableFit,
    positions: Float[np.ndarray, "t d"],
    branch: Int[np.ndarray, " t"] | None = None,
) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    """Return error and its standard deviation at positions, the edge held, in mm or °.

    The deviation is that of the table; a reading there scatters by `TableFit.noise` on top.

    Args:
        fit: The table.
        positions: In mm or °, columns in the order of `TableEffect.nodes`.
        branch: 0 (positive direction) or 1 per row; needed for a table with two directions.

    Raises:
        FitError: If a table with two directions is asked without any.
    """
    if fit.layout.branches == 2 and branch is None:
        msg = (
            "a table with two directions says something else in each: "
            "give the direction of every position (branch)."
        )
        raise core.FitError(msg)
    samples = Samples(positions, np.zeros(len(positions)), branch)
    rows = core.Stack((fit.layout,)).matrix(samples.readings)
    moved: Any = rows @ fit.covariance
    variance = moved.multiply(rows).sum(axis=1)
    mean = rows @ fit.layout.to_values(fit.values)
    return mean, np.sqrt(np.maximum(variance, 0.0))


def mean_row(
    layout: core.TableEffect, place: Sequence[float]
) -> Float[np.ndarray, " n"]:
    """Return each unknown's share in what a table says at a place, the mean of its directions."""
    ways = np.arange(layout.branches)
    there = Samples(np.tile(np.array(place), (len(ways), 1)), np.zeros(len(ways)), ways)
    return np.asarray(core.Stack((layout,)).matrix(there.readings).mean(axis=0))


def zeroed(fit: TableFit, row: Float[np.ndarray, " n"]) -> TableFit:
    """Return a table less what it says at a place, by each unknown's share in that (`mean_row`).

    The standard deviations of its values are those of the differences. The fit is one of all its
    readings.
    """
    effect = fit.layout
    values = fit.values - float(row @ effect.to_values(fit.values))
    assert fit.estimate is not None  # only folds have none
    posterior = fit.estimate.posterior
    here = posterior.problem.stack.here(0)
    # Stated deviations hold more than the noise; correlations are those of the noise alone.
    scale = effect.to_values(fit.standard_deviation)
    scale = scale / np.sqrt(posterior.inverse_diagonal[here])
    unknowns = np.zeros(len(posterior.values))
    unknowns[here] = row * scale
    shared = scale * posterior.factor.solve(unknowns)[here]
    gain = effect.to_table(row @ shared - 2.0 * shared)
    deviation = np.sqrt(np.maximum(np.square(fit.standard_deviation) + gain, 0.0))
    return dataclasses.replace(fit, values=values, standard_deviation=deviation)


def leave_out(
    fit: TableFit, samples: Samples, groups: Int[np.ndarray, " t"]
) -> dict[int, TableFit]:
    """Return for each group the table fitted to all readings but those of the group.

    Smoothness and the weight that the loss leaves each reading are those of the fit of all
    samples by `fit_table`; values, noise and effects of runs are estimated anew. Arrays over
    readings are empty, and so are its runs.

    Raises:
        FitError: If there are fewer than two groups.
    """
    estimate = fit.estimate
    assert estimate is not None  # every fit of `fit_table` has one
    stack = estimate.posterior.problem.stack
    effect, readings, zeros = stack.effects[-1], samples.readings, {}
    with core.one_blas_thread():
        sums = core.sums_by_group(estimate, readings, stack.matrix(readings), groups)
        if isinstance(effect, core.GroupEffect):
            runs, ahead = readings.inputs["run"], stack.starts[-2] - stack.band
            for label in sums:
                absent = ~np.isin(np.arange(len(fit.runs)), runs[groups != label])
                shares = effect.by_group[np.tile(absent, effect.parts)]
                zeros[label] = np.pad(shares, ((0, 0), (ahead, 0)))
        return folds_of(fit, sums, zeros)


def as_alike(fit: TableFit, samples: Samples, times: float) -> TableFit:
    """Return what readings tell of a table if only one in so many is news: `Estimate.alike`.

    Raises:
        FitError: If so few readings determine nothing.
    """
    assert fit.estimate is not None  # every fit of `fit_table` has one
    with core.one_blas_thread():
        estimate = fit.estimate.alike(times)
        runs = [run.run for run in fit.runs]
        told = result_of(fit.layout, estimate, fit.loss, count=len(fit.wild), runs=runs)
        stack = estimate.posterior.problem.stack
        residual = residual_of(stack, samples.readings, estimate.values)
    return dataclasses.replace(
        fit,
        values=told.values,
        standard_deviation=np.maximum(told.standard_deviation, fit.standard_deviation),
        noise=told.noise,
        smoothness=told.smoothness,
        residual=residual,
        runs=told.runs,
        covariance=told.covariance,
        estimate=estimate,
    )


def spatial_blocks(
    layout: core.TableEffect, samples: Samples, count: int = 5
) -> Int[np.ndarray, " t"]:
    """Return a group for each reading, so many in all: interleaved blocks of neighbouring cells.

    For data without runs. Each axis is cut into about four blocks per group so that what is
    left out is bridged from around it and not extrapolated.
    """
    blocks, size = np.zeros(len(samples.error), np.int64), 1
    for column, line in enumerate(layout.nodes):
        cells = max(len(line) - 1, 1)
        cell = np.searchsorted(line[1:-1], samples.positions[:, column], side="right")
        per_axis = min(cells, 4 * count)
        blocks = blocks * per_axis + cell * per_axis // cells
        size *= per_axis
    if size == 1:  # nothing is around a single cell: one reading in so many
        return np.arange(len(blocks)) % count
    # Every group gets the same number of blocks, in random places.
    group = np.random.default_rng(0).permutation(np.arange(size) % min(count, size))
    return np.asarray(group[np.minimum(blocks, size - 1)], np.int64)
