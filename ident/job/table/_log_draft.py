"""A table fitted to a log in pieces, and its proof: one more pass, with the written file."""

import dataclasses
from collections.abc import Iterator
from functools import partial
from typing import final

import numpy as np
from jaxtyping import Int

from ...exchange import Model
from ...fit import Grouping, Samples, StreamedFit, fit_streamed, predict, spatial_blocks
from ...proof import ErrorFigures, ErrorTally, held_out
from ...readings import Readings, joined
from ..result._result import STAGES, Remark, largest_wild
from ._draft import TableDraft
from ._log_readings import LogReadings
from ._passes import NodePasses, as_passes_differ, of_both_ways
from ._remarks import outside

_SHOWN = 20_000
"""Readings, and up to twice as many, that plots show."""


@final
@dataclasses.dataclass(frozen=True)
class FittedLog:
    """A log that a table was fitted to piece by piece.

    Attributes:
        streamed: What the passes over it gave, with a table for every block left out.
        grouping: Tells the block of each reading: a place that is left out as one.
        zero: What was taken off the error, so that it is zero at the datum, in mm or °.
    """

    readings: LogReadings
    streamed: StreamedFit
    grouping: Grouping
    zero: float

    @property
    def every(self) -> int:
        """One reading in so many is shown."""
        return max(1, self.streamed.count // _SHOWN)

    def figures(self, back: Model) -> tuple[dict[str, ErrorFigures], int]:
        """Return the figures of all readings by stage, and how many lie outside the table.

        Args:
            back: The written table, read back.
        """
        plan, beyond = self.readings.plan, 0
        table = plan.table
        tally = dict[str, ErrorTally]()
        folds = {
            label: table.model(plan.integers([fold])[0])
            for label, fold in self.streamed.folds.items()
        }
        for samples in self.readings.pieces():
            at, before = (samples.positions, samples.branch), samples.error - self.zero
            groups, held_out = self.grouping(samples), before - plan.acted(*at)
            residual = held_out + table.offset(back, *at)
            for label in np.unique(groups).tolist():
                row = groups == label
                part = samples.take(row)
                held_out[row] += table.offset(folds[label], part.positions, part.branch)
            wild = self.streamed.wild_of(samples)
            for name, error in zip(STAGES, (before, held_out, residual), strict=True):
                errors = ErrorTally.of(error, wild=wild)
                tally[name] = tally[name] + errors if name in tally else errors
            beyond += int(outside(table, samples.positions).sum())
        return {name: sums.figures for name, sums in tally.items()}, beyond

    def passes(self) -> NodePasses:
        """Return the passes of all readings; one that a piece ends in counts as two."""
        parts = list[NodePasses]()
        for samples in self.readings.pieces():
            at, wild = (
                (samples.positions, samples.branch),
                self.streamed.wild_of(samples),
            )
            left = samples.error - predict(self.streamed.fit, *at)[0]
            parts.append(NodePasses.of(self.readings.plan, samples, left, wild))
        return NodePasses.joined(parts)

    def shown(self) -> tuple[Samples, Int[np.ndarray, " n"]]:
        """Return every n-th reading and those that no plot may lack, and which these are."""
        parts, rows, first = list[Samples](), list[np.ndarray](), 0
        for samples in self.readings.pieces():
            index = np.arange(-first % self.every, len(samples.error), self.every)
            index = np.union1d(index, self._extremes(samples))
            parts.append(samples.take(index))
            rows.append(first + index)
            first += len(samples.error)
        row = np.concatenate(rows)
        samples = Samples(
            np.concatenate([part.positions for part in parts]),
            np.concatenate([part.error for part in parts]),
            joined([part.branch for part in parts]),
        )
        keep = row % self.every == 0
        keep[self._extremes(samples)] = True
        return samples.take(keep), row[keep]

    def _extremes(self, samples: Samples) -> Int[np.ndarray, " n"]:
        """Return the largest wild readings, and the outermost sound ones of each direction."""
        wild = np.zeros(len(samples.error), bool)
        if self.streamed.wild:
            wild = self.streamed.wild_of(samples)
        rows = [largest_wild(samples.error - self.zero, wild)]
        branch = np.zeros(len(wild)) if samples.branch is None else samples.branch
        for own in (np.flatnonzero(~wild & (branch == way)) for way in (0, 1)):
            for column in samples.positions[own].T if own.size else ():
                rows.append(own[[np.argmin(column), np.argmax(column)]])
        return np.concatenate(rows)


def fit_log(readings: LogReadings) -> TableDraft | None:
    """Fit the table of a plan to a log.

    None where readings of both ways lie apart, which is taken off in memory only.
    """
    plan = readings.plan
    spec, table = plan.fit, plan.table
    grouping = partial(spatial_blocks, table.layout)
    streamed = fit_streamed(
        table.layout,
        readings.parts,
        grouping,
        smoothness=spec.smoothness,
        loss=spec.loss,
    )
    log = FittedLog(readings, streamed, grouping, plan.zeroed(streamed.fit)[0])
    samples, row = log.shown()
    at, wild = (samples.positions, samples.branch), streamed.wild_of(samples)
    residual = samples.error - predict(streamed.fit, *at)[0]
    fit = dataclasses.replace(streamed.fit, residual=residual, wild=wild)
    order = row.astype(float)
    surface = samples.branch is None and len(spec.over) > 1
    if surface and of_both_ways(plan, order, samples, fit)[1]:
        return None
    fit, alike = as_passes_differ(plan, log.passes(), samples, fit)
    zero, estimate = plan.zeroed(fit)
    streamed = dataclasses.replace(streamed, fit=fit)
    log = dataclasses.replace(log, streamed=streamed, zero=zero)
    before = samples.error - zero
    heldout = held_out(
        table, samples, streamed.folds, grouping(samples), plan.integers, before,
        plan.acted(*at),
    )  # fmt: skip
    shown = Readings(
        positions=samples.positions,
        error=before,
        direction=None if samples.branch is None else 1 - 2 * samples.branch,
        run=None,
        order=order,
        timed=False,
        slices={},
    )
    remarks = (*readings.remarks, *_of_the_route(log), *alike)
    return TableDraft(
        plan.job, plan.index, spec, plan, estimate, "none", shown, heldout, remarks, log
    )


def _of_the_route(log: FittedLog) -> Iterator[Remark]:
    readings, streamed, every = log.readings, log.streamed, log.every
    names, words = ", ".join(map(repr, readings.plan.fit.sources)), ""
    if every > 1:
        words = f"; plots and tables of readings show one reading in {every}"
    yield Remark.info(
        f"{names}: {streamed.count} readings were read in pieces and not into memory{words}."
    )
    if readings.has_runs:
        yield Remark.warning(
            "A log that is read in pieces allows none of its runs an offset of its own,"
            " holds none of them out, and gives no figures of ISO 230-2: what differs from"
            " run to run counts as noise. stream = false reads it into memory, which does"
            " all three."
        )
    if streamed.crowded:
        yield Remark.warning(
            f"At {streamed.crowded} nodes wild readings stand side by side: they may"
            " be right and the table too smooth there. Readings in memory would be"
            " given a second thought; a log that is read in pieces is not. Fit every"
            " n-th row of it to have them judged."
        )
