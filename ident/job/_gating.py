"""The gate of one fit: its table and the limits of the job, brought together."""

from typing import TYPE_CHECKING

from ...data.lists import ListFile
from ..exchange import by_branch
from ..proof import (
    GateCheck,
    GateTable,
    choose_cycles,
    gate_check,
    judge,
)
from ..proof.axis import check_switching, largest_step, switching_cycles
from .file._load import Job
from .result._result import Remark

if TYPE_CHECKING:
    from ._draft import AbstractDraft
    from .table._draft import TableDraft


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
    limits, cycle_time = job.limits, job.spec.controller.cycle_time
    fastest = limits.max_velocity
    if switched:
        fastest = min(fastest, limits.max_switching / cycle_time)
    stated = None if listing is None else listing.integer(entry)
    return choose_cycles(jump, cycle_time, fastest, limits.max_acceleration, stated)


def pass_gate(one: "TableDraft", cycles: int | None) -> tuple[GateCheck, ...]:
    """Return every line of the gate for a fitted table."""
    job, table, closed = one.job, one.plan.table, []
    for name, nodes in zip(one.fit.over, table.nodes, strict=True):
        limits = job.spec.axes[name].limits
        ends = nodes.positions[[0, -1]]
        closed.append(
            limits is not None and bool(ends[0] <= limits[0] and ends[1] >= limits[1])
        )
    change = one.change
    return judge(
        GateTable(
            names=one.fit.over,
            nodes=tuple(nodes.positions for nodes in table.nodes),
            offset=tuple(by_branch(table, one.offset).values()),
            change=None if change is None else tuple(by_branch(table, change).values()),
            closed=tuple(closed),
            periodic=table.periodic,
            unit=job.spec.axes[one.axis].plain_unit,
            cycles=cycles or 0,
            cycle_time=job.spec.controller.cycle_time,
        ),
        job.limits,
    )


def chosen_cycles(one: "TableDraft") -> int | None:
    """Return the `n_cycles` to write, or None where that of the list stays.

    As the job says; else the smallest that keeps every step within `max_switching`.
    """
    if one.fit.n_cycles is not None or one.kind.cycles is None:
        return one.fit.n_cycles
    limit = one.job.limits.max_switching
    return switching_cycles(one.jump, limit, _existing(one))


def switching_checks(one: "TableDraft") -> list[GateCheck]:
    """Return the line of the gate for switching a table, where it can be spread."""
    if one.kind.cycles is None:  # a leadscrew table
        return []
    job, cycles = one.job, _cycles(one)
    unit = job.spec.axes[one.axis].unit
    name = one.kind.cycles[0]
    return [check_switching(one.jump, cycles, job.limits, unit, name)]


def switching_remarks(one: "TableDraft") -> list[Remark]:
    """Return what the user must know of switching a table; nothing where it is small."""
    axis, jump, limit = one.axis, one.jump, one.job.limits.max_switching
    if largest_step(jump, 0) <= limit:
        return []
    unit = one.job.spec.axes[axis].unit
    start = (
        f"Switching the {one.kind.name} table of {axis} (COMP ON/OFF {one.kind.keyword},"
        f" homing, reload) moves {axis} by up to {jump:.4g} {unit}"
    )
    if one.kind.cycles is None:
        words = (
            f"{start} in one cycle: the controller has no n_cycles for it. At standstill"
            " only, without a tool in cut, best where the table is near 0."
        )
        return [Remark.info(words)]
    name, cycles = one.kind.cycles[0], _cycles(one)
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


def settled_checks(one: "AbstractDraft") -> list[GateCheck]:
    """Return the line of the gate for a fit that did not settle; none for one that did."""
    if one.settled:
        return []
    where = f"{one.name}: its values still move from pass to pass"
    return [gate_check("settled", 1.0, 0.0, "unsettled fits", where)]


def unsettled(one: "AbstractDraft") -> Remark:
    """Return what to do about a fit that did not settle."""
    return Remark.error(
        f"The iterations of the {one.name} did not settle: its values are not those that"
        " its readings ask for. Look at the readings that contradict the others: measure"
        " them again, or leave them out (skip); or take nodes that can follow them."
    )


def _cycles(one: "TableDraft") -> int:
    """Return the `n_cycles` that the list will hold."""
    chosen = chosen_cycles(one)
    return (_existing(one) or 0) if chosen is None else chosen


def _existing(one: "TableDraft") -> int | None:
    listing, cycles = one.lists.compensation, one.kind.cycles
    assert cycles is not None  # of a table that can be spread
    return None if listing is None else listing.integer(cycles[0])
