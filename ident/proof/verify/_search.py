"""The search for the hypothesis that explains a target, and its rivals."""

import dataclasses
import functools
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize

from .._figures import MOST_WILD, wild_readings
from ._channel import AbstractChannel, Change
from ._hypothesis import FAULT, Hypothesis
from ._log import FLOOR, RESOLUTION, Target
from ._scan import few_of, otherwise, place, scaled, structures, timed

_MOST_PLACES = 30
"""Places per master at which a table that lies elsewhere is tried on all rows."""
_KEPT = 3
"""Structures that are looked at closely, beside the plain one."""

EQUAL = 6.0
"""Difference of criteria below which two explain a log equally well: odds of 20 to 1."""


@dataclasses.dataclass(frozen=True)
class Rival:
    """A hypothesis with its criterion, the smaller the better.

    Attributes:
        hypothesis: The way it is applied.
        misfit: −2 log likelihood.
        criterion: The misfit and what the hypothesis costs.
    """

    hypothesis: Hypothesis
    misfit: float
    criterion: float


@dataclasses.dataclass(frozen=True)
class Found:
    """What explains a column.

    Attributes:
        rivals: All that were looked at closely, best first.
        nothing: Criterion of a controller that adds nothing.
        column: What the best one adds per row, in mm or °.
        residual: What it leaves at the rows that are judged.
        rows: Those that count: no wild ones.
        samples: Number of independent rows.
    """

    rivals: tuple[Rival, ...]
    nothing: float
    column: Float[np.ndarray, " t"]
    residual: Float[np.ndarray, " e"]
    rows: Int[np.ndarray, " r"]
    samples: float

    @property
    def best(self) -> Hypothesis:
        """The best one."""
        return self.rivals[0].hypothesis


def search(
    channel: AbstractChannel, target: Target, start: Sequence[Hypothesis] = ()
) -> Found:
    """Return the hypothesis that explains the values of a target best.

    Noise is normal, its size that of each hypothesis; what the best one leaves says how
    many rows are independent of each other, and which of them are wild and do not count.

    Args:
        channel: The compensation.
        target: Values at all rows.
        start: Hypotheses that are looked at in any case.
    """
    every = _Rows(
        channel, target, np.arange(channel.motion.rows)[channel.motion.judged]
    )
    judged, left = every, every.searched(start)
    best = judged.ranked(left, float(len(every.rows)))[0].hypothesis
    residual = every.target.residual(every.column(best))
    wild = wild_readings(residual, max(FLOOR, target.step))
    if 0.0 < wild.mean() <= MOST_WILD:
        judged = _Rows(channel, target, every.rows[~wild])
        left = judged.searched(start)
        best = judged.ranked(left, float(len(judged.rows)))[0].hypothesis
        residual = judged.target.residual(judged.column(best))
    samples = independent(residual)
    best = judged.ranked(left, samples)[0].hypothesis
    left |= judged.squares(neighbours(channel, best))
    rivals = judged.ranked(left, samples)
    first = judged.plainest(rivals)
    column = channel.column(first.hypothesis.change)
    late = np.arange(len(column)) - first.hypothesis.lag
    column = first.hypothesis.scale * column[np.clip(late, 0, len(column) - 1)]
    nothing = judged.target.criterion(np.array([judged.target.power]), samples)
    return Found(
        rivals=(first, *(one for one in rivals if one is not first)),
        nothing=float(nothing[0]) + FAULT,
        column=column,
        residual=every.target.residual(column[every.rows]),
        rows=judged.rows,
        samples=samples,
    )


@dataclasses.dataclass(frozen=True)
class _Rows:
    """The rows of a target that count, and what hypotheses leave there."""

    channel: AbstractChannel
    whole: Target
    rows: Int[np.ndarray, " r"]

    @functools.cached_property
    def target(self) -> Target:
        """The target at these rows."""
        return self.whole.at(self.rows)

    def column(self, hypothesis: Hypothesis) -> Float[np.ndarray, " r"]:
        """Return what a hypothesis adds."""
        column = self.channel.column(hypothesis.change)
        return np.asarray(hypothesis.scale * column[self.rows - hypothesis.lag])

    def squares(self, hypotheses: Iterable[Hypothesis]) -> dict[Hypothesis, float]:
        """Return the sum of squares that each hypothesis leaves."""
        return {
            one: float(self.target.residual_squares(self.column(one)[None])[0])
            for one in hypotheses
        }

    def ranked(self, left: Mapping[Hypothesis, float], samples: float) -> list[Rival]:
        """Return hypotheses, the best first, by the sum of squares that each leaves."""
        squares = np.array(list(left.values()))
        misfits = self.target.criterion(squares, samples).tolist()
        found = [
            Rival(one, misfit, misfit + one.cost(self.channel, samples))
            for one, misfit in zip(left, misfits, strict=True)
        ]
        return sorted(found, key=lambda one: one.criterion)

    def searched(self, start: Sequence[Hypothesis]) -> dict[Hypothesis, float]:
        """Return what promising structures leave, and hypotheses that are given."""
        left: dict[Hypothesis, float] = {}
        for change in self._promising():
            left |= self._refined(change)
        return left | self.squares(start)

    def _promising(self) -> list[Change]:
        """Return masters, edges and shifts that may explain the values, best first."""
        few, plain = few_of(self.rows), self.channel.plain
        part = self.whole.at(few)
        found = {
            Hypothesis(change): squares
            for one in structures(self.channel)
            for change, squares in place(self.channel, one, part, few)
        }
        best = _Rows(self.channel, self.whole, few).ranked(found, float(len(few)))
        kept = [one.hypothesis.change for one in best[:_KEPT]]
        return kept if plain in kept else [*kept, plain]

    def _refined(self, change: Change) -> dict[Hypothesis, float]:
        """Return a structure with and without a lag, with and without another filter."""
        every = timed(self.channel, change, self.target, self.rows)
        if not change.is_shifted:
            return every
        # Of a table that lies elsewhere the best of each, its place refined with it.
        best: dict[tuple[bool, bool], Hypothesis] = {}
        for one in sorted(every, key=every.__getitem__):
            best.setdefault((bool(one.lag), one.change.cycles is None), one)
        found: dict[Hypothesis, float] = {}
        for one in best.values():
            found |= self._moved(one.change, one.lag)
        return found

    def _moved(self, change: Change, lag: int) -> dict[Hypothesis, float]:
        """Return a shifted table with its place refined on all rows, with its factors."""
        free = np.flatnonzero(change.shift)
        steps = 0.05 * np.array([self.channel.ways[k].step for k in free])

        def left(away: Float[np.ndarray, " f"]) -> dict[Hypothesis, float]:
            shift = np.array(change.shift)
            shift[free] += steps * away
            one = dataclasses.replace(change, shift=tuple(shift.tolist()))
            return scaled(self.target, one, lag, self.column(Hypothesis(one, lag)))

        # Without derivatives: where an edge is a step, nothing is smooth.
        found = minimize(
            lambda away: min(left(away).values()),
            np.zeros(len(free)),
            method="Nelder-Mead",
            options={
                "initial_simplex": np.eye(len(free) + 1, len(free), -1),
                "xatol": 5e-3,
                "fatol": np.inf,
                "maxfev": _MOST_PLACES * len(free),
            },
        )
        return left(found.x)

    def plainest(self, rivals: Sequence[Rival]) -> Rival:
        """Return the best, or the plain one where nothing tells them apart in a list."""
        plain = Hypothesis(self.channel.plain)
        same = next((one for one in rivals if one.hypothesis == plain), rivals[0])
        first, second = (
            self.target.residual(self.column(one.hypothesis))
            for one in (rivals[0], same)
        )
        enough = max(RESOLUTION, self.target.step)
        return same if float(np.max(np.abs(first - second))) <= enough else rivals[0]


def independent(residual: Float[np.ndarray, " r"]) -> float:
    """Return to how many independent rows a residual amounts.

    From the correlations of neighbours, up to the distance at which chance alone would
    make them: what a model leaves out is seen in many rows, and is yet one observation.
    """
    count = len(residual)
    spectrum = np.square(np.abs(np.fft.rfft(residual, 2 * count)))
    alike = np.fft.irfft(spectrum)[:count]
    if alike[0] <= 0.0:
        return float(count)
    alike = alike / alike[0]
    beyond = alike < 2.0 / np.sqrt(count)
    reach = int(np.argmax(beyond)) if beyond.any() else count
    return max(2.0, count / (2.0 * float(alike[:reach].sum()) - 1.0))


def neighbours(channel: AbstractChannel, best: Hypothesis) -> list[Hypothesis]:
    """Return hypotheses that differ from the best one in a single respect."""
    change = best.change
    found = [
        dataclasses.replace(best, scale=scale, is_free=False)
        for scale in (1.0, -best.scale if not best.is_free else -1.0)
    ]
    changes: list[dict[str, Any]] = []
    if channel.motion.cycle is not None:
        found += [
            dataclasses.replace(best, lag=lag)
            for lag in (0, best.lag - 1, best.lag + 1)
            if abs(lag) <= channel.motion.reach
        ]
        cycles = channel.cycles_under(channel.conventions)
        changes += [{"cycles": None}]
        changes += [{"cycles": cycles // 2}] * (cycles > 1)
    changes += [{"shift": ()}] * change.is_shifted
    others = [dataclasses.replace(change, **one) for one in changes]
    others += itertools.chain.from_iterable(otherwise(channel, change))
    return found + [dataclasses.replace(best, change=one) for one in others]
