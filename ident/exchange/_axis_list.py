"""What an axis list sets up by itself: backlash, temperature, activation."""

from collections.abc import Iterable
from typing import Literal

import numpy as np

from ...data.lists import ListFile
from ...models import (
    Backlash,
    ConstantParameter,
    Conventions,
    TemperatureLine,
)
from ._errors import ExchangeError
from ._identity import flag, optional, real
from ._nodes import as_array
from ._units import LIST_UNITS, SGN16, SGN32, round_to_list

ACTIVATION = {
    "cross": "lr_param.crosscomp",
    "plane": "lr_param.crosscomp2",
    "leadscrew": "lr_param.ssfk",
    "friction": "lr_param.frict_comp",
    "crosstalk": "lr_param.crosstalk",
    "temperature": "lr_param.temp_comp",
    "backlash": "lr_param.anwahl_losekomp",
}
"""Entry of the axis list that switches each compensation on."""
WIDTH = "getriebe[0].lose"
CYCLES = "lr_param.n_backlash_cyc"
MOST_CYCLES = 19
"""For a reversal and for the temperature: fewer than 20 (S-25, S-44)."""

_PER_METRE = 1e-6
_LINE = "lr_param.temp_comp"


def is_activated(machine: ListFile, compensation: str) -> bool:
    """Return whether an axis list switches a compensation on.

    Raises:
        ExchangeError: If its entry is unreadable.
    """
    entry = ACTIVATION[compensation]
    if compensation == "backlash":
        return optional(machine, entry) != 0
    return flag(machine, entry)


def entries_of_activation(compensations: Iterable[str]) -> dict[str, int | str]:
    """Return the entries of an axis list that switch tables and lines on.

    Raises:
        ExchangeError: If backlash is among them: its entry says how, too
            (`entries_of_backlash`).
    """
    entries: dict[str, int | str] = {}
    for name in compensations:
        if name == "backlash":
            raise ExchangeError(
                where=ACTIVATION[name],
                found="backlash without its reference flank",
                expected="the entries of the backlash itself",
            )
        entries[ACTIVATION[name]] = 1
    return entries


def reversal_cycles(machine: ListFile | None) -> int:
    """Return over how many cycles an axis list spreads a reversal (P-AXIS-00243)."""
    return 0 if machine is None else _cycles(machine, CYCLES)


def backlash_from_list(machine: ListFile, conventions: Conventions) -> Backlash | None:
    """Return the backlash compensation of an axis list in mm or °; None: it is off.

    The size is that of the first gear, ``getriebe[0]``.

    Raises:
        ExchangeError: If an entry is unreadable or the selection is none of 0, 1, 2.
    """
    selection = optional(machine, ACTIVATION["backlash"])
    if selection not in (0, 1, 2):
        raise ExchangeError(
            where=f"{machine.source}: {ACTIVATION['backlash']}",
            found=str(selection),
            expected="0, 1 or 2",
        )
    if selection == 0:
        return None
    first: Literal[1, -1] = conventions.backlash_reference
    second: Literal[1, -1] = -1 if first == 1 else 1
    return Backlash(
        width=as_array(optional(machine, WIDTH) / LIST_UNITS),
        reference=first if selection == 1 else second,
        cycles=_cycles(machine, CYCLES),
    )


def entries_of_backlash(
    backlash: Backlash, conventions: Conventions
) -> dict[str, int | str]:
    """Return the entries of an axis list for a backlash, rounded to list units.

    Raises:
        ExchangeError: If the size or the number of cycles does not fit.
    """
    same = backlash.reference == conventions.backlash_reference
    width = round_to_list(np.asarray(backlash.width), WIDTH, SGN16)
    _refuse_many(backlash.cycles, CYCLES)
    return {
        ACTIVATION["backlash"]: 1 if same else 2,
        WIDTH: int(width),
        CYCLES: backlash.cycles,
    }


def temperature_from_list(
    machine: ListFile, conventions: Conventions
) -> TemperatureLine | None:
    """Return the temperature line of an axis list in mm; None: it is off.

    Its parameters are what the list says: how a PLC changes them stands nowhere in it.

    Raises:
        ExchangeError: If an entry is unreadable.
    """
    if not is_activated(machine, "temperature"):
        return None
    place, shift = (
        optional(machine, f"{_LINE}_{name}") / LIST_UNITS
        for name in ("position_0", "offset_0")
    )
    return TemperatureLine(
        position_0=constant(place),
        offset_0=constant(shift),
        coefficient=constant(_PER_METRE * real(machine, f"{_LINE}_coefficient")),
        cycles=_cycles(machine, f"{_LINE}_n_cycles"),
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
                where=f"{_LINE}_{name}",
                found="a curve over the temperature",
                expected="one number (the PLC writes TEMPC::* for the rest)",
            )
        values[name] = float(found.value)
    _refuse_many(line.cycles, f"{_LINE}_n_cycles")
    coefficient = values.pop("coefficient") / _PER_METRE
    if not abs(coefficient) <= 10_000:
        raise ExchangeError(
            where=f"{_LINE}_coefficient",
            found=f"{coefficient:.6g} µm/m",
            expected="-10000 to 10000",
        )
    entries: dict[str, int | float | str] = {ACTIVATION["temperature"]: 1}
    for name, value in values.items():
        bounds = (SGN32[0] + 1, SGN32[1])
        entries[f"{_LINE}_{name}"] = int(
            round_to_list(np.asarray(value), f"{_LINE}_{name}", bounds)
        )
    # 1e-6 µm/m: over 10 m that is 10 fm. What stands behind it is floating point noise.
    entries[f"{_LINE}_coefficient"] = round(coefficient, 6)
    entries[f"{_LINE}_n_cycles"] = line.cycles
    return entries


def _cycles(machine: ListFile, name: str) -> int:
    cycles = optional(machine, name)
    if cycles < 0:
        raise ExchangeError(
            where=f"{machine.source}: {name}", found=str(cycles), expected="0 or more"
        )
    return cycles


def _refuse_many(cycles: int, name: str) -> None:
    if cycles > MOST_CYCLES:
        raise ExchangeError(
            where=name, found=str(cycles), expected=f"at most {MOST_CYCLES} cycles"
        )
