"""Backlash compensation: its entries in an axis list ↔ `Backlash`."""

from typing import final

import numpy as np

from ....data.lists import ListFile
from ....models import Backlash
from ...exchange._capacity import ANY_LIST, ListTarget
from ...exchange._identity import not_negative, optional, refuse_many
from ...exchange._machine_lists import REVERSAL_CYCLES, InUse, Reading
from ...exchange._nodes import as_array
from ...exchange._units import LIST_UNITS, SGN16, ExchangeError, expect, round_to_list
from ...exchange.controller._motion import Motion
from .._protocol import AbstractEntries, Axes
from . import KIND

WIDTH = KIND.prefix


@final
class BacklashEntries(AbstractEntries):
    """Gear and axis parameters ↔ `Backlash`."""

    kind = KIND
    models = (Backlash,)
    value = WIDTH
    coupled = False

    def is_activated(self, machine: ListFile) -> bool:
        return optional(machine, KIND.activation) != 0

    def activation(self) -> dict[str, int | str]:
        raise ExchangeError(
            where=KIND.activation,
            found="backlash without its reference flank",
            expected="the entries of the backlash itself",
        )

    def model(self, listing: ListFile, axis: int, reading: Reading) -> Backlash | None:
        # The size is that of the first gear, ``getriebe[0]``.
        selection = optional(listing, KIND.activation)
        name = f"{listing.source}: {KIND.activation}"
        expect(selection in (0, 1, 2), name, selection, "0, 1 or 2")
        if selection == 0:
            return None
        reference = reading.conventions.backlash_reference
        return Backlash(
            width=as_array(optional(listing, WIDTH) / LIST_UNITS),
            reference=reference if selection == 1 else -reference,
            cycles=not_negative(listing, REVERSAL_CYCLES),
        )

    def to_list(
        self, model: Backlash, masters: Axes = (), target: ListTarget = ANY_LIST
    ) -> dict[str, int | str]:
        same = model.reference == target.rules.backlash_reference
        width = round_to_list(np.asarray(model.width), WIDTH, SGN16)
        refuse_many(model.cycles, REVERSAL_CYCLES)
        return {
            KIND.activation: 1 if same else 2,
            WIDTH: int(width),
            REVERSAL_CYCLES: model.cycles,
        }

    def looks_at(self, in_use: InUse, motion: Motion, reading: Reading) -> Axes:
        return () if in_use.axis in motion.directions else in_use.masters

    def inputs(self, masters: Axes) -> Axes:
        return ()

    def turns(self, model: Backlash) -> bool:
        return True


ENTRIES = BacklashEntries()
backlash_from_list, entries_of_backlash = ENTRIES.from_list, ENTRIES.to_list
