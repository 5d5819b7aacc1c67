"""A table fitted to a log in pieces, and its proof: one more pass, with the written file."""

import dataclasses
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from ...fit import Grouping, Samples, StreamedFit, fit_streamed, predict
from ...proof import blocks_of, held_out_deviation, run_groups
from ...readings import places_of, visits_overlap
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
        grouping: Tells the group of each reading.
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
    grouping, by_run = _grouping(readings)
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
        return (*readings.remarks, *_of_the_route(plan, found, by_run, every))

    fitted = Fitted(log.pieces, remarks, by_run, every=every)
    return TableDraft(plan.job, plan.index, spec, plan, estimate, "none", fitted)


def _of_the_route(
    plan: Plan, found: StreamedFit, by_run: bool, every: int
) -> Iterator[Remark]:
    names, shown = ", ".join(map(repr, plan.fit.sources)), ""
    if every > 1:
        shown = f"; plots and tables of readings show one reading in {every}"
    yield Remark.info(
        f"{names}: {found.count} readings were read in pieces and not into memory{shown}."
    )
    if by_run:
        yield Remark.warning(
            "The runs go over the same places, but a log that is read in pieces allows"
            " none of them an offset of its own, and gives no figures of ISO 230-2:"
            " what differs from run to run counts as noise. stream = false reads it"
            " into memory, which does both."
        )
    if found.crowded:
        yield Remark.warning(
            f"At {found.crowded} nodes wild readings stand side by side: they may"
            " be right and the table too smooth there. Readings in memory would be"
            " given a second thought; a log that is read in pieces is not. Fit every"
            " n-th row of it to have them judged."
        )


def _grouping(readings: LogReadings) -> tuple[Grouping, bool]:
    """Return what is left out together: runs that repeat each other, else spatial blocks.

    Beside it stands whether these are runs.
    """
    table = readings.table
    if readings.has_runs:
        visits, counts = _visits(readings)
        runs, visitor = np.unique(visits[:, 0], return_inverse=True)
        sizes = np.array([counts[run] for run in runs.tolist()])
        if visits_overlap(visits[:, 1], visitor.reshape(-1), sizes):
            groups = run_groups(np.arange(len(runs)))
            return partial(_by_run, runs, groups), True
    return partial(blocks_of, table.layout), False


def _by_run(
    runs: Int[np.ndarray, " r"], groups: Int[np.ndarray, " r"], samples: Samples
) -> Int[np.ndarray, " t"]:
    assert samples.run is not None  # of a log with runs
    return np.asarray(groups[np.searchsorted(runs, samples.run)])


def _visits(readings: LogReadings) -> tuple[Int[np.ndarray, "v 2"], Counter[int]]:
    """Return the different pairs of a run and a place, and the readings of each run."""
    nodes = tuple(each.positions for each in readings.table.nodes)
    pairs, counts = np.zeros((0, 2), dtype=np.int64), Counter[int]()
    for part in readings.parts:
        for samples in part():
            assert samples.run is not None  # of a log with runs
            way = None if samples.branch is None else 1 - 2 * samples.branch
            cells = places_of(samples.positions, nodes, way)
            found = np.unique(np.stack([samples.run, cells], axis=1), axis=0)
            pairs = np.unique(np.concatenate([pairs, found]), axis=0)
            counts.update(samples.run.tolist())
    return pairs, counts
