"""A table fitted to a log in pieces, and its proof: one more pass, with the written file."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...exchange import Model
from ...fit import (
    AbstractPass,
    Grouping,
    Place,
    Samples,
    Stream,
    StreamedFit,
    added,
    fit_streamed,
    predict,
)
from ...proof import ErrorFigures, held_out_deviation
from .._plan import Plan
from .._remarks import Counts, outside
from .._result import Remark, SampleView, Streamed
from .._table_draft import AbstractTableDraft, Proof
from ._groups import Runs, grouping_of
from ._readings import LogReadings

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
        folds: Entries of the list fitted without each group.
        zero: What was taken off the error, so that it is zero at the datum, in mm or °.
    """

    readings: LogReadings
    found: StreamedFit
    grouping: Grouping
    folds: Mapping[int, Int[np.ndarray, "..."]]
    zero: float

    @property
    def in_memory(self) -> bool:
        return False

    @property
    def by_run(self) -> bool:
        """Whether runs were left out, else spatial blocks."""
        return isinstance(self.grouping, Runs)

    def proof(self, back: Model) -> Proof:
        count, wild = self.found.count, self.found.wild
        every = max(1, count // _SHOWN)
        tally: _Tally = Stream(self.readings.parts).ask(_Take(self, back, every))
        view = tally.columns()
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
            error=tally.figures(),
            counts=Counts(count, wild, tally.outside),
            by_run=self.by_run,
            remarks=(*self.readings.remarks, *self._of_the_stream(every)),
            streamed=Streamed(count, wild, every),
        )

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
    grouping = grouping_of(readings, Stream(readings.parts))
    found = fit_streamed(
        plan.table.layout,
        readings.parts,
        grouping,
        smoothness=spec.smoothness,
        loss=spec.loss,
    )
    zero, estimate = plan.zeroed(found.fit)
    return StreamedDraft(
        plan.index,
        spec,
        plan.lists,
        plan=plan,
        estimate=estimate,
        run_effects="none",
        readings=readings,
        found=found,
        grouping=grouping,
        folds={k: plan.integers([fold])[0] for k, fold in found.folds.items()},
        zero=zero,
    )


@dataclasses.dataclass(frozen=True)
class _Tally:
    """What the last pass gives.

    Attributes:
        sizes: Number, sum of squares and largest magnitude of each stage of the error, over
            all readings and over those that are not wild, shape ``(stage, 2, 3)``.
        outside: Readings outside the table.
        rows: Readings by part.
        view: Every n-th reading and the largest wild ones, column by column, in pieces.
    """

    sizes: Float[np.ndarray, "3 2 3"]
    outside: int
    rows: dict[int, int]
    view: tuple[Columns, ...]

    def __add__(self, other: "_Tally") -> "_Tally":
        sizes = self.sizes + other.sizes
        sizes[..., 2] = np.maximum(self.sizes[..., 2], other.sizes[..., 2])
        rows = {
            part: self.rows.get(part, 0) + other.rows.get(part, 0)
            for part in self.rows | other.rows
        }
        view = (*self.view, *other.view)
        return _Tally(sizes, self.outside + other.outside, rows, view)

    def columns(self) -> Columns:
        """Return the readings that are kept, ``row`` counted over all parts."""
        found = {
            name: np.concatenate([piece[name] for piece in self.view])
            for name in self.view[0]
        }
        lengths = [self.rows.get(part, 0) for part in range(max(self.rows) + 1)]
        starts = np.concatenate([[0], np.cumsum(lengths)])
        found["row"] = starts[found["part"]] + found["row"]
        keep = ~found["beside"] | _largest(found["before"], found["wild"])
        return {name: column[keep] for name, column in found.items()}

    def figures(self) -> dict[str, ErrorFigures]:
        """Return the figures of every stage, as `error_figures` gives them."""
        found = {}
        for name, ((count, square, most), (sound, least, largest)) in zip(
            _STAGES, self.sizes.tolist(), strict=True
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


@final
@dataclasses.dataclass(frozen=True)
class _Take(AbstractPass):
    """Asks for the error before, predicted and from the file.

    Attributes:
        one: The fit.
        back: The written table, read back.
        every: n, of the readings that are kept.
    """

    one: StreamedDraft
    back: Model
    every: int

    def onto(self, done: _Tally | None, samples: Samples, place: Place) -> _Tally:
        """See `AbstractPass`."""
        one, table = self.one, self.one.plan.table
        wild, share = one.found.judged(samples)
        before = samples.error - one.zero
        acted = one.plan.acted(samples.positions, samples.branch)
        groups = one.grouping(samples)
        written = table.offset(self.back, samples.positions, samples.branch)
        errors = (
            before,
            before + self._held_out(samples, groups) - acted,
            before + written - acted,
        )
        sizes = [[_size(error), _size(error[~wild])] for error in errors]
        out = int(outside(table, samples.positions).sum())
        # By its place in the part: nobody has to wait for the parts before it.
        keep = np.zeros(len(before), bool)
        keep[-place.row % self.every :: self.every] = True
        worst = _largest(before, wild) & ~keep
        keep |= worst
        view = dict(zip(_STAGES, (error[keep] for error in errors), strict=True))
        view |= self._view(samples.take(keep), groups[keep])
        view |= {"wild": wild[keep], "share": share[keep], "beside": worst[keep]}
        view["row"] = place.row + np.flatnonzero(keep)
        view["part"] = np.full(len(view["row"]), place.part)
        rows = {place.part: len(before)}
        return added(done, _Tally(np.array(sizes), out, rows, (view,)))

    def _held_out(
        self, samples: Samples, groups: Int[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return what the list fitted without it adds at each reading."""
        table = self.one.plan.table
        found = np.zeros(len(samples.error))
        for group, integers in self.one.folds.items():
            own = groups == group
            if own.any():
                part = samples.take(own)
                model = table.model(integers)
                found[own] = table.offset(model, part.positions, part.branch)
        return found

    def _view(self, samples: Samples, groups: Int[np.ndarray, " t"]) -> Columns:
        """Return what is known of readings beside their errors."""
        deviation = np.zeros(len(groups))
        for group, fold in self.one.found.folds.items():
            own = groups == group
            deviation[own] = held_out_deviation(fold, samples.take(own))
        said, _ = predict(self.one.found.fit, samples.positions, samples.branch)
        found = {
            "positions": samples.positions,
            "predicted_sd": deviation,
            "residual": samples.error - said,
        }
        if samples.branch is not None:
            found["direction"] = 1 - 2 * samples.branch
        return found
