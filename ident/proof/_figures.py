"""How large an error is, and what a list leaves of readings that were held out of its fit."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.measurements import iso230_figures
from ...data.signals import travel_direction
from ..exchange import LIST_UNITS, AbstractTable
from ..fit import RunEffect, Samples, TableFit, predict

_WHOLE, _FEWEST = 0.8, 2
"""Share of the travel that a pass goes over at least, and passes there and back that tell."""

_MOST_RUNS = 20
"""Up to here each run is left out on its own."""


@dataclasses.dataclass(frozen=True)
class ErrorFigures:
    """Size of an error in mm (or °).

    Attributes:
        rms: Root of the mean square, over all readings.
        max: Largest magnitude, over all readings.
        iso230: A, R, B, B_mean, E, M … of ISO 230-2 where there are runs, else None;
            figures that the data do not give are left out.
        without_wild: Rms and max of the others; None where no reading is wild.
    """

    rms: float
    max: float
    iso230: Mapping[str, float] | None = None
    without_wild: "ErrorFigures | None" = None

    @property
    def sound(self) -> "ErrorFigures":
        """What the machine does: rms and largest error without wild readings.

        A single reading of 1 mm among thousands of 10 µm would be all that rms and max
        tell of; before and after a list are compared without it.
        """
        return self.without_wild or self

    def as_tree(self) -> dict[str, float]:
        """Return all figures by name, as result.json gives them."""
        return {
            "rms": self.rms,
            "max": self.max,
            "rms_without_wild": self.sound.rms,
            "max_without_wild": self.sound.max,
            **(self.iso230 or {}),
        }


class RunTable(NamedTuple):
    """Target in mm or °, run and direction (±1) that each reading belongs to."""

    target: Float[np.ndarray, " t"]
    run: Int[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"]


@dataclasses.dataclass(frozen=True)
class ErrorTally:
    """What the figures of an error are made of: those of parts of the readings add up.

    Attributes:
        sizes: Number, sum of squares and largest magnitude, of all readings and of those
            that are not wild.
    """

    sizes: Float[np.ndarray, "2 3"]

    @classmethod
    def of(
        cls, error: Float[np.ndarray, " t"], wild: Bool[np.ndarray, " t"] | None = None
    ) -> "ErrorTally":
        """Return that of some readings; arguments as `error_figures`."""
        sound = error if wild is None else error[~wild]
        sizes = [
            [len(errors), np.square(errors).sum(), np.abs(errors).max(initial=0.0)]
            for errors in (error, sound)
        ]
        return cls(np.array(sizes, dtype=float))

    def __add__(self, other: "ErrorTally") -> "ErrorTally":
        total = self.sizes + other.sizes
        total[:, 2] = np.maximum(self.sizes[:, 2], other.sizes[:, 2])
        return ErrorTally(total)

    @property
    def figures(self) -> ErrorFigures:
        """What they come to."""
        whole, sound = (
            ErrorFigures(math.sqrt(square / max(count, 1)), largest)
            for count, square, largest in self.sizes.tolist()
        )
        count, count_sound = self.sizes[:, 0]
        if count_sound in (0, count):
            return whole
        return dataclasses.replace(whole, without_wild=sound)


def error_figures(
    error: Float[np.ndarray, " t"],
    runs: RunTable | None = None,
    wild: Bool[np.ndarray, " t"] | None = None,
) -> ErrorFigures:
    """Return the size of an error in mm or °.

    Args:
        error: One value per reading.
        runs: How the readings lie in a run table, or None where they do not.
        wild: Readings that are the instrument's fault; figures without them are given
            beside those of all readings. ISO 230-2 knows no such thing.
    """
    figures = ErrorTally.of(error, wild).figures
    if runs is None:
        return figures
    standard = iso230_figures(runs.target, error, runs.run, runs.direction)
    iso = {key: value for key, value in standard.items() if value is not None}
    return dataclasses.replace(figures, iso230=iso)


@dataclasses.dataclass(frozen=True)
class HeldOut:
    """What a list would have left of each reading, had it not been measured.

    Attributes:
        residual: Error left per reading in mm or °.
        standard_deviation: Predicted for such a reading, noise of the reading and
            rounding to list units included.
        by_run: Whether runs were left out (else blocks).
    """

    residual: Float[np.ndarray, " t"]
    standard_deviation: Float[np.ndarray, " t"]
    by_run: bool


def held_out(
    table: AbstractTable,
    samples: Samples,
    fits: Mapping[int, TableFit],
    groups: Int[np.ndarray, " t"],
    to_integers: Callable[[Sequence[TableFit]], Int[np.ndarray, "k ..."]],
    before: Float[np.ndarray, " t"],
    active: Float[np.ndarray, " t"],
    *,
    runs: Sequence[RunEffect] = (),
    by_run: bool = False,
) -> HeldOut:
    """Return what lists leave of the readings that they were fitted without.

    Each fold goes the whole way: fitted, rounded to list units, evaluated by the
    rules of the controller.

    Args:
        table: What is written.
        samples: Readings.
        fits: By group, the table fitted without it.
        groups: Of each reading.
        to_integers: From fits to the entries of their lists.
        before: Error as measured, per reading.
        active: Offset that was active while measuring, per reading.
        runs: What all runs have of their own: one that is left out has as much.
        by_run: Whether the groups are runs.
    """
    folds = [fits[label] for label in sorted(fits)]
    fold_of_reading = np.array(sorted(fits)).searchsorted(groups)
    offsets = table.offsets(to_integers(folds), samples.positions, samples.branch)
    offset = offsets[fold_of_reading, np.arange(len(before))]
    spread = np.zeros(len(before))
    for number, fold in enumerate(folds):
        own = samples.take(fold_of_reading == number)
        spread[fold_of_reading == number] = predict(fold, own.positions, own.branch)[1]
    noise = np.array([fold.noise**2 for fold in folds])
    rounding = 1 / (12 * LIST_UNITS**2)
    order = samples.order
    place = np.zeros(len(before)) if order is None else order - 0.5
    variance = spread**2 + noise[fold_of_reading] + run_variance(runs, place)
    deviation = np.sqrt(variance + rounding)
    return HeldOut(before + offset - active, deviation, by_run)


def groups_of_passes(
    place: Float[np.ndarray, " t"], order: Float[np.ndarray, " t"]
) -> Int[np.ndarray, " t"] | None:
    """Return the pass, there and back, of each reading of an axis that went to and fro.

    None where fewer than two such passes go over all of the travel: blocks are left out.
    """
    when = np.argsort(order, kind="stable")
    along = place[when]
    number = np.cumsum(np.diff(travel_direction(along), prepend=0) != 0) - 1
    if number[-1] < 0:
        return None
    ends = np.full((2, number[-1] + 1), -np.inf)
    np.maximum.at(ends[0], number, along)
    np.maximum.at(ends[1], number, -along)
    whole = ends.sum(axis=0) > _WHOLE * np.ptp(along)
    if np.sum(whole) < 2 * _FEWEST or not whole[1:-1].all():
        return None
    passes = np.empty(len(place), np.int64)
    passes[when] = number // 2
    return groups_of_runs(passes)


def groups_of_runs(run: Int[np.ndarray, " t"]) -> Int[np.ndarray, " t"]:
    """Return the run of each reading, to be left out; of many runs, a tenth at a time."""
    runs, index = np.unique(run, return_inverse=True)
    groups = run if len(runs) <= _MOST_RUNS else index.reshape(-1) % 10
    return np.asarray(groups, dtype=np.int64)


def run_variance(
    runs: Sequence[RunEffect], place: Float[np.ndarray, " t"]
) -> Float[np.ndarray, " t"]:
    """Return what a run that was not measured yet adds by its own offset and drift, in mm².

    Args:
        runs: Those measured; fewer than two tell nothing.
        place: Of each reading in its run, −½ to ½; 0 where runs have no drift.
    """
    if len(runs) < 2:
        return np.zeros(len(place))
    squares = np.array([[run.offset**2, run.drift**2] for run in runs])
    offset, drift = squares.sum(axis=0) / (len(runs) - 1)
    return np.asarray(offset + drift * np.square(place))
