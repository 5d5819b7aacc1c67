"""Where the nodes of a fit lie, and whether they suit axis and list."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ...data.measurements import MESH_FORMATS, MeasurementError
from ..exchange import (
    LIST_UNITS,
    AbstractTable,
    CrossTable,
    ExchangeError,
    GridNodes,
    LeadscrewTable,
    ListNodes,
    Model,
    PlaneTable,
    grid_nodes,
    nodes_in,
    point_nodes,
)
from ._errors import JobError
from ._fit_schema import CrossSpec, LeadscrewSpec, LineSpec, PlaneSpec, TableSpec
from ._found_nodes import grid_words
from ._load import Job
from ._source import Tables, masters_of, measured_for


def empty_table(job: Job, fit: TableSpec) -> AbstractTable:
    """Return the kind of table that a fit writes, its nodes not yet known."""
    axes = job.spec.axes
    number = axes[fit.axis].number
    masters = tuple(axes[name].number for name in masters_of(fit))
    if isinstance(fit, PlaneSpec):
        return PlaneTable(number, masters, (), job.conventions)
    if isinstance(fit, CrossSpec):
        return CrossTable(number, masters, (), job.conventions)
    return LeadscrewTable(number, masters, (), job.conventions, bilateral=fit.bilateral)


def has_nodes(fit: TableSpec) -> bool:
    """Return whether a fit says where its nodes lie; else those of the list stay."""
    return fit.start is not None or (
        isinstance(fit, LineSpec) and fit.setpoints is not None
    )


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
    periodic = False
    if not isinstance(fit, PlaneSpec):
        periodic = _full_turn(job, index, fit, nodes[0])
    return dataclasses.replace(empty_table(job, fit), nodes=nodes, periodic=periodic)


def _nodes(
    job: Job, tables: Tables, index: int, fit: TableSpec, old: Model | None
) -> tuple[ListNodes, ...]:
    name = f"fits[{index}]"
    if isinstance(fit, PlaneSpec):
        if (
            fit.start is not None
            and fit.interval is not None
            and fit.points is not None
        ):
            return tuple(
                grid_nodes(start, interval, count, name)
                for start, interval, count in zip(
                    fit.start, fit.interval, fit.points, strict=True
                )
            )
    elif fit.setpoints is not None:
        return (point_nodes(np.array(fit.setpoints, dtype=float), name),)
    elif fit.start is not None and fit.interval is not None and fit.points is not None:
        return (grid_nodes(fit.start, fit.interval, fit.points, name),)
    if old is None and isinstance(fit, PlaneSpec):
        spec = job.spec.measurements[fit.sources[0]]
        if tables.large(fit.sources[0]) is not None:
            raise _no_nodes(job, tables, index, fit)  # no mesh is that large
        read = tables.table(fit.sources[0])
        if read.format in MESH_FORMATS and not spec.columns:
            return tuple(_mesh_nodes(read.column(axis).values, name) for axis in "xy")
    if old is None:
        raise _no_nodes(job, tables, index, fit)
    return nodes_in(old, name)


def _no_nodes(job: Job, tables: Tables, index: int, fit: TableSpec) -> JobError:
    wanted = "start, interval and points"
    if isinstance(fit, LineSpec):
        wanted = f"setpoints, or {wanted}"
    suited = _suited_nodes(tables, fit)
    hint = f"; these suit the readings: {suited}" if suited else ""
    return job.error(("fits", index), f"no nodes, expected {wanted}{hint}")


def _suited_nodes(tables: Tables, fit: TableSpec) -> str:
    """Return nodes that suit the readings of a fit as keys; empty where that is unknown."""
    masters = masters_of(fit)
    turning = any(tables.job.spec.axes[name].modulo is not None for name in masters)
    if turning or any(tables.large(name) is not None for name in fit.sources):
        return ""
    try:
        measured = [measured_for(tables, name, fit, masters) for name in fit.sources]
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


def _full_turn(
    job: Job, index: int, fit: CrossSpec | LeadscrewSpec, nodes: ListNodes
) -> bool:
    """Return whether the table goes round, refusing one that goes round in part."""
    master = masters_of(fit)[0]
    span = job.spec.axes[master].modulo
    asked = isinstance(fit, LeadscrewSpec) and fit.modulo
    wraps = asked or (isinstance(fit, CrossSpec) and span is not None)
    if not wraps or span is None:
        return wraps
    ends = nodes.positions[[0, -1]]
    if np.max(np.abs(ends - np.array(span))) > 1e-9:
        raise job.error(
            ("fits", index),
            f"found nodes from {ends[0]:g} to {ends[1]:g}, expected the modulo range of"
            f" {master} from {span[0]:g} to {span[1]:g}, both ends included",
        )
    return True


def refuse_short_cross(
    job: Job, index: int, fit: TableSpec, table: AbstractTable
) -> None:
    """Raise where a cross table ends inside its master's software limits (S-12)."""
    if not isinstance(fit, CrossSpec):
        return
    limits = job.spec.axes[fit.master].limits
    if limits is None or table.periodic:
        return
    ends = table.nodes[0].positions[[0, -1]]
    if ends[0] > limits[0] + 1e-9 or ends[1] < limits[1] - 1e-9:
        raise job.error(
            ("fits", index),
            f"found nodes from {ends[0]:g} to {ends[1]:g}, expected them to reach the"
            f" software limits of {fit.master}, {limits[0]:g} to {limits[1]:g}: what"
            " the controller does outside a cross table is not documented",
        )
