"""Temperature compensation: its entries in an axis list ↔ `TemperatureLine`."""

from typing import Any, final

import numpy as np

from ....data.lists import ListFile
from ....models import ConstantParameter, Conventions, TemperatureLine
from ...exchange._errors import ExchangeError
from ...exchange._identity import flag, not_negative, optional, real, refuse_many
from ...exchange._machine_lists import Reading
from ...exchange._nodes import as_array
from ...exchange._units import LIST_UNITS, SGN32, round_to_list
from .._protocol import AbstractEntries
from . import KIND

_PER_METRE = 1e-6


def temperature_from_list(
    machine: ListFile, conventions: Conventions
) -> TemperatureLine | None:
    """Return the temperature line of an axis list in mm; None: it is off.

    Its parameters are what the list says: how a PLC changes them stands nowhere in it.

    Raises:
        ExchangeError: If an entry is unreadable.
    """
    if not flag(machine, KIND.activation):
        return None
    place, shift = (
        optional(machine, f"{KIND.prefix}_{name}") / LIST_UNITS
        for name in ("position_0", "offset_0")
    )
    return TemperatureLine(
        position_0=constant(place),
        offset_0=constant(shift),
        coefficient=constant(_PER_METRE * real(machine, f"{KIND.prefix}_coefficient")),
        cycles=not_negative(machine, f"{KIND.prefix}_n_cycles"),
        sign=float(conventions.temperature_sign),
    )


def constant(value: float) -> ConstantParameter:
    """Return a number as a parameter that no temperature changes."""
    return ConstantParameter(as_array(value))


def entries_of_temperature(line: TemperatureLine) -> dict[str, int | float | str]:
    """Return the entries of an axis list for a temperature line of a linear axis.

    Raises:
        ExchangeError: If a parameter follows a temperature, which only a PLC can make
            it do, or something does not fit.
    """
    values = {}
    for name in ("position_0", "offset_0", "coefficient"):
        found = getattr(line, name)
        if not isinstance(found, ConstantParameter):
            raise ExchangeError(
                where=f"{KIND.prefix}_{name}",
                found="a curve over the temperature",
                expected="one number (the PLC writes TEMPC::* for the rest)",
            )
        values[name] = float(found.value)
    refuse_many(line.cycles, f"{KIND.prefix}_n_cycles")
    coefficient = values.pop("coefficient") / _PER_METRE
    if not abs(coefficient) <= 10_000:
        raise ExchangeError(
            where=f"{KIND.prefix}_coefficient",
            found=f"{coefficient:.6g} µm/m",
            expected="-10000 to 10000",
        )
    entries: dict[str, int | float | str] = {KIND.activation: 1}
    for name, value in values.items():
        bounds = (SGN32[0] + 1, SGN32[1])
        entries[f"{KIND.prefix}_{name}"] = int(
            round_to_list(np.asarray(value), f"{KIND.prefix}_{name}", bounds)
        )
    # 1e-6 µm/m: over 10 m that is 10 fm. What stands behind it is floating point noise.
    entries[f"{KIND.prefix}_coefficient"] = round(coefficient, 6)
    entries[f"{KIND.prefix}_n_cycles"] = line.cycles
    return entries


@final
class TemperatureEntries(AbstractEntries):
    """``lr_param.temp_comp`` ↔ `TemperatureLine`."""

    kind = KIND
    models = (TemperatureLine,)
    value = f"{KIND.prefix}_offset_0"
    units = ("mm",)

    def is_in(self, listing: ListFile) -> bool:
        return self.is_activated(listing)

    def model(
        self, listing: ListFile, axis: int, reading: Reading
    ) -> TemperatureLine | None:
        if axis in reading.modulo:
            raise ExchangeError(
                where=f"{listing.source}: {KIND.prefix}_coefficient",
                found=f"temperature compensation of the rotary axis {axis}",
                expected="a linear axis: the manuals give no unit for a rotary one",
            )
        line = reading.lines.get(axis)
        return line or temperature_from_list(listing, reading.conventions)

    def to_list(
        self,
        model: TemperatureLine,
        masters: tuple[int, ...],
        conventions: Conventions,
        **options: Any,
    ) -> dict[str, int | float | str]:
        return entries_of_temperature(model)

    def installed(
        self, model: TemperatureLine, masters: tuple[int, ...], listing: ListFile
    ) -> dict[str, Any]:
        return {KIND.name: model}


ENTRIES = TemperatureEntries()
