"""Repeated runs: readings taken in one go, over the same places as others."""

import numpy as np
from jaxtyping import Float, Int

_LEAST = 3
"""Readings that a run must have, so that it can have an offset of its own."""

_COMMON = 0.5
"""Share of its places that a run must have in common with others to be a repetition."""


def ranked(run: Int[np.ndarray, " t"]) -> tuple[int, Int[np.ndarray, " t"]]:
    """Return how many runs there are, and of each reading which it is, from 0 up."""
    low, high = (int(run.min()), int(run.max())) if run.size else (0, 0)
    if not 0 <= high - low < 4 * run.size:
        runs, index = np.unique(run, return_inverse=True)
        return len(runs), index.reshape(-1)
    # Numbers of runs stand close together: counting them is faster than sorting.
    rank = np.cumsum(np.bincount(run - low) > 0) - 1
    return int(rank[-1]) + 1, rank[run - low]


def cycles_of(
    run: Int[np.ndarray, " t"], direction: Int[np.ndarray, " t"]
) -> Int[np.ndarray, " t"]:
    """Return cycles that hold both directions, where each run holds only one.

    Some tables number the way out and the way back as runs of their own. An offset per
    such run would take the reversal for itself; the k-th run out and the k-th run back
    are one cycle.
    """
    runs, index = ranked(run)
    forward = np.bincount(index, direction > 0, runs)
    mixed = (forward > 0) & (forward < np.bincount(index))
    one_way = forward > 0
    if mixed.any() or one_way.all() or not one_way.any():
        return run
    cycle = np.where(one_way, np.cumsum(one_way), np.cumsum(~one_way))
    return np.asarray(cycle[index], dtype=np.int64)


def place_in_run(
    run: Int[np.ndarray, " t"], order: Float[np.ndarray, " t"]
) -> Float[np.ndarray, " t"]:
    """Return where in its run each reading was taken, 0 at the start, 1 at the end."""
    runs, index = ranked(run)
    first, last = np.full(runs, np.inf), np.full(runs, -np.inf)
    np.minimum.at(first, index, order)
    np.maximum.at(last, index, order)
    span = (last - first)[index]
    place = np.zeros(len(run))
    np.divide(order - first[index], span, out=place, where=span > 0)
    return place


def runs_overlap(
    positions: Float[np.ndarray, "t d"],
    run: Int[np.ndarray, " t"],
    nodes: tuple[Float[np.ndarray, " _"], ...],
    direction: Int[np.ndarray, " t"] | None,
) -> bool:
    """Return whether every run goes over places that others go over too.

    Args:
        positions: Of the masters.
        run: Run per reading.
        nodes: Of the table, per master: their cells are the places.
        direction: ±1 where the two directions are different places, else None.
    """
    runs, index = ranked(run)
    if runs < 2:
        return False
    cell = places_of(positions, nodes, direction)
    visits = np.unique(cell * runs + index)
    place, visitor = np.divmod(visits, runs)
    return visits_overlap(place, visitor, np.bincount(index))


def places_of(
    positions: Float[np.ndarray, "t d"],
    nodes: tuple[Float[np.ndarray, " _"], ...],
    direction: Int[np.ndarray, " t"] | None,
) -> Int[np.ndarray, " t"]:
    """Return a number for the place of each reading: its nearest node, and its direction."""
    cell = np.zeros(len(positions), dtype=np.int64)
    for k, own in enumerate(nodes):
        # Nearest node: readings at the nodes themselves must not fall to either side.
        middle = 0.5 * (own[1:] + own[:-1])
        cell = cell * len(own) + np.searchsorted(middle, positions[:, k])
    return cell if direction is None else 2 * cell + (direction < 0)


def visits_overlap(
    place: Int[np.ndarray, " v"],
    visitor: Int[np.ndarray, " v"],
    readings: Int[np.ndarray, " r"],
) -> bool:
    """Return `runs_overlap` from the places that each run visits.

    Args:
        place: Of each visit.
        visitor: Its run, counted from 0.
        readings: Number of readings of each run.
    """
    if len(readings) < 2 or readings.min() < _LEAST:
        return False
    shared = np.bincount(place)[place] > 1
    total = np.bincount(visitor, minlength=len(readings))
    common = np.bincount(visitor, weights=shared, minlength=len(readings))
    return bool(np.all(common >= _COMMON * total))
