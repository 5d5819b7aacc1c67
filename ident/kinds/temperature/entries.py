"""Temperature compensation: its entries in an axis list ↔ `TemperatureLine`.

The table that a PLC follows (``temperature_<axis>.csv``) makes such a line, too.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float

from ....data.lists import ListFile
from ....models import ConstantParameter, Conventions, TemperatureCurve, TemperatureLine
from ...exchange._capacity import ANY_LIST, ListTarget
from ...exchange._identity import flag, not_negative, optional, real, refuse_many
from ...exchange._machine_lists import InUse, Reading
from ...exchange._nodes import refuse_unordered
from ...exchange._units import LIST_UNITS, SGN32, ExchangeError, expect, round_to_list
from ...exchange.controller._motion import Motion
from .._protocol import AbstractEntries, Axes
from . import KIND

PREFIX = KIND.prefix
COLUMNS = ("temperature", "offset_0", "coefficient")
"""Of the table of a PLC: in °C, mm and µm/m."""
SENSORS = ("offset_0_sensor", "coefficient_sensor")
"""Further columns where offset and coefficient follow different ones: the name in each row."""
Table = Mapping[str, Float[np.ndarray, " n"]]
"""Columns of the table of a PLC by name."""
_PER_METRE = 1e-6


def read_temperature_table(
    path: Path,
    sensors: Sequence[str],
    followed: Sequence[str],
    conventions: Conventions,
    machine: ListFile | None = None,
) -> TemperatureLine:
    """Return the temperature line of an axis as its PLC makes it.

    Linear between the temperatures of the table and held outside.

    Args:
        path: CSV with the columns ``temperature``, ``offset_0`` and ``coefficient``, and
            `SENSORS` where these follow different ones.
        sensors: Sensors of the motion, in the order of its temperatures.
        followed: Those that offset and coefficient follow, one for both; empty: those that the
            table names, else the only one.
        conventions: Sign of the line.
        machine: Axis list with the reference position and the filter; None: 0 and none.

    Raises:
        ExchangeError: If a column is missing or the temperatures do not ascend, or it
            is open which sensor counts.
    """
    columns, named = read_law(path)
    if len(followed) == 1 and named:
        offset, slope = named
        found = f"a law whose offset follows {offset} and whose coefficient {slope}"
        raise ExchangeError(
            str(path), found, f"a sensor for each, as in :{offset},{slope}"
        )
    followed = followed or named or (sensors if len(sensors) == 1 else ())
    if missing := [name for name in followed or ("",) if name not in sensors]:
        names = ", ".join(f"temperature.{name}" for name in sensors) or "no temperature"
        expected = missing[0] or "one column temperature.<sensor>"
        raise ExchangeError(str(path), f"{names} in the motion", expected)
    numbers = [sensors.index(name) for name in followed]
    return temperature_line(columns, (numbers[0], numbers[-1]), conventions, machine)


def read_law(path: Path) -> tuple[Table, tuple[str, ...]]:
    """Return the columns of the table of a PLC, as `COLUMNS`, and the sensors that it names.

    These are those of offset and coefficient, or none.

    Raises:
        ExchangeError: If a column is missing or the temperatures do not ascend.
    """
    from ....data.measurements import read_table  # lists alone need none

    table = read_table(path)
    by_name = {column.name: column for column in table.columns}
    words = f"columns {', '.join(by_name)}"
    expect(by_name.keys() >= set(COLUMNS), str(path), words, ", ".join(COLUMNS))
    values = {name: table.numbers(by_name[name]) for name in COLUMNS}
    where = f"{path}: temperature"
    refuse_unordered(values["temperature"], where, "ascending temperatures")
    texts = [by_name[name].text for name in SENSORS if name in by_name]
    return values, tuple(text[0].strip() for text in texts if text)


def temperature_line(
    table: Table,
    sensors: tuple[int, int],
    conventions: Conventions,
    machine: ListFile | None = None,
) -> TemperatureLine:
    """Return the temperature line that a PLC makes of a table.

    Args:
        table: Columns as `COLUMNS`.
        sensors: Numbers of those that offset and coefficient follow.
        conventions: Sign of the line.
        machine: Axis list with the reference position and the filter; None: 0 and none.
    """
    place, cycles = (
        0 if machine is None else optional(machine, f"{PREFIX}_{name}")
        for name in ("position_0", "n_cycles")
    )
    warmth, offset, slope = (table[name] for name in COLUMNS)
    return TemperatureLine(
        position_0=place / LIST_UNITS,
        offset_0=TemperatureCurve.of(warmth, offset, sensors[0]),
        coefficient=TemperatureCurve.of(warmth, _PER_METRE * slope, sensors[1]),
        cycles=cycles,
        sign=float(conventions.temperature_sign),
    )


def held_in(listing: ListFile) -> list[str]:
    """Return the names of the entries by which an axis list itself holds a line."""
    return [
        name
        for name in (f"{PREFIX}_offset_0", f"{PREFIX}_coefficient")
        if (entry := listing.get(name)) is not None and entry.value.strip("+-0.")
    ]


@final
class TemperatureEntries(AbstractEntries):
    """``lr_param.temp_comp`` ↔ `TemperatureLine`."""

    kind = KIND
    models = (TemperatureLine,)
    value = f"{PREFIX}_offset_0"
    units = ("mm",)
    coupled = False

    def adds_nothing(self, listing: ListFile) -> bool:
        # A line of zeros is what a PLC finds: what it makes of it stands in no list.
        return not held_in(listing)

    def model(
        self, listing: ListFile, axis: int, reading: Reading
    ) -> TemperatureLine | None:
        expect(
            axis not in reading.modulo,
            f"{listing.source}: {PREFIX}_coefficient",
            f"temperature compensation of the rotary axis {axis}",
            "a linear axis: the manuals give no unit for a rotary one",
        )
        if axis in reading.lines:
            return reading.lines[axis]
        if not flag(listing, KIND.activation):
            return None
        place, shift = (
            optional(listing, f"{PREFIX}_{name}") / LIST_UNITS
            for name in ("position_0", "offset_0")
        )
        return TemperatureLine(
            position_0=place,
            offset_0=shift,
            coefficient=_PER_METRE * real(listing, f"{PREFIX}_coefficient"),
            cycles=not_negative(listing, f"{PREFIX}_n_cycles"),
            sign=float(reading.conventions.temperature_sign),
        )

    def lacks(self, in_use: InUse, motion: Motion, reading: Reading) -> str | None:
        line = reading.lines.get(in_use.axis)
        parameters = () if line is None else (line.offset_0, line.coefficient)
        follows = any(isinstance(one, TemperatureCurve) for one in parameters)
        return (
            "there is no temperature" if follows and not motion.temperatures else None
        )

    def looks_at(self, in_use: InUse, motion: Motion, reading: Reading) -> Axes:
        line = reading.lines.get(in_use.axis)
        slope = None if line is None else line.coefficient
        # A law of the PLC may be the same at all positions.
        flat = isinstance(slope, TemperatureCurve) and not np.any(slope.values)
        return () if flat else in_use.masters

    def to_list(
        self, model: TemperatureLine, masters: Axes = (), target: ListTarget = ANY_LIST
    ) -> dict[str, int | float | str]:
        values = {}
        for name in ("position_0", "offset_0", "coefficient"):
            parameter, words = getattr(model, name), "a curve over the temperature"
            expected = "one number (the PLC writes TEMPC::* for the rest)"
            constant = isinstance(parameter, ConstantParameter)
            expect(constant, f"{PREFIX}_{name}", words, expected)
            values[name] = float(parameter.value)
        refuse_many(model.cycles, f"{PREFIX}_n_cycles")
        coefficient = values.pop("coefficient") / _PER_METRE
        words = f"{coefficient:.6g} µm/m"
        name = f"{PREFIX}_coefficient"
        expect(abs(coefficient) <= 10_000, name, words, "-10000 to 10000")
        entries: dict[str, int | float | str] = {KIND.activation: 1}
        for name, value in values.items():
            entry, bounds = f"{PREFIX}_{name}", (SGN32[0] + 1, SGN32[1])
            entries[entry] = int(round_to_list(np.asarray(value), entry, bounds))
        # 1e-6 µm/m: over 10 m that is 10 fm. What stands behind it is floating point noise.
        entries[f"{PREFIX}_coefficient"] = round(coefficient, 6)
        entries[f"{PREFIX}_n_cycles"] = model.cycles
        return entries


ENTRIES = TemperatureEntries()
temperature_from_list, entries_of_temperature = ENTRIES.from_list, ENTRIES.to_list
