"""A table fitted to a log in pieces, and its proof: one more pass, with the written file."""

import dataclasses
import itertools
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import partial, reduce
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...exchange import Model
from ...fit import Grouping, Samples, StreamedFit, fit_streamed, predict
from ...proof import ErrorFigures, blocks_of, held_out_deviation, run_groups
from ...readings import places_of, visits_overlap
from ..result._result import Remark, SampleView, Streamed
from ._draft import AbstractTableDraft, Proof
from ._log_readings import LogReadings
from ._plan import Plan
from ._remarks import outside

_SHOWN = 20_000
"""Readings, and up to twice as many, that plots show."""
_WORST = 12
"""Wild readings that are listed."""
_STAGES = ("before", "predicted", "from_file")

Columns = dict[str, np.ndarray]


@final
@dataclasses.dataclass(frozen=True)
class StreamedDraft(AbstractTableDraft):
    """A table fitted to a log in pieces.

    Attributes:
        readings: What was measured.
        found: What the passes over it gave, with a table for every group left out.
        grouping: Tells the group of each reading.
        by_run: Whether these are runs, else spatial blocks.
        folds: Entries of the list fitted without each group.
        zero: What was taken off the error, so that it is zero at the datum, in mm or °.
    """

    readings: LogReadings
    found: StreamedFit
    grouping: Grouping
    by_run: bool
    folds: Mapping[int, Int[np.ndarray, "..."]]
    zero: float

    @property
    def in_memory(self) -> bool:
        return False

    def proof(self, back: Model) -> Proof:
        count, wild = self.found.count, self.found.wild
        every = max(1, count // _SHOWN)
        pieces = [*self._pieces(back, every)]
        view = {
            name: np.concatenate([piece.view[name] for piece in pieces])
            for name in pieces[0].view
        }
        keep = ~view.pop("beside") | _largest(view["before"], view["wild"])
        view = {name: column[keep] for name, column in view.items()}
        return Proof(
            fit=dataclasses.replace(
                self.estimate,
                residual=view["residual"],
                share=view["share"],
                wild=view["wild"],
            ),
            samples=SampleView(
                positions=view["positions"],
                direction=view.get("direction"),
                run=None,
                order=view["row"].astype(float),
                before=view["before"],
                predicted=view["predicted"],
                from_file=view["from_file"],
                predicted_sd=view["predicted_sd"],
                share=view["share"],
            ),
            error=_figures(pieces),
            readings=count,
            wild=wild,
            outside=sum(piece.outside for piece in pieces),
            by_run=self.by_run,
            remarks=(*self.readings.remarks, *self._of_the_stream(every)),
            streamed=Streamed(count, wild, every),
        )

    def _pieces(self, back: Model, every: int) -> Iterator["_Piece"]:
        """Yield what is known of each piece of the log, with the written table read back."""
        table, first = self.plan.table, 0
        for number, part in enumerate(self.readings.parts):
            row = 0
            for samples in part():
                wild, share = self.found.judged(samples)
                before = samples.error - self.zero
                acted = self.plan.acted(samples.positions, samples.branch)
                groups = self.grouping(samples)
                written = table.offset(back, samples.positions, samples.branch)
                errors = (
                    before,
                    before + self._held_out(samples, groups) - acted,
                    before + written - acted,
                )
                keep = np.zeros(len(before), bool)
                keep[-row % every :: every] = True
                worst = _largest(before, wild) & ~keep
                keep |= worst
                view = dict(zip(_STAGES, (one[keep] for one in errors), strict=True))
                view |= self._view(samples.take(keep), groups[keep])
                view |= {
                    "wild": wild[keep],
                    "share": share[keep],
                    "beside": worst[keep],
                }
                view["row"] = first + row + np.flatnonzero(keep)
                sizes = [[_size(error), _size(error[~wild])] for error in errors]
                out = int(outside(table, samples.positions).sum())
                if len(before):
                    yield _Piece(number, np.array(sizes), out, view)
                row += len(before)
            first += row

    def _held_out(
        self, samples: Samples, groups: Int[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return what the list fitted without it adds at each reading."""
        table = self.plan.table
        found = np.zeros(len(samples.error))
        for group, integers in self.folds.items():
            own = groups == group
            if own.any():
                part = samples.take(own)
                model = table.model(integers)
                found[own] = table.offset(model, part.positions, part.branch)
        return found

    def _view(self, samples: Samples, groups: Int[np.ndarray, " t"]) -> Columns:
        """Return what is known of readings beside their errors."""
        deviation = np.zeros(len(groups))
        for group, fold in self.found.folds.items():
            own = groups == group
            deviation[own] = held_out_deviation(fold, samples.take(own))
        said, _ = predict(self.found.fit, samples.positions, samples.branch)
        found = {
            "positions": samples.positions,
            "predicted_sd": deviation,
            "residual": samples.error - said,
        }
        if samples.branch is not None:
            found["direction"] = 1 - 2 * samples.branch
        return found

    def _of_the_stream(self, every: int) -> Iterator[Remark]:
        """Return what the route changes, and what it cannot do."""
        names = ", ".join(map(repr, self.fit.sources))
        shown = ""
        if every > 1:
            shown = f"; plots and tables of readings show one reading in {every}"
        yield Remark.info(
            f"{names}: {self.found.count} readings were read in pieces and not into"
            f" memory{shown}."
        )
        if self.by_run:
            yield Remark.warning(
                "The runs go over the same places, but a log that is read in pieces allows"
                " none of them an offset of its own, and gives no figures of ISO 230-2:"
                " what differs from run to run counts as noise. stream = false reads it"
                " into memory, which does both."
            )
        if self.found.crowded:
            yield Remark.warning(
                f"At {self.found.crowded} nodes wild readings stand side by side: they may"
                " be right and the table too smooth there. Readings in memory would be"
                " given a second thought; a log that is read in pieces is not. Fit every"
                " n-th row of it to have them judged."
            )


def fit_log(plan: Plan, readings: LogReadings) -> StreamedDraft:
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
    return StreamedDraft(
        plan.job,
        plan.index,
        spec,
        plan=plan,
        estimate=estimate,
        run_effects="none",
        readings=readings,
        found=found,
        grouping=grouping,
        by_run=by_run,
        folds={k: plan.integers([fold])[0] for k, fold in found.folds.items()},
        zero=zero,
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


@dataclasses.dataclass(frozen=True)
class _Piece:
    """What the last pass gives of one piece.

    Attributes:
        part: Of the log.
        sizes: Number, sum of squares and largest magnitude of each stage of the error, over
            all readings and over those that are not wild, shape ``(stage, 2, 3)``.
        outside: Readings outside the table.
        view: Every n-th reading and the largest wild ones, column by column.
    """

    part: int
    sizes: Float[np.ndarray, "3 2 3"]
    outside: int
    view: Columns


def _figures(pieces: list[_Piece]) -> dict[str, ErrorFigures]:
    """Return the figures of every stage, as `error_figures` gives them."""

    def together(
        one: Float[np.ndarray, "3 2 3"], other: Float[np.ndarray, "3 2 3"]
    ) -> Float[np.ndarray, "3 2 3"]:
        both = np.array(one + other)
        both[..., 2] = np.maximum(one[..., 2], other[..., 2])
        return both

    parts = itertools.groupby(pieces, key=lambda piece: piece.part)
    sizes = [reduce(together, (p.sizes for p in own)) for _, own in parts]
    found = {}
    for name, ((count, square, most), (sound, least, largest)) in zip(
        _STAGES, reduce(together, sizes).tolist(), strict=True
    ):
        rms = float(np.sqrt(square / max(count, 1)))
        others = (None, float(np.sqrt(least / max(sound, 1))), largest)
        if sound in (0, count):
            found[name] = ErrorFigures(rms, most)
        else:
            found[name] = ErrorFigures(rms, most, *others)
    return found


def _size(error: Float[np.ndarray, " t"]) -> list[float]:
    return [
        float(len(error)),
        float(error @ error),
        float(np.abs(error).max(initial=0.0)),
    ]


def _largest(
    error: Float[np.ndarray, " t"], wild: Bool[np.ndarray, " t"]
) -> Bool[np.ndarray, " t"]:
    """Tell which are the largest of the wild readings."""
    rows = np.flatnonzero(wild)
    rows = rows[np.argsort(-np.abs(error[rows]), kind="stable")][:_WORST]
    found = np.zeros(len(error), bool)
    found[rows] = True
    return found
