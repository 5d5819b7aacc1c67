"""Where the tests stand: how many along which axis, chosen by events held out."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core import FitError, Regression, node_shares, regress, simplest
from ._events import Events

_CELLS, _FOLDS = 8, 8
_SAME_PLACE = 1e-3
"""Share of the travel within which events stand at one place."""
_VISITS = 3
"""Events at each place, on average, from which on the axes come back to few places."""
LEAST_SPAN = 0.01
"""mm below which an axis stands still, whatever its positions scatter by."""
TOUCHED = 1e-9
"""Weight of a test in an event from which on the event touches it."""

_DETERMINED = 1e-6
"""Singular value, absolute, from which on events determine a combination of tests."""

Axes = tuple[int, ...]
Nodes = tuple[Float[np.ndarray, " _n"], ...]


def fitted(
    events: Events,
    group: Int[np.ndarray, " n"],
    columns: Float[np.ndarray, "n p"],
    loss: str,
) -> Iterator[tuple[int, Bool[np.ndarray, " n"], Regression]]:
    """Yield number and events of each group, and the values of tests over them.

    Each value rests on the events around it. The scatter within events counts beside that
    between them where these are few, and wild ones need spare ones to be found.

    Args:
        events: Readings of the values.
        group: Number of the values that each event shows.
        columns: Weight of each test in each event.
        loss: As for `regress`.
    """
    for number in np.unique(group).tolist():
        members = group == number
        design = columns[members]
        spare = len(design) - int((design > TOUCHED).any(axis=0).sum())
        root = np.sqrt(events.weight[members])
        found = regress(
            design * root[:, None],
            events.value[members] * root,
            loss=loss if spare >= max(4, design.shape[1]) else "gauss",
            noise=events.own_noise,
        )
        yield number, members, found


def held_out(
    events: Events,
    group: Int[np.ndarray, " n"],
    columns: Float[np.ndarray, "n p"],
    place: Int[np.ndarray, " n"],
    wild: Bool[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Return what values fitted to other events leave of each, in mm; arguments as `fitted`.

    Events of one place are held out together, and none is fitted to wild ones.

    Where the others leave values open, those nearest to the median of these events are
    taken: a test that none of them touches has the median.
    """
    residual, root = np.zeros(len(events)), np.sqrt(events.weight)
    folds = np.arange(int(place.max()) + 1) % _FOLDS
    fold = np.random.default_rng(0).permutation(folds)[place]
    for held, number in itertools.product(range(_FOLDS), np.unique(group)):
        rows = (fold == held) & (group == number)
        training = ~wild & (fold != held) & (group == number)
        observed = events.value[training]
        centre = float(np.median(observed)) if observed.size else 0.0
        design = columns[training] * root[training, None]
        aim = (observed - centre) * root[training]
        value = np.linalg.lstsq(design, aim, rcond=1e-6)[0]
        residual[rows] = events.value[rows] - centre - columns[rows] @ value
    return residual


def columns_of(
    positions: Float[np.ndarray, "n k"], axes: Axes, nodes: Nodes
) -> Float[np.ndarray, "n p"]:
    """Return the weight of each test of a grid in each event, the last axis fastest.

    What the controller's surface gives for the same tests, as products of what each axis
    gives: the search looks at hundreds of grids, and nothing is compiled for each shape.
    """
    result = np.ones((len(positions), 1))
    for axis, line in zip(axes, nodes, strict=True):
        share = node_shares(positions[:, axis], line)
        result = (result[:, :, None] * share[:, None, :]).reshape(len(result), -1)
    return result


def choose_tests(
    events: Events, group: Int[np.ndarray, " n"], modes: tuple[int, ...], most: int
) -> tuple[Axes, Float[np.ndarray, "p k"]]:
    """Return adaptation axes and places of tests that predict held-out events best.

    The fewest tests whose loss is not above the least by more than chance over the places.
    They stand on a grid, the last axis fastest: at the few places to which an axis comes back,
    else evenly spaced over the events.

    Raises:
        FitError: If no choice can be fitted.
    """
    most = min(most, int(np.unique(group, return_counts=True)[1].min()))
    candidates = _candidates(events.positions, group, modes, most)
    if not candidates:
        names = " or ".join(str(mode) for mode in modes)
        msg = (
            f"mode {names} cannot be fitted: the events do not spread over the adaptation "
            "axes that it needs."
        )
        raise FitError(msg)
    pairs = [(each, columns_of(events.positions, *each)) for each in candidates]
    # A test that the events do not determine has no value; where all grids have one, it is
    # left out.
    whole = [
        (each, design)
        for each, design in pairs
        if np.linalg.matrix_rank(design, _DETERMINED) == design.shape[1]
    ]
    pairs = whole or pairs
    sizes = [design.shape[1] for _, design in pairs]
    # What the finest choice rejects has no part in the search.
    _, finest = pairs[int(np.argmax(sizes))]
    sound = np.ones(len(events), bool)
    for _, members, regression in fitted(events, group, finest, "student"):
        sound[members] = ~regression.wild
    events, group = events.take(sound), group[sound]
    cell, no_wild = _cells(events.positions), np.zeros(len(events), bool)
    root = np.sqrt(events.weight)
    sounds = (design[sound] for _, design in pairs)
    tried = [held_out(events, group, part, cell, no_wild) * root for part in sounds]
    scale = min(max(1.4826 * float(np.median(np.abs(loss))), 1e-9) for loss in tried)
    (axes, grid), _ = pairs[simplest(tried, sizes, scale, cell)]
    return axes, np.array([*itertools.product(*grid)])


def _candidates(
    positions: Float[np.ndarray, "n k"],
    group: Int[np.ndarray, " n"],
    modes: tuple[int, ...],
    most: int,
) -> list[tuple[Axes, Nodes]]:
    """Return axes and nodes from the first to the last event along each, so many at most.

    Over one axis at least three where the events bear them: one statement of the manuals has
    exactly three tests in mode 2 (S-37), which the check of lists warns of else.
    """
    stops = [_stops(column, group) for column in positions.T]
    moving = np.flatnonzero(np.ptp(positions, axis=0) > LEAST_SPAN).tolist()
    candidates = []
    for axes in (a for mode in modes for a in itertools.combinations(moving, mode - 1)):
        fewest = 3 if len(axes) == 1 else 2
        ends = [min(most, len(stops[axis]) or most) for axis in axes]
        ranges = [range(max(min(fewest, end), 2), end + 1) for end in ends]
        for counts in itertools.product(*ranges):
            if math.prod(counts) <= most:
                lines = [
                    _line(stops[axis], positions[:, axis], count)
                    for axis, count in zip(axes, counts, strict=True)
                ]
                candidates.append((axes, tuple(lines)))
    return candidates


def _line(
    stops: Float[np.ndarray, " s"], column: Float[np.ndarray, " n"], count: int
) -> Float[np.ndarray, " _p"]:
    """Return so many of the places at which an axis stood, or evenly spaced over its events."""
    if stops.size:
        chosen = np.linspace(0, len(stops) - 1, count).round().astype(int)
        return np.asarray(stops[chosen])
    places = np.linspace(column.min(), column.max(), count)
    # Whole steps of about a hundredth of the span can be read aloud.
    step = 10.0 ** math.floor(math.log10(np.ptp(places) / 50.0))
    return np.asarray(np.round(places / step) * step)


def _places(column: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Return the number of the place along an axis at which each event stands, ascending."""
    step = max(np.ptp(column) * _SAME_PLACE, LEAST_SPAN)
    number, place, start = np.zeros(len(column), np.int64), -1, -np.inf
    for event in np.argsort(column).tolist():
        if column[event] - start > step:
            place, start = place + 1, column[event]
        number[event] = place
    return number


def _stops(
    column: Float[np.ndarray, " n"], group: Int[np.ndarray, " n"]
) -> Float[np.ndarray, " _s"]:
    """Return the few places to which an axis comes back, to 0.01 mm; none of one that does not.

    Only those at which events of every group took place, where there are two of these: a test
    is written with all its values.
    """
    number = _places(column)
    if (number.max() + 1) * _VISITS > len(column):
        return np.zeros(0)
    means = np.bincount(number, column) / np.bincount(number)
    seen = np.zeros((len(means), int(group.max()) + 1), bool)
    seen[number, group] = True
    whole = seen.sum(axis=1) == len(np.unique(group))
    return np.asarray(np.round(means[whole] if whole.sum() > 1 else means, 2))


def _cells(positions: Float[np.ndarray, "n k"]) -> Int[np.ndarray, " n"]:
    """Return the number of the place of each event, among as many as can be held out.

    Few places that the axes come back to again and again are no sample of what lies between
    them: there each event stands for itself.
    """
    if not positions.shape[1]:
        return np.arange(len(positions)) % _FOLDS
    places = np.unique(np.stack([*map(_places, positions.T)], axis=1), axis=0)
    if len(places) * _VISITS <= len(positions):
        return np.arange(len(positions))
    parts = []
    for column in positions.T:
        edges = np.quantile(column, np.linspace(0.0, 1.0, _CELLS + 1)[1:-1])
        parts.append(np.searchsorted(np.unique(edges), column, side="right"))
    _, index = np.unique(np.column_stack(parts), axis=0, return_inverse=True)
    return np.asarray(index.reshape(-1))
