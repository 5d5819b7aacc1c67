"""A table fitted to a log in pieces, and its proof: one more pass, with the written file."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from ...fit import Grouping, Samples, StreamedFit, fit_streamed, predict
from ...proof import blocks_of, held_out_deviation
from ..result._result import Remark
from ._draft import Columns, Fitted, Piece, TableDraft
from ._log_readings import LogReadings
from ._plan import Plan

_SHOWN = 20_000
"""Readings, and up to twice as many, that plots show."""


@dataclasses.dataclass(frozen=True)
class _Log:
    """A log that a table was fitted to piece by piece.

    Attributes:
        plan: What is written.
        log: What was measured.
        found: What the passes over it gave, with a table for every group left out.
        grouping: Tells the spatial block of each reading: it is left out as one.
        folds: Entries of the list fitted without each group.
        zero: What was taken off the error, so that it is zero at the datum, in mm or °.
    """

    plan: Plan
    log: LogReadings
    found: StreamedFit
    grouping: Grouping
    folds: Mapping[int, Int[np.ndarray, "..."]]
    zero: float

    def pieces(self) -> Iterator[Piece]:
        first = 0
        for part in self.log.parts:
            row = 0
            for samples in part():
                wild, share = self.found.judged(samples)
                before, groups = samples.error - self.zero, self.grouping(samples)
                acted = self.plan.acted(samples.positions, samples.branch)
                held_out = before + self._held_out(samples, groups) - acted
                columns = partial(self._columns, samples, groups, share, first + row)
                if len(before):
                    yield Piece(samples, before, held_out, wild, columns, row)
                row += len(before)
            first += row

    def _held_out(
        self, samples: Samples, groups: Int[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return what the list fitted without it adds at each reading."""
        table, found = self.plan.table, np.zeros(len(samples.error))
        for group, integers in self.folds.items():
            own = groups == group
            if own.any():
                part = samples.take(own)
                model = table.model(integers)
                found[own] = table.offset(model, part.positions, part.branch)
        return found

    def _columns(
        self,
        samples: Samples,
        groups: Int[np.ndarray, " t"],
        share: Float[np.ndarray, " t"],
        first: int,
        rows: Int[np.ndarray, " n"],
    ) -> Columns:
        """Return what is known of some readings beside their errors."""
        deviation, samples = np.zeros(len(rows)), samples.take(rows)
        for group, fold in self.found.folds.items():
            own = groups[rows] == group
            deviation[own] = held_out_deviation(fold, samples.take(own))
        fitted, _ = predict(self.found.fit, samples.positions, samples.branch)
        found = {
            "order": (first + rows).astype(float),
            "predicted_sd": deviation,
            "share": share[rows],
            "residual": samples.error - fitted,
        }
        if samples.branch is not None:
            found["direction"] = 1 - 2 * samples.branch
        return found


def fit_log(plan: Plan, readings: LogReadings) -> TableDraft:
    """Fit the table of a plan to a log.

    Raises:
        FitError: If the readings cannot determine it.
        ExchangeError: If the result fits no list.
        MeasurementError: If a cell of the log cannot be used.
    """
    spec = plan.fit
    grouping = partial(blocks_of, plan.table.layout)
    found = fit_streamed(
        plan.table.layout,
        readings.parts,
        grouping,
        smoothness=spec.smoothness,
        loss=spec.loss,
    )
    zero, estimate = plan.zeroed(found.fit)
    folds = {k: plan.integers([fold])[0] for k, fold in found.folds.items()}
    log = _Log(plan, readings, found, grouping, folds, zero)
    every = max(1, found.count // _SHOWN)

    def remarks() -> Sequence[Remark]:
        return (*readings.remarks, *_of_the_route(readings, found, every))

    fitted = Fitted(log.pieces, remarks, by_run=False, every=every)
    return TableDraft(plan.job, plan.index, spec, plan, estimate, "none", fitted)


def _of_the_route(
    readings: LogReadings, found: StreamedFit, every: int
) -> Iterator[Remark]:
    names, shown = ", ".join(map(repr, readings.fit.sources)), ""
    if every > 1:
        shown = f"; plots and tables of readings show one reading in {every}"
    yield Remark.info(
        f"{names}: {found.count} readings were read in pieces and not into memory{shown}."
    )
    if readings.has_runs:
        yield Remark.warning(
            "A log that is read in pieces allows none of its runs an offset of its own,"
            " holds none of them out, and gives no figures of ISO 230-2: what differs from"
            " run to run counts as noise. stream = false reads it into memory, which does"
            " all three."
        )
    if found.crowded:
        yield Remark.warning(
            f"At {found.crowded} nodes wild readings stand side by side: they may"
            " be right and the table too smooth there. Readings in memory would be"
            " given a second thought; a log that is read in pieces is not. Fit every"
            " n-th row of it to have them judged."
        )
