"""Where the nodes of a fit lie: whether they suit axis and list, and which suit readings."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ....data.measurements import MESH_FORMATS, MeasurementError
from ...exchange import (
    LIST_UNITS,
    AbstractTable,
    ExchangeError,
    ListNodes,
    Model,
    grid_nodes,
    nodes_in,
    point_nodes,
)
from ...kinds._keys import Grid, TableSpec
from ...readings import Tables
from ..file._load import Job


def table_of(
    tables: Tables, index: int, fit: TableSpec, old: Model | None
) -> AbstractTable:
    """Return the table that a fit writes.

    Its nodes are those that the job gives, else those of the old table, else the points
    of a mesh.

    Raises:
        JobError: If there are no nodes, or they do not go round a modulo axis.
        ExchangeError: If a list cannot hold them.
    """
    job, nodes = tables.job, _nodes(tables, index, fit, old)
    periodic = _full_turn(job, index, fit, nodes[0])
    return dataclasses.replace(empty_table(job, fit), nodes=nodes, periodic=periodic)


def empty_table(job: Job, fit: TableSpec) -> AbstractTable:
    """Return the kind of table that a fit writes, its nodes not yet known."""
    axes, columns = job.spec.axes, fit.kind.entries.table
    assert columns is not None  # the keys of a table
    masters = tuple(axes[name].number for name in fit.over)
    return columns(axes[fit.axis].number, masters, (), job.conventions, **fit.form)


def _nodes(
    tables: Tables, index: int, fit: TableSpec, old: Model | None
) -> tuple[ListNodes, ...]:
    name = f"fits[{index}]"
    if fit.nodes:
        return tuple(
            point_nodes(np.array(pair, dtype=float), name)
            if isinstance(pair, list)
            else grid_nodes(*pair, name)
            for pair in fit.nodes
        )
    if old is not None:
        return nodes_in(old, name)
    source = fit.sources[0]
    # No mesh is that large.
    if len(fit.over) == 2 and tables.large(source) is None:
        read = tables.table(source)
        columns = tables.job.spec.measurements[source].columns
        if read.format in MESH_FORMATS and not columns:
            return tuple(_mesh_nodes(read.column(axis).values, name) for axis in "xy")
    reason = f"no nodes, expected {fit.nodes_wanted}{_suited_nodes(tables, fit)}"
    raise tables.job.error(("fits", index), reason)


def _suited_nodes(tables: Tables, fit: TableSpec) -> str:
    """Return the hint which nodes suit the readings of a fit; empty where that is unknown."""
    turning = any(tables.job.spec.axes[name].modulo is not None for name in fit.over)
    if turning or any(tables.large(name) is not None for name in fit.sources):
        return ""
    try:
        measured = [tables.measured(name, fit.axis, fit.over) for name in fit.sources]
        places = [
            np.concatenate([table.require(f"{axis}.position") for table in measured])
            for axis in fit.over
        ]
    except MeasurementError:
        return ""
    if not all(np.ptp(column) > 0 for column in places):
        return ""
    return f"; these suit the readings: {grid_words(grid_keys(places))}"


def _mesh_nodes(places: Float[np.ndarray, " t"], name: str) -> ListNodes:
    """Return the grid lines of a mesh, to the nearest list unit.

    Raises:
        ExchangeError: If there are fewer than two.
    """
    lines = np.unique(places)
    if len(lines) < 2:
        raise ExchangeError(name, "one line of points", "a surface")
    start = round(float(lines[0]) * LIST_UNITS) / LIST_UNITS
    # A line without any reading leaves a gap: the smallest distance is that of the grid.
    count = round(float(lines[-1] - lines[0]) / float(np.diff(lines).min())) + 1
    interval = float(lines[-1] - lines[0]) / (count - 1)
    return grid_nodes(start, round(interval * LIST_UNITS) / LIST_UNITS, count, name)


def _full_turn(job: Job, index: int, fit: TableSpec, nodes: ListNodes) -> bool:
    """Return whether the table goes round, refusing one that goes round in part.

    Within the limits of an axis that does not reach where its turn ends, a table may have two
    ends.
    """
    master = job.spec.axes[fit.over[0]]
    span, turns = master.modulo, fit.turns(job.spec.axes)
    for source in fit.sources if turns else ():
        if job.spec.measurements[source].remove == "line":
            reason = (
                f"found 'line', expected 'offset' or 'none': {fit.over[0]} goes round, and"
                " an error that closes with its turn has no slope"
            )
            raise job.error(("measurements", source, "remove"), reason)
    if span is None:
        return turns
    ends = nodes.positions[[0, -1]]
    whole = bool(np.max(np.abs(ends - np.array(span))) <= 1e-9)
    within = bool(span[0] - 1e-9 <= ends[0] and ends[1] <= span[1] + 1e-9)
    if whole == turns and (whole or (within and master.limits is not None)):
        return turns
    reason = (
        f"found nodes from {ends[0]:g} to {ends[1]:g}, expected the modulo range of"
        f" {fit.over[0]} from {span[0]:g} to {span[1]:g}, both ends included"
    )
    if not turns:  # else the axis jumps where a turn ends
        reason = (
            f"found nodes from {ends[0]:g} to {ends[1]:g} for {fit.over[0]}, which goes round"
            f" from {span[0]:g} to {span[1]:g}, and no modulo, expected its whole turn and modulo"
            " = true (first = last); or nodes within that range, and the limits that keep the"
            f" axis from turning on (axes.{fit.over[0]}.limits)"
        )
    raise job.error(("fits", index), reason)


_KEYS = ("start", "interval", "points")
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_LINE, _SURFACE = 80, 20
"""Intervals of a table over one position, and over each of two."""
_EACH = 2
"""Readings per node, at least, where there are no targets: the prior smooths, and what
too few nodes cannot follow no standard deviation tells."""
_TARGETS = 250
"""Different places up to which they are taken for targets."""
_BESIDE = 0.1
"""Share of their distance by which readings lie beside targets at most."""
_HOLES = 0.3
"""Share of the nodes of a plane that may lack a reading: targets that were left out."""


def grid_over(
    places: Float[np.ndarray, " t"],
    reach: tuple[float, float] | None = None,
    *,
    surface: bool = False,
) -> Grid:
    """Return nodes that suit readings.

    Evenly spaced targets become the nodes, also where readings lie a little beside them;
    else round numbers that cover the readings.

    Args:
        places: Positions of the readings.
        reach: Ends that the table must reach, or None.
        surface: It is one of two positions of a plane.
    """
    unique = np.unique(np.round(places[np.isfinite(places)], 4))
    low, high = float(unique[0]), float(unique[-1])
    if reach is not None:
        low, high = min(low, reach[0]), max(high, reach[1])
    if (targets := _targets(unique)) is not None:
        first, interval, count = targets
        last = first + interval * (count - 1)
        before = max(0, int(np.ceil((first - low) / interval - _BESIDE)))
        after = max(0, int(np.ceil((high - last) / interval - _BESIDE)))
        return first - before * interval, interval, count + before + after
    count = len(places) // _EACH
    limit = min(_SURFACE, int(np.sqrt(count))) if surface else min(_LINE, count)
    interval = _round_up((high - low) / max(2, min(limit, len(unique) - 1)))
    start = np.floor(low / interval + 1e-6) * interval
    points = int(np.ceil((high - start) / interval - 1e-6)) + 1
    return round(float(start), 4), interval, max(points, 2)


def _targets(places: Float[np.ndarray, " p"]) -> Grid | None:
    """Return the evenly spaced targets at or beside which all places lie, or None.

    The places are different and ascend.
    """
    steps = np.diff(places)
    ends = np.flatnonzero(steps > 0.5 * steps.max(initial=0.0))
    count = len(ends) + 1
    if not 2 <= count <= _TARGETS:
        return None
    low, high = places[np.append(0, ends + 1)], places[np.append(ends, len(places) - 1)]
    middle, beside = 0.5 * (low + high), float((high - low).max()) / 2.0
    interval = float(middle[-1] - middle[0]) / (count - 1)
    if beside > _BESIDE * interval:
        return None
    for digits in range(-2, 5):
        start, step = round(float(middle[0]), digits), round(interval, digits)
        off = np.abs(start + step * np.arange(count) - middle)
        if step > 0.0 and off.max() < max(beside, 1e-3):
            return start, step, count
    return None


def grids_for(
    first: Float[np.ndarray, " t"], second: Float[np.ndarray, " t"]
) -> tuple[Grid, Grid]:
    """Return nodes of a plane that suit readings: hardly more than different places.

    Where the targets of the two masters were not measured in all their combinations,
    every second one of the more numerous is left out until the readings suffice.
    """
    grids = [grid_over(first, surface=True), grid_over(second, surface=True)]
    places = np.stack([first, second], axis=1)
    unique = np.unique(np.round(places[np.isfinite(places).all(axis=1)], 4), axis=0)
    while (1.0 - _HOLES) * grids[0][2] * grids[1][2] > len(unique):
        k = int(grids[1][2] > grids[0][2])
        start, interval, points = grids[k]
        if points == 2:
            break
        grids[k] = start, round(2.0 * interval, 4), points // 2 + 1
    return grids[0], grids[1]


def grid_keys(
    places: Sequence[Float[np.ndarray, " t"]], reach: tuple[float, float] | None = None
) -> dict[str, Any]:
    """Return the keys of nodes that suit readings.

    Args:
        places: Positions of the readings, per master.
        reach: Ends that a table over one position must reach, or None.
    """
    if len(places) == 1:
        return dict(zip(_KEYS, grid_over(places[0], reach), strict=True))
    pairs = zip(*grids_for(places[0], places[1]), strict=True)
    return dict(zip(_KEYS, map(list, pairs), strict=True))


def grid_words(grid: Mapping[str, Any]) -> str:
    """Return `grid_keys` as they stand in a job."""
    values = {key: np.atleast_1d(value) for key, value in grid.items()}
    words = {key: ", ".join(f"{item:g}" for item in row) for key, row in values.items()}
    if np.ndim(grid["points"]):
        words = {key: f"[{text}]" for key, text in words.items()}
    return ", ".join(f"{key} = {text}" for key, text in words.items())


def same_nodes(
    nodes: Sequence[Float[np.ndarray, " _"]], grid: Mapping[str, Any]
) -> bool:
    """Return whether nodes of each master are those of `grid_keys`."""
    grids = zip(*map(np.atleast_1d, grid.values()), strict=True)
    return all(
        len(line) == points
        and bool(np.allclose(line, start + interval * np.arange(points)))
        for line, (start, interval, points) in zip(nodes, grids, strict=True)
    )


def _round_up(width: float) -> float:
    """Return the next larger of 1, 2, 2.5, 5, 10, … at every power of ten."""
    power = 10.0 ** np.floor(np.log10(width))
    share = width / power
    step = next(size for size in _STEPS if size >= share - 1e-9)
    return round(float(step * power), 4)
