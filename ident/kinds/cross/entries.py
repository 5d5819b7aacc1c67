"""Cross compensation: ``kw.crosscomp`` in a list ↔ `Cross`."""

import dataclasses
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Int

from ....data.lists import ListFile
from ....models import Conventions, Cross, Setpoints
from ...exchange._capacity import ANY_LIST, ListTarget, refuse_huge
from ...exchange._identity import axis_number, column, required, scaled, unit_size
from ...exchange._machine_lists import Reading
from ...exchange._nodes import (
    ListNodes,
    as_array,
    nodes_of_model,
    refuse_jump,
    refuse_unordered,
    wrapped,
)
from ...exchange._table import AbstractTable
from ...exchange._units import from_list_units, round_to_list
from .._protocol import AbstractEntries, Axes
from . import KIND

if TYPE_CHECKING:
    from ...fit import joint

PREFIX = KIND.prefix
DEFAULT_COUNT = 1000
"""Entries without ``max_points``: one manual has 1001, two have 1000 (S-13)."""


@final
@dataclasses.dataclass(frozen=True)
class CrossTable(AbstractTable):
    """A cross table: the offset over the position of one master."""

    kind = KIND

    def model(self, integers: Int[np.ndarray, " n"]) -> Cross:
        # The list knows single setpoints only.
        points = ListNodes(self.nodes[0].integers)
        return Cross(
            nodes=wrapped(points.model(), self.modulo),
            values=as_array(from_list_units(integers)),
            sign=float(self.sign),
            held=self.conventions.cross_edge == "hold",
        )

    def effect(self, axis: str, masters: tuple[str, ...]) -> "joint.Cross":
        from ...fit import joint

        places = self.nodes[0].positions
        return joint.Cross(axis, places, master=masters[0], modulo=self.periodic)


@final
class CrossEntries(AbstractEntries):
    """``kw.crosscomp`` ↔ `Cross`."""

    kind = KIND
    models = (Cross,)
    value = f"{PREFIX}.table[].correction"
    columns = ("correction",)
    rules = ("held",)
    table = CrossTable

    def is_in(self, listing: ListFile) -> bool:
        return bool(listing.table(PREFIX, "setpoint"))

    def named_masters(self, listing: ListFile) -> Axes:
        return (required(listing, f"{PREFIX}.master_ax_nr"),)

    def axes(
        self, listing: ListFile, number: int, conventions: Conventions
    ) -> tuple[int, Axes]:
        # The list is that of the compensated axis, and names its master; or, by the older
        # manuals, the other way round (S-10).
        (partner,) = self.named_masters(listing)
        by_slave = conventions.cross_list == "slave"
        return (number, (partner,)) if by_slave else (partner, (number,))

    def model(self, listing: ListFile, axis: int, reading: Reading) -> Cross:
        conventions, increment = reading.conventions, reading.increment
        count = required(listing, f"{PREFIX}.last_index") + 1
        refuse_huge(count, f"{listing.source}: {PREFIX}.last_index")
        slave, (master,) = self.axes(listing, axis_number(listing), conventions)
        by_master = unit_size(listing, PREFIX, master, increment)
        by_slave = unit_size(listing, PREFIX, slave, increment)
        points = scaled(column(listing, PREFIX, "setpoint", count), by_master)
        values = scaled(column(listing, PREFIX, "correction", count), by_slave)
        refuse_unordered(points, f"{listing.source}: {PREFIX}.table[].setpoint")
        return Cross(
            nodes=wrapped(Setpoints(as_array(points)), reading.modulo.get(master)),
            values=as_array(values),
            sign=float(conventions.cross_sign),
            held=conventions.cross_edge == "hold",
        )

    def to_list(
        self, model: Cross, masters: Axes = (), target: ListTarget = ANY_LIST
    ) -> dict[str, int | str]:
        (master,) = self.exactly(masters, 1)
        points = nodes_of_model(model.nodes, PREFIX).integers
        entries: dict[str, int | str] = {f"{PREFIX}.unit": 1}
        count = len(points)
        entries |= target.max_points_entry(PREFIX, count, count <= DEFAULT_COUNT)
        entries[f"{PREFIX}.last_index"] = count - 1
        entries[f"{PREFIX}.master_ax_nr"] = master
        table = round_to_list(np.asarray(model.values), self.value)
        refuse_jump(model.nodes, table, self.value)
        for k, (point, value) in enumerate(zip(points, table.tolist(), strict=True)):
            entries[f"{PREFIX}.table[{k}].setpoint"] = point
            entries[f"{PREFIX}.table[{k}].correction"] = value
        return entries


ENTRIES = CrossEntries()
cross_from_list, entries_of_cross = ENTRIES.from_list, ENTRIES.to_list
