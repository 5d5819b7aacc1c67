"""Readings of a table, of several measurements one after the other.

Runs are readings taken in one go; where they go over the same places they are repeated.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

_LEAST = 3
"""Readings that a run must have, so that it can have an offset of its own."""

_COMMON = 0.5
"""Share of its places that a run must have in common with others to be a repetition."""

_STRETCHES = 2
"""Groups of runs without a common place, up to which the table tells how they lie."""

_SEVERAL, _SURE, _GROWN = 5, 6.0, 5e-6
"""Places that two measurements share, deviations of a slope between them, and mm per mm (half a
kelvin of steel), from which on one is the longer."""
_STEEL = 11.5e-6
"""Expansion per K."""


def longer_than(
    parts: Mapping[str, tuple[Float[np.ndarray, " _n"], Float[np.ndarray, " _n"]]],
) -> str:
    """Return in words which measurement shows an axis longer than another; nothing where none.

    What lies between two at the places that both reach is no straight line unless the axis grew,
    or the slope of an instrument is another one.

    Args:
        parts: Position and error in mm of the readings, by measurement.
    """
    profiles = dict[str, tuple[np.ndarray, np.ndarray]]()
    for name, (place, error) in parts.items():
        finite = np.isfinite(place) & np.isfinite(error)
        at, index = np.unique(place[finite].round(3), return_inverse=True)
        mean = np.bincount(index.reshape(-1), error[finite]) / np.bincount(
            index.reshape(-1)
        )
        profiles[name] = at, mean
    slopes = dict[tuple[str, str], float]()
    for one, other in itertools.permutations(profiles, 2):
        (at, mean), (theirs, wanted) = profiles[one], profiles[other]
        if len(theirs) < _SEVERAL:
            continue
        inside = (at >= theirs[0]) & (at <= theirs[-1])
        if inside.sum() < _SEVERAL:
            continue
        between = mean[inside] - np.interp(at[inside], theirs, wanted)
        way = at[inside] - at[inside].mean()
        slope = float(way @ between / (way @ way))
        left = between - between.mean() - slope * way
        deviation = np.sqrt(left @ left / (len(way) - 2) / (way @ way))
        if slope > max(_SURE * deviation, _GROWN):
            slopes[one, other] = slope
    if not slopes:
        return ""
    (one, other), slope = max(slopes.items(), key=lambda item: item[1])
    return (
        f"Measurement {one!r} shows the axis longer than {other!r} does, by {1e6 * slope:.2g}"
        f" µm/m, as steel grows in {slope / _STEEL:.2g} K: state how warm the axis was in each"
        " (expansion and material_temperature), leave out the one whose slope is the instrument's"
        ' (or state remove = "line" in all, and the list has no slope), or fit a temperature in one'
        " group with it"
    )


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

    Runs that no place joins to the rest, as the lines of a surface that are passed twice each,
    tell nothing of what they have in common: it is theirs or the table's. Of two stretches
    smoothness tells it.

    Args:
        positions: Of the masters.
        run: Run per reading.
        nodes: Of the table, per master: their cells are the places.
        direction: ±1 where the two directions are different places, else None.
    """
    runs, index = ranked(run)
    if runs < 2:
        return False
    cell = np.zeros(len(positions), dtype=np.int64)
    for k, line in enumerate(nodes):
        # Nearest node: readings at the nodes themselves must not fall to either side.
        middle = 0.5 * (line[1:] + line[:-1])
        cell = cell * len(line) + np.searchsorted(middle, positions[:, k])
    places, seen = ranked(cell)
    met = sp.coo_array((np.ones(len(cell)), (index, runs + seen)), (runs + places,) * 2)
    if connected_components(met, directed=False)[0] > _STRETCHES:
        return False
    if direction is not None:
        cell = 2 * cell + (direction < 0)
    place, visitor = np.divmod(np.unique(cell * runs + index), runs)
    if np.bincount(index).min() < _LEAST:
        return False
    shared = np.bincount(place)[place] > 1
    common = np.bincount(visitor, weights=shared, minlength=runs)
    return bool(np.all(common >= _COMMON * np.bincount(visitor, minlength=runs)))


@dataclasses.dataclass(frozen=True)
class Readings:
    """What was measured for one fit, one measurement after the other; in mm or °.

    Attributes:
        positions: Of the masters.
        error: Actual − commanded.
        direction: ±1, or None where it is neither needed nor known.
        run: Cycle of each reading, or None where nothing was repeated.
        order: Time in s, or row number.
        timed: Whether it is a time.
        slices: Rows of each measurement.
        late: What one standard deviation of the instruments' delays makes of the error, or
            None at standstill.
        own_zero: Whether the zero of each is the machine's, beside others whose zero is
            arbitrary; None where all are alike.
    """

    positions: Float[np.ndarray, "t d"]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None
    run: Int[np.ndarray, " t"] | None
    order: Float[np.ndarray, " t"]
    timed: bool
    slices: Mapping[str, slice]
    late: Float[np.ndarray, " t"] | None = None
    own_zero: Bool[np.ndarray, " t"] | None = None

    @property
    def floating(self) -> tuple[int, ...]:
        """Runs whose zero is arbitrary, beside others whose zero is the machine's."""
        if self.own_zero is None or self.run is None:
            return ()
        return tuple(np.unique(self.run[~self.own_zero]).tolist())

    @property
    def time(self) -> Float[np.ndarray, " t"] | None:
        """In s, or None."""
        return self.order if self.timed else None


def rows_of(sources: Sequence[str], counts: Sequence[int]) -> dict[str, slice]:
    """Return the rows of each measurement, one after the other, by its name."""
    ends = itertools.pairwise([0, *itertools.accumulate(counts)])
    return {name: slice(*ends_of) for name, ends_of in zip(sources, ends, strict=True)}


def joined(parts: list[np.ndarray | None]) -> np.ndarray | None:
    """Return the columns of all measurements one after the other, if all have it."""
    arrays = [part for part in parts if part is not None]
    return np.concatenate(arrays) if len(arrays) == len(parts) else None


def joined_runs(
    runs: Sequence[Int[np.ndarray, " _t"] | None], counts: Sequence[int]
) -> Int[np.ndarray, " t"] | None:
    """Number the runs of all measurements one after the other.

    A measurement without runs is a run of its own beside others.

    Args:
        runs: Of each measurement, or None.
        counts: Readings of each measurement.
    """
    if len(runs) == 1 and runs[0] is None:
        return None
    numbered: list[np.ndarray] = []
    first = 1
    for run, count in zip(runs, counts, strict=True):
        number = np.zeros(count, dtype=np.int64) if run is None else ranked(run)[1]
        numbered.append(number.astype(np.int64) + first)
        first += int(number.max(initial=0)) + 1
    return np.concatenate(numbered)
