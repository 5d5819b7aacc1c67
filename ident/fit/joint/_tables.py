"""Tables as effects: leadscrew, cross, plane, over the stencil of the controller."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float

from ...core._errors import FitError
from .._types import Samples, TableLayout
from ._data import JointData
from ._effect import AbstractEffect, AbstractOwnEffect, Block, sparse_rows


def _ascending(nodes: Float[np.ndarray, " _n"], name: str) -> None:
    if len(nodes) < 2 or not (np.diff(nodes) > 0).all():
        msg = f"{name}: expected at least two nodes in ascending order."
        raise FitError(msg)


def _table_block(
    layout: TableLayout,
    inputs: tuple[Float[np.ndarray, " t"], ...],
    branch: Float[np.ndarray, " t"] | None,
    labels: tuple[str, ...],
) -> Block:
    """Return the block of a table; values in the order of the list, the end of a ring once.

    Args:
        layout: Where the nodes lie.
        inputs: Position per input axis, NaN = not measured.
        branch: Direction of motion for a table with two branches.
        labels: Of the values.
    """
    positions = np.column_stack(inputs)
    known = np.asarray(np.isfinite(positions).all(axis=1))
    side = None
    if branch is not None:
        known &= np.isfinite(branch)
        side = (branch < 0).astype(np.int64)
    table = layout.effect
    # What is not known goes to the first node, with share zero.
    filled = np.where(known[:, None], positions, [nodes[0] for nodes in layout.nodes])
    readings = layout.readings(Samples(filled, np.zeros(len(known)), side))
    nodes, shares = table.design(readings)
    own = np.argsort(table.unknowns)
    columns = sparse_rows(own[nodes], shares, known, table.size)
    prior = dataclasses.replace(table.prior, order=own[table.prior.order])
    return Block(columns, known, labels, ("mm",) * table.size, prior, table)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class LeadscrewEffect(AbstractOwnEffect):
    """Error of an axis over its own position, mm.

    Values: one per node; bilateral: all for positive direction, then all for negative;
    periodic: the last node is the first again and has no value of its own.

    Attributes:
        nodes: Along the axis in mm or °, ascending.
        bilateral: Whether each direction of motion has values of its own.
        periodic: The last node is the first one again (modulo axis).
    """

    nodes: Float[np.ndarray, " n"]
    bilateral: bool = False
    periodic: bool = False

    def __post_init__(self) -> None:
        _ascending(self.nodes, self.name)

    @property
    def compensation(self) -> str:
        """See `AbstractEffect`."""
        return "leadscrew"

    @property
    def layout(self) -> TableLayout:
        """The table."""
        return TableLayout(
            (np.asarray(self.nodes, float),),
            2 if self.bilateral else 1,
            self.periodic,
        )

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return self.layout.effect.size

    def placed(self, data: JointData) -> "LeadscrewEffect":
        """See `AbstractEffect`."""
        del data
        return self

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        position = data.column("position", self.axis, self.name)
        way = None
        if self.bilateral:
            way = data.column("direction", self.axis, self.name)
        own = self.nodes[: len(self.nodes) - int(self.periodic)]
        ways = (", moving positive", ", moving negative") if self.bilateral else ("",)
        labels = tuple(f"{self.axis} = {node:g}{word}" for word in ways for node in own)
        return _table_block(self.layout, (position,), way, labels)

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(n,)``, or ``(2, n)`` bilateral; the end of a ring repeated."""
        rows = values.reshape(2 if self.bilateral else 1, -1)
        if self.periodic:
            rows = np.concatenate([rows, rows[:, :1]], axis=1)
        return rows if self.bilateral else rows[0]


@final
@dataclasses.dataclass(frozen=True, eq=False)
class CrossEffect(AbstractEffect):
    """Error of an axis over the position of another, mm; one value per node.

    Attributes:
        master: Axis over whose position the table runs.
        nodes: Along the master in mm or °, ascending.
        periodic: The last node is the first one again (modulo master).
    """

    master: str
    nodes: Float[np.ndarray, " n"]
    periodic: bool = False

    def __post_init__(self) -> None:
        _ascending(self.nodes, self.name)

    @property
    def compensation(self) -> str:
        """See `AbstractEffect`."""
        return "cross"

    @property
    def masters(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return (self.master,)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return ()

    @property
    def name(self) -> str:
        """See `AbstractEffect`."""
        return f"cross of {self.axis} over {self.master}"

    @property
    def layout(self) -> TableLayout:
        """The table."""
        nodes = (np.asarray(self.nodes, float),)
        return TableLayout(nodes, periodic=self.periodic)

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return len(self.nodes) - int(self.periodic)

    def placed(self, data: JointData) -> "CrossEffect":
        """See `AbstractEffect`."""
        del data
        return self

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        position = data.column("position", self.master, self.name)
        own = self.nodes[: self.size]
        labels = tuple(f"{self.master} = {node:g}" for node in own)
        return _table_block(self.layout, (position,), None, labels)

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(n,)``; the end of a ring repeated."""
        return np.concatenate([values, values[:1]]) if self.periodic else values


@final
@dataclasses.dataclass(frozen=True, eq=False)
class PlaneEffect(AbstractEffect):
    """Error of an axis over the positions of two masters, mm.

    Values: node 1 of master 2 with all nodes of master 1, then node 2 …

    Attributes:
        masters: The two axes over whose positions it runs.
        nodes: Along master 1 and along master 2 in mm or °, ascending.
    """

    masters: tuple[str, str]  # pyright: ignore[reportIncompatibleMethodOverride]
    nodes: tuple[Float[np.ndarray, " _n1"], Float[np.ndarray, " _n2"]]

    def __post_init__(self) -> None:
        for nodes in self.nodes:
            _ascending(nodes, self.name)

    @property
    def compensation(self) -> str:
        """See `AbstractEffect`."""
        return "plane"

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return ()

    @property
    def name(self) -> str:
        """See `AbstractEffect`."""
        return f"plane of {self.axis} over {self.masters[0]} and {self.masters[1]}"

    @property
    def layout(self) -> TableLayout:
        """The table."""
        return TableLayout(tuple(np.asarray(nodes, float) for nodes in self.nodes))

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return len(self.nodes[0]) * len(self.nodes[1])

    def placed(self, data: JointData) -> "PlaneEffect":
        """See `AbstractEffect`."""
        del data
        return self

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        first, second = (
            data.column("position", master, self.name) for master in self.masters
        )
        labels = tuple(
            f"{self.masters[0]} = {one:g}, {self.masters[1]} = {two:g}"
            for two in self.nodes[1]
            for one in self.nodes[0]
        )
        return _table_block(self.layout, (first, second), None, labels)

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(n2, n1)``."""
        return values.reshape(len(self.nodes[1]), len(self.nodes[0]))
