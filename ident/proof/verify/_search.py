"""The search for the hypothesis that explains a target, and its rivals."""

import dataclasses
import functools
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize

from ....data.signals import MOST_WILD, independent, wild_readings
from ._channel import AbstractChannel, Change
from ._hypothesis import FAULT, Hypothesis
from ._log import FLOOR, RESOLUTION, Target
from ._scan import few_of, otherwise, place, scaled, structures, timed

_MOST_PLACES = 30
"""Places per master at which a table that lies elsewhere is tried on all rows."""
_KEPT = 3
"""Structures that are looked at closely, wherever and in their place, beside the plain one."""

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
        channel: The compensation.
        rivals: All that were looked at closely, best first.
        nothing: Criterion of a controller that adds nothing.
        column: What the best one adds per row, in mm or °.
        residual: What it leaves at the rows that are judged.
        rows: Those that count: no wild ones.
        samples: Number of independent rows.
    """

    channel: AbstractChannel
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

    @property
    def faults(self) -> dict[str, float | None]:
        """The size of each fault of the best one; empty where there is none."""
        return self.best.faults(self.channel)


def search(
    channel: AbstractChannel, target: Target, start: Sequence[Hypothesis] = ()
) -> Found:
    """Return the hypothesis that explains the values of a target best.

    Noise is normal, its size that of each hypothesis; what the best one leaves says how
    many rows are independent of each other, and which of them are wild and do not count.
    Hypotheses to start with are looked at in any case.
    """
    judged = np.arange(channel.motion.rows)[channel.motion.judged]
    sound = all_rows = _Rows(channel, target, judged)
    squares, residual = all_rows.searched(start)
    wild = wild_readings(residual, max(FLOOR, target.step))
    if 0.0 < wild.mean() <= MOST_WILD:
        sound = _Rows(channel, target, all_rows.rows[~wild])
        squares, residual = sound.searched(start)
    samples = independent_of(channel, sound.rows, residual)
    best = sound.ranked(squares, samples)[0].hypothesis
    squares |= sound.squares(neighbours(channel, best))
    rivals = sound.ranked(squares, samples)
    first = sound.plainest(rivals)
    column = channel.column(first.hypothesis.change)
    delayed = np.arange(len(column)) - first.hypothesis.lag
    column = first.hypothesis.scale * column[np.clip(delayed, 0, len(column) - 1)]
    nothing = sound.target.criterion(np.array([sound.target.power]), samples)
    return Found(
        channel=channel,
        rivals=(first, *(rival for rival in rivals if rival is not first)),
        nothing=float(nothing[0]) + FAULT,
        column=column,
        residual=all_rows.target.residual(column[all_rows.rows]),
        rows=sound.rows,
        samples=samples,
    )


def independent_of(
    channel: AbstractChannel,
    rows: Int[np.ndarray, " r"],
    residual: Float[np.ndarray, " r"],
) -> float:
    """Return to how many independent rows a residual amounts, like beside like.

    Rows of a recording follow each other in time. Those without time are sorted both ways: what
    belongs to a direction alternates from place to place, what belongs to a place between the runs
    through all of them, and neither is noise.
    """
    motion = channel.motion
    if motion.time is None:
        places = [
            motion.positions[k][rows] for k in channel.masters if k in motion.positions
        ]
        way = motion.directions.get(channel.axis)
        direction = [] if way is None else [way[rows]]
        orders = [[*places[::-1], *direction], [*direction, *places[::-1]]]
        if places or direction:
            return min(independent(residual[np.lexsort(keys)]) for keys in orders)
    return independent(residual)


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
        squares = self.target.residual_squares
        return {each: float(squares(self.column(each)[None])[0]) for each in hypotheses}

    def ranked(
        self, squares_of: Mapping[Hypothesis, float], samples: float
    ) -> list[Rival]:
        """Return hypotheses, the best first, by the sum of squares that each leaves."""
        squares = np.array(list(squares_of.values()))
        misfits = self.target.criterion(squares, samples).tolist()
        rivals = [
            Rival(hypothesis, misfit, misfit + hypothesis.cost(self.channel, samples))
            for hypothesis, misfit in zip(squares_of, misfits, strict=True)
        ]
        return sorted(rivals, key=lambda rival: rival.criterion)

    def searched(
        self, start: Sequence[Hypothesis]
    ) -> tuple[dict[Hypothesis, float], Float[np.ndarray, " r"]]:
        """Return what promising hypotheses leave and given ones, and the residual of the best."""
        squares = dict[Hypothesis, float]()
        for change in self._promising():
            squares |= self._refined(change)
        squares |= self.squares(start)
        best = self.ranked(squares, float(len(self.rows)))[0].hypothesis
        return squares, self.target.residual(self.column(best))

    def _promising(self) -> list[Change]:
        """Return masters, edges and shifts that may explain the values, best first."""
        sample, plain = few_of(self.rows), self.channel.plain
        part = self.whole.at(sample)
        squares_of = {
            Hypothesis(change): squares
            for structure in structures(self.channel)
            for change, squares in place(self.channel, structure, part, sample)
        }
        few = _Rows(self.channel, self.whole, sample)
        ranking = few.ranked(squares_of, float(len(sample)))
        changes = [rival.hypothesis.change for rival in ranking]
        # Another place imitates another rule: the best in their place have a say as well.
        in_place = [change for change in changes if not change.is_shifted]
        return list(dict.fromkeys([*changes[:_KEPT], *in_place[:_KEPT], plain]))

    def _refined(self, change: Change) -> dict[Hypothesis, float]:
        """Return a structure with and without a lag, with and without another filter."""
        variants = timed(self.channel, change, self.target, self.rows)
        if not change.is_shifted:
            return variants
        # Of a table that lies elsewhere the best of each, its place refined with it.
        leaders: dict[tuple[bool, bool], Hypothesis] = {}
        for hypothesis in sorted(variants, key=variants.__getitem__):
            sort = bool(hypothesis.lag), hypothesis.change.cycles is None
            leaders.setdefault(sort, hypothesis)
        refined: dict[Hypothesis, float] = {}
        for hypothesis in leaders.values():
            refined |= self._shifted(hypothesis.change, hypothesis.lag)
        return refined

    def _shifted(self, change: Change, lag: int) -> dict[Hypothesis, float]:
        """Return a shifted table with its place refined on all rows, with its factors."""
        shifted = np.flatnonzero(change.shift)
        steps = 0.05 * np.array([self.channel.ways[k].step for k in shifted])

        def squares(displacement: Float[np.ndarray, " f"]) -> dict[Hypothesis, float]:
            shift = np.array(change.shift)
            shift[shifted] += steps * displacement
            trial = dataclasses.replace(change, shift=tuple(shift.tolist()))
            return scaled(self.target, trial, lag, self.column(Hypothesis(trial, lag)))

        # Without derivatives: where an edge is a step, nothing is smooth.
        optimum = minimize(
            lambda displacement: min(squares(displacement).values()),
            np.zeros(len(shifted)),
            method="Nelder-Mead",
            options={
                "initial_simplex": np.eye(len(shifted) + 1, len(shifted), -1),
                "xatol": 5e-3,
                "fatol": np.inf,
                "maxfev": _MOST_PLACES * len(shifted),
            },
        )
        return squares(optimum.x)

    def plainest(self, rivals: Sequence[Rival]) -> Rival:
        """Return the best, or the plain one where nothing tells them apart in a list."""
        plain, best = Hypothesis(self.channel.plain), rivals[0]
        listed = next((rival for rival in rivals if rival.hypothesis == plain), best)
        columns = (self.column(rival.hypothesis) for rival in (best, listed))
        first, second = map(self.target.residual, columns)
        limit = max(RESOLUTION, self.target.step)
        return listed if float(np.max(np.abs(first - second))) <= limit else best


def neighbours(channel: AbstractChannel, best: Hypothesis) -> list[Hypothesis]:
    """Return hypotheses that differ from the best one in a single respect."""
    change = best.change
    hypotheses = [
        dataclasses.replace(best, scale=scale, is_free=False)
        for scale in (1.0, -best.scale if not best.is_free else -1.0)
    ]
    changes: list[dict[str, Any]] = []
    if channel.motion.cycle is not None:
        hypotheses += [
            dataclasses.replace(best, lag=lag)
            for lag in (0, best.lag - 1, best.lag + 1)
            if abs(lag) <= channel.motion.reach
        ]
        cycles = channel.cycles_under(channel.conventions)
        changes += [{"cycles": None}]
        changes += [{"cycles": cycles // 2}] * (cycles > 1)
    changes += [{"shift": ()}] * change.is_shifted
    altered = [dataclasses.replace(change, **fields) for fields in changes]
    altered += itertools.chain.from_iterable(otherwise(channel, change))
    return hypotheses + [dataclasses.replace(best, change=one) for one in altered]
