"""Over how many cycles a reversal is spread, and what must not be compensated twice."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ....models import Leadscrew
from ...core._errors import FitError

MOST_CYCLES = 19
"""P-AXIS-00243 lies below 20."""
_TWICE = 0.25
"""Share of the backlash from which on a table is said to carry it."""


def spread_cycles(
    width: float,
    cycle_time: float,
    *,
    acceleration: float,
    velocity: float | None = None,
) -> tuple[int, str | None]:
    r"""Return over how many cycles to spread a reversal, and a warning where none suffice.

    A step $b$ through a sin² filter of n cycles of T seconds moves at most with
    $\pi b / 2nT$ and accelerates at most with $\tfrac12 b (\pi / nT)^2$.

    Args:
        width: Backlash in mm or °.
        cycle_time: In s.
        acceleration: That the step may ask for, in mm/s² or °/s².
        velocity: That the step may ask for, in mm/s or °/s; None = any.

    Raises:
        FitError: If cycle time or limits are not positive.
    """
    for name, value in (
        ("cycle time", cycle_time),
        ("acceleration", acceleration),
        ("velocity", 1.0 if velocity is None else velocity),
    ):
        if not value > 0:
            msg = f"{name}: found {value!r}, expected a number above 0."
            raise FitError(msg)
    size = abs(width)
    needed = math.pi / cycle_time * math.sqrt(0.5 * size / acceleration)
    if velocity is not None:
        needed = max(needed, 0.5 * math.pi * size / (cycle_time * velocity))
    cycles = max(math.ceil(needed - 1e-9), 1)
    if cycles <= MOST_CYCLES:
        return cycles, None
    reached = 0.5 * size * (math.pi / (MOST_CYCLES * cycle_time)) ** 2
    return MOST_CYCLES, (
        f"Spreading {1e3 * size:.1f} µm gently asks for {cycles} cycles, the controller takes "
        f"{MOST_CYCLES}: the reversal will accelerate the axis by {reached:.0f} mm/s²."
    )


def carried_by(table: Leadscrew, positions: Float[np.ndarray, " t"]) -> float:
    """Return the backlash that a leadscrew table already takes away, in mm or °.

    Args:
        table: As the controller evaluates it.
        positions: Where the backlash was measured, in mm or °.
    """
    place = jnp.asarray(positions)
    up, down = (table.offset(place, jnp.full(place.shape, way)) for way in (1.0, -1.0))
    return float(jnp.mean(up - down))


def carried_warning(width: float, carried: float, active: bool) -> str | None:
    """Return the warning that a table and the backlash would compensate twice.

    Args:
        width: Fitted, in mm or °.
        carried: By the table, in mm or °.
        active: Whether the table was active while measuring.
    """
    if abs(carried) <= _TWICE * abs(width):
        return None
    if active:
        return (
            f"A bilateral leadscrew table was active and already takes away "
            f"{1e3 * carried:.1f} µm at reversal: the {1e3 * width:.1f} µm found here are "
            "what it leaves. Put them into the table, or take the backlash out of it."
        )
    return (
        f"The bilateral leadscrew table already takes away {1e3 * carried:.1f} µm at "
        f"reversal: with a backlash of {1e3 * width:.1f} µm beside it the axis would be "
        "compensated twice. Use one of them, not both."
    )
