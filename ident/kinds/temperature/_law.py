"""The law over the temperature: the table for the PLC, and what it may do to the machine."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ...proof import GateCheck, GateLimits, gate_check
from .effect import TemperatureFit
from .entries import COLUMNS

_SAME = 1e-3
"""K within which two rows are one."""
RATE = 0.001
"""mm/s: 60 µm in a minute, faster than structures move and slower than any path minds."""
_IDLE = 1.0
"""µm/m per s, for a coefficient that is to be 0."""


@dataclasses.dataclass(frozen=True)
class ThermalLaw:
    """Parameters of the line over the temperature, in the sign of the entries.

    Linear between the rows, held outside. With two sensors each column follows its own.

    Attributes:
        temperature: In °C, ascending.
        offset: In mm (P-AXIS-00273).
        coefficient: In µm/m (P-AXIS-00274).
        offset_deviation: Standard deviation in mm.
        coefficient_deviation: In µm/m.
    """

    temperature: Float[np.ndarray, " n"]
    offset: Float[np.ndarray, " n"]
    coefficient: Float[np.ndarray, " n"]
    offset_deviation: Float[np.ndarray, " n"]
    coefficient_deviation: Float[np.ndarray, " n"]

    @property
    def columns(self) -> dict[str, Float[np.ndarray, " n"]]:
        """The table as the PLC has it: °C, mm, µm/m."""
        values = self.temperature, self.offset, self.coefficient
        return dict(zip(COLUMNS, values, strict=True))

    def csv(self) -> str:
        """Return the table as CSV."""
        rows = zip(*self.columns.values(), strict=True)
        lines = [f"{warm:.4f},{offset:.6f},{slope:.4f}" for warm, offset, slope in rows]
        return "\n".join([",".join(COLUMNS), *lines]) + "\n"

    def largest(self, away: Float[np.ndarray, " p"]) -> tuple[float, float, int]:
        """Return the largest correction in mm, its temperature in °C, and where.

        Args:
            away: Places in mm from the reference position.
        """
        added = self.offset[:, None] + 1e-6 * np.outer(self.coefficient, away)
        row, place = np.unravel_index(int(np.argmax(np.abs(added))), added.shape)
        return abs(float(added[row, place])), float(self.temperature[row]), int(place)


def thermal_law(relative: TemperatureFit, zero: float, sign: int) -> ThermalLaw:
    """Return the law that takes the error of a line away.

    Args:
        relative: The line, nothing to correct at ``zero``.
        zero: Temperature in °C; a row of its own where it lies inside.
        sign: Offset per Δs.
    """
    laws = [relative.offset, relative.coefficient]
    nodes = np.concatenate(
        [law.temperature for law in laws if law is not None and len(law.value) > 1]
    )
    if nodes.min() < zero < nodes.max():
        nodes = np.append(nodes, zero)
    rows = np.unique(np.round(nodes, 4))
    rows = rows[np.append(True, np.diff(rows) > _SAME)]
    coefficient = np.zeros(len(rows))
    if relative.coefficient is not None:
        coefficient = -sign * 1e6 * relative.coefficient.at(rows)
    first, second = relative.deviation_at(rows)
    return ThermalLaw(
        temperature=rows,
        # 1 nm and 0.1 nm over a metre: far below the unit of the controller.
        offset=np.round(-sign * relative.offset.at(rows), 6) + 0.0,
        coefficient=np.round(coefficient, 4) + 0.0,
        offset_deviation=first,
        coefficient_deviation=1e6 * second,
    )


def judge_law(
    law: ThermalLaw,
    reference: float,
    places: Float[np.ndarray, " p"],
    axis: str,
    limits: GateLimits,
) -> tuple[GateCheck, ...]:
    """Return every line of the gate.

    Args:
        law: As it is written.
        reference: Position in mm where the line turns.
        places: Smallest and largest position in mm; one: there is no coefficient.
        axis: For the words.
        limits: Of the job.
    """
    most, warm, place = law.largest(places - reference)
    where = f"at {warm:.4g} °C"
    if len(places) > 1:
        where += f", {axis} = {places[place]:g}"
    steep = int(np.argmax(np.abs(law.coefficient)))
    slope = float(abs(law.coefficient[steep]))
    there = f"at {law.temperature[steep]:.4g} °C"
    added = 1e-6 * slope * limits.feed / 60.0
    follows = "while the PLC follows the temperature"
    return (
        gate_check("max_correction", most, limits.max_correction, "mm", where),
        gate_check("max_slope", 1e-3 * slope, limits.max_slope, "µm/mm", there),
        gate_check("max_velocity", added, limits.max_velocity, "mm/s", there),
        gate_check("max_velocity by the PLC", RATE, limits.max_velocity, "mm/s", follows),
    )  # fmt: skip


def rates(away: Float[np.ndarray, " p"]) -> tuple[float, float]:
    """Return what the PLC may change per second: offset in mm, coefficient in µm/m.

    Both together move the farthest position with `RATE` at most. Neither is 0: what an
    earlier program left in the controller must be able to go.

    Args:
        away: Places in mm from the reference position; one: there is no coefficient.
    """
    if len(away) == 1:
        return RATE, _IDLE
    return 0.5 * RATE, 0.5 * RATE / (1e-6 * max(float(np.abs(away).max()), 1.0))
