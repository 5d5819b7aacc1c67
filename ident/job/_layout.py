"""Where the nodes of a fit lie, and whether they suit axis and list."""

import dataclasses

import numpy as np

from ..exchange import (
    AbstractTable,
    CrossTable,
    LeadscrewTable,
    ListNodes,
    Model,
    PlaneTable,
    grid_nodes,
    nodes_in,
    point_nodes,
)
from ._fit_schema import CrossSpec, LeadscrewSpec, LineSpec, PlaneSpec, TableSpec
from ._load import Job
from ._source import masters_of


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


def table_of(job: Job, index: int, fit: TableSpec, old: Model | None) -> AbstractTable:
    """Return the table that a fit writes, at its nodes or those of the old one.

    Raises:
        JobError: If there are no nodes, or they do not go round a modulo axis.
        ExchangeError: If a list cannot hold them.
    """
    nodes = _nodes(job, index, fit, old)
    periodic = False
    if not isinstance(fit, PlaneSpec):
        periodic = _full_turn(job, index, fit, nodes[0])
    return dataclasses.replace(empty_table(job, fit), nodes=nodes, periodic=periodic)


def _nodes(
    job: Job, index: int, fit: TableSpec, old: Model | None
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
    if old is None:
        wanted = "start, interval and points"
        if isinstance(fit, LineSpec):
            wanted = f"setpoints, or {wanted}"
        raise job.error(("fits", index), f"no nodes, expected {wanted}")
    return nodes_in(old, name)


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
