"""A table from its plan to its draft: readings in memory or in pieces, fitted."""

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float

from ...core import FitError
from ...exchange import LIST_UNITS
from ...fit import (
    RunEffects,
    Samples,
    TableFit,
    doubt_of_means,
    fit_table,
    leave_out,
    spatial_blocks,
)
from ...proof import (
    HeldOut,
    groups_of_passes,
    groups_of_runs,
    held_out,
)
from ...readings import Readings, Tables, place_in_run, runs_overlap, without_zero
from .._draft import AbstractDraft, Leftovers
from ..result._result import Remark
from ._draft import TableDraft
from ._layout import grid_keys, grid_words, same_nodes
from ._log_draft import fit_log
from ._log_readings import in_pieces
from ._passes import as_passes_differ, nearest_node, of_both_ways
from ._plan import Plan, missing_way
from ._readings import read_fit, with_one_zero
from ._remarks import LOG, doubt_of_places, limit_remarks, outside
from ._run_remarks import SEEN, TINY
from ._trend import refuse_unowned_trend

if TYPE_CHECKING:
    from ..joint._share import Share

_PART = 0.1
"""Share of a table over which readings must lie at least."""
_TOUCHED = 0.25
"""Share of a cell at its end that readings must reach into for the node beyond it to be read."""
_EMPTY = 0.9
"""Share of the way of all readings that one gap takes where they stand at two places."""
_DRIFT_NEEDS = 4
"""Readings that every run must have, so that a drift is more than a guess."""


def fit_planned(plan: Plan, tables: Tables, left: Leftovers) -> AbstractDraft:
    """Fit a planned table to its own measurements.

    Raises:
        JobError: If the readings do not determine the fit, or show a constant or a slope
            and the job does not say whose.
    """
    log, words = in_pieces(tables, plan, left)
    if log is not None:
        if plan.fit.constraints:
            reason = (
                "found beside a log that is read in pieces, expected stream = false"
            )
            raise plan.job.error(("fits", plan.index, "constraints"), reason)
        draft = fit_log(log)
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
            msg = " ".join([str(error), *said])
            raise FitError(msg) from None
    refuse_unowned_trend(plan, draft.estimate)
    return held_beyond(draft)


def held_beyond(draft: TableDraft) -> TableDraft:
    """Return a table that goes on beyond its readings as the controller does.

    There the smoothness would go on straight, or bend. Where the other direction was read the
    table follows that, as far from it as at the last reading; else it holds its edge. How far
    that moves a node joins its deviation: either may be right.
    """
    plan, estimate = draft.plan, draft.estimate
    masters, branches = plan.table.nodes, plan.table.branches
    if plan.table.periodic:
        return draft
    shape = branches, *(len(nodes.positions) for nodes in reversed(masters))
    values = estimate.values.reshape(shape).copy()
    deviation = estimate.standard_deviation.reshape(shape).copy()
    least = max(SEEN * estimate.noise, TINY)
    said = dict[tuple[str, float, float, str], list[str]]()
    for k, (name, line) in enumerate(zip(plan.fit.over, masters, strict=True)):
        nodes = line.positions
        parts = [_part_read(draft, k, branch) for branch in range(branches)]
        fitted, curves, sd = (
            np.moveaxis(array, -1 - k, 1)
            for array in (values.copy(), values, deviation)
        )
        for branch, (first, last, *ends) in enumerate(parts):
            begin, end, *_ = parts[branch - 1]
            for place, way in (
                (ends[0], np.arange(first, -1, -1)),
                (ends[1], np.arange(last, len(nodes))),
            ):
                if len(way) < 2:
                    continue
                other = fitted[branch - 1, way]
                # Without another direction it is itself, which was not read there.
                seen = (way >= begin) & (way <= end)
                held, gone = _beyond(
                    nodes[way], fitted[branch, way], place, other, seen
                )
                moved = np.abs(fitted[branch, way[1:]] - gone)
                if max(moved.max(), np.abs(gone - held).max()) <= least:
                    continue
                curves[branch, way[1:]] = gone
                sd[branch, way[1:]] = np.hypot(sd[branch, way[1:]], moved)
                low, high = sorted((float(nodes[way[1]]), float(nodes[way[-1]])))
                does = "holds its edge"
                if (seen[1:] & seen[:-1]).any():
                    does = "follows the other direction"
                elif plan.old is not None:
                    does = "keeps its old shape, moved as its edge is"
                said.setdefault((name, low, high, does), []).append("+−"[branch])
    remarks = [
        Remark.warning(
            f"No reading{f' in {signs[0]} direction' * (len(signs) < branches)} lies at {name} ="
            f" {low:g}{f' to {high:g}' * (high > low)}: there the table {does}, which nobody"
            " measured. Measure there as well."
        )
        for (name, low, high, does), signs in said.items()
    ]
    estimate = dataclasses.replace(
        estimate,
        values=values.reshape(estimate.values.shape),
        standard_deviation=deviation.reshape(estimate.values.shape),
    )
    return dataclasses.replace(draft, estimate=estimate, said=(*draft.said, *remarks))


def _beyond(
    nodes: Float[np.ndarray, " n"],
    curve: Float[np.ndarray, "n *m"],
    place: float,
    other: Float[np.ndarray, "n *m"],
    seen: Bool[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, "*m"], Float[np.ndarray, "n1 *m"]]:
    """Return the edge of a table at its last reading, and the nodes beyond it from there on.

    Args:
        nodes: From the last that was read on outwards.
        curve: What was fitted there.
        place: Of the last reading.
        other: What was fitted in the other direction.
        seen: Where that was read.
    """
    share = max((place - nodes[0]) / (nodes[1] - nodes[0]), 0.0)
    edge = curve[0] + share * (curve[1] - curve[0])
    beside = (seen[1:] & seen[:-1]).reshape(-1, *[1] * (curve.ndim - 1))
    return edge, edge + np.cumsum(beside * np.diff(other, axis=0), axis=0)


def _part_read(
    draft: TableDraft, master: int, branch: int
) -> tuple[int, int, float, float]:
    """Return the first and the last node along a master that were read, and reading there.

    A node that readings touch from afar, at the other end of its cell, is beyond them.
    """
    table, readings, wild = draft.plan.table, draft.readings, draft.estimate.wild
    nodes = table.nodes[master].positions
    rows = np.ones(len(readings.error), bool)
    if len(wild) == len(rows):
        rows = ~wild
    if table.branches == 2 and readings.direction is not None:
        rows &= readings.direction == (1, -1)[branch]
    places = np.clip(readings.positions[rows, master], nodes[0], nodes[-1])
    if draft.log is not None:  # of which a part is in memory
        shape = table.branches, *(len(line.positions) for line in reversed(table.nodes))
        support = np.moveaxis(
            draft.estimate.support.reshape(shape)[branch], -1 - master, 0
        )
        places = nodes[support.reshape(len(nodes), -1).any(axis=1)]
    if not len(places):
        return 0, len(nodes) - 1, nodes[0], nodes[-1]
    low, high = float(places.min()), float(places.max())
    near = _TOUCHED * np.diff(nodes)
    first = int(np.searchsorted(nodes[1:] - near, low, "right"))
    last = int(np.searchsorted(nodes[:-1] + near, high))
    return min(first, last), max(first, last), low, high


def fit_plan(plan: Plan, readings: Readings, remarks: Sequence[Remark]) -> TableDraft:
    """Fit the table of a plan to its readings.

    Raises:
        FitError: If the readings cannot determine it.
        ExchangeError: If the result fits no list.
    """
    table, spec, remarks = plan.table, plan.fit, [*remarks]
    _refuse_small_part(plan, readings)
    remarks += _two_places(plan, readings)
    readings, owner = with_one_zero(plan, readings)
    remarks += limit_remarks(plan.job, plan.fit.over, readings.positions)
    run = readings.run
    nodes = tuple(line.positions for line in table.nodes)
    # Whether the runs go over the same places, so that others can judge each.
    signs = readings.direction if table.branches == 2 else None
    repeated = run is not None and runs_overlap(readings.positions, run, nodes, signs)
    if run is not None and not repeated and owner is None and len(np.unique(run)) > 1:
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
        run=run if repeated else owner,
        order=place_in_run(run, readings.order)
        if run is not None and repeated
        else None,
    )
    effects: RunEffects = "none" if owner is None else "offset"
    if run is not None and repeated:
        shortest = np.unique(run, return_counts=True)[1].min()
        effects = "drift" if shortest >= _DRIFT_NEEDS else "offset"
    fewest = len(samples.error)  # readings of a direction
    if branch is not None:
        fewest = int(np.bincount(branch, minlength=2).min())
        if not fewest:
            missing = missing_way(1 - 2 * branch)
            reason = (
                f"found no reading in {missing} direction of {plan.axis}, expected both"
                " directions for bilateral = true"
            )
            notes = [each.message for each in remarks]
            raise plan.refusal(". ".join([reason, " ".join(notes)]).rstrip(". "))
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
    if run is None and branch is None:
        samples, apart = of_both_ways(plan, readings, samples, fit)
        remarks += apart
        fit = fit_to(samples) if apart else fit
    fit, alike = as_passes_differ(plan, readings.order, samples, fit)
    remarks += alike
    if finer:
        words = "There are more nodes than readings: the prior fills in between."
        words += _better_nodes(plan, readings)
        remarks.append(Remark.warning(words))
    if (inequalities := plan.inequalities) is not None:
        free, fit = fit, inequalities.keep(fit, samples)
        remarks.append(_constrained(plan, fit.values - free.values))
    zero, estimate = plan.zeroed(fit)
    if not repeated:  # zeros of measurements that were taken off are no effects of runs
        effects = "none"
        estimate = dataclasses.replace(estimate, runs=(), suspect_runs=())
    before = readings.error - zero
    acted = plan.acted(readings.positions, branch)
    estimate = _doubted(plan, readings, samples, estimate)
    if run is not None and repeated:
        groups = groups_of_runs(run)
    else:
        passes, along = None, readings.positions
        if along.shape[1] == 1 and len(along) >= LOG:
            passes = groups_of_passes(along[:, 0], readings.order)
        groups = spatial_blocks(fit.layout, samples) if passes is None else passes
    folds = leave_out(fit, samples, groups)
    heldout = held_out(
        table, samples, folds, groups, plan.integers, before, acted, by_run=repeated
    )
    readings = dataclasses.replace(readings, error=before)
    return TableDraft(
        plan.job, plan.index, spec, plan, estimate, effects, readings, heldout, remarks
    )


def _better_nodes(plan: Plan, readings: Readings) -> str:
    """Return nodes that suit readings better, in words; nothing where a job cannot have them."""
    over, axes = plan.fit.over, plan.job.spec.axes
    if any(axes[name].modulo is not None for name in over):
        return ""  # they must cover the turn
    # What a cross table does beyond its ends is not documented (S-12).
    alone = len(over) == 1 and not plan.fit.lengths
    limits = axes[over[0]].limits if alone else None
    reach = None if limits is None else (limits[0], limits[1])
    grid = grid_keys([*readings.positions.T], reach)
    nodes = [line.positions for line in plan.table.nodes]
    few = np.min(grid["points"]) < 4  # each is left out in turn
    if few or same_nodes(nodes, grid) or plan.old is not None:
        return ""
    return f" Nodes that suit these readings: {grid_words(grid)}."


def _two_places(plan: Plan, readings: Readings) -> Iterator[Remark]:
    """Yield that readings stand at two places of a master, where more nodes lie between.

    Raises:
        JobError: If there is no old table whose nodes must stay.
    """
    lines = zip(plan.fit.over, plan.table.nodes, readings.positions.T, strict=True)
    for name, nodes, places in lines:
        low, high = float(places.min()), float(places.max())
        gap = float(np.diff(np.sort(places)).max(initial=0.0))
        within = (nodes.positions > low) & (nodes.positions < high)
        if gap < _EMPTY * (high - low) or plan.table.periodic or within.sum() < 1:
            continue
        words = (
            f"readings stand at two places along {name} alone, {low:.6g} and {high:.6g}:"
            f" what lies between nobody has seen"
        )
        if plan.old is None:
            words += ", expected nodes there alone (the controller goes straight), or more places"
            raise plan.refusal(words)
        yield Remark.warning(f"All {words}. The old table keeps its shape there.")


def _refuse_small_part(plan: Plan, readings: Readings) -> None:
    """Raise where readings lie in so small a part of the table that their unit must be wrong."""
    if plan.table.periodic:
        return
    lines = zip(plan.fit.over, plan.table.nodes, readings.positions.T, strict=True)
    for name, nodes, places in lines:
        low, high = float(places.min()), float(places.max())
        first, last = nodes.positions[[0, -1]].tolist()
        # Inches are a 25th of millimetres. Those of a single place are refused as such.
        if 0.0 < high - low < _PART * (last - first):
            words = (
                f"found readings at {name} = {low:.6g} to {high:.6g}, expected them over"
                f" more than a tenth of the table, which goes from {first:g} to {last:g}: is"
                f" the unit of {name}.position right (columns)? A table for that part alone"
                " holds its edge beyond it"
            )
            raise plan.refusal(words)


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
    recording = share.recording
    readings = share.readings(plan.fit.over, plan.table.branches == 2)
    _refuse_small_part(plan, readings)
    branch = plan.branch(readings.direction)
    samples = Samples(readings.positions, readings.error, branch, run=readings.run)
    fit = _fit_of_share(plan, share)
    refuse_unowned_trend(plan, fit)
    if share.constant:
        fit = _doubted(plan, readings, samples, fit)
    spread = float(np.hypot(share.noise, 1 / (np.sqrt(12.0) * LIST_UNITS)))
    heldout = HeldOut(
        residual=share.predicted[share.rows],
        standard_deviation=np.full(len(samples.error), spread),
        by_run=recording.by_run,
    )
    effects = "offset" if fit.runs else "none"
    remarks = (*share.remarks(), *_two_places(plan, readings))
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
        share=np.asarray(share.fit.share[plan.axis][share.rows], dtype=float),
        wild=share.wild,
        runs=tuple(share.fit.runs.get(plan.axis, ())),
        suspect_nodes=(),
        suspect_runs=(),
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
    offset, drift = doubt_of_means(runs)
    ones = np.ones(len(samples.error))
    means = [offset * ones]
    if samples.order is not None:
        means.append(drift * (samples.order - 0.5))
    for pattern in means if offset or drift else []:
        for name, rows in readings.slices.items():
            kind = plan.job.spec.measurements[name].remove
            places = [*samples.positions[rows].T]
            pattern[rows] = without_zero(pattern[rows], places, kind)
        patterns.append(pattern)
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
