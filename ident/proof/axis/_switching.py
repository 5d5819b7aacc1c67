"""How far and how fast an axis moves by itself where a compensation comes or goes."""

from .._gate import GateCheck, GateLimits, gate_check
from .._reversal import reversal_dynamics

MOST_CYCLES = 20
"""Largest `n_cycles` of cross, plane and crosstalk (P-COMP-00026, 00027, 00064)."""


def largest_step(jump: float, cycles: int) -> float:
    """Return the largest step in one cycle of a jump that sin² spreads over cycles.

    Args:
        jump: In mm or °.
        cycles: `n_cycles`; 0 and 1 are abrupt (S-06).
    """
    return reversal_dynamics(jump, cycles, 1.0)[0]


def switching_cycles(
    jump: float, max_step: float, existing: int | None = None, most: int = MOST_CYCLES
) -> int | None:
    """Return over how many cycles a jump is to be spread, or None: as it is.

    The smallest number whose largest step stays inside the limit. An existing number that
    is large enough stays; where even the largest is too small, that one is returned, and
    the gate says no.

    Args:
        jump: In mm or °.
        max_step: Largest step in one cycle, likewise.
        existing: What the list says already, or None.
        most: Largest number that the parameter may have.
    """
    if largest_step(jump, existing or 0) <= max_step:
        return None
    enough = (n for n in range(2, most) if largest_step(jump, n) <= max_step)
    return next(enough, most)


def check_switching(
    jump: float,
    cycles: int,
    limits: GateLimits,
    unit: str,
    entry: str,
    moments: str = "COMP ON/OFF, homing or reload",
) -> GateCheck:
    """Return the line of the gate for the step in one cycle where one comes or goes.

    Args:
        jump: What it adds at most, in mm or °.
        cycles: Over which it is spread.
        limits: Of the job.
        unit: Of the jump.
        entry: What spreads it in the list, for the words.
        moments: At which it comes or goes, for the words.
    """
    how = f"{entry} {cycles}" if cycles > 1 else f"{entry} {cycles}: abrupt"
    step = largest_step(jump, cycles)
    where = f"at {moments}, {how}"
    return gate_check("max_switching", step, limits.max_switching, unit, where)
