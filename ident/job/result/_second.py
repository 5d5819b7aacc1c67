"""A second measurement, with the new list active: all that may be called verified."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.errors import FoundError
from ....data.measurements import Iso230, iso230
from ....data.signals import (
    CLOSER,
    MANY,
    MOST_WILD,
    repeatability,
    resolution,
    wild_readings,
)
from ...proof import Diagnosis, ErrorFigures, RunTable, error_figures

LESS = 1.5
"""Ratio of the measured to the predicted error, from which on less came of a list."""
_REST = 0.2
"""Share of the error that a constant and slopes leave where they are nearly all of it."""
SHOWN = 0.5
"""Share of what a list adds that may be left where the figures alone show its sign."""

_SAME_SHAPE = 0.95
"""Correlation of what two lists add from which on nothing tells them apart."""
_LEFT = 5.0
"""Scatter of a reading that the mean of a place exceeds where an entry is another."""

_BESIDE = 4
"""Neighbours, itself among them, that judge a place that was read once."""

_FINER, _COARSER = 0.05, 5.0
"""Part of what is predicted below which no second readings lie; multiple of what the first ones
and the list scatter by above which none lie that do not follow the list."""

_WHOLE, _GAP, _WIDER = 0.8, 0.15, 2.5
"""Share of the travel from which on a second measurement speaks for all of it; share of it that
may lie between places that follow each other, and how much wider than in the first one that is."""


class SecondMeasurementError(FoundError):
    """A second measurement cannot stand beside the first."""


def part_of(
    names: Sequence[str],
    first: Float[np.ndarray, "t d"],
    second: Float[np.ndarray, "s d"],
    turn: float | None = None,
) -> tuple[str, float, float] | None:
    """Return the axis of which a second measurement saw a part only, and which part.

    Args:
        names: Of the axes.
        first: Their positions in the first measurement, in mm or °.
        second: Likewise in the second one.
        turn: Length of one turn in °, of an axis that goes round.
    """
    for name, old, new in zip(names, first.T, second.T, strict=True):
        (start, end), reached = _reach(old, turn), _reach(new, turn)
        low, high = reached if turn else np.clip(reached, start, end)
        if high - low < _WHOLE * (end - start):
            return name, reached[0], reached[1] % turn if turn else reached[1]
    return None


def gap_of(
    names: Sequence[str],
    first: Float[np.ndarray, "t d"],
    second: Float[np.ndarray, "s d"],
) -> tuple[str, float, float] | None:
    """Return the widest stretch that a second measurement skips, and the first one does not.

    Arguments are those of `part_of`.
    """
    for name, old, new in zip(names, first.T, second.T, strict=True):
        places, travel = np.unique(new), float(np.ptp(old))
        usual = float(np.diff(np.unique(old)).max(initial=0.0))
        wide = np.diff(places)
        at = int(np.argmax(wide)) if wide.size else 0
        if wide.size and wide[at] > max(_GAP * travel, _WIDER * usual):
            return name, float(places[at]), float(places[at + 1])
    return None


def near_of(
    names: Sequence[str],
    positions: Float[np.ndarray, "t d"],
    error: Float[np.ndarray, " t"],
    direction: Int[np.ndarray, " t"] | None,
    scatter: float,
    *,
    sloped: bool = True,
) -> str:
    """Return the place where readings agree that far more is left than elsewhere; empty: none.

    Args:
        names: Of the axes.
        positions: Of each reading, in mm or °.
        error: With the list active, in mm or °.
        direction: ±1 of each, or None.
        scatter: Of a reading, as it was predicted.
        sloped: Whether a constant and slopes are the instrument's.
    """
    visits = [positions] if direction is None else [positions, direction[:, None]]
    columns = np.hstack(visits)
    places, at, counts = np.unique(
        columns.round(2), axis=0, return_inverse=True, return_counts=True
    )
    rest = error
    if sloped:
        slopes = np.column_stack([np.ones(len(error)), positions])
        rest = error - slopes @ np.linalg.lstsq(slopes, error)[0]
    if counts.max() > 1 or len(error) < _BESIDE:
        mean = np.bincount(at.reshape(-1), rest) / counts
        size = np.where(counts > 1, np.abs(mean), 0.0)
        worst = int(np.argmax(size))
        spread = np.ptp(rest[at.reshape(-1) == worst])
    else:  # each place was read once: it is judged with those beside it
        from scipy.spatial import KDTree  # takes long to load

        travel = np.maximum(np.ptp(columns, axis=0), 1e-9)
        beside = KDTree(columns / travel).query(columns / travel, _BESIDE)[1]
        size = np.abs(rest[beside].mean(axis=1))
        size[np.ptp(rest[beside], axis=1) > size] = 0.0
        worst, spread = int(np.argmax(size)), 0.0
        places = columns
    # One reading that is off, or several that differ, are no fault of the list.
    if size[worst] <= max(_LEFT * scatter, spread):
        return ""
    words = [f"{n} = {x:.6g}" for n, x in zip(names, places[worst], strict=False)]
    if direction is not None:
        words.append("positive" if places[worst, -1] > 0 else "negative")
    return ", ".join(words)


def scatter_of(
    positions: Float[np.ndarray, "t d"],
    error: Float[np.ndarray, " t"],
    direction: Int[np.ndarray, " t"] | None,
) -> float:
    """Return how readings of one place scatter in mm or °; infinity where few repeat one.

    Arguments are those of `near_of`.
    """
    visits = [positions] if direction is None else [positions, direction[:, None]]
    at = np.unique(np.hstack(visits).round(2), axis=0, return_inverse=True)[1]
    scatter, count = repeatability(at.reshape(-1), error)
    return scatter if count >= MANY else np.inf


def _reach(places: Float[np.ndarray, " t"], turn: float | None) -> tuple[float, float]:
    """Return the first and the last place; on an axis that goes round, beside the widest gap."""
    if turn is None:
        return float(places.min()), float(places.max())
    angles = np.unique(places % turn)
    last = int(np.argmax(np.diff(angles, append=angles[0] + turn)))
    low, high = float(angles[(last + 1) % len(angles)]), float(angles[last])
    return low, high if high >= low else high + turn


@dataclasses.dataclass(frozen=True)
class LeftTrend:
    """A constant and slopes that a second measurement shows.

    Attributes:
        words: Both, with unit and standard deviation.
        rest: What is left without them, rms in mm or °.
        owned: Its job says whose they are, and not otherwise than the first.
        fault: They are what the list itself does, with the other flank as the right one.
    """

    words: str
    rest: float
    owned: bool
    fault: bool = False


@dataclasses.dataclass(frozen=True)
class SecondMeasurement:
    """Readings taken with the list of one fit active.

    Attributes:
        name: What the user calls it, as a rule the file.
        positions: Commanded positions in mm or °, shape ``(t, d)``, master 1 first.
        error: Error seen in mm or ° (the instrument's arbitrary offset or line removed
            as in the first measurement), shape ``(t,)``.
        direction: ±1 per reading, or None.
        run: Run per reading, or None.
        wild: Readings that are the instrument's fault: rms and largest error are given
            without them as well, as for the first measurement; None: those far from all
            others.
        added: What the list adds at these readings, standard deviation in mm or °; None
            where only a diagnosis can tell that it acts.
        unseen: What these readings show nothing of and the first ones do, as the fields of
            `Code.IN_PART`: a part of the travel in mm or °, or of the temperatures, the
            other direction of motion, places between two, a slope, a zero.
        before: Error of the first measurement without that slope, rms in mm or °; None: as
            it is.
        near: A place where its readings agree that far more is left, in words; empty: none.
        beyond: That readings lie beyond what the list was made from, in words; empty: none.
        trend: Constant and slopes of these readings, where they are large; else None.
        adds: What the list adds at each of these readings in mm or °, from which is told how
            many times it acts; empty where only a diagnosis can tell that.
        acted: What the list added there that acted before and is contained in this one, in mm
            or °; empty where there was none.
        factor: How many times it acts, and its standard deviation, where these readings
            show that by themselves; else None.
        still: The same of the list that acted before, where it was told apart; else None.
        noise: How readings of the first measurement scatter in mm or °; 0: not known.
        zero: Whether they show that the axis as a whole lies where it should.
    """

    name: str
    positions: Float[np.ndarray, "t d"]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None = None
    run: Int[np.ndarray, " t"] | None = None
    wild: Bool[np.ndarray, " t"] | None = None
    added: float | None = None
    unseen: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    before: float | None = None
    near: str = ""
    beyond: str = ""
    trend: LeftTrend | None = None
    adds: Float[np.ndarray, " t"] = dataclasses.field(
        default_factory=lambda: np.zeros(0)
    )
    acted: Float[np.ndarray, " t"] = dataclasses.field(
        default_factory=lambda: np.zeros(0)
    )
    factor: tuple[float, float] | None = None
    still: tuple[float, float] | None = None
    noise: float = 0.0
    zero: bool = False

    def __post_init__(self) -> None:
        if self.error.size == 0 or not np.isfinite(self.error).all():
            words = f"{self.error.size} readings, {int(np.isfinite(self.error).sum())}"
            raise SecondMeasurementError(
                self.name, f"{words} of them numbers", "one number or more, and no gaps"
            )

    @property
    def sound(self) -> Bool[np.ndarray, " t"]:
        """Readings that are not wild: where many are far off, it is the list."""
        wild = wild_readings(self.error) if self.wild is None else self.wild
        return np.asarray(~wild | (wild.mean() > MOST_WILD))

    def check_scatter(
        self,
        first: Float[np.ndarray, " s"],
        predicted: float,
        unit: str,
        *,
        alone: bool,
    ) -> None:
        """Refuse readings too good or too bad to be of the machine: of another unit, or column.

        The former would prove any list, also one that doubles the error.

        Args:
            first: Error in the first measurement, in mm or °.
            predicted: Error with the list active, rms likewise, from these.
            unit: Of a thousandth of it.
            alone: No other list of the axis may add more than it says.

        Raises:
            SecondMeasurementError: If they are.
        """
        # What is smaller than a step of the display shows as nothing.
        step, found = max(map(resolution, (first, self.error))), list[str]()
        for scatter, least, left in (
            (self.figures.rms, _FINER * predicted, predicted),
            (self._scatter, CLOSER * self.noise, self.noise),
        ):
            if scatter < least and left > step:
                found.append(
                    f"{1e3 * scatter:.1g} {unit}, where {1e3 * left:.2g} {unit} are left of the"
                    " first ones at best"
                )
        # Such an error that does not follow the list is none that a list makes, whatever it does.
        known = float(np.std(first) + (np.std(self.adds) if self.adds.size else 0.0))
        if alone and _COARSER * known < self._rest < np.inf:
            found.append(
                f"{1e3 * self._rest:.3g} {unit} beside what the list adds, where the first ones"
                f" and the list did by {1e3 * known:.3g} {unit}"
            )
        if found:
            raise SecondMeasurementError(
                self.name,
                f"readings of the error that scatter by {found[0]}",
                "readings of the machine: is their unit right, and their column (columns)",
            )

    @property
    def _scatter(self) -> float:
        """How readings scatter in mm or °, by repeats, or about all that the list may add."""
        repeats = np.inf
        if self.run is not None:  # within one, a log stands still for many readings
            repeats = scatter_of(self.positions, self.error, self.direction)
        # A tenth of a bare error lies near the list as no machine does.
        return min(repeats, self._rest)

    @property
    def _rest(self) -> float:
        """What is left beside a zero, slopes and all that the list may add, rms in mm or °.

        Infinity where the list adds nothing that is known, or readings are few.
        """
        if not self.adds.size:
            return np.inf
        columns = [np.ones(len(self.error)), self.positions, self.adds]
        known, error = np.column_stack(columns)[self.sound], self.error[self.sound]
        if (free := len(error) - known.shape[1]) < MANY:
            return np.inf
        rest = error - known @ np.linalg.lstsq(known, error)[0]
        return float(np.sqrt(rest @ rest / free))

    @property
    def figures(self) -> ErrorFigures:
        """Rms and largest error, and ISO 230-2 for a run table, in mm or °."""
        runs = None
        if self.iso230 is not None and self.run is not None:
            assert self.direction is not None  # else there is no evaluation
            runs = RunTable(self.positions[:, 0], self.run, self.direction)
        return error_figures(self.error, runs, ~self.sound)

    @property
    def iso230(self) -> Iso230 | None:
        """Evaluation by ISO 230-2, or None where the readings are no run table."""
        if self.run is None or self.direction is None or self.positions.shape[1] != 1:
            return None
        return iso230(self.positions[:, 0], self.error, self.run, self.direction)


@dataclasses.dataclass(frozen=True)
class MeasuredAgain:
    """What a second measurement says of one fit.

    Attributes:
        source: ``file``, the job of the second measurement relative to the first one,
            its ``sha256``, and the ``date`` on which it was first evaluated, as
            ``2026-11-22``.
        readings: The error with the list active; None where it shows none of this fit.
        diagnosis: What the list does, by what changed between the measurements; None
            where no such measurement tells it.
        before: Error in the first measurement, rms without wild readings; of the whole
            axis for a fit of a group.
        predicted: Likewise, as predicted with the list active.
        beside: Compensations of the axis that do something else than their lists say, where
            this one is not known to.
    """

    source: Mapping[str, str]
    readings: SecondMeasurement | None
    diagnosis: Diagnosis | None
    before: float
    predicted: float
    beside: tuple[str, ...] = ()

    @property
    def verdict(self) -> str | None:
        """Of the diagnosis; None: there is none."""
        return None if self.diagnosis is None else self.diagnosis.verdict

    @property
    def rms(self) -> float | None:
        """Error with the list active, rms without wild readings; None: not measured."""
        return None if self.readings is None else self.readings.figures.sound.rms

    @property
    def is_hidden(self) -> bool:
        """Whether more is left and the list that acted before has the shape of the new one."""
        readings = self.readings
        if readings is None or readings.adds.shape != readings.acted.shape:
            return False
        if (
            not readings.acted.any()
            or readings.figures.sound.rms <= LESS * self.predicted
        ):
            return False
        new = readings.adds + readings.acted
        return bool(abs(np.corrcoef(new, readings.acted)[0, 1]) > _SAME_SHAPE)

    @property
    def trend(self) -> LeftTrend | None:
        """Constant and slopes that keep the error from being as predicted; None: no such."""
        trend = None if self.readings is None else self.readings.trend
        if trend is None or self.rms is None:
            return None
        # A second instrument may be noisier than the first.
        small = max(LESS * self.predicted, _REST * self.rms)
        return (
            trend if trend.rest <= small and self.rms > LESS * self.predicted else None
        )

    @property
    def shown(self) -> bool:
        """Whether the figures alone show that the list does what it says.

        What is left is as predicted, and far less than the list adds at these very
        readings: with another sign, size or place that much would be left.
        """
        if self.readings is None or self.readings.added is None or self.rms is None:
            return False
        small = self.rms <= LESS * self.predicted
        return small and self.rms <= SHOWN * self.readings.added

    @property
    def is_wrong(self) -> bool:
        """Whether the list surely does something else than it says, or on another flank."""
        return self.is_misread or (self.trend is not None and self.trend.fault)

    @property
    def is_misread(self) -> bool:
        """Whether a diagnosis names what the list does that it does not say."""
        return not self.shown and self.verdict not in (None, "right", "cannot tell")

    @property
    def acts(self) -> bool:
        """Whether the list surely does what it says."""
        return self.shown or self.verdict == "right"
