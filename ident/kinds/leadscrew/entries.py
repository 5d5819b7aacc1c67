"""Leadscrew error compensation: ``kw.ssfk`` in a list ↔ `Leadscrew`."""

import dataclasses
from collections.abc import Collection
from typing import TYPE_CHECKING, Any, ClassVar, final

import numpy as np
from jaxtyping import Int

from ....data.lists import ListFile
from ....models import Conventions, EquidistantNodes, Leadscrew, Setpoints
from ...exchange._capacity import ANY_LIST, ListTarget, refuse_huge
from ...exchange._identity import (
    axis_number,
    column,
    flag,
    optional,
    required,
    scaled,
    unit_size,
)
from ...exchange._machine_lists import Reading
from ...exchange._nodes import (
    as_array,
    nodes_of_model,
    refuse_unequal_ends,
    refuse_unordered,
)
from ...exchange._table import AbstractTable, Model
from ...exchange._units import (
    SGN16,
    ExchangeError,
    expect,
    from_list_units,
    round_to_list,
)
from .. import kind
from .._protocol import AbstractEntries, Axes
from . import KIND

if TYPE_CHECKING:
    from ...fit import joint

PREFIX = KIND.prefix
DEFAULT_COUNT = 1499
"""Entries without ``max_points``: ``kw_nr_max`` must stay below 1500."""


@final
@dataclasses.dataclass(frozen=True)
class LeadscrewTable(AbstractTable):
    """A leadscrew table: the offset over the position of the axis itself.

    Attributes:
        bilateral: One value per direction of motion.
    """

    bilateral: bool = False

    kind = KIND
    branch_names: ClassVar[tuple[str, ...]] = ("pos", "neg")
    value_bounds: ClassVar[tuple[int, int]] = SGN16

    @property
    def branches(self) -> int:
        return 2 if self.bilateral else 1

    def model(self, integers: Int[np.ndarray, "..."]) -> Leadscrew:
        values, nodes = from_list_units(integers), self.nodes[0].model()
        rows = [as_array(row) for row in np.atleast_2d(values)]
        neg = rows[1] if self.bilateral else None
        return Leadscrew(nodes, rows[0], neg, self.modulo, float(self.sign))

    def effect(self, axis: str, masters: tuple[str, ...]) -> "joint.Leadscrew":
        from ...fit import joint

        places, both = self.nodes[0].positions, self.bilateral
        return joint.Leadscrew(axis, places, bilateral=both, modulo=self.periodic)

    def refuse_other_form(self, old: Model, source: str) -> None:
        assert isinstance(old, Leadscrew)
        for name, was, will in (
            ("bilateral", old.bilateral, self.bilateral),
            ("modulo", old.modulo is not None, self.periodic),
        ):
            # A table for both directions may become one per direction, not vice versa.
            if was != will and (was or name == "modulo"):
                raise ExchangeError(
                    where=f"{source}: {PREFIX}.{name}",
                    found=f"{int(was)} in the table that was active while measuring",
                    expected=f"{name} = {str(was).lower()} in the fit as well",
                )


@final
class LeadscrewEntries(AbstractEntries):
    """``kw.ssfk`` ↔ `Leadscrew`."""

    kind = KIND
    models = (Leadscrew,)
    value = f"{PREFIX}.table[].pos"
    columns = ("pos", "neg")
    table = LeadscrewTable
    comes_last = True

    def model(self, listing: ListFile, axis: int, reading: Reading) -> Leadscrew:
        size = unit_size(listing, PREFIX, axis_number(listing), reading.increment)
        count = required(listing, f"{PREFIX}.kw_nr_max")
        expect(count >= 1, f"{listing.source}: {PREFIX}.kw_nr_max", count, "1 or more")
        refuse_huge(count, f"{listing.source}: {PREFIX}.kw_nr_max")
        names = ("pos", "neg") if flag(listing, f"{PREFIX}.bilateral") else ("pos",)
        values = {
            name: as_array(scaled(column(listing, PREFIX, name, count), size))
            for name in names
        }
        # An interval of 0, its default, asks for setpoints.
        interval = optional(listing, f"{PREFIX}.interval")
        nodes: EquidistantNodes | Setpoints
        if interval > 0:
            begin = optional(listing, f"{PREFIX}.kw_startpos")
            start, step = (
                as_array(scaled(number, size)) for number in (begin, interval)
            )
            nodes = EquidistantNodes(start, step, count)
        else:
            points = scaled(column(listing, PREFIX, "setpoint", count), size)
            refuse_unordered(points, f"{listing.source}: {PREFIX}.table[].setpoint")
            nodes = Setpoints(as_array(points))
        modulo = None
        if flag(listing, f"{PREFIX}.modulo"):
            # From its first to its last point where the axis has no range (S-20).
            first, last = np.asarray(nodes.positions)[[0, -1]].tolist()
            modulo = reading.modulo.get(axis, (first, last))
        sign = float(reading.conventions.leadscrew_sign)
        return Leadscrew(nodes, values["pos"], values.get("neg"), modulo, sign)

    def to_list(
        self, model: Leadscrew, masters: Axes = (), target: ListTarget = ANY_LIST
    ) -> dict[str, int | str]:
        # A bilateral table carries set_pos_without_comp 1: the values of others cannot
        # then turn its direction (S-23). Values fit SGN16: one manual says so (S-22).
        branches = {
            name: round_to_list(np.asarray(branch), f"{PREFIX}.table[].{name}", SGN16)
            for name, branch in (("pos", model.pos), ("neg", model.neg))
            if branch is not None
        }
        nodes, modulo = nodes_of_model(model.nodes, PREFIX), model.modulo is not None
        count = len(nodes.integers)
        entries: dict[str, int | str] = {f"{PREFIX}.unit": 1}
        entries |= target.max_points_entry(PREFIX, count + 1, count <= DEFAULT_COUNT)
        entries |= {
            f"{PREFIX}.interval": nodes.interval,
            f"{PREFIX}.kw_startpos": nodes.integers[0],
            f"{PREFIX}.kw_nr_max": count,
            f"{PREFIX}.bilateral": int("neg" in branches),
            f"{PREFIX}.modulo": int(modulo),
        }
        if "neg" in branches:
            entries[f"{PREFIX}.set_pos_without_comp"] = 1
        if not nodes.interval:
            for k, point in enumerate(nodes.integers):
                entries[f"{PREFIX}.table[{k}].setpoint"] = point
        for name, values in branches.items():
            if modulo:
                refuse_unequal_ends(values, f"{PREFIX}.table[].{name}")
            for k, value in enumerate(values.tolist()):
                entries[f"{PREFIX}.table[{k}].{name}"] = value
        return entries

    def beside(self, model: Leadscrew, others: Collection[str]) -> dict[str, int | str]:
        if not model.bilateral:
            return {}
        play = kind("backlash")
        words = "a backlash beside a leadscrew table for both directions"
        expected = "one of the two: the table contains the backlash"
        expect(play.name not in others, play.activation, words, expected)
        return {play.activation: 0}

    def installed(
        self, model: Leadscrew, masters: Axes, listing: ListFile
    ) -> dict[str, Any]:
        raw_input = flag(listing, f"{PREFIX}.set_pos_without_comp")
        return {KIND.name: model, "leadscrew_alone": raw_input}

    def sees_offsets(self, listing: ListFile, conventions: Conventions) -> bool:
        raw_input = flag(listing, f"{PREFIX}.set_pos_without_comp")
        return not raw_input and conventions.leadscrew_input == "all"

    def turns(self, model: Leadscrew) -> bool:
        return model.bilateral


ENTRIES = LeadscrewEntries()
leadscrew_from_list, entries_of_leadscrew = ENTRIES.from_list, ENTRIES.to_list
