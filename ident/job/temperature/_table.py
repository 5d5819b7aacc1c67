"""The law as a table over the temperature: what the PLC is given, and CSV of it."""

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ....data.lists import ListFile
from ....models import Conventions, TemperatureLine
from ...exchange import read_temperature_table
from ...kinds.temperature.effect import TemperatureFit

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
