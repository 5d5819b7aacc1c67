"""What a fit writes: one table at given nodes, as list entries and as model."""

import abc
import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float, Int

from ...data.lists import ListFile, Value
from ...models import AbstractLookup, Conventions
from ..core import touched
from ..fit import TableEffect
from ..kinds import Kind
from ._capacity import ANY_LIST, ListTarget
from ._identity import Increments
from ._machine_lists import Reading
from ._nodes import ListNodes, nodes_of_model
from ._units import LIST_UNITS, SGN32, expect, from_list_units, round_to_list

if TYPE_CHECKING:
    from ..fit.joint import AbstractEffect

Model = AbstractLookup
"""A plane, a cross or a leadscrew table as the controller applies it."""


@dataclasses.dataclass(frozen=True)
class AbstractTable(abc.ABC):
    """One compensation of one axis at fixed nodes: the bridge from fit to list.

    Attributes:
        axis: Logical number of the compensated axis.
        masters: Logical numbers of the axes whose positions enter, master 1 first; the
            axis itself for a leadscrew.
        nodes: Per master, in list units.
        conventions: Sign and edge rules.
        periodic: The range of the nodes is one turn, and the last node the first again.
    """

    axis: int
    masters: tuple[int, ...]
    nodes: tuple[ListNodes, ...]
    conventions: Conventions
    periodic: bool = False

    kind: ClassVar[Kind]
    """What is known of the compensation."""
    branch_names: ClassVar[tuple[str, ...]] = ("",)
    value_bounds: ClassVar[tuple[int, int]] = SGN32

    @property
    def sign(self) -> int:
        """Offset = sign · entry."""
        return int(getattr(self.conventions, f"{self.kind.name}_sign"))

    @abc.abstractmethod
    def model(self, integers: Int[np.ndarray, "..."]) -> Model:
        """Return the model that the controller makes of integer entries."""

    @abc.abstractmethod
    def effect(self, axis: str, masters: tuple[str, ...]) -> "AbstractEffect":
        """Return it as an effect of a joint fit.

        Args:
            axis: Name of the compensated axis.
            masters: Names of the axes whose positions enter, master 1 first.
        """

    def entries(
        self, integers: Int[np.ndarray, "..."], target: ListTarget = ANY_LIST
    ) -> Mapping[str, Value]:
        """Return the list entries for integer values shaped like `layout`."""
        target = dataclasses.replace(target, rules=self.conventions)
        return self.kind.entries.to_list(self.model(integers), self.masters, target)

    def read(self, listing: ListFile, increments: Increments = None) -> Model:
        """Return the model of the table that a list holds."""
        ranges = {} if self.modulo is None else {self.masters[0]: self.modulo}
        reading = Reading(self.conventions, increments, ranges)
        model: Model = self.kind.entries.model(listing, self.axis, reading)
        return model

    def refuse_other_form(self, old: Model, source: str) -> None:
        """Raise where the table cannot continue one of another form."""
        return None

    @property
    def branches(self) -> int:
        """Number of values per node: 2 where the direction of motion counts."""
        return 1

    @property
    def modulo(self) -> tuple[float, float] | None:
        """Range of the axis that the table goes round, or None."""
        if not self.periodic:
            return None
        ends = self.nodes[0].positions
        return float(ends[0]), float(ends[-1])

    @cached_property
    def layout(self) -> TableEffect:
        """Nodes in mm or °, for the fit."""
        return TableEffect(
            nodes=tuple(nodes.positions for nodes in self.nodes),
            branches=self.branches,
            periodic=self.periodic,
        )

    def to_integers(self, offset: Float[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
        """Round offsets at the nodes (mm or °) to the integers of the list (`round_to_list`)."""
        name = f"{self.kind.prefix}.table[].{self.kind.entries.columns[0]}"
        return round_to_list(self.sign * offset, name, self.value_bounds)

    def to_offsets(self, integers: Int[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """Return the offsets at the nodes in mm or ° that integer entries stand for."""
        return self.sign * from_list_units(integers)

    def offset(
        self,
        model: Model,
        positions: Float[np.ndarray, "t d"],
        branch: Int[np.ndarray, " t"] | None,
    ) -> Float[np.ndarray, " t"]:
        """Return what the controller adds at each reading, in mm or °.

        Positions have a column per master; branches are 0 for positive and 1 for negative
        motion, None where the table does not ask.
        """
        direction = None if branch is None else 1 - 2 * branch
        return offset_at(model, positions, direction)

    def offsets(
        self,
        integers: Int[np.ndarray, "k ..."],
        positions: Float[np.ndarray, "t d"],
        branch: Int[np.ndarray, " t"] | None,
    ) -> Float[np.ndarray, "k t"]:
        """Return the `offset` at each reading under each of several lists."""
        direction = None if branch is None else 1 - 2 * branch
        # The lists have their nodes in common: only these count of the first.
        nodes, weights = touched(self.model(integers[0]), positions, direction)
        entries = self.to_offsets(integers).reshape(len(integers), -1)
        # One by one, which takes less memory.
        return np.stack([(row[nodes] * weights).sum(axis=1) for row in entries])

    def at_nodes(self, model: Model) -> Float[np.ndarray, "..."]:
        """Return the offset of a model at the nodes, shaped like `layout`."""
        axes = [nodes.positions for nodes in reversed(self.nodes)]
        grid = np.meshgrid(*axes, indexing="ij")
        points = np.stack([column.ravel() for column in reversed(grid)], axis=1)
        if self.periodic:
            # The last node is the first one again; asked as a position it would wrap,
            # and a held table would answer with its own end.
            points[-1] = points[0]
        branch = np.repeat(np.arange(self.branches), len(points))
        offset = self.offset(model, np.tile(points, (self.branches, 1)), branch)
        return offset.reshape(self.layout.shape)


def offset_at(
    model: AbstractLookup,
    positions: Float[np.ndarray, "t d"],
    direction: Int[np.ndarray, " t"] | None = None,
) -> Float[np.ndarray, " t"]:
    """Return the offset in mm or ° that a table adds at each position.

    Args:
        model: The table.
        positions: One column per master (leadscrew: the axis itself), in mm or °.
        direction: ±1 per row for a leadscrew; positive where it is left out.
    """
    # Further columns are other axes.
    masters = np.asarray(positions[:, : len(model.ways)], dtype=np.float64)
    nodes, weights = touched(model, masters, direction)
    entries = np.concatenate([np.ravel(table) for table in model.tables])
    table: Any = model
    return np.asarray(table.sign * (entries[nodes] * weights).sum(axis=1))


def nodes_in(model: Model, name: str) -> tuple[ListNodes, ...]:
    """Return the nodes of a model per master (`nodes_of_model`)."""
    masters = model.ways
    names = [name] if len(masters) == 1 else [f"{name} master {k}" for k in (1, 2)]
    return tuple(nodes_of_model(*pair) for pair in zip(masters, names, strict=True))


def by_branch(table: AbstractTable, values: np.ndarray) -> Mapping[str, np.ndarray]:
    """Split values into named branches (``pos`` and ``neg``, or ``""``)."""
    if table.branches == 1:
        return {table.branch_names[0]: values}
    return dict(zip(table.branch_names, values, strict=True))


def refuse_lost_nodes(table: AbstractTable, old: Model, source: str) -> None:
    """Raise where a table that continues an old one lacks some of its nodes.

    Only on the old nodes, or on more, is old + residual a table again.
    """
    table.refuse_other_form(old, source)
    for master, mine, theirs in zip(table.masters, table.nodes, old.ways, strict=True):
        previous = np.rint(np.asarray(theirs.positions, dtype=float) * LIST_UNITS)
        missing = sorted(set(previous.astype(np.int64).tolist()) - set(mine.integers))
        shown = ", ".join(f"{k / LIST_UNITS:g}" for k in missing[:5])
        more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
        found = (
            f"nodes of axis {master} at {shown}{more} in the table that was active while"
            " measuring, but not in the new one"
        )
        where = f"{source}: {table.kind.prefix}"
        expect(not missing, where, found, "the old nodes or more of them")
