"""The gate: what a table may do to the machine before it is let out."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ._dynamics import (
    GateTable,
    acceleration,
    gradient,
    kink,
    place_of,
    slope,
    step,
)
from ._reversal import reversal_dynamics


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


@dataclasses.dataclass(frozen=True)
class GateLimits:
    """Limits of the gate with their defaults; lengths in mm (or °).

    Attributes:
        max_correction: Largest offset.
        max_slope: Between neighbouring nodes, in µm per mm.
        max_step: Between neighbouring nodes.
        max_reversal: Jump of a bilateral table at reversal.
        feed: In mm/min (°/min), at which the dynamics are judged.
        max_velocity: That the table adds, in mm/s.
        max_kink: Change of that velocity at a node, in mm/s.
        max_acceleration: That the table adds, smoothed over 10 ms, in mm/s².
        max_change: Against the existing list; None = not judged.
        max_current: Of friction lists, as share of the rated value.
        max_switching: In one cycle, where a compensation comes or goes (COMP ON/OFF,
            homing, reload, start-up).
        max_jump: In all, by which the axis moves by itself then.
    """

    max_correction: float = 1.0
    max_slope: float = 20.0
    max_step: float = 0.2
    max_reversal: float = 0.1
    feed: float = 30_000.0
    max_velocity: float = 20.0
    max_kink: float = 20.0
    max_acceleration: float = 5_000.0
    max_change: float | None = None
    max_current: float = 0.5
    max_switching: float = 0.02
    max_jump: float = 0.5


def judge(table: GateTable, limits: GateLimits) -> tuple[GateCheck, ...]:
    """Return every line of the gate for a table.

    Velocity, kink and acceleration are those that the table adds while its masters move
    with `GateLimits.feed`; for a plane in the worst direction.
    """
    unit = "mm" if table.unit == "mm" else "°"
    feed = limits.feed / 60.0
    steepest, at_slope = slope(table)
    largest_step, at_step = step(table)
    sharpest, at_kink = kink(table)
    fastest, at_acceleration = acceleration(table, feed)
    # 1 µm per mm is 0.001, and so is 0.001° per °.
    per = "µm/mm" if table.unit == "mm" else "0.001°/°"
    lines = [
        _largest(table, "max_correction", table.offset, limits.max_correction, unit),
        gate_check("max_slope", 1e3 * steepest, limits.max_slope, per, at_slope),
        gate_check("max_step", largest_step, limits.max_step, unit, at_step),
        gate_check(
            "max_velocity",
            gradient(table) * feed,
            limits.max_velocity,
            f"{unit}/s",
            at_slope,
        ),
        gate_check("max_kink", sharpest * feed, limits.max_kink, f"{unit}/s", at_kink),
        gate_check(
            "max_acceleration",
            fastest,
            limits.max_acceleration,
            f"{unit}/s²",
            at_acceleration,
        ),
    ]
    if len(table.offset) == 2:
        lines += _reversal(table, limits, unit)
    if table.change is not None and limits.max_change is not None:
        lines.append(
            _largest(table, "max_change", table.change, limits.max_change, unit)
        )
    return tuple(lines)


def gate_check(
    name: str, value: float, limit: float, unit: str, where: str
) -> GateCheck:
    """Return one line of the gate, passed where the value stays within the limit."""
    # The noise of floating point must not fail a table that lies on the limit.
    passed = bool(value <= limit * (1 + 1e-9))
    return GateCheck(name, float(value), float(limit), unit, passed, where)


def _largest(
    table: GateTable,
    name: str,
    branches: Sequence[np.ndarray],
    limit: float,
    unit: str,
) -> GateCheck:
    sizes = np.abs(np.stack(branches))
    _, *index = np.unravel_index(sizes.argmax(), sizes.shape)
    where = f"at {place_of(table, [int(k) for k in index])}"
    return gate_check(name, float(sizes.max()), limit, unit, where)


def _reversal(table: GateTable, limits: GateLimits, unit: str) -> list[GateCheck]:
    jump = np.abs(table.offset[0] - table.offset[1])
    k = int(jump.argmax())
    where = f"at {place_of(table, [k])}"
    spread = f"{where}, spread over {table.cycles} cycles"
    return reversal_checks(
        float(jump[k]), table.cycles, table.cycle_time, limits, unit, (where, spread)
    )


def reversal_checks(
    jump: float,
    cycles: int,
    cycle_time: float,
    limits: GateLimits,
    unit: str,
    where: tuple[str, str],
) -> list[GateCheck]:
    """Return the lines of the gate for what comes at a reversal.

    Args:
        jump: In mm or °.
        cycles: Over which it is spread.
        cycle_time: In s.
        limits: Of the job.
        unit: Of the jump.
        where: Words for the jump, and for what it does when it is spread.
    """
    fast, hard = reversal_dynamics(jump, cycles, cycle_time)
    at, spread = where
    return [
        gate_check("max_reversal", jump, limits.max_reversal, unit, at),
        gate_check(
            "max_velocity at reversal", fast, limits.max_velocity, f"{unit}/s", spread
        ),
        gate_check(
            "max_acceleration at reversal",
            hard,
            limits.max_acceleration,
            f"{unit}/s²",
            spread,
        ),
    ]
