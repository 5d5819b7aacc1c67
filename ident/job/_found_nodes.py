"""Where the nodes of a table would lie that nobody has chosen yet."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

Grid = tuple[float, float, int]
"""Start, interval and number of nodes, in mm or °."""

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_LINE, _SURFACE = 80, 20
"""Intervals of a table over one position, and over each of two."""
_EACH = 10
"""Readings per node, at least, where there are no targets."""
_TARGETS = 250
"""Different places up to which they are taken for targets."""
_HOLES = 0.05
"""Share of the nodes of a plane that may lack a reading: targets that were left out."""


def grid_over(
    places: Float[np.ndarray, " t"],
    reach: tuple[float, float] | None = None,
    *,
    surface: bool = False,
) -> Grid:
    """Return nodes that suit readings.

    Evenly spaced targets become the nodes; else round numbers that cover the readings.

    Args:
        places: Positions of the readings.
        reach: Ends that the table must reach, or None.
        surface: It is one of two positions of a plane.
    """
    known = np.unique(np.round(places[np.isfinite(places)], 4))
    low, high = float(known[0]), float(known[-1])
    if reach is not None:
        low, high = min(low, reach[0]), max(high, reach[1])
    steps = np.diff(known)
    if 2 <= len(known) <= _TARGETS and np.ptp(steps) < 1e-3 * steps[0]:
        interval = round(float(steps.mean()), 4)
        if abs(known[0] + interval * (len(known) - 1) - known[-1]) < 1e-3:
            before = int(np.ceil((known[0] - low) / interval - 1e-6))
            after = int(np.ceil((high - known[-1]) / interval - 1e-6))
            start = float(known[0]) - before * interval
            return start, interval, len(known) + before + after
    count = len(places) // _EACH
    most = min(_SURFACE, int(np.sqrt(count))) if surface else min(_LINE, count)
    interval = _round_up((high - low) / max(2, min(most, len(known) - 1)))
    start = np.floor(low / interval + 1e-6) * interval
    points = int(np.ceil((high - start) / interval - 1e-6)) + 1
    return round(float(start), 4), interval, max(points, 2)


def grids_for(
    first: Float[np.ndarray, " t"], second: Float[np.ndarray, " t"]
) -> tuple[Grid, Grid]:
    """Return nodes of a plane that suit readings: hardly more than different places.

    Where the targets of the two masters were not measured in all their combinations,
    every second one of the more numerous is left out until the readings suffice.

    Args:
        first: Positions of the first master.
        second: Positions of the second one.
    """
    grids = [grid_over(first, surface=True), grid_over(second, surface=True)]
    places = np.stack([first, second], axis=1)
    known = np.unique(np.round(places[np.isfinite(places).all(axis=1)], 4), axis=0)
    while (1.0 - _HOLES) * grids[0][2] * grids[1][2] > len(known):
        k = int(grids[1][2] > grids[0][2])
        start, interval, points = grids[k]
        if points == 2:
            break
        grids[k] = start, round(2.0 * interval, 4), points // 2 + 1
    return grids[0], grids[1]


def grid_words(places: Sequence[Float[np.ndarray, " t"]]) -> str:
    """Return the keys of nodes that suit readings, as they stand in a job.

    Args:
        places: Positions of the readings, per master.
    """
    if len(places) == 1:
        ((start, interval, points),) = _grids(places)
        return f"start = {start:g}, interval = {interval:g}, points = {points}"
    first, second = _grids(places)
    keys = zip(("start", "interval", "points"), first, second, strict=True)
    return ", ".join(f"{key} = [{one:g}, {two:g}]" for key, one, two in keys)


def suit(
    nodes: Sequence[Float[np.ndarray, " _"]], places: Sequence[Float[np.ndarray, " t"]]
) -> bool:
    """Return whether nodes are those that suit readings.

    Args:
        nodes: Of a table, per master, in mm or °.
        places: Positions of the readings, per master.
    """
    return all(
        len(own) == points
        and bool(np.allclose(own, start + interval * np.arange(points)))
        for own, (start, interval, points) in zip(nodes, _grids(places), strict=True)
    )


def _grids(places: Sequence[Float[np.ndarray, " t"]]) -> tuple[Grid, ...]:
    if len(places) == 1:
        return (grid_over(places[0]),)
    return grids_for(places[0], places[1])


def _round_up(width: float) -> float:
    """Return the next larger of 1, 2, 2.5, 5, 10, … at every power of ten."""
    power = 10.0 ** np.floor(np.log10(width))
    share = width / power
    step = next(each for each in _STEPS if each >= share - 1e-9)
    return round(float(step * power), 4)
