"""Leadscrew error compensation: ``kw.ssfk`` in a list ↔ `Leadscrew`."""

import dataclasses
import functools
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, final

import jax
import numpy as np
from jaxtyping import Float, Int

from ....data.lists import ListFile
from ....models import Conventions, EquidistantNodes, Leadscrew, Setpoints
from ...exchange._capacity import ANY_LIST, ListTarget, refuse_huge
from ...exchange._identity import (
    Increments,
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


def read_leadscrew(
    listing: ListFile,
    conventions: Conventions,
    increment: Increments = None,
    *,
    modulo: tuple[float, float] | None = None,
) -> Leadscrew:
    """Return the leadscrew table that a list describes, its entries as NumPy has them.

    For what looks at the numbers alone: to make arrays of them that JAX can compute with
    takes longer than to read the list. The range of a modulo table is that from its first to its
    last point where it is not given (S-20); increments are as for `from_list`.

    Raises:
        ExchangeError: If an entry is missing or the setpoints do not ascend.
    """
    size = unit_size(listing, PREFIX, axis_number(listing), increment)
    count = required(listing, f"{PREFIX}.kw_nr_max")
    expect(count >= 1, f"{listing.source}: {PREFIX}.kw_nr_max", count, "1 or more")
    refuse_huge(count, f"{listing.source}: {PREFIX}.kw_nr_max")
    branches = ("pos", "neg") if flag(listing, f"{PREFIX}.bilateral") else ("pos",)
    values = scaled(
        np.stack([column(listing, PREFIX, branch, count) for branch in branches]), size
    )
    # An interval of 0, its default, asks for setpoints.
    interval = optional(listing, f"{PREFIX}.interval")
    places: tuple[np.ndarray, ...]
    if interval > 0:
        start = optional(listing, f"{PREFIX}.kw_startpos")
        places = tuple(np.asarray(scaled(number, size)) for number in (start, interval))
        ends = places[0], places[0] + (count - 1) * places[1]
    else:
        points = scaled(column(listing, PREFIX, "setpoint", count), size)
        refuse_unordered(points, f"{listing.source}: {PREFIX}.table[].setpoint")
        places, ends = (points,), (points[0], points[-1])
    wraps = None
    if flag(listing, f"{PREFIX}.modulo"):
        wraps = modulo or (float(ends[0]), float(ends[1]))
    return leadscrew_of(places, values, wraps, conventions)


def leadscrew_of(
    places: Sequence[Float[np.ndarray, "..."]],
    branches: Float[np.ndarray, "b n"],
    modulo: tuple[float, float] | None,
    conventions: Conventions,
) -> Leadscrew:
    """Return a leadscrew table over some nodes, its numbers as NumPy has them.

    Args:
        places: Start and interval of equidistant nodes, or the positions of all nodes.
        branches: Its entries in mm or °: one row for both directions, or one for each.
        modulo: Range of the axis where the table goes round.
        conventions: Sign rule.
    """
    sign = float(conventions.leadscrew_sign)
    structure = _structure(len(places), branches.shape, modulo, sign)
    # Setpoints are searched, which only JAX's own arrays can be where nothing is compiled.
    nodes = places if len(places) == 2 else map(as_array, places)
    leadscrew: Leadscrew = jax.tree.unflatten(structure, [*nodes, *branches])
    return leadscrew


@functools.lru_cache(maxsize=256)
def _structure(
    places: int,
    shape: tuple[int, int],
    modulo: tuple[float, float] | None,
    sign: float,
) -> Any:
    """Return all of a table but its numbers: those of the nodes, then the entries.

    To put them in is a tenth of the work of making a table anew.
    """
    branches, count = shape
    entries = as_array(np.arange(float(count)))
    unit, negative = as_array(1.0), entries if branches == 2 else None
    nodes = EquidistantNodes(unit, unit, count) if places == 2 else Setpoints(entries)
    return jax.tree.structure(Leadscrew(nodes, entries, negative, modulo, sign))


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
        branches = np.atleast_2d(from_list_units(integers))
        places = self.nodes[0].places
        return leadscrew_of(places, branches, self.modulo, self.conventions)

    def effect(self, axis: str, masters: tuple[str, ...]) -> "joint.Leadscrew":
        from ...fit import joint

        places, both = self.nodes[0].positions, self.bilateral
        return joint.Leadscrew(axis, places, bilateral=both, modulo=self.periodic)

    def read(self, listing: ListFile, increments: Increments = None) -> Leadscrew:
        return read_leadscrew(listing, self.conventions, increments, modulo=self.modulo)

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
        rules, turn = reading.conventions, reading.modulo.get(axis)
        table = read_leadscrew(listing, rules, reading.increment, modulo=turn)
        leadscrew: Leadscrew = jax.tree.map(as_array, table)
        return leadscrew

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
