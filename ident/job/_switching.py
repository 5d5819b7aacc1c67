"""What switching a fitted table does: the jump, its `n_cycles`, the gate, the words."""

import numpy as np

from ..proof import GateCheck
from ..proof.axis import check_switching, largest_step, switching_cycles
from ._fitting import AbstractFitted
from ._gating import limits_of
from ._load import Job
from ._result import Remark


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
