"""What a thermal line may do to the machine before it is let out."""

import numpy as np

from ...proof import GateCheck, GateLimits, gate_check
from ._table import ThermalLaw

RATE = 0.001
"""mm/s: 60 µm in a minute, faster than structures move and slower than any path minds."""
_IDLE = 1.0
"""µm/m per s, for a coefficient that is to be 0."""


def judge_law(
    law: ThermalLaw,
    reference: float,
    span: tuple[float, float] | None,
    axis: str,
    limits: GateLimits,
) -> tuple[GateCheck, ...]:
    """Return every line of the gate.

    Args:
        law: As it is written.
        reference: Position in mm where the line turns.
        span: Smallest and largest position in mm; None: there is no coefficient.
        axis: For the words.
        limits: Of the job.
    """
    places = np.array([reference] if span is None else span)
    away = places - reference
    correction = np.abs(law.offset[:, None] + 1e-6 * np.outer(law.coefficient, away))
    row, column = np.unravel_index(int(np.argmax(correction)), correction.shape)
    where = f"at {law.temperature[row]:.4g} °C"
    if span is not None:
        where += f", {axis} = {places[column]:g}"
    checks = [
        gate_check(
            "max_correction",
            float(correction[row, column]), limits.max_correction, "mm", where,
        )
    ]  # fmt: skip
    steep = int(np.argmax(np.abs(law.coefficient)))
    slope = float(abs(law.coefficient[steep]))
    where = f"at {law.temperature[steep]:.4g} °C"
    added = 1e-6 * slope * limits.feed / 60.0
    return (
        *checks,
        gate_check("max_slope", 1e-3 * slope, limits.max_slope, "µm/mm", where),
        gate_check("max_velocity", added, limits.max_velocity, "mm/s", where),
        gate_check(
            "max_velocity by the PLC", RATE, limits.max_velocity, "mm/s",
            "while the PLC follows the temperature",
        ),
    )  # fmt: skip


def largest_correction(
    law: ThermalLaw, reference: float, span: tuple[float, float] | None
) -> float:
    """Return the largest correction in mm: the jump of switching it off while warm."""
    away = np.zeros(1) if span is None else np.array(span) - reference
    values = law.offset[:, None] + 1e-6 * np.outer(law.coefficient, away)
    return float(np.max(np.abs(values)))


def rates(reference: float, span: tuple[float, float] | None) -> tuple[float, float]:
    """Return what the PLC may change per second: offset in mm, coefficient in µm/m.

    Both together move the farthest position with `RATE` at most. Neither is 0: what an
    earlier program left in the controller must be able to go.
    """
    if span is None:
        return RATE, _IDLE
    reach = max(abs(place - reference) for place in span)
    return 0.5 * RATE, 0.5 * RATE / (1e-6 * max(reach, 1.0))
