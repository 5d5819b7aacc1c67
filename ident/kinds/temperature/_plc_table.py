"""The table that a PLC follows for the temperature: ``temperature_<axis>.csv``."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ....data.lists import ListFile
from ....data.measurements import read_table
from ....models import Conventions, TemperatureCurve, TemperatureLine
from ...exchange._errors import ExchangeError
from ...exchange._identity import optional
from ...exchange._units import LIST_UNITS
from . import KIND
from .entries import constant

COLUMNS = ("temperature", "offset_0", "coefficient")
"""In °C, mm and µm/m."""


def read_temperature_table(
    path: Path,
    sensors: Sequence[str],
    sensor: str | None,
    conventions: Conventions,
    machine: ListFile | None = None,
) -> TemperatureLine:
    """Return the temperature line of an axis as its PLC makes it.

    Linear between the temperatures of the table and held outside.

    Args:
        path: CSV with the columns ``temperature``, ``offset_0`` and ``coefficient``.
        sensors: Sensors of the motion, in the order of its temperatures.
        sensor: The one that the PLC looks at; None: the only one.
        conventions: Sign of the line.
        machine: Axis list with the reference position and the filter; None: 0 and none.

    Raises:
        ExchangeError: If a column is missing or the temperatures do not ascend, or it
            is open which sensor counts.
    """
    table = read_table(path)
    names = [column.name for column in table.columns]
    for name in COLUMNS:
        if name not in names:
            raise ExchangeError(
                where=str(path),
                found=f"columns {', '.join(names)}",
                expected=", ".join(COLUMNS),
            )
    warmth, offsets, slopes = (table.numbers(table.column(name)) for name in COLUMNS)
    if not len(warmth) or not (np.diff(warmth) > 0).all():
        raise ExchangeError(
            where=f"{path}: temperature",
            found=", ".join(f"{value:g}" for value in warmth[:8]) or "no row",
            expected="ascending temperatures",
        )
    number = _number(sensors, sensor, str(path))
    return temperature_line(warmth, offsets, slopes, number, conventions, machine)


def temperature_line(
    warmth: Float[np.ndarray, " n"],
    offsets: Float[np.ndarray, " n"],
    slopes: Float[np.ndarray, " n"],
    sensor: int,
    conventions: Conventions,
    machine: ListFile | None = None,
) -> TemperatureLine:
    """Return the temperature line that a PLC makes of a table.

    Args:
        warmth: Temperatures in °C, ascending.
        offsets: ``offset_0`` in mm.
        slopes: ``coefficient`` in µm/m.
        sensor: Number of the sensor that it follows.
        conventions: Sign of the line.
        machine: Axis list with the reference position and the filter; None: 0 and none.
    """
    place, cycles = (
        0 if machine is None else optional(machine, f"{KIND.prefix}_{name}")
        for name in ("position_0", "n_cycles")
    )
    return TemperatureLine(
        position_0=constant(place / LIST_UNITS),
        offset_0=TemperatureCurve.of(warmth, offsets, sensor),
        coefficient=TemperatureCurve.of(warmth, 1e-6 * slopes, sensor),
        cycles=cycles,
        sign=float(conventions.temperature_sign),
    )


def _number(sensors: Sequence[str], sensor: str | None, where: str) -> int:
    if sensor is None and len(sensors) == 1:
        return 0
    if sensor is not None and sensor in sensors:
        return list(sensors).index(sensor)
    known = ", ".join(f"temperature.{name}" for name in sensors) or "no temperature"
    wanted = "one column temperature.<sensor>" if sensor is None else sensor
    raise ExchangeError(where=where, found=f"{known} in the motion", expected=wanted)
