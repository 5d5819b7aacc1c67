"""The law over the temperature: the table for the PLC, and what it may do to the machine."""

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ....data.lists import ListFile
from ....models import Conventions, TemperatureLine
from ...proof import GateCheck, GateLimits, gate_check
from ._plc_table import read_temperature_table
from .effect import TemperatureFit

_SAME = 1e-3
"""K within which two rows are one."""
_HEAD = "temperature,offset_0,coefficient"


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
    offset, coefficient = np.zeros(len(rows)), np.zeros(len(rows))
    offset = -sign * relative.offset.at(rows)
    if relative.coefficient is not None:
        coefficient = -sign * 1e6 * relative.coefficient.at(rows)
    first, second = relative.deviation_at(rows)
    return ThermalLaw(
        temperature=rows,
        # 1 nm and 0.1 nm over a metre: far below the unit of the controller.
        offset=np.round(offset, 6) + 0.0,
        coefficient=np.round(coefficient, 4) + 0.0,
        offset_deviation=first,
        coefficient_deviation=1e6 * second,
    )


def csv_text(law: ThermalLaw) -> str:
    """Return the table as CSV: °C, mm, µm/m."""
    rows = zip(law.temperature, law.offset, law.coefficient, strict=True)
    lines = [f"{warm:.4f},{offset:.6f},{slope:.4f}" for warm, offset, slope in rows]
    return "\n".join([_HEAD, *lines]) + "\n"


def read_back(
    path: Path,
    sensors: tuple[str, ...],
    chosen: tuple[int | None, int | None],
    conventions: Conventions,
    machine: ListFile | None,
) -> TemperatureLine:
    """Return the line as the PLC makes it of the file, by the controller's rules.

    Args:
        path: The table.
        sensors: Names of the columns of the temperatures.
        chosen: Sensor of offset and coefficient; None: that column is all 0.
        conventions: Sign of the line.
        machine: The axis list that was written.
    """
    both = [
        read_temperature_table(
            path,
            sensors,
            sensors[0 if number is None else number],
            conventions,
            machine,
        )
        for number in chosen
    ]
    return dataclasses.replace(both[0], coefficient=both[1].coefficient)


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
