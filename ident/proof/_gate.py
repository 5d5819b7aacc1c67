"""The gate: what a table, and a jump spread over cycles, may do to the machine."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from ...data.units import small_unit
from ...models import step_response
from ..exchange import MOST_REVERSAL_CYCLES
from ..kinds._keys import JobPart, Positive
from ._dynamics import GateTable, acceleration, gradient, kink, place_of, slope, step

MOST_CYCLES = 20
"""Largest `n_cycles` of cross, plane and crosstalk (P-COMP-00026, 00027, 00064)."""


@dataclasses.dataclass(frozen=True)
class GateCheck:
    """One line of the gate: what was found, the limit, whether it passed.

    Attributes:
        name: As the key of the limit in the job file, or what is judged by it.
        value: Largest value found, in `unit`.
        limit: Largest value allowed.
        unit: Of both.
        passed: Whether the value stays inside.
        where: Where the largest value lies, in words.
    """

    name: str
    value: float
    limit: float
    unit: str
    passed: bool
    where: str


class GateLimits(JobPart, frozen=True):
    """Limits of the gate."""

    max_correction: Positive = 1.0
    """Largest entry in mm or °. Example: `0.2`."""
    max_slope: Positive = 20.0
    """Largest slope in µm per mm. Example: `5.0`."""
    max_step: Positive = 0.2
    """Largest step between neighbouring nodes in mm or °. Example: `0.05`."""
    max_reversal: Positive = 0.1
    """Largest jump at a reversal in mm or °. Example: `0.05`."""
    feed: Positive = 30_000.0
    """Feed in mm/min (°/min) at which the next three are judged. Example: `15000`."""
    max_velocity: Positive = 20.0
    """Largest velocity that is added, in mm/s or °/s. Example: `10.0`."""
    max_kink: Positive = 20.0
    """Largest change of that velocity at a node, in mm/s or °/s. Example: `10.0`."""
    max_acceleration: Positive = 5_000.0
    """Largest acceleration that is added, smoothed over 10 ms, in mm/s² or °/s². Example:
    `2000`."""
    max_change: Positive | None = None
    """Largest change against the existing list in mm or °; left out: any. Example:
    `0.1`."""
    max_current: Positive = 0.5
    """Friction: largest share of the rated current or torque. Example: `0.3`."""
    max_switching: Positive = 0.02
    """Largest step in one cycle where a compensation comes or goes (COMP ON/OFF, homing,
    reload, start-up), in mm or °. Example: `0.01`."""
    max_jump: Positive = 0.5
    """Largest way that the axis moves by itself then, in mm or °. Example: `0.2`."""

    def check(self, name: str, value: float, unit: str, where: str) -> GateCheck:
        """Return a line of the gate; the first word of its name is that of its limit."""
        limit = getattr(self, name.partition(" ")[0])
        return gate_check(name, value, limit, unit, where)


def judge(table: GateTable, limits: GateLimits) -> tuple[GateCheck, ...]:
    """Return every line of the gate for a table.

    Velocity, kink and acceleration are those that the table adds while its masters move
    with `GateLimits.feed`; for a plane in the worst direction.
    """
    unit, feed = table.unit, limits.feed / 60.0
    steepest, at_slope = slope(table)
    sharpest, at_kink = kink(table)
    per = f"{small_unit(unit)}/{unit}"
    measures: dict[str, tuple[str, tuple[float, str]]] = {
        "max_correction": (unit, _largest(table, table.offset)),
        "max_slope": (per, (1e3 * steepest, at_slope)),
        "max_step": (unit, step(table)),
        "max_velocity": (f"{unit}/s", (gradient(table) * feed, at_slope)),
        "max_kink": (f"{unit}/s", (sharpest * feed, at_kink)),
        "max_acceleration": (f"{unit}/s²", acceleration(table, feed)),
    }
    lines = [
        limits.check(name, value, shown_unit, place)
        for name, (shown_unit, (value, place)) in measures.items()
    ]
    if len(table.offset) == 2:
        jump, place = _largest(table, [table.offset[0] - table.offset[1]])
        words = place, f"{place}, spread over {table.cycles} cycles"
        spread = table.cycles, table.cycle_time
        lines += reversal_checks(jump, *spread, limits, unit, words)
    if table.change is not None and limits.max_change is not None:
        worst, place = _largest(table, table.change)
        lines.append(limits.check("max_change", worst, unit, place))
    return tuple(lines)


def reversal_checks(
    jump: float,
    cycles: int,
    cycle_time: float,
    limits: GateLimits,
    unit: str,
    where: tuple[str, str],
) -> list[GateCheck]:
    """Return the lines of the gate for a jump at a reversal, spread over cycles of so many s.

    `where` are words for the jump, in mm or °, and for what it does when it is spread.
    """
    fast, hard = reversal_dynamics(jump, cycles, cycle_time)
    at, spread = where
    return [
        limits.check("max_reversal", jump, unit, at),
        limits.check("max_velocity at reversal", fast, f"{unit}/s", spread),
        limits.check("max_acceleration at reversal", hard, f"{unit}/s²", spread),
    ]


def gate_check(
    name: str, value: float, limit: float, unit: str, where: str
) -> GateCheck:
    """Return one line of the gate, passed where the value stays within the limit."""
    # The noise of floating point must not fail a table that lies on the limit.
    within_limit = bool(value <= limit * (1 + 1e-9))
    return GateCheck(name, float(value), float(limit), unit, within_limit, where)


def check_switching(
    jump: float,
    cycles: int,
    limits: GateLimits,
    unit: str,
    entry: str,
    moments: str = "COMP ON/OFF, homing or reload",
) -> GateCheck:
    """Return the line of the gate for the step per cycle while one is switched on or off.

    The jump is what it adds at most, in mm or °. Words name the entry of the list that spreads
    it, and the moments at which it comes or goes.
    """
    spreading = f"{entry} {cycles}" if cycles > 1 else f"{entry} {cycles}: abrupt"
    step = largest_step(jump, cycles)
    place = f"at {moments}, {spreading}"
    return limits.check("max_switching", step, unit, place)


def _largest(table: GateTable, branches: Sequence[np.ndarray]) -> tuple[float, str]:
    """Return the largest size among branches, and at which node it is."""
    sizes = np.abs(np.stack(branches))
    _, *index = np.unravel_index(sizes.argmax(), sizes.shape)
    return float(sizes.max()), f"at {place_of(table, [int(k) for k in index])}"


def reversal_dynamics(
    jump: float, cycles: int, cycle_time: float
) -> tuple[float, float]:
    """Return the largest velocity and acceleration of a spread jump, in mm/s and mm/s², or °.

    Both are differences from cycle to cycle, as the drive sees them; the jump is in mm or °, the
    cycles are P-AXIS-00243, their time is in s.
    """
    # Before, during and after it: sin²(π/2 · k/n), 0 and 1 abrupt (P-AXIS-00243, S-25).
    position = jump * np.concatenate([[0.0, 0.0], step_response(cycles), [1.0]])
    velocity = (position[1:] - position[:-1]) / cycle_time
    acceleration = (velocity[1:] - velocity[:-1]) / cycle_time
    return float(np.abs(velocity).max()), float(np.abs(acceleration).max())


def choose_cycles(
    jump: float,
    cycle_time: float,
    max_velocity: float,
    max_acceleration: float,
    existing: int | None = None,
    most: int = MOST_REVERSAL_CYCLES,
) -> int:
    """Return the number of cycles, 2 or more, over which a jump is spread.

    The smallest number whose velocity (mm/s) and acceleration (mm/s²) from cycle to cycle both
    stay inside the limits: a longer spread makes the path late at every reversal. An
    existing value of the list that is long enough stays. Where even the largest (`most`) is too
    short, that one is returned, and the gate says no.
    """

    def within_limits(cycles: int) -> bool:
        velocity, acceleration = reversal_dynamics(jump, cycles, cycle_time)
        return velocity <= max_velocity and acceleration <= max_acceleration

    if existing is not None and 2 <= existing <= most and within_limits(existing):
        return existing
    return next((n for n in range(2, most) if within_limits(n)), most)


def largest_step(jump: float, cycles: int) -> float:
    """Return the largest step in one cycle of a jump, in mm or °, that `n_cycles` spreads.

    By sin²; 0 and 1 are abrupt (S-06).
    """
    return reversal_dynamics(jump, cycles, 1.0)[0]


def switching_cycles(
    jump: float, max_step: float, existing: int | None = None, most: int = MOST_CYCLES
) -> int | None:
    """Return over how many cycles a jump is to be spread, or None: as it is.

    As `choose_cycles`, by the largest step alone; an existing number may be abrupt, but must be
    one that the controller takes. Jump and largest step are in mm or °.
    """
    if largest_step(jump, existing or 0) <= max_step and 0 <= (existing or 0) <= most:
        return None
    return choose_cycles(jump, 1.0, max_step, math.inf, most=most)
