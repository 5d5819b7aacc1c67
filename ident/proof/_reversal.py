"""How fast a jump is that is spread over cycles: at reversal, and on switching."""

from collections.abc import Callable

import numpy as np

from ...models import step_response
from ..exchange import MOST_REVERSAL_CYCLES

MOST_CYCLES = 20
"""Largest `n_cycles` of cross, plane and crosstalk (P-COMP-00026, 00027, 00064)."""


def reversal_dynamics(
    jump: float, cycles: int, cycle_time: float
) -> tuple[float, float]:
    """Return the largest velocity and acceleration of a spread jump.

    Both are differences from cycle to cycle, as the drive sees them.

    Args:
        jump: In mm or °.
        cycles: Value of P-AXIS-00243.
        cycle_time: In s.

    Returns:
        mm/s and mm/s² (°/s, °/s²).
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
) -> int:
    """Return the number of cycles (2 … 19) over which a reversal jump is spread.

    The smallest number whose velocity and acceleration from cycle to cycle both
    stay inside the limits: a longer spread makes the path late at every reversal. An
    existing value that is long enough stays. Where even 19 is too short, 19 is
    returned, and the gate says no.

    Args:
        jump: Largest difference of the two directions in mm or °.
        cycle_time: In s.
        max_velocity: In mm/s.
        max_acceleration: In mm/s².
        existing: Value in the axis list, or None.
    """

    def inside(cycles: int) -> bool:
        velocity, acceleration = reversal_dynamics(jump, cycles, cycle_time)
        return velocity <= max_velocity and acceleration <= max_acceleration

    longest = MOST_REVERSAL_CYCLES
    if existing is not None and 2 <= existing <= longest and inside(existing):
        return existing
    return _fewest(inside, longest)


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

    def inside(cycles: int) -> bool:
        return largest_step(jump, cycles) <= max_step

    return None if inside(existing or 0) else _fewest(inside, most)


def _fewest(inside: Callable[[int], bool], most: int) -> int:
    """Return the smallest number of cycles that stays inside the limits, else the largest."""
    return next((n for n in range(2, most) if inside(n)), most)
