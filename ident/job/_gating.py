"""The gate of one fit: its table and the limits of the job, brought together."""

from ..exchange import by_branch
from ..proof import (
    GateCheck,
    GateLimits,
    GateTable,
    choose_cycles,
    judge,
)
from ._fitting import AbstractFitted
from ._load import Job
from ._source import masters_of


def limits_of(job: Job) -> GateLimits:
    """Return the limits of a job, defaults where it names none."""
    given = {name: value for name, value in job.spec.gate if value is not None}
    return GateLimits(**given)


def cycles_for(job: Job, fitted: AbstractFitted) -> int | None:
    """Return the cycles that spread a reversal jump, None for one branch only."""
    if fitted.plan.table.branches == 1:
        return None
    limits = limits_of(job)
    listing = fitted.plan.axis_list
    existing = None if listing is None else listing.integer("lr_param.n_backlash_cyc")
    return choose_cycles(
        float(abs(fitted.offset[0] - fitted.offset[1]).max()),
        job.spec.controller.cycle_time,
        limits.max_velocity,
        limits.max_acceleration,
        existing,
    )


def pass_gate(
    job: Job, fitted: AbstractFitted, cycles: int | None
) -> tuple[GateCheck, ...]:
    """Return every line of the gate for a fitted table."""
    table = fitted.plan.table
    names = masters_of(fitted.plan.fit)
    closed = []
    for name, nodes in zip(names, table.nodes, strict=True):
        limits = job.spec.axes[name].limits
        ends = nodes.positions[[0, -1]]
        closed.append(
            limits is not None and bool(ends[0] <= limits[0] and ends[1] >= limits[1])
        )
    change = fitted.change
    linear = job.spec.axes[fitted.plan.fit.axis].kind == "linear"
    return judge(
        GateTable(
            names=names,
            nodes=tuple(nodes.positions for nodes in table.nodes),
            offset=tuple(by_branch(table, fitted.offset).values()),
            change=None if change is None else tuple(by_branch(table, change).values()),
            closed=tuple(closed),
            periodic=table.periodic,
            unit="mm" if linear else "deg",
            cycles=cycles or 0,
            cycle_time=job.spec.controller.cycle_time,
        ),
        limits_of(job),
    )
