"""The search for the hypothesis that explains a column of a log, and its rivals."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ._channel import EDGES, AbstractChannel, Change, lagged
from ._hypothesis import Hypothesis
from ._scan import Scored, few_rows, place, scaled, structures, timed
from ._target import RESOLUTION, Target

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
    scored: list[Scored] = []
    for change in _promising(channel, target):
        scored += _closely(channel, change, judged)
    for one in start:
        scored.append(_again(channel, one, judged))
    samples = float(len(judged.values))
    best = min(scored, key=lambda one: _value(channel, judged, one, samples))
    residual = judged.values - judged.free_of(_column(channel, best.hypothesis, rows))
    samples = independent(residual)
    best = min(scored, key=lambda one: _value(channel, judged, one, samples))
    scored += [
        _again(channel, one, judged) for one in neighbours(channel, best.hypothesis)
    ]
    unique = {one.hypothesis: one for one in scored}
    rivals = sorted(
        (
            Rival(
                one.hypothesis,
                judged.criterion(one.squares, samples),
                _value(channel, judged, one, samples),
            )
            for one in unique.values()
        ),
        key=lambda one: one.criterion,
    )
    first = _plainest(channel, judged, rivals)
    column = _whole(channel, first.hypothesis)
    nothing = judged.criterion(judged.power, samples) + 2.0 * 4.6
    return Found(
        rivals=(first, *(one for one in rivals if one is not first)),
        nothing=nothing,
        column=column,
        residual=judged.values - judged.free_of(column[rows]),
        samples=samples,
    )


def _promising(channel: AbstractChannel, target: Target) -> list[Change]:
    """Return masters, edges and shifts that may explain the values, best first."""
    rows = float(len(few_rows(channel.motion.judged)))
    found: list[tuple[float, Change]] = []
    for one in structures(channel):
        for change, squares in place(channel, one, target):
            cost = Hypothesis(change).cost(channel, rows)
            found.append((target.criterion(squares * len(target.values), rows) + cost,
                          change))  # fmt: skip
    found.sort(key=lambda one: one[0])
    kept = [change for _, change in found[:_KEPT]]
    if channel.plain not in kept:
        kept.append(channel.plain)
    return kept


def _closely(channel: AbstractChannel, change: Change, judged: Target) -> list[Scored]:
    """Return a structure with and without a lag, with and without another filter."""
    every = timed(channel, change, judged)
    found: list[Scored] = []
    for late, other in itertools.product((False, True), repeat=2):
        some = [
            one
            for one in every
            if (late or one.hypothesis.lag == 0)
            and (other or one.hypothesis.change.cycles is None)
        ]
        # Two factors at least: the second may be the likelier one.
        some.sort(key=lambda one: one.squares)
        found += some[:3]
    found += [
        one
        for one in every
        if one.hypothesis.lag == 0 and one.hypothesis.change.cycles is None
    ]
    unique = {one.hypothesis: one for one in found}
    if not change.is_shifted:
        return list(unique.values())
    timings = {(one.change.cycles, one.lag) for one in unique}
    return [
        one
        for cycles, lag in sorted(timings, key=str)
        for one in _moved(channel, dataclasses.replace(change, cycles=cycles), lag,
                          judged)
    ]  # fmt: skip


def _moved(
    channel: AbstractChannel, change: Change, lag: int, judged: Target
) -> list[Scored]:
    """Return a shifted table with its place refined on all rows, with its factors."""
    rows = channel.motion.judged
    free = [k for k, value in enumerate(change.shift) if value]
    steps = 0.05 * np.array([channel.ways[k].step for k in free])

    def at(away: Float[np.ndarray, " f"]) -> Change:
        shift = np.array(change.shift)
        shift[free] += steps * away
        return dataclasses.replace(change, shift=tuple(shift.tolist()))

    def left(away: Float[np.ndarray, " f"]) -> list[Scored]:
        one = at(away)
        return scaled(judged, one, lag, lagged(channel.column(one), rows, lag))

    def least(away: Float[np.ndarray, " f"]) -> float:
        return min(one.squares for one in left(away))

    best = np.zeros(len(free))
    if change.edge == "zero" or channel.edge(change.conventions) == "zero":
        # The edge is a step: nothing is smooth, and places are tried one by one.
        for width in (1.0, 0.25, 0.06, 0.015):
            for k in range(len(free)):
                side = np.eye(len(free))[k]
                tried = [best + by * width * side for by in np.linspace(-1.0, 1.0, 9)]
                best = min(tried, key=least)
        return left(best)
    # A parabola through three places per master, twice: the search came near already.
    for width in (1.0, 0.1):
        for k in range(len(free)):
            side = width * np.eye(len(free))[k]
            below, here, above = (least(best + by * side) for by in (-1.0, 0.0, 1.0))
            bend = below - 2.0 * here + above
            if bend > 0:
                best = best + np.clip(0.5 * (below - above) / bend, -3.0, 3.0) * side
    return left(best)


def _again(channel: AbstractChannel, hypothesis: Hypothesis, judged: Target) -> Scored:
    column = _column(channel, hypothesis, channel.motion.judged)
    inner, power = judged.products(column)
    return Scored(hypothesis, judged.power - 2.0 * inner + power)


def _whole(channel: AbstractChannel, hypothesis: Hypothesis) -> np.ndarray:
    column = channel.column(hypothesis.change)
    at = np.clip(np.arange(len(column)) - hypothesis.lag, 0, len(column) - 1)
    return hypothesis.scale * column[at]


def _column(
    channel: AbstractChannel, hypothesis: Hypothesis, rows: slice
) -> Float[np.ndarray, " r"]:
    column = channel.column(hypothesis.change)
    return hypothesis.scale * lagged(column, rows, hypothesis.lag)


def _value(
    channel: AbstractChannel, judged: Target, one: Scored, samples: float
) -> float:
    return judged.criterion(one.squares, samples) + one.hypothesis.cost(
        channel, samples
    )


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
    rows = channel.motion.judged
    plain = next(
        (one for one in rivals if one.hypothesis == Hypothesis(channel.plain)), None
    )
    if plain is None:
        return rivals[0]
    apart = _column(channel, rivals[0].hypothesis, rows)
    apart = judged.free_of(apart - _column(channel, plain.hypothesis, rows))
    enough = max(RESOLUTION, judged.step)
    return plain if float(np.max(np.abs(apart))) <= enough else rivals[0]


def neighbours(channel: AbstractChannel, best: Hypothesis) -> list[Hypothesis]:
    """Return hypotheses that differ from the best one in a single respect."""
    change = best.change
    found = [
        dataclasses.replace(best, scale=scale, is_free=False)
        for scale in (1.0, -best.scale if not best.is_free else -1.0)
    ]
    if any(way.ends for way in channel.ways):
        own = channel.edge(change.conventions)
        for edge in EDGES:
            other = None if edge == own else edge
            found.append(_with(best, edge=other))
    found += [_with(best, masters=swap) for swap in (None, *channel.swaps)]
    if channel.motion.cycle is not None:
        found += [dataclasses.replace(best, lag=best.lag + by) for by in (-1, 1)
                  if abs(best.lag + by) <= channel.motion.reach]  # fmt: skip
        found += [dataclasses.replace(best, lag=0), _with(best, cycles=None)]
        cycles = channel.cycles_under(channel.conventions)
        if cycles > 1:
            found.append(_with(best, cycles=max(1, cycles // 2)))
    if change.is_shifted:
        found.append(_with(best, shift=()))
    for convention in change.conventions.listing():
        if convention.name in channel.relevant:
            for choice in convention.choices:
                values = {**change.conventions.to_dict(), convention.name: choice}
                rules = change.conventions.from_dict(values)
                found.append(_with(best, conventions=rules))
    return found


def _with(hypothesis: Hypothesis, **changes: object) -> Hypothesis:
    change = dataclasses.replace(hypothesis.change, **changes)  # type: ignore[arg-type]
    return dataclasses.replace(hypothesis, change=change)
