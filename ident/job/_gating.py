"""What a fit does where it comes and goes, and where it does not settle: cycles, checks, words."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ...data.lists import ListFile
from ..proof import GateCheck, choose_cycles, error_figures, gate_check
from ..proof.axis import MOST_CYCLES, largest_step
from .file._load import Job
from .result._result import Remark
from .result._verdict import GAIN

if TYPE_CHECKING:
    from ._draft import AbstractDraft, Foreseen
    from .table._draft import TableDraft


_WORSE = 1.25
"""Share of the error before that a list may leave on readings that the fit did not see.

Where five runs hold nothing but scatter, the mean of four makes the fifth worse by √(1 + 1/4):
such a list does no harm, and a second measurement may tell more. Above that it does harm.
"""
_AS_PREDICTED = 1.1
"""Error that a written list leaves relative to that on readings held out, at most."""


def spread_over(
    job: Job, jump: float, listing: ListFile | None, entry: str, switched: bool = False
) -> int:
    """Return the cycles that spread a jump in mm or °, in which `max_switching` may count as well.

    Those that a list has at its entry stay where they are enough.
    """
    limits, cycle_time = job.spec.gate, job.spec.controller.cycle_time
    fastest = limits.max_velocity
    if switched:
        fastest = min(fastest, limits.max_switching / cycle_time)
    stated = None if listing is None else listing.integer(entry)
    return choose_cycles(jump, cycle_time, fastest, limits.max_acceleration, stated)


def switching_remarks(draft: "TableDraft") -> Iterator[Remark]:
    """Yield what the user must know of switching a table; nothing where it is small."""
    axis, jump, limit = draft.axis, draft.jump, draft.job.spec.gate.max_switching
    yield from _old_table_remarks(draft, limit)
    if largest_step(jump, 0) <= limit:
        return
    unit, spread = draft.job.spec.axes[axis].unit, draft.kind.cycles
    cycles = draft.spread[1]
    step = largest_step(jump, cycles)
    how = " in one cycle: the controller has no n_cycles for it"
    if spread is not None:
        how = f": {spread[0]} {cycles} spreads it, {step:.3g} {unit} per cycle at most"
    words = (
        f"Switching the {draft.kind.name} table of {axis} (COMP ON/OFF {draft.kind.keyword},"
        f" homing, reload) moves {axis} by up to {jump:.4g} {unit}{how}. At standstill"
        " only, without a tool in cut, best where the table is near 0."
    )
    if spread is None or step <= limit:
        yield Remark.info(words)
        return
    advice = "n_cycles can be no larger"
    if cycles < spread[1] and largest_step(jump, spread[1]) <= limit:
        advice = "leave n_cycles out of the job, and it is chosen"
    words += f" That is more than max_switching ({limit:g} {unit}): {advice}. Else"
    half = 0.5 * float(np.ptp(draft.offset))
    if largest_step(half, MOST_CYCLES if spread is not None else 0) <= limit:
        words += (
            f" take a datum where the table is halfway between its least and its largest value,"
            f" so that it adds {half:.4g} {unit} at most, or"
        )
    words += " raise max_switching in [gate] if the builder of the machine allows it."
    yield Remark.warning(words)


def _old_table_remarks(draft: "TableDraft", limit: float) -> Iterator[Remark]:
    """Yield how an old table goes at a reload, which the new list does not spread."""
    old, entries = draft.plan.old_offset, draft.kind.cycles
    if old is None or entries is None or not draft.plan.active:
        return
    listing = draft.lists.compensation
    cycles = (listing and listing.integer(entries[0])) or 0
    largest = float(np.abs(old).max())
    cycles = cycles if cycles <= MOST_CYCLES else 0
    if (step := largest_step(largest, cycles)) > limit:
        unit = draft.job.spec.axes[draft.axis].unit
        yield Remark.warning(
            f"Where the list is reloaded while the old {draft.kind.name} table acts, the old one"
            f" goes by its own {entries[0]} ({cycles}): up to {step:.3g} {unit} in one cycle, more"
            f" than max_switching ({limit:g} {unit}). Reload it with the drives off, or restart."
        )


def fit_checks(draft: "AbstractDraft") -> Iterator[GateCheck]:
    """Yield the lines of the gate for the fit itself: that it settled, and that it helps.

    A fit that settled has no line for that.
    """
    if not draft.converged:
        where = f"{draft.name}: its values still move from pass to pass"
        yield gate_check("settled", 1.0, 0.0, "unsettled fits", where)
    if (foreseen := draft.foreseen) is not None:
        stages = foreseen.before, foreseen.predicted
        before, predicted = (
            error_figures(s, wild=foreseen.wild).sound.rms for s in stages
        )
        where = f"rms on readings that the fit did not see, limit {_WORSE:g} × before"
        yield gate_check(GAIN, predicted, _WORSE * before, draft.unit, where)


def leaves_what_was_predicted(
    left: Float[np.ndarray, " n"],
    foreseen: "Foreseen",
    spare: float,
    unit: str,
    where: str,
) -> GateCheck:
    """Return the line of the gate for a list that is no sum of what was fitted.

    Args:
        left: What the list leaves of each reading, in the unit.
        foreseen: What was predicted of them.
        spare: What it may leave besides, as rounding does.
        unit: Of all, for the line.
        where: Words for the readings.
    """
    stages, wild = (left, foreseen.predicted), foreseen.wild
    rms, predicted = (error_figures(s, wild=wild).sound.rms for s in stages)
    limit = _AS_PREDICTED * predicted + spare
    return gate_check("from_file", rms, limit, unit, f"{where}, limit as predicted")


def gate_remarks(
    draft: "AbstractDraft", gate: Sequence[GateCheck], every: Sequence["AbstractDraft"]
) -> Iterator[Remark]:
    """Yield what the lines of the gate for a fit leave to say, beside all fits of its axis."""
    if not draft.converged:
        remedy = (
            "Look at the readings that contradict the others: measure them again, or leave them"
            " out (skip); or take nodes that can follow them."
        )
        if draft.kind.adds_current:
            remedy = "Record more speeds, each for longer and in both directions."
        yield Remark.error(
            f"The iterations of the {draft.name} did not settle: its values are not those that"
            f" its readings ask for. {remedy}"
        )
    kind, judged = draft.kind, any(check.name == "max_change" for check in gate)
    if draft.job.spec.gate.max_change is not None and not (
        judged or kind.adds_current or kind.by_plc
    ):
        key = "list" if kind.holder == "compensation" else "machine_data"
        yield Remark.warning(
            f"max_change does not judge the {draft.name}: the job gives none that was there"
            f" before, to compare with (axes.{draft.axis}.{key})."
        )
    others = ", ".join(other.compensation for other in every if other is not draft)
    if others and any(check.name == GAIN and not check.passed for check in gate):
        yield Remark.warning(
            f"The {draft.name} would not help, and holds back what stands in the same"
            f" lists ({others}): take it out of the job to have that."
        )
