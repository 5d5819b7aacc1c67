"""A table from its plan to its draft: readings in memory or in pieces, fitted."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from ...core import FitError, GroupEffect
from ...exchange import LIST_UNITS
from ...fit import (
    RunEffects,
    Samples,
    TableFit,
    fit_table,
    leave_out,
    scatter_of_runs,
    spatial_blocks,
)
from ...proof import HeldOut, groups_of_passes, groups_of_runs, held_out, run_variance
from ...readings import Readings, Tables, place_in_run, runs_overlap, without_zero
from .._draft import AbstractDraft, Leftovers
from ..result._result import Remark
from ._draft import TableDraft
from ._ends import (
    better_nodes,
    held_beyond,
    refuse_other_stretches,
    refuse_small_part,
    two_places,
)
from ._log_draft import fit_log
from ._log_readings import in_pieces
from ._passes import (
    NodePasses,
    as_passes_differ,
    nearest_node,
    of_both_ways,
    one_way,
    zeros_apart,
)
from ._plan import Plan, missing_way
from ._readings import read_fit, with_one_zero
from ._remarks import LOG, doubt_of_places, limit_remarks, outside
from ._trend import refuse_unowned_trend

if TYPE_CHECKING:
    from ..joint._share import Share

_DRIFT_NEEDS = 4
"""Readings that every run must have, so that a drift is more than a guess."""
_APART = (
    "readings on the way there and back lie apart, which only memory tells from waves of the"
    " table; where it does not hold them all, fit every n-th row"
)


def fit_planned(plan: Plan, tables: Tables, left: Leftovers) -> AbstractDraft:
    """Fit a planned table to its own measurements.

    Raises:
        JobError: If the readings do not determine the fit, or show a constant or a slope
            and the job does not say whose.
    """
    log, words = in_pieces(tables, plan, left)
    draft = None
    if log is not None:
        if plan.fit.constraints:
            reason = (
                "found beside a log that is read in pieces, expected stream = false"
            )
            raise plan.job.error(("fits", plan.index, "constraints"), reason)
        draft = fit_log(log)
        if draft is None:
            words = (log.into_memory(_APART),)
    if draft is not None:
        read = draft.readings
        refuse_small_part(plan, read)
        doubts = *two_places(plan, read), *limit_remarks(plan, read.positions, log=True)
        draft = dataclasses.replace(draft, said=(*draft.said, *doubts))
    else:
        readings, notes = read_fit(tables, plan, left)
        try:
            draft = fit_plan(plan, readings, (*words, *notes))
        except FitError as error:
            count = len(readings.error)
            beyond = int(outside(plan.table, readings.positions).sum())
            said = [note.message for note in notes]
            if doubt := doubt_of_places(beyond, count):
                said = [f"{beyond} of {count} readings lie outside the table.{doubt}"]
            raise FitError(" ".join([str(error), *said])) from None
    refuse_unowned_trend(plan, draft.estimate)
    return held_beyond(draft)


def fit_plan(plan: Plan, readings: Readings, remarks: Sequence[Remark]) -> TableDraft:
    """Fit the table of a plan to its readings."""
    table, spec, remarks = plan.table, plan.fit, [*remarks]
    refuse_small_part(plan, readings)
    refuse_other_stretches(plan, readings)
    remarks += two_places(plan, readings)
    readings, owner = with_one_zero(plan, readings)
    remarks += limit_remarks(plan, readings.positions)
    run, branch = readings.run, plan.branch(readings.direction)
    nodes = tuple(line.positions for line in table.nodes)
    signs = readings.direction if table.branches == 2 else None
    if run is not None and not runs_overlap(readings.positions, run, nodes, signs):
        if owner is None and len(np.unique(run)) > 1:
            words = (
                "The runs do not go over the same places, so that none can be judged by the"
                " others: offsets of single runs are not estimated."
            )
            remarks.append(Remark.info(words))
        run = None
    if owner is None and run is None:
        remarks += zeros_apart(plan, readings)
    samples = Samples(readings.positions, readings.error, branch, run=owner)
    effects: RunEffects = "none" if owner is None else "offset"
    if run is not None:
        order = place_in_run(run, readings.order)
        samples = dataclasses.replace(samples, run=run, order=order)
        shortest = np.unique(run, return_counts=True)[1].min()
        effects = "drift" if shortest >= _DRIFT_NEEDS else "offset"
    fewest = len(samples.error)  # readings of a direction
    if branch is not None:
        fewest = int(np.bincount(branch, minlength=2).min())
        if not fewest:
            notes = " ".join(each.message for each in remarks)
            reason = (
                f"found no reading in {missing_way(1 - 2 * branch)} direction of {plan.axis},"
                f" expected both directions for bilateral = true. {notes}"
            )
            raise plan.refusal(reason.rstrip(". "))
    finer = fewest < table.layout.size // table.branches
    fit_to = functools.partial(
        fit_table,
        table.layout,
        smoothness=spec.smoothness,
        loss=spec.loss,
        run_effects=effects,
        allow_gaps=finer,
    )
    fit = fit_to(samples)
    if branch is None:
        samples, apart = of_both_ways(plan, readings.order, samples, fit)
        remarks += apart
        fit = fit_to(samples) if apart else fit
    when = np.argsort(readings.order, kind="stable")
    left, wild = np.asarray(fit.residual)[when], np.asarray(fit.wild)[when]
    if np.isfinite(left[~wild]).sum() >= LOG:
        passes = NodePasses.of(plan, samples.take(when), left, wild)
        fit, alike = as_passes_differ(plan, passes, samples, fit)
        remarks += alike
    remarks += one_way(plan, readings, fit)
    if finer:
        words = "There are more nodes than readings: the prior fills in between."
        words += better_nodes(plan, readings)
        remarks.append(Remark.warning(words))
    if (inequalities := plan.inequalities) is not None:
        free, fit = fit, inequalities.keep(fit, samples)
        remarks.append(_constrained(plan, fit.values - free.values))
    zero, estimate = plan.zeroed(fit)
    if run is None:  # zeros of measurements that were taken off are no effects of runs
        effects = "none"
        estimate = dataclasses.replace(estimate, runs=(), suspect_runs=())
    before = readings.error - zero
    acted = plan.acted(readings.positions, branch)
    estimate = _doubted(plan, readings, samples, estimate)
    groups, along = None, readings.positions
    if run is not None:
        groups = groups_of_runs(run)
    elif along.shape[1] == 1 and len(along) >= LOG:
        groups = groups_of_passes(along[:, 0], readings.order)
    if groups is None:
        groups = spatial_blocks(fit.layout, samples)
    folds = leave_out(fit, samples, groups)
    heldout = held_out(
        table, samples, folds, groups, plan.integers, before, acted,
        runs=estimate.runs, by_run=run is not None,
    )  # fmt: skip
    readings = dataclasses.replace(readings, error=before)
    return TableDraft(
        plan.job, plan.index, spec, plan, estimate, effects, readings, heldout, remarks
    )


def _constrained(plan: Plan, shifts: Float[np.ndarray, "..."]) -> Remark:
    """Return by how much entries were shifted so that they keep the constraints."""
    count = int(np.sum(np.abs(shifts) >= 0.5 / LIST_UNITS))
    return Remark.info(
        f"The entries are {' and '.join(plan.fit.constraints)}, as constraints asks: for it"
        f" {count} of {shifts.size} moved, by up to {plan.small(np.abs(shifts).max(), '.1f')}."
        " Standard deviations are those of the fit without."
    )


def draft_of_share(plan: Plan, share: "Share") -> TableDraft:
    """Return the table of a group as one that was fitted alone."""
    recording, turns = share.recording, share.axis if plan.table.branches == 2 else None
    readings = recording.readings(plan.fit.over, turns, share.error, share.rows)
    refuse_small_part(plan, readings)
    refuse_other_stretches(plan, readings)
    branch = plan.branch(readings.direction)
    samples = Samples(readings.positions, readings.error, branch, run=readings.run)
    fit = _fit_of_share(plan, share)
    refuse_unowned_trend(plan, fit)
    if share.constant:
        fit = _doubted(plan, readings, samples, fit)
    variance = run_variance(fit.runs, np.zeros(len(samples.error)))
    variance += share.noise**2 + 1 / (12.0 * LIST_UNITS**2)
    heldout = HeldOut(
        residual=share.predicted[share.rows],
        standard_deviation=np.sqrt(variance),
        by_run=recording.by_run,
    )
    effects = "offset" if fit.runs else "none"
    remarks = (*share.remarks(), *two_places(plan, readings))
    draft = TableDraft(
        plan.job, plan.index, plan.fit, plan, fit, effects, readings, heldout, remarks
    )
    return held_beyond(draft)


def _fit_of_share(plan: Plan, share: "Share") -> TableFit:
    """Return a part of a joint fit as the fit of a single table."""
    part = share.part
    deviation = part.effect.table(part.standard_deviation)
    if share.constant:
        # Where the instrument drifted, nobody knows at what instant its zero was right.
        zero = np.hypot(share.fit.datum[plan.axis][1], share.drifted)
        deviation = np.hypot(deviation, zero)
    support = np.asarray(part.effect.table(part.support.astype(float)))
    # What only neighbours of the same table hide is filled like any other gap.
    hidden = ~np.isfinite(deviation)
    suspects = share.fit.suspect_runs[plan.axis]
    if plan.fit.loss != "gauss":
        suspects = share.fit.fits[plan.axis].design.aside
    deviation[hidden] = float(np.std(part.table))
    support = np.where(hidden, 0.0, support).astype(np.int64)
    return TableFit(
        layout=plan.table.layout,
        values=np.asarray(part.table + share.constant),
        standard_deviation=deviation,
        support=support,
        noise=share.noise,
        smoothness=dict(part.smoothness),
        loss=plan.fit.loss,
        residual=np.asarray(share.fit.residual[plan.axis][share.rows]),
        wild=share.wild,
        runs=tuple(share.fit.runs.get(plan.axis, ())),
        suspect_nodes=(),
        suspect_runs=suspects,
        covariance=sp.csr_array((0, 0)),
        converged=share.fit.converged,
        message=share.fit.fits[plan.axis].message,
    )


def _doubted(
    plan: Plan, readings: Readings, samples: Samples, fit: TableFit
) -> TableFit:
    """Return a fit whose standard deviations contain the errors that its readings share."""
    patterns = _patterns(plan, readings, samples, fit)
    doubts = [_doubt(plan, samples, pattern) for pattern in patterns]
    squares = sum(map(np.square, doubts), np.square(fit.standard_deviation))
    return dataclasses.replace(fit, standard_deviation=np.sqrt(squares))


def _patterns(
    plan: Plan, readings: Readings, samples: Samples, fit: TableFit
) -> list[Float[np.ndarray, " t"]]:
    """Return the errors that readings share, each as its standard deviation at every reading.

    By the delay of an instrument: an error in motion that is taken a moment too late has
    changed by that moment times the speed. By the runs: a table keeps the mean of their
    offsets and drifts, and a few runs do not tell what the mean of many would be.
    """
    patterns = [] if readings.late is None else [readings.late]
    # Least squares takes a run that contradicts the others into the mean as well.
    suspects = () if fit.loss == "gauss" else fit.suspect_runs
    aside = {*suspects, *readings.floating}
    runs = [run for run in fit.runs if run.run not in aside]
    scatter = scatter_of_runs(runs)
    for pattern in _kept(samples, fit, aside, scatter) if any(scatter) else []:
        for name, rows in readings.slices.items():
            kind = plan.job.spec.measurements[name].remove
            places = [*samples.positions[rows].T]
            pattern[rows] = without_zero(pattern[rows], places, kind)
        patterns.append(pattern)
    return patterns


def _kept(
    samples: Samples, fit: TableFit, aside: set[int], scatter: tuple[float, float]
) -> list[Float[np.ndarray, " t"]]:
    """Return what a table keeps of the offsets and drifts of runs, at every reading.

    Each as its standard deviation, from those of the runs that are not set aside.
    """
    counted = np.array([run.run not in aside for run in fit.runs])
    ones = np.ones((len(counted), 1))
    index, effect = samples.readings.inputs["run"], None
    if fit.estimate is not None:
        effect = fit.estimate.posterior.problem.stack.effects[-1]
    kept = effect.kept if isinstance(effect, GroupEffect) else None
    parts = [ones] if kept is None else np.split(kept, len(kept) // len(counted))
    middle = 0.0 if samples.order is None else samples.order - 0.5
    patterns = []
    # The offsets, and the drifts about the middle of a run.
    for deviation, effects, place in zip(scatter, parts, (1.0, middle), strict=False):
        shown = effects[:, effects.any(axis=0)] * counted[:, None]
        columns = np.linalg.qr(shown)[0].T
        patterns += [deviation * place * column[index] for column in columns]
    return patterns


def _doubt(
    plan: Plan, samples: Samples, pattern: Float[np.ndarray, " t"]
) -> Float[np.ndarray, "..."]:
    """Return the error of each node where the error of its readings is a pattern.

    What the datum takes off does not count; nodes without readings get the rms of the others.
    """
    shape = plan.table.layout.shape
    index = nearest_node(plan, samples)
    size = int(np.prod(shape))
    count = np.bincount(index, minlength=size)
    mean = np.bincount(index, pattern, minlength=size) / np.maximum(count, 1)
    everywhere = np.sqrt(np.mean(mean[count > 0] ** 2))
    values = np.where(count > 0, mean, everywhere).reshape(shape)
    return values - plan.zero_of(values)
