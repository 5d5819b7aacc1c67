"""The search for the hypothesis that explains a column of a log, and its rivals."""

import dataclasses
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from ._channel import AbstractChannel, Change, lagged
from ._hypothesis import Hypothesis
from ._scan import few_rows, otherwise, place, scaled, structures, timed
from ._target import RESOLUTION, Target

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
        samples: Number of independent rows.
    """

    rivals: tuple[Rival, ...]
    nothing: float
    column: Float[np.ndarray, " t"]
    residual: Float[np.ndarray, " r"]
    samples: float

    @property
    def best(self) -> Hypothesis:
        """The best one."""
        return self.rivals[0].hypothesis


def search(
    channel: AbstractChannel,
    target: Target,
    start: Sequence[Hypothesis] = (),
) -> Found:
    """Return the hypothesis that explains the values of a target best.

    Args:
        channel: The compensation.
        target: Values at all rows.
        start: Hypotheses that are looked at in any case.
    """
    rows = channel.motion.judged
    judged = target.at(np.arange(rows.start, rows.stop))
    left: dict[Hypothesis, float] = {}
    for change in _promising(channel, target):
        left |= _closely(channel, change, judged)
    left |= _squares(channel, start, judged)
    best = _ranked(channel, judged, left, float(len(judged.values)))[0].hypothesis
    residual = judged.values - judged.free_of(_column(channel, best))
    samples = independent(residual)
    best = _ranked(channel, judged, left, samples)[0].hypothesis
    left |= _squares(channel, neighbours(channel, best), judged)
    rivals = _ranked(channel, judged, left, samples)
    first = _plainest(channel, judged, rivals)
    column = channel.column(first.hypothesis.change)
    late = np.arange(len(column)) - first.hypothesis.lag
    column = first.hypothesis.scale * column[np.clip(late, 0, len(column) - 1)]
    nothing = judged.criterion(np.array([judged.power]), samples)
    return Found(
        rivals=(first, *(one for one in rivals if one is not first)),
        nothing=float(nothing[0]) + 2.0 * 4.6,
        column=column,
        residual=judged.values - judged.free_of(column[rows]),
        samples=samples,
    )


def _ranked(
    channel: AbstractChannel,
    judged: Target,
    left: Mapping[Hypothesis, float],
    samples: float,
) -> list[Rival]:
    """Return hypotheses, the best first, by the sum of squares that each leaves."""
    misfits = judged.criterion(np.array(list(left.values())), samples).tolist()
    found = [
        Rival(one, misfit, misfit + one.cost(channel, samples))
        for one, misfit in zip(left, misfits, strict=True)
    ]
    return sorted(found, key=lambda one: one.criterion)


def _promising(channel: AbstractChannel, target: Target) -> list[Change]:
    """Return masters, edges and shifts that may explain the values, best first."""
    rows = float(len(few_rows(channel.motion.judged)))
    found = {
        Hypothesis(change): squares * len(target.values)
        for one in structures(channel)
        for change, squares in place(channel, one, target)
    }
    best = _ranked(channel, target, found, rows)[:_KEPT]
    kept = [one.hypothesis.change for one in best]
    return kept if channel.plain in kept else [*kept, channel.plain]


def _closely(
    channel: AbstractChannel, change: Change, judged: Target
) -> dict[Hypothesis, float]:
    """Return a structure with and without a lag, with and without another filter."""
    every = timed(channel, change, judged)
    if not change.is_shifted:
        return every
    # Of a table that lies elsewhere the best of each, its place refined with it.
    best: dict[tuple[bool, bool], Hypothesis] = {}
    for one in sorted(every, key=every.__getitem__):
        best.setdefault((bool(one.lag), one.change.cycles is None), one)
    found: dict[Hypothesis, float] = {}
    for one in best.values():
        found |= _moved(channel, one.change, one.lag, judged)
    return found


def _moved(
    channel: AbstractChannel, change: Change, lag: int, judged: Target
) -> dict[Hypothesis, float]:
    """Return a shifted table with its place refined on all rows, with its factors."""
    free = np.flatnonzero(change.shift)
    steps = 0.05 * np.array([channel.ways[k].step for k in free])

    def left(away: Float[np.ndarray, " f"]) -> dict[Hypothesis, float]:
        shift = np.array(change.shift)
        shift[free] += steps * away
        one = dataclasses.replace(change, shift=tuple(shift.tolist()))
        return scaled(judged, one, lag, _column(channel, Hypothesis(one, lag)))

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


def _squares(
    channel: AbstractChannel, hypotheses: Iterable[Hypothesis], judged: Target
) -> dict[Hypothesis, float]:
    """Return the sum of squares that each hypothesis leaves."""
    found: dict[Hypothesis, float] = {}
    for one in hypotheses:
        inner, power = judged.products(_column(channel, one)[None])
        found[one] = float(judged.power - 2.0 * inner[0] + power[0])
    return found


def _column(
    channel: AbstractChannel, hypothesis: Hypothesis
) -> Float[np.ndarray, " r"]:
    """Return what a hypothesis adds at the rows that are judged."""
    rows, column = channel.motion.judged, channel.column(hypothesis.change)
    return hypothesis.scale * lagged(column, rows, hypothesis.lag)


def independent(residual: Float[np.ndarray, " r"]) -> float:
    """Return to how many independent rows a residual amounts.

    From the correlation of neighbours: what a model leaves out is seen in many rows, and
    is yet one observation.
    """
    power = float(residual @ residual)
    if power <= 0.0:
        return float(len(residual))
    next_to = float(residual[1:] @ residual[:-1]) / power
    share = (1.0 - next_to) / (1.0 + next_to) if next_to > 0 else 1.0
    return max(2.0, share * len(residual))


def _plainest(
    channel: AbstractChannel, judged: Target, rivals: Sequence[Rival]
) -> Rival:
    """Return the best, or the plain one where nothing tells them apart in a list."""
    plain = next(
        (one for one in rivals if one.hypothesis == Hypothesis(channel.plain)), None
    )
    if plain is None:
        return rivals[0]
    apart = _column(channel, rivals[0].hypothesis)
    apart = judged.free_of(apart - _column(channel, plain.hypothesis))
    enough = max(RESOLUTION, judged.step)
    return plain if float(np.max(np.abs(apart))) <= enough else rivals[0]


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
