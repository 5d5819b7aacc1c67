"""Where a table may lie, how late it may come, how it may be filtered: the search."""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int

from ._channel import EDGES, AbstractChannel, Change, Way
from ._hypothesis import FREE_BAND, SCALES, SHIFTS, Hypothesis
from ._log import Target

FILTERS = (*range(1, 21), 22, 25, 28, 30, 35, 40, 50, 60, 80, 100)
"""Lengths of a filter that are tried; at most those of the history of a log."""

_FEW_FILTERS = (1, 2, 3, 4, 5, 8, 12, 20, 40)
"""The same where the lists know of no filter."""

_ROWS = 2048
"""Rows that are enough to see where a table lies."""
_TIMED_ROWS = 4096
"""Rows that are enough to see which lags and filters come into question."""
_TIMED = 8
"""So many of them are looked at on all rows."""
_SIZES = sorted(SCALES)
_CLOSER = np.linspace(-1.0, 1.0, 17)
"""Places that are tried around the best one, in units of the last distance."""


def scaled(
    target: Target, change: Change, lag: int, column: Float[np.ndarray, " t"]
) -> dict[Hypothesis, float]:
    """Return the squares that a column leaves, by every factor of a fault and the best.

    Factors that leave twice as much as the best one cannot win.
    """
    factor, least, power = (float(value[0]) for value in target.fitted(column[None]))
    if not power:
        return {Hypothesis(change, lag): target.power}
    excess = _excess(np.full(1, factor), target.band)[0]
    squares = (least + np.square(excess) * power).tolist()
    nearest = np.argsort(np.abs(excess))[:2]
    squares_of = {
        Hypothesis(change, lag, scale): square
        for k, (scale, square) in enumerate(zip(_SIZES, squares, strict=True))
        if square < 2.0 * least or k in nearest
    }
    size = _SIZES[nearest[0]]
    if abs(factor - size) > max(FREE_BAND, target.band) * abs(size):
        squares_of[Hypothesis(change, lag, factor, is_free=True)] = least
    return squares_of


def _excess(factors: Float[np.ndarray, " s"], band: float) -> Float[np.ndarray, "s k"]:
    """Return how far the best factors are from each of `SCALES`, less what a band allows."""
    sizes = np.array(_SIZES)
    difference = factors[:, None] - sizes
    allowed = band * np.abs(sizes)
    return np.asarray(difference - np.clip(difference, -allowed, allowed))


def structures(channel: AbstractChannel) -> list[Change]:
    """Return every choice of masters, edge or rule, without shift, lag or filter."""
    masters, edges, rules = otherwise(channel, channel.plain)
    edges += [
        edge for swapped in masters[1:] for edge in otherwise(channel, swapped)[1]
    ]
    return list(dict.fromkeys([*masters, *edges, *rules]))


def otherwise(channel: AbstractChannel, change: Change) -> tuple[list[Change], ...]:
    """Return a change with every choice of masters, then of edges, and with other rules."""
    listed, rules = channel.edge(change.conventions), channel.rules(change.conventions)
    edges = EDGES if any(master.ends for master in channel.ways) else ()
    turns = (False, True) if channel.two_way else (False,)
    swaps = itertools.product((None, *channel.swaps), turns)
    other = functools.partial(dataclasses.replace, change)
    return (
        [other(masters=masters, turned=turned) for masters, turned in swaps],
        [other(edge=None if edge == listed else edge) for edge in edges],
        [other(conventions=rule) for rule in rules],
    )


def few_of(rows: Int[np.ndarray, " r"], count: int = _ROWS) -> Int[np.ndarray, " f"]:
    """Return some thousand out of rows, evenly spread."""
    return rows[:: max(1, len(rows) // count)]


def place(
    channel: AbstractChannel,
    change: Change,
    target: Target,
    rows: Int[np.ndarray, " r"],
) -> list[tuple[Change, float]]:
    """Return where a table may lie, as it is and where else it fits better.

    Changes of one with its masters and edge, and the sum of squares that each leaves of a target
    at some rows, which are enough to see it.
    """

    def left(shifts: Float[np.ndarray, "s k"]) -> Float[np.ndarray, " s"]:
        return least_squares(target, channel.columns_at(change, shifts, rows))

    def tried(*shift: float) -> tuple[Change, float]:
        shifted = dataclasses.replace(change, shift=tuple(shift))
        return shifted, float(left(np.array([shift]))[0])

    start = [0.0] * len(channel.ways)
    places = [(change, tried(*start)[1])]
    several = change.masters is not None and change.edge is not None
    if several or change.conventions != channel.conventions:
        return places  # and another place on top of it: too far off
    singles: list[list[float]] = []
    for k, master in enumerate(channel.ways):
        singles.append(_along(left, start, k, master))
        places.append(tried(*singles[-1]))
    if len(singles) == 2:
        joint = singles[0] if places[-2][1] < places[-1][1] else singles[1]
        for k in (0, 1, 0, 1):
            joint = _along(left, joint, k, channel.ways[k])
        places.append(tried(*joint))
    return places


def least_squares(
    target: Target, columns: Float[np.ndarray, "s r"]
) -> Float[np.ndarray, " s"]:
    """Return the sum of squares that each column leaves at the best factor of `scaled`."""
    factors, squares, power = target.fitted(columns)
    # A factor near that of a fault counts as it, which leaves the difference of both.
    excess = np.abs(_excess(factors, target.band))
    is_fault = (excess <= FREE_BAND * np.abs(_SIZES)).any(axis=1)
    return squares + np.where(is_fault, np.square(excess.min(axis=1)) * power, 0.0)


def _along(
    squares: Callable[[Float[np.ndarray, "s k"]], Float[np.ndarray, " s"]],
    start: Sequence[float],
    at: int,
    way: Way,
) -> list[float]:
    """Return the best shift along one master, the others staying where they are."""
    reach = 0.75 * (way.high - way.low)
    spacing = max(0.5 * way.step, 2.0 * reach / SHIFTS)
    grid = np.arange(-reach, reach + spacing, spacing)

    def moved(places: Float[np.ndarray, " s"]) -> Float[np.ndarray, "s k"]:
        shifts = np.tile(np.array(start, dtype=float), (len(places), 1))
        shifts[:, at] = places
        return shifts

    optimum = float(grid[int(np.argmin(squares(moved(grid))))])
    # Ever closer around the best one, each time with all places at once.
    while spacing > 1e-3 * way.step:
        closer = optimum + spacing * _CLOSER
        optimum = float(closer[int(np.argmin(squares(moved(closer))))])
        spacing *= 2.0 / (len(_CLOSER) - 1)
    return [float(coordinate) for coordinate in moved(np.array([optimum]))[0]]


def timed(
    channel: AbstractChannel,
    change: Change,
    target: Target,
    rows: Int[np.ndarray, " r"],
) -> dict[Hypothesis, float]:
    """Return the squares that lags and lengths of the filter leave, with their factors.

    Masters, edge and shift are those of the change; the target is that at the rows.
    """
    motion = channel.motion
    parts = channel.parts(change, slice(None))
    if motion.cycle is None:
        column = channel.over_cycles(parts, change)[rows]
        return scaled(target, change, 0, column)
    listed_cycles = max(channel.cycles_under(change.conventions), 1)
    lengths = FILTERS if listed_cycles > 1 else (*_FEW_FILTERS, max(channel.listed, 1))
    sample = few_of(np.arange(len(rows)), _TIMED_ROWS)
    part = target.at(sample)
    lags = np.arange(-motion.reach, motion.reach + 1)
    columns: dict[int, Float[np.ndarray, " t"]] = {}
    guesses: list[tuple[float, int, int]] = []
    changes = {n: dataclasses.replace(change, cycles=n) for n in lengths}
    changes[listed_cycles] = change
    for cycles, variant in changes.items():
        columns[cycles] = channel.over_cycles(parts, variant)
        squares = least_squares(part, columns[cycles][rows[sample] - lags[:, None]])
        guesses += zip(squares.tolist(), itertools.repeat(cycles), lags.tolist())
    guesses.sort()
    # The best of all, and of those that keep the length, or the lag.
    candidates = [
        *guesses[:_TIMED],
        *[guess for guess in guesses if guess[1] == listed_cycles][:_TIMED],
        *[guess for guess in guesses if guess[2] == 0][:_TIMED],
    ]
    hypotheses: dict[Hypothesis, float] = {}
    chosen = dict.fromkeys([(listed_cycles, 0), *(each[1:] for each in candidates)])
    for cycles, lag in chosen:
        delayed = columns[cycles][rows - lag]
        hypotheses |= scaled(target, changes[cycles], lag, delayed)
    return hypotheses
