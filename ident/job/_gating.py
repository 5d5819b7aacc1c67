"""The gate of one fit: its table and the limits of the job, brought together."""

from ...data.lists import ListFile
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


def limits_of(job: Job) -> GateLimits:
    """Return the limits of a job, defaults where it names none."""
    given = {name: value for name, value in job.spec.gate if value is not None}
    return GateLimits(**given)


def cycles_for(job: Job, fitted: AbstractFitted) -> int | None:
    """Return the cycles that spread a reversal jump, None for one branch only."""
    if fitted.plan.table.branches == 1:
        return None
    jump = float(abs(fitted.offset[0] - fitted.offset[1]).max())
    return spread_over(job, jump, fitted.plan.axis_list, "lr_param.n_backlash_cyc")


def spread_over(
    job: Job, jump: float, listing: ListFile | None, entry: str, switched: bool = False
) -> int:
    """Return the cycles that spread a jump; those of a list stay where they are enough.

    Args:
        job: The job.
        jump: In mm or °.
        listing: The list that is there, or None.
        entry: Of that list.
        switched: Whether `max_switching` counts as well.
    """
    limits, cycle_time = limits_of(job), job.spec.controller.cycle_time
    fastest = limits.max_velocity
    if switched:
        fastest = min(fastest, limits.max_switching / cycle_time)
    stated = None if listing is None else listing.integer(entry)
    return choose_cycles(jump, cycle_time, fastest, limits.max_acceleration, stated)


def pass_gate(
    job: Job, fitted: AbstractFitted, cycles: int | None
) -> tuple[GateCheck, ...]:
    """Return every line of the gate for a fitted table."""
    table = fitted.plan.table
    names = fitted.plan.fit.over
    closed = []
    for name, nodes in zip(names, table.nodes, strict=True):
        limits = job.spec.axes[name].limits
        ends = nodes.positions[[0, -1]]
        closed.append(
            limits is not None and bool(ends[0] <= limits[0] and ends[1] >= limits[1])
        )
    change = fitted.change
    return judge(
        GateTable(
            names=names,
            nodes=tuple(nodes.positions for nodes in table.nodes),
            offset=tuple(by_branch(table, fitted.offset).values()),
            change=None if change is None else tuple(by_branch(table, change).values()),
            closed=tuple(closed),
            periodic=table.periodic,
            unit="mm"
            if job.spec.axes[fitted.plan.fit.axis].kind == "linear"
            else "deg",
            cycles=cycles or 0,
            cycle_time=job.spec.controller.cycle_time,
        ),
        limits_of(job),
    )
