"""The proof of a fit to a log: one more pass, with the file as the controller reads it."""

import dataclasses
from collections.abc import Iterator
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...exchange import Model
from ...fit import (
    AbstractPass,
    Place,
    Samples,
    Stream,
    added,
    predict,
)
from ...proof import ErrorFigures, held_out_deviation
from .._draft import Written
from .._prove import Proof
from .._remarks import Counts, outside
from .._result import Remark, SampleView, Streamed
from ._fit import StreamedFitted

_SHOWN = 20_000
"""Readings, and up to twice as many, that plots show."""
_WORST = 12
"""Wild readings that are listed."""
_STAGES = ("before", "predicted", "from_file")

Columns = dict[str, np.ndarray]


def prove_streamed(one: StreamedFitted, done: Written) -> Proof:
    """Return the proof of a fit, as `prove` does; the readings that it shows are a few."""
    table = one.plan.table
    listing = done.compensation
    assert listing is not None  # a table stands in it
    back = table.read(listing)
    every = max(1, one.estimate.count // _SHOWN)
    stream = Stream(one.readings.parts)
    tally: _Tally = stream.ask(_Take(one, back, every))
    view = tally.columns()
    count, wild = one.estimate.count, one.estimate.wild
    return Proof(
        fit=dataclasses.replace(
            one.fit,
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
        by_run=one.by_run,
        remarks=(*one.readings.remarks, *_of_the_stream(one, every)),
        streamed=Streamed(count, wild, every),
    )


def _of_the_stream(one: StreamedFitted, every: int) -> Iterator[Remark]:
    """Return what the route changes, and what it cannot do."""
    names = ", ".join(map(repr, one.plan.fit.sources))
    shown = (
        f"; plots and tables of readings show one reading in {every}"
        if every > 1
        else ""
    )
    yield Remark.info(
        f"{names}: {one.estimate.count} readings were read in pieces and not into"
        f" memory{shown}."
    )
    if one.by_run:
        words = (
            "The runs go over the same places, but a log that is read in pieces allows"
            " none of them an offset of its own, and gives no figures of ISO 230-2:"
            " what differs from run to run counts as noise. stream = false reads it into"
            " memory, which does both."
        )
        yield Remark.warning(words)
    if one.estimate.crowded:
        words = (
            f"At {one.estimate.crowded} nodes wild readings stand side by side: they may"
            " be right and the table too smooth there. Readings in memory would be given"
            " a second thought; a log that is read in pieces is not. Fit every n-th row"
            " of it to have them judged."
        )
        yield Remark.warning(words)


@dataclasses.dataclass(frozen=True)
class _Size:
    """How large an error is: number, sum of squares, largest magnitude."""

    count: int = 0
    square: float = 0.0
    largest: float = 0.0

    @classmethod
    def of(cls, error: Float[np.ndarray, " t"]) -> "_Size":
        """Return the size of some errors."""
        largest = float(np.abs(error).max(initial=0.0))
        return cls(len(error), float(error @ error), largest)

    def __add__(self, other: "_Size") -> "_Size":
        largest = max(self.largest, other.largest)
        return _Size(self.count + other.count, self.square + other.square, largest)

    @property
    def rms(self) -> float:
        """Root of the mean square."""
        return float(np.sqrt(self.square / max(self.count, 1)))


@dataclasses.dataclass(frozen=True)
class _Tally:
    """What the last pass gives.

    Attributes:
        sizes: Of each stage, over all readings and over those that are not wild.
        outside: Readings outside the table.
        rows: Readings by part.
        view: Every n-th reading and the largest wild ones, column by column in pieces.
    """

    sizes: dict[str, tuple[_Size, _Size]]
    outside: int
    rows: dict[int, int]
    view: dict[str, list[np.ndarray]]

    def __add__(self, other: "_Tally") -> "_Tally":
        sizes = {
            name: (whole + other.sizes[name][0], sound + other.sizes[name][1])
            for name, (whole, sound) in self.sizes.items()
        }
        rows = dict(self.rows)
        for part, count in other.rows.items():
            rows[part] = rows.get(part, 0) + count
        names = self.view or other.view
        view = {
            name: [*self.view.get(name, ()), *other.view.get(name, ())]
            for name in names
        }
        return _Tally(sizes, self.outside + other.outside, rows, view)

    def columns(self) -> Columns:
        """Return the readings that are kept, ``row`` counted over all parts."""
        found = {name: np.concatenate(parts) for name, parts in self.view.items()}
        lengths = [self.rows.get(part, 0) for part in range(max(self.rows) + 1)]
        starts = np.concatenate([[0], np.cumsum(lengths)])
        found["row"] = starts[found["part"]] + found["row"]
        keep = ~found["beside"] | _largest(found["before"], found["wild"])
        return {name: column[keep] for name, column in found.items()}

    def figures(self) -> dict[str, ErrorFigures]:
        """Return the figures of every stage, as `error_figures` gives them."""
        found = {}
        for name, (whole, sound) in self.sizes.items():
            if sound.count in (0, whole.count):
                found[name] = ErrorFigures(whole.rms, whole.largest)
                continue
            found[name] = ErrorFigures(
                whole.rms, whole.largest, None, sound.rms, sound.largest
            )
        return found


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

    one: StreamedFitted
    back: Model
    every: int

    def onto(self, done: _Tally | None, samples: Samples, place: Place) -> _Tally:
        """See `AbstractPass`."""
        one, table = self.one, self.one.plan.table
        wild, share = one.estimate.judged(samples)
        before = samples.error - one.zero
        active = np.zeros(len(before))
        if one.plan.active and one.plan.old is not None:
            active = table.offset(one.plan.old, samples.positions, samples.branch)
        groups = one.grouping(samples)
        errors = {
            "before": before,
            "predicted": before + self._held_out(samples, groups) - active,
            "from_file": before
            + table.offset(self.back, samples.positions, samples.branch)
            - active,
        }
        sizes = {
            name: (_Size.of(error), _Size.of(error[~wild]))
            for name, error in errors.items()
        }
        out = int(outside(table, samples.positions).sum())
        # By its place in the part: nobody has to wait for the parts before it.
        keep = np.zeros(len(before), bool)
        keep[-place.row % self.every :: self.every] = True
        worst = _largest(before, wild) & ~keep
        keep |= worst
        view: Columns = {name: error[keep] for name, error in errors.items()}
        view |= self._view(samples.take(keep), groups[keep])
        view["wild"], view["share"] = wild[keep], share[keep]
        view["beside"] = worst[keep]
        view["row"] = place.row + np.flatnonzero(keep)
        view["part"] = np.full(len(view["row"]), place.part)
        pieces = {name: [values] for name, values in view.items()}
        return added(done, _Tally(sizes, out, {place.part: len(before)}, pieces))

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
        estimate = self.one.estimate
        deviation = np.zeros(len(groups))
        for group, fold in estimate.folds.items():
            own = groups == group
            deviation[own] = held_out_deviation(fold, samples.take(own))
        said, _ = predict(estimate.fit, samples.positions, samples.branch)
        found = {
            "positions": samples.positions,
            "predicted_sd": deviation,
            "residual": samples.error - said,
        }
        if samples.branch is not None:
            found["direction"] = 1 - 2 * samples.branch
        return found
