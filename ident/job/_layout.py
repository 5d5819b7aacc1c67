"""Where the nodes of a fit lie, and whether they suit axis and list."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ...data.measurements import MESH_FORMATS, MeasurementError
from ..exchange import (
    LIST_UNITS,
    AbstractTable,
    ExchangeError,
    GridNodes,
    ListNodes,
    Model,
    grid_nodes,
    nodes_in,
    point_nodes,
)
from ..kinds._keys import TableSpec
from ..readings import Tables
from ._errors import JobError
from ._found_nodes import grid_words
from ._load import Job


def table_of(
    job: Job, tables: Tables, index: int, fit: TableSpec, old: Model | None
) -> AbstractTable:
    """Return the table that a fit writes.

    Its nodes are those that the job gives, else those of the old table, else the points
    of a mesh.

    Raises:
        JobError: If there are no nodes, or they do not go round a modulo axis.
        ExchangeError: If a list cannot hold them.
    """
    nodes = _nodes(job, tables, index, fit, old)
    periodic = _full_turn(job, index, fit, nodes[0])
    return dataclasses.replace(empty_table(job, fit), nodes=nodes, periodic=periodic)


def empty_table(job: Job, fit: TableSpec) -> AbstractTable:
    """Return the kind of table that a fit writes, its nodes not yet known."""
    axes, own = job.spec.axes, fit.kind.entries.table
    assert own is not None  # the keys of a table
    masters = tuple(axes[name].number for name in fit.over)
    return own(axes[fit.axis].number, masters, (), job.conventions, **fit.form)


def _nodes(
    job: Job, tables: Tables, index: int, fit: TableSpec, old: Model | None
) -> tuple[ListNodes, ...]:
    name = f"fits[{index}]"
    if fit.nodes:
        return tuple(
            point_nodes(np.array(each, dtype=float), name)
            if isinstance(each, list)
            else grid_nodes(*each, name)
            for each in fit.nodes
        )
    if old is not None:
        return nodes_in(old, name)
    # No mesh is that large.
    if len(fit.over) == 2 and tables.large(fit.sources[0]) is None:
        read = tables.table(fit.sources[0])
        columns = job.spec.measurements[fit.sources[0]].columns
        if read.format in MESH_FORMATS and not columns:
            return tuple(_mesh_nodes(read.column(axis).values, name) for axis in "xy")
    raise _no_nodes(job, tables, index, fit)


def _no_nodes(job: Job, tables: Tables, index: int, fit: TableSpec) -> JobError:
    suited = _suited_nodes(tables, fit)
    hint = f"; these suit the readings: {suited}" if suited else ""
    return job.error(("fits", index), f"no nodes, expected {fit.nodes_wanted}{hint}")


def _suited_nodes(tables: Tables, fit: TableSpec) -> str:
    """Return nodes that suit the readings of a fit as keys; empty where that is unknown."""
    masters = fit.over
    turning = any(tables.job.spec.axes[name].modulo is not None for name in masters)
    if turning or any(tables.large(name) is not None for name in fit.sources):
        return ""
    try:
        measured = [tables.measured(name, fit.axis, masters) for name in fit.sources]
        places = [
            np.concatenate([one.require(f"{axis}.position") for one in measured])
            for axis in masters
        ]
    except MeasurementError:
        return ""
    return grid_words(places) if all(np.ptp(one) > 0 for one in places) else ""


def _mesh_nodes(places: Float[np.ndarray, " t"], name: str) -> GridNodes:
    """Return the grid lines of a mesh, to the nearest list unit.

    Raises:
        ExchangeError: If there are fewer than two.
    """
    lines = np.unique(places)
    if len(lines) < 2:
        raise ExchangeError(
            where=name, found="one line of points", expected="a surface"
        )
    start = round(float(lines[0]) * LIST_UNITS) / LIST_UNITS
    # A line without any reading leaves a gap: the smallest distance is that of the grid.
    count = round(float(lines[-1] - lines[0]) / float(np.diff(lines).min())) + 1
    interval = float(lines[-1] - lines[0]) / (count - 1)
    return grid_nodes(start, round(interval * LIST_UNITS) / LIST_UNITS, count, name)


def _full_turn(job: Job, index: int, fit: TableSpec, nodes: ListNodes) -> bool:
    """Return whether the table goes round, refusing one that goes round in part."""
    span = job.spec.axes[fit.over[0]].modulo
    if not fit.turns(job.spec.axes) or span is None:
        return fit.turns(job.spec.axes)
    ends = nodes.positions[[0, -1]]
    if np.max(np.abs(ends - np.array(span))) > 1e-9:
        raise job.error(
            ("fits", index),
            f"found nodes from {ends[0]:g} to {ends[1]:g}, expected the modulo range of"
            f" {fit.over[0]} from {span[0]:g} to {span[1]:g}, both ends included",
        )
    return True
