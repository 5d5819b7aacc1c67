"""Where a table may lie, how late it may come, how it may be filtered: the search."""

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize_scalar

from ._channel import EDGES, AbstractChannel, Change, Edge, lagged
from ._hypothesis import FREE_BAND, SCALES, Hypothesis
from ._target import Target

FILTERS = (*range(1, 21), 22, 25, 28, 30, 35, 40, 50, 60, 80, 100)
"""Lengths of a filter that are tried; at most those of the history of a log."""

_FEW_FILTERS = (1, 2, 3, 4, 5, 8, 12, 20, 40)
"""The same where the lists know of no filter."""

_ROWS = 4096
"""Rows that are enough to see where a table lies."""
_SHIFTS = 240
"""Most places of a table that are tried along one master."""


@dataclasses.dataclass(frozen=True)
class Scored:
    """A hypothesis and what it leaves.

    Attributes:
        hypothesis: The way it is applied.
        squares: Sum of squares left over in mm².
    """

    hypothesis: Hypothesis
    squares: float


def scaled(
    target: Target, change: Change, lag: int, column: Float[np.ndarray, " t"]
) -> list[Scored]:
    """Return a column with every factor that a fault explains, and the best one.

    Factors far from the best one are left out: they cannot win.
    """
    inner, power = target.products(column)
    if power <= 1e-18 * len(column):
        return [Scored(Hypothesis(change, lag), target.power)]
    best = inner / power
    least = target.power - best * inner
    near = sorted(SCALES, key=lambda scale: abs(scale - best))[:2]
    found = [
        Scored(Hypothesis(change, lag, scale), least + (scale - best) ** 2 * power)
        for scale in near
    ]
    if abs(best - near[0]) > FREE_BAND * abs(near[0]):
        found.append(Scored(Hypothesis(change, lag, best, is_free=True), least))
    return found


def structures(channel: AbstractChannel) -> list[Change]:
    """Return every choice of masters, edge or rule, without shift, lag or filter."""
    plain = channel.plain
    rules = [dataclasses.replace(plain, conventions=one) for one in channel.rules()]
    masters: list[Change] = [plain]
    masters += [dataclasses.replace(plain, masters=swap) for swap in channel.swaps]
    edges: list[Change] = []
    if any(way.ends for way in channel.ways):
        own = channel.edge(channel.conventions)
        other: list[Edge] = [edge for edge in EDGES if edge != own]
        for one, edge in itertools.product(masters, other):
            edges.append(dataclasses.replace(one, edge=edge))
    return masters + edges + rules


def few_rows(rows: slice) -> Int[np.ndarray, " r"]:
    """Return some thousand rows out of those that are judged, evenly spread."""
    every = max(1, (rows.stop - rows.start) // _ROWS)
    return np.arange(rows.start, rows.stop, every)


def place(
    channel: AbstractChannel, change: Change, target: Target
) -> list[tuple[Change, float]]:
    """Return where a table may lie: as it is, and where else it fits better.

    Args:
        channel: The compensation.
        change: Masters and edge.
        target: Values at all rows.

    Returns:
        Changes with the sum of squares that each leaves at some rows, per row.
    """
    rows = few_rows(channel.motion.judged)
    part = target.at(rows)

    def left(shift: Sequence[float]) -> float:
        moved = dataclasses.replace(change, shift=tuple(shift))
        column = channel.column_at(moved, rows)
        return min(one.squares for one in scaled(part, moved, 0, column)) / len(rows)

    start = [0.0] * len(channel.ways)
    found = [(change, left(start))]
    several = change.masters is not None and change.edge is not None
    if several or change.conventions != channel.conventions:
        return found  # and another place on top of it: too far off
    singles: list[list[float]] = []
    for k, way in enumerate(channel.ways):
        best = _along(left, start, k, way.high - way.low, way.step)
        singles.append(best)
        found.append((dataclasses.replace(change, shift=tuple(best)), left(best)))
    if len(singles) == 2:
        both = singles[0] if left(singles[0]) < left(singles[1]) else singles[1]
        for k in (0, 1, 0, 1):
            way = channel.ways[k]
            both = _along(left, both, k, way.high - way.low, way.step)
        found.append((dataclasses.replace(change, shift=tuple(both)), left(both)))
    return found


def _along(
    left: Callable[[Sequence[float]], float],
    start: Sequence[float],
    at: int,
    length: float,
    step: float,
) -> list[float]:
    """Return the best shift along one master, the others staying where they are."""
    reach = 0.75 * length
    spacing = max(0.5 * step, 2.0 * reach / _SHIFTS)
    grid = np.arange(-reach, reach + spacing, spacing)

    def moved(value: float) -> list[float]:
        return [*start[:at], float(value), *start[at + 1 :]]

    values = [left(moved(value)) for value in grid]
    best = grid[int(np.argmin(values))]
    found = minimize_scalar(
        lambda value: left(moved(value)),
        bounds=(best - spacing, best + spacing),
        method="bounded",
        options={"xatol": 1e-3 * step},
    )
    return moved(found.x)


def timed(channel: AbstractChannel, change: Change, target: Target) -> Iterable[Scored]:
    """Yield every lag and every length of the filter, with the factors that fit.

    Args:
        channel: The compensation.
        change: Masters, edge and shift.
        target: Values at the rows that are judged.
    """
    motion = channel.motion
    parts = channel.parts(change, slice(None))
    if motion.cycle is None:
        column = channel.over_cycles(parts, change)[motion.judged]
        yield from scaled(target, change, 0, column)
        return
    own = max(channel.cycles_under(change.conventions), 1)
    tried = FILTERS if own > 1 else (*_FEW_FILTERS, max(channel.listed, 1))
    for cycles in dict.fromkeys((*tried, own)):
        one = change if cycles == own else dataclasses.replace(change, cycles=cycles)
        column = channel.over_cycles(parts, one)
        for lag in range(-motion.reach, motion.reach + 1):
            yield from scaled(target, one, lag, lagged(column, motion.judged, lag))
