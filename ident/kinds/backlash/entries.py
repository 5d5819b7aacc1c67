"""Backlash compensation: its entries in an axis list ↔ `Backlash`."""

from typing import Any, Literal, final

import numpy as np

from ....data.lists import ListFile
from ....models import Backlash, Conventions
from ...exchange._errors import ExchangeError
from ...exchange._identity import not_negative, optional, refuse_many
from ...exchange._machine_lists import REVERSAL_CYCLES, InUse, Reading
from ...exchange._motion import Motion
from ...exchange._nodes import as_array
from ...exchange._units import LIST_UNITS, SGN16, round_to_list
from .._protocol import AbstractEntries
from . import KIND

WIDTH = KIND.prefix


def backlash_from_list(machine: ListFile, conventions: Conventions) -> Backlash | None:
    """Return the backlash compensation of an axis list in mm or °; None: it is off.

    The size is that of the first gear, ``getriebe[0]``.

    Raises:
        ExchangeError: If an entry is unreadable or the selection is none of 0, 1, 2.
    """
    selection = optional(machine, KIND.activation)
    if selection not in (0, 1, 2):
        raise ExchangeError(
            where=f"{machine.source}: {KIND.activation}",
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
        cycles=not_negative(machine, REVERSAL_CYCLES),
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
    refuse_many(backlash.cycles, REVERSAL_CYCLES)
    return {
        KIND.activation: 1 if same else 2,
        WIDTH: int(width),
        REVERSAL_CYCLES: backlash.cycles,
    }


@final
class BacklashEntries(AbstractEntries):
    """Gear and axis parameters ↔ `Backlash`."""

    kind = KIND
    models = (Backlash,)
    value = WIDTH

    def is_in(self, listing: ListFile) -> bool:
        return self.is_activated(listing)

    def is_activated(self, machine: ListFile) -> bool:
        return optional(machine, KIND.activation) != 0

    def activation(self) -> dict[str, int | str]:
        raise ExchangeError(
            where=KIND.activation,
            found="backlash without its reference flank",
            expected="the entries of the backlash itself",
        )

    def model(self, listing: ListFile, axis: int, reading: Reading) -> Backlash | None:
        return backlash_from_list(listing, reading.conventions)

    def to_list(
        self,
        model: Backlash,
        masters: tuple[int, ...],
        conventions: Conventions,
        **options: Any,
    ) -> dict[str, int | str]:
        return entries_of_backlash(model, conventions)

    def installed(
        self, model: Backlash, masters: tuple[int, ...], listing: ListFile
    ) -> dict[str, Any]:
        return {KIND.name: model}

    def looks_at(self, one: InUse, motion: Motion) -> tuple[int, ...]:
        return () if one.axis in motion.directions else one.masters

    def inputs(self, masters: tuple[int, ...]) -> tuple[int, ...]:
        return ()

    def turns(self, model: Backlash) -> bool:
        return True


ENTRIES = BacklashEntries()
