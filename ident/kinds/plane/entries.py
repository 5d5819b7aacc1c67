"""Plane compensation: ``kw.crosscomp2`` in a list ↔ `Plane`."""

import dataclasses
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Int

from ....data.lists import ListFile
from ....models import EquidistantNodes, Plane
from ...exchange._capacity import ANY_LIST, ListTarget, refuse_huge
from ...exchange._identity import (
    axis_number,
    optional,
    required,
    scaled,
    unit_size,
    values_of,
)
from ...exchange._machine_lists import Reading
from ...exchange._nodes import as_array, refuse_jump, wrapped
from ...exchange._table import AbstractTable, nodes_in
from ...exchange._units import expect, from_list_units, round_to_list
from .._protocol import AbstractEntries, Axes
from . import KIND

if TYPE_CHECKING:
    from ...fit import joint

PREFIX = KIND.prefix
DEFAULT_LAST_INDEX = 100
"""Largest index per direction where ``max_points`` is not set (101 · 101 entries)."""


@final
@dataclasses.dataclass(frozen=True)
class PlaneTable(AbstractTable):
    """A plane table: the offset over the positions of two masters."""

    kind = KIND

    def model(self, integers: Int[np.ndarray, "j i"]) -> Plane:
        first, second = (nodes.model() for nodes in self.nodes)
        values = as_array(from_list_units(integers))
        return Plane(first, second, values, sign=float(self.sign))

    def effect(self, axis: str, masters: tuple[str, ...]) -> "joint.Plane":
        from ...fit import joint

        first, second = (nodes.positions for nodes in self.nodes)
        return joint.Plane(axis, (masters[0], masters[1]), (first, second))


@final
class PlaneEntries(AbstractEntries):
    """``kw.crosscomp2`` ↔ `Plane`."""

    kind = KIND
    models = (Plane,)
    value = f"{PREFIX}.table[][].correction"
    columns = ("correction",)
    table = PlaneTable

    def named_masters(self, listing: ListFile) -> Axes:
        names = ("master1_ax_nr", "master2_ax_nr")
        return tuple(required(listing, f"{PREFIX}.{name}") for name in names)

    def model(self, listing: ListFile, axis: int, reading: Reading) -> Plane:
        first, second = self.named_masters(listing)
        conventions, increment = reading.conventions, reading.increment
        slave = axis_number(listing)
        # The grid is QUADRATIC where nothing else is said (P-COMP-00031).
        stated, forms = listing.text(f"{PREFIX}.grid"), ("QUADRATIC", "RECTANGULAR")
        grid, name = (stated or forms[0]).upper(), f"{listing.source}: {PREFIX}.grid"
        expect(grid in forms, name, repr(stated), " or ".join(forms))
        rectangular = grid == "RECTANGULAR"
        nodes: list[EquidistantNodes] = []
        for k, master in ((1, first), (2, second)):
            size = unit_size(listing, PREFIX, master, increment)
            interval = f"{PREFIX}.interval{k if rectangular else ''}"
            step = required(listing, interval)
            last = required(listing, f"{PREFIX}.last_index_master{k}")
            name = f"{listing.source}: {PREFIX} master {k}"
            words = f"interval {step}, last index {last}"
            expected = "an interval above 0 and an index of 0 or more"
            expect(step > 0 and last >= 0, name, words, expected)
            # The start position is 0 where it is not given, as in the controller.
            start = optional(listing, f"{PREFIX}.start_position_master{k}")
            places = as_array(scaled(start, size)), as_array(scaled(step, size))
            nodes.append(EquidistantNodes(*places, last + 1))
        size = unit_size(listing, PREFIX, slave, increment)
        n1, n2 = nodes[0].count, nodes[1].count
        refuse_huge(n1 * n2, f"{listing.source}: {PREFIX}.last_index_master1 and 2")
        table = np.zeros((n2, n1) if conventions.plane_index == "ji" else (n1, n2))
        for index, value in values_of(listing, PREFIX, "correction").items():
            if isinstance(index, tuple) and all(np.less(index, table.shape)):
                table[index] = scaled(value, size)
        return Plane(
            nodes1=wrapped(nodes[0], reading.modulo.get(first)),
            nodes2=wrapped(nodes[1], reading.modulo.get(second)),
            values=as_array(table if conventions.plane_index == "ji" else table.T),
            sign=float(conventions.plane_sign),
        )

    def to_list(
        self, model: Plane, masters: Axes = (), target: ListTarget = ANY_LIST
    ) -> dict[str, int | str]:
        first, second = self.exactly(masters, 2)
        g1, g2 = grids = nodes_in(model, PREFIX)
        for k, grid in enumerate(grids, 1):
            name, expected = f"{PREFIX} master {k}", "equidistant nodes"
            expect(grid.interval, name, "single setpoints", expected)
        existing = target.existing
        form = None if existing is None else existing.text(f"{PREFIX}.grid")
        entries: dict[str, int | str] = {f"{PREFIX}.unit": 1}
        if g1.interval == g2.interval and (form or "").upper() != "RECTANGULAR":
            entries[f"{PREFIX}.interval"] = g1.interval
        else:
            entries[f"{PREFIX}.grid"] = "RECTANGULAR"
            entries[f"{PREFIX}.interval1"] = g1.interval
            entries[f"{PREFIX}.interval2"] = g2.interval
        fits = max(g1.count, g2.count) <= DEFAULT_LAST_INDEX + 1
        entries |= target.max_points_entry(PREFIX, g1.count * g2.count, fits)
        entries |= {
            f"{PREFIX}.last_index_master1": g1.count - 1,
            f"{PREFIX}.last_index_master2": g2.count - 1,
            f"{PREFIX}.start_position_master1": g1.integers[0],
            f"{PREFIX}.start_position_master2": g2.integers[0],
            f"{PREFIX}.master1_ax_nr": first,
            f"{PREFIX}.master2_ax_nr": second,
        }
        table = round_to_list(np.asarray(model.values), self.value)
        refuse_jump(model.nodes1, table.T, f"{self.value} along master 1")
        refuse_jump(model.nodes2, table, f"{self.value} along master 2")
        if target.rules.plane_index == "ij":
            table = table.T
        for j, row in enumerate(table.tolist()):
            for i, value in enumerate(row):
                entries[f"{PREFIX}.table[{j}][{i}].correction"] = value
        return entries


ENTRIES = PlaneEntries()
plane_from_list, entries_of_plane = ENTRIES.from_list, ENTRIES.to_list
