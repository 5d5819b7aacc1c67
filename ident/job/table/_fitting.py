"""A table from its plan to its draft: readings in memory or in pieces, fitted."""

import dataclasses
from collections import Counter
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ...exchange import AbstractTable
from ...fit import Samples, TableFit, TableLayout, doubt_of_means, fit_table
from ...proof import held_out
from ...readings import (
    Readings,
    Tables,
    place_in_run,
    runs_overlap,
    without_zero,
)
from .._draft import AbstractDraft, Leftovers
from ..result._result import Remark
from ._draft import InMemory, TableDraft
from ._layout import grid_words, suit
from ._log_draft import fit_log
from ._log_readings import in_pieces
from ._plan import Plan
from ._readings import read_fit
from ._trend import refuse_unowned_trend

_DRIFT_NEEDS = 4
"""Readings that every run must have, so that a drift is more than a guess."""


def fit_alone(plan: Plan, tables: Tables, left: Leftovers) -> AbstractDraft:
    """Fit a planned table to its own measurements.

    Raises:
        JobError: If the readings do not determine the fit, or show a constant or a slope
            and the job does not say whose.
    """
    log, words = in_pieces(tables, plan.fit, plan.table)
    if log is not None:
        _refuse_beside(plan, left)
        found = fit_log(plan, log)
    else:
        readings, more = read_fit(tables, plan.index, plan.fit, plan.table, left)
        found = fit_plan(plan, readings, (*words, *more))
    refuse_unowned_trend(plan, found.estimate)
    return found


def _refuse_beside(plan: Plan, left: Leftovers) -> None:
    for name in plan.fit.sources:
        for other in left.beside.get((plan.index, name), ()):
            raise plan.job.error(
                ("measurements", name, "stream"),
                f"found a log that is read in pieces, beside {other.words}, which was off"
                f" while measuring and will act as well: expected stream = false, so that"
                f" fits[{plan.index}] can correct what it leaves",
            )


def fit_plan(plan: Plan, readings: Readings, remarks: Sequence[Remark]) -> TableDraft:
    """Fit the table of a plan to its readings.

    Raises:
        FitError: If the readings cannot determine it.
        ExchangeError: If the result fits no list.
    """
    table, spec, remarks = plan.table, plan.fit, [*remarks]
    run, repeated = readings.run, _is_repeated(readings, table)
    if run is not None and not repeated and len(np.unique(run)) > 1:
        words = (
            "The runs do not go over the same places, so that none can be judged by the"
            " others: offsets of single runs are not estimated."
        )
        remarks.append(Remark.info(words))
    branch = plan.branch(readings.direction)
    samples = Samples(
        positions=readings.positions,
        error=readings.error,
        branch=branch,
        run=run if repeated else None,
        order=place_in_run(run, readings.order)
        if run is not None and repeated
        else None,
    )
    effects = _run_effects(samples)
    finer = _finer_than(table.layout, branch, len(readings.error))
    fit = fit_table(
        table.layout,
        samples,
        smoothness=spec.smoothness,
        loss=spec.loss,
        run_effects=effects,
        allow_gaps=finer,
    )
    if finer:
        words = "There are more nodes than readings: the prior fills in between."
        places = [*readings.positions.T]
        if not suit([nodes.positions for nodes in table.nodes], places):
            words += f" Nodes that suit these readings: {grid_words(places)}."
        remarks.append(Remark.warning(words))
    zero, estimate = plan.zeroed(fit)
    before = readings.error - zero
    acted = plan.acted(readings.positions, branch)
    estimate = doubted(plan, readings, samples, estimate)
    left = held_out(table, samples, fit, plan.integers, before, acted)
    fitted = InMemory(plan, readings, remarks, samples, before, left, estimate)
    return TableDraft(plan.job, plan.index, spec, plan, estimate, effects, fitted)


def _is_repeated(readings: Readings, table: AbstractTable) -> bool:
    """Return whether the runs go over the same places, so that others can judge each."""
    if readings.run is None:
        return False
    nodes = tuple(each.positions for each in table.nodes)
    way = readings.direction if table.branches == 2 else None
    return runs_overlap(readings.positions, readings.run, nodes, way)


def doubted(
    plan: Plan, readings: Readings, samples: Samples, fit: TableFit
) -> TableFit:
    """Return a fit whose deviations know what its readings are off together."""
    patterns = _patterns(plan, readings, samples, fit)
    doubts = [_doubt(plan, samples, fit, each) for each in patterns]
    squares = sum(map(np.square, doubts), np.square(fit.standard_deviation))
    return dataclasses.replace(fit, standard_deviation=np.sqrt(squares))


def _patterns(
    plan: Plan, readings: Readings, samples: Samples, fit: TableFit
) -> list[Float[np.ndarray, " t"]]:
    """Return what readings are off together, each by one standard deviation.

    By the delay of an instrument: an error in motion that is taken a moment too late has
    changed by that moment times the speed. By the runs: a table keeps the mean of their
    offsets and drifts, and a few runs do not tell what the mean of many would be.
    """
    found = [] if readings.late is None else [readings.late]
    runs = [run for run in fit.runs if run.run not in fit.suspect_runs]
    offset, drift = doubt_of_means(runs)
    ones = np.ones(len(samples.error))
    means = [offset * ones]
    if samples.order is not None:
        means.append(drift * (samples.order - 0.5))
    for pattern in means if offset or drift else []:
        for name, own in readings.slices.items():
            kind = plan.job.spec.measurements[name].remove
            places = [*samples.positions[own].T]
            pattern[own] = without_zero(pattern[own], places, kind)
        found.append(pattern)
    return found


def _doubt(
    plan: Plan, samples: Samples, estimate: TableFit, pattern: Float[np.ndarray, " t"]
) -> Float[np.ndarray, "..."]:
    """Return by how much each node is off where its readings are off by a pattern.

    What the datum takes off is no doubt; nodes without readings are off as the others are.
    """
    table, shape = plan.table, plan.table.layout.shape
    at: list[np.ndarray] = [] if samples.branch is None else [samples.branch]
    for nodes, places in zip(
        reversed(table.nodes), reversed(samples.positions.T), strict=True
    ):
        middles = 0.5 * (nodes.positions[1:] + nodes.positions[:-1])
        at.append(np.searchsorted(middles, places))
    index = np.ravel_multi_index(tuple(at), shape)
    size = int(np.prod(shape))
    count = np.bincount(index, minlength=size)
    mean = np.bincount(index, pattern, minlength=size) / np.maximum(count, 1)
    everywhere = np.sqrt(np.mean(mean[count > 0] ** 2))
    values = np.where(count > 0, mean, everywhere).reshape(shape)
    return values - plan.zero_of(dataclasses.replace(estimate, values=values))


def _finer_than(
    layout: TableLayout, branch: Int[np.ndarray, " t"] | None, count: int
) -> bool:
    """Return whether there are more nodes than readings, in a direction at least."""
    counts = [count] if branch is None else np.bincount(branch, minlength=2)
    return bool(min(counts) < layout.effect.size // layout.branches)


def _run_effects(samples: Samples) -> str:
    """Return what each run may have of its own: ``none``, ``offset`` or ``drift``."""
    if samples.run is None:
        return "none"
    counts = Counter(samples.run.tolist()).values()
    if len(counts) < 2:
        return "none"
    return "drift" if min(counts) >= _DRIFT_NEEDS else "offset"
