"""The gate of one fit: its table and the limits of the job, brought together."""

import numpy as np

from ...data.lists import ListFile
from ..exchange import by_branch
from ..proof import (
    GateCheck,
    GateLimits,
    GateTable,
    choose_cycles,
    judge,
)
from ..proof.axis import check_switching, largest_step, switching_cycles
from ._fitting import AbstractFitted
from ._load import Job
from ._result import Remark


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


def jump_of(one: AbstractFitted) -> float:
    """Return the largest offset that switching or reloading a table brings, mm or °."""
    change = one.change
    both = (one.offset,) if change is None else (one.offset, change)
    return max(float(np.abs(part).max()) for part in both)


def cycles_entry(one: AbstractFitted) -> str | None:
    """Return the entry that spreads the switching; a leadscrew table has none."""
    cycles = one.plan.fit.kind.cycles
    return None if cycles is None else cycles[0]


def chosen_cycles(job: Job, one: AbstractFitted) -> int | None:
    """Return the `n_cycles` to write, or None where that of the list stays.

    As the job says; else the smallest that keeps every step within `max_switching`.
    """
    name = cycles_entry(one)
    if one.plan.fit.n_cycles is not None or name is None:
        return one.plan.fit.n_cycles
    limit = limits_of(job).max_switching
    return switching_cycles(jump_of(one), limit, _existing(one, name))


def switching_checks(job: Job, one: AbstractFitted) -> list[GateCheck]:
    """Return the line of the gate for switching a table, where it can be spread."""
    name = cycles_entry(one)
    if name is None:
        return []
    cycles, unit = _cycles(job, one, name), _unit(job, one)
    return [check_switching(jump_of(one), cycles, limits_of(job), unit, name)]


def switching_remarks(job: Job, one: AbstractFitted) -> list[Remark]:
    """Return what the user must know of switching a table; nothing where it is small."""
    name, jump, limit = cycles_entry(one), jump_of(one), limits_of(job).max_switching
    if largest_step(jump, 0) <= limit:
        return []
    axis, kind = one.plan.fit.axis, one.plan.table.compensation
    keyword, unit = one.plan.table.keyword, _unit(job, one)
    start = (
        f"Switching the {kind} table of {axis} (COMP ON/OFF {keyword}, homing, reload)"
        f" moves {axis} by up to {jump:.4g} {unit}"
    )
    if name is None:
        words = (
            f"{start} in one cycle: the controller has no n_cycles for it. At standstill"
            " only, without a tool in cut, best where the table is near 0."
        )
        return [Remark.info(words)]
    cycles = _cycles(job, one, name)
    step = largest_step(jump, cycles)
    words = f"{start}: {name} {cycles} spreads it, {step:.3g} {unit} per cycle at most."
    if step <= limit:
        return [Remark.info(f"{words} At standstill only, without a tool in cut.")]
    more = "n_cycles can be no larger"
    if cycles < (switching_cycles(jump, limit) or 0):
        more = "leave n_cycles out of the job, and it is chosen"
    words += (
        f" That is more than max_switching ({limit:g} {unit}): {more}. Else move the zero"
        f" of the table to where {axis} is homed (datum), so that less comes at once, or"
        " raise max_switching in [gate] if the builder of the machine allows it."
    )
    return [Remark.warning(words)]


def _cycles(job: Job, one: AbstractFitted, name: str) -> int:
    """Return the `n_cycles` that the list will hold."""
    chosen = chosen_cycles(job, one)
    return (_existing(one, name) or 0) if chosen is None else chosen


def _existing(one: AbstractFitted, name: str) -> int | None:
    listing = one.plan.existing
    return None if listing is None else listing.integer(name)


def _unit(job: Job, one: AbstractFitted) -> str:
    return job.spec.axes[one.plan.fit.axis].unit
