"""Tables as effects: leadscrew, cross, plane, over the stencil of the controller."""

import abc
import dataclasses
import itertools
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float

from ...core import FitError
from .._types import Samples, TableLayout
from ._data import JointData
from ._effect import ANYWHERE, AbstractEffect, Block, Ranges, sparse_rows


@dataclasses.dataclass(frozen=True, eq=False)
class AbstractTable(AbstractEffect):
    """A table over one or two masters; its values are in the order of the list.

    The end of a ring has no value of its own, it is the start again.
    """

    def __post_init__(self) -> None:
        for nodes in self.layout.nodes:
            if len(nodes) < 2 or not (np.diff(nodes) > 0).all():
                msg = f"{self.name}: expected at least two nodes in ascending order."
                raise FitError(msg)

    @property
    @abc.abstractmethod
    def layout(self) -> TableLayout:
        """Where the nodes lie."""

    @property
    def name(self) -> str:
        """See `AbstractEffect`."""
        return f"{self.compensation} of {self.axis} over {' and '.join(self.masters)}"

    @cached_property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return self.layout.effect.size

    @property
    def ranges(self) -> Ranges:
        """See `AbstractEffect`."""
        layout = self.layout
        ways = {("direction", self.axis): ANYWHERE} if layout.branches == 2 else {}
        return ways | {
            ("position", master): (float(nodes[0]), float(nodes[-1]))
            for master, nodes in zip(self.masters, layout.nodes, strict=True)
        }

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        layout, table = self.layout, self.layout.effect
        places = np.column_stack(
            [data.column("position", master, self.name) for master in self.masters]
        )
        known, side = np.asarray(np.isfinite(places).all(axis=1)), None
        if layout.branches == 2:
            way = data.column("direction", self.axis, self.name)
            known, side = known & np.isfinite(way), (way < 0).astype(np.int64)
        # What is not known goes to the first node, with share zero.
        filled = np.where(known[:, None], places, [nodes[0] for nodes in layout.nodes])
        samples = Samples(filled, np.zeros(len(known)), side)
        nodes, shares = table.design(layout.readings(samples))
        own = np.argsort(table.unknowns)
        columns = sparse_rows(own[nodes], shares, known, table.size)
        prior = dataclasses.replace(table.prior, order=own[table.prior.order])
        return Block(columns, known, self._labels(), prior, table)

    def _labels(self) -> tuple[str, ...]:
        layout = self.layout
        ways = ("",)
        if layout.branches == 2:
            ways = (", moving positive", ", moving negative")
        own = [
            nodes[: len(nodes) - int(layout.periodic)]
            for nodes in reversed(layout.nodes)
        ]
        return tuple(
            ", ".join(
                f"{master} = {value:g}"
                for master, value in zip(self.masters, reversed(place), strict=True)
            )
            + way
            for way in ways
            for place in itertools.product(*own)
        )

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(n,)``, ``(2, n)`` or ``(n2, n1)``; the end of a ring repeated."""
        table = self.layout.effect
        unknowns = np.empty(table.size, np.asarray(values).dtype)
        unknowns[table.unknowns] = values
        return table.to_table(unknowns)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class LeadscrewEffect(AbstractTable):
    """Error of an axis over its own position, mm.

    Values: one per node; bilateral: all for positive direction, then all for negative.

    Attributes:
        nodes: Along the axis in mm or °, ascending.
        bilateral: Whether each direction of motion has values of its own.
        periodic: The last node is the first one again (modulo axis).
    """

    nodes: Float[np.ndarray, " n"]
    bilateral: bool = False
    periodic: bool = False

    compensation = "leadscrew"

    @property
    def name(self) -> str:
        """See `AbstractEffect`."""
        return f"leadscrew of {self.axis}"

    @cached_property
    def layout(self) -> TableLayout:
        """See `AbstractTable`."""
        nodes = (np.asarray(self.nodes, float),)
        return TableLayout(nodes, 2 if self.bilateral else 1, self.periodic)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class CrossEffect(AbstractTable):
    """Error of an axis over the position of another, mm; one value per node.

    Attributes:
        master: Axis over whose position the table runs.
        nodes: Along the master in mm or °, ascending.
        periodic: The last node is the first one again (modulo master).
    """

    master: str
    nodes: Float[np.ndarray, " n"]
    periodic: bool = False

    compensation = "cross"

    @cached_property
    def masters(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return (self.master,)

    @cached_property
    def layout(self) -> TableLayout:
        """See `AbstractTable`."""
        return TableLayout((np.asarray(self.nodes, float),), periodic=self.periodic)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class PlaneEffect(AbstractTable):
    """Error of an axis over the positions of two masters, mm.

    Values: node 1 of master 2 with all nodes of master 1, then node 2 …

    Attributes:
        masters: The two axes over whose positions it runs.
        nodes: Along master 1 and along master 2 in mm or °, ascending.
    """

    masters: tuple[str, str] = dataclasses.field()
    nodes: tuple[Float[np.ndarray, " _n1"], Float[np.ndarray, " _n2"]] = (
        dataclasses.field()
    )

    compensation = "plane"

    @cached_property
    def layout(self) -> TableLayout:
        """See `AbstractTable`."""
        return TableLayout(tuple(np.asarray(nodes, float) for nodes in self.nodes))
