"""Effects: what a stack is made of, as rows of a design over their unknowns."""

import abc
import dataclasses
from functools import cached_property
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Bool, Float, Int

from ...models import (
    AbstractLookup,
    EquidistantNodes,
    Leadscrew,
    Plane,
    Setpoints,
    linear_weights,
)
from ._prior import AbstractPrior, NoPrior, Smooth, chain
from ._readings import FitError, Readings, filled

Design = tuple[Int[np.ndarray, "t k"], Float[np.ndarray, "t k"]]
"""Unknowns that each reading touches, and their shares: a sparse matrix, k per row."""

_EVEN = 1e-9
"""Nodes count as equidistant when they lie on a straight line to this share of a cell."""
READ = 1e-3
"""Share of a node in a reading from which on it supports it: single precision, or digits cut off a
position, make smaller ones."""


class AbstractEffect(abc.ABC):
    """One effect that is linear in its unknowns: ``value = Σ shares · unknowns``."""

    ridge: float = 0.0
    """Precision that holds unknowns at zero, relative to their mean information."""
    least: float | Float[np.ndarray, " n"] = 0.0
    """Share in a reading above which it supports an unknown."""

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of unknowns."""

    @property
    @abc.abstractmethod
    def prior(self) -> AbstractPrior:
        """Prior of the unknowns."""

    @abc.abstractmethod
    def design(self, readings: Readings) -> Design:
        """Return the rows of the design for some readings."""


def touched(
    model: AbstractLookup,
    positions: Float[np.ndarray, "t d"],
    direction: Float[np.ndarray, " t"] | Int[np.ndarray, " t"] | None = None,
) -> Design:
    """Return the entries of a table that readings touch, and their weights.

    Args:
        model: The table; only its nodes count.
        positions: One column per master, in mm or °.
        direction: ±1 per reading for a leadscrew; positive where it is left out.
    """
    count = len(positions)
    if count == 0:
        return np.zeros((0, 1), dtype=np.int64), np.zeros((0, 1))
    sense = np.where(np.zeros(count) if direction is None else direction < 0, -1, 1)
    nodes, weights = _stencil(model, filled(positions, 64), filled(sense, 64))
    return np.asarray(nodes)[:count], np.asarray(weights)[:count]


@jax.jit
def _stencil(
    model: Any, positions: Float[Array, "n d"], direction: Int[Array, " n"]
) -> tuple[Array, Array]:
    stencil = model.stencil(*model.looked_up(positions, direction))
    return stencil.nodes, stencil.weights


def axis_nodes(nodes: Float[np.ndarray, " n"]) -> EquidistantNodes | Setpoints:
    """Return the controller model's nodes for node positions along one axis in mm or °."""
    interval = (nodes[-1] - nodes[0]) / max(len(nodes) - 1, 1)
    even = nodes[0] + interval * np.arange(len(nodes))
    if len(nodes) > 1 and np.abs(nodes - even).max() <= _EVEN * interval:
        start, step = jnp.asarray(nodes[0]), jnp.asarray(interval)
        return EquidistantNodes(start, step, len(nodes))
    return Setpoints(jnp.asarray(nodes))


@final
@dataclasses.dataclass(frozen=True, eq=False)
class TableEffect(AbstractEffect):
    """A table over one or two inputs, by the stencil of the controller's own model.

    Unknowns are the node values in an order in which neighbours stand near each other: the
    longer axis of a plane is the slow one, a ring is folded, branches follow each other.

    Attributes:
        nodes: Ascending node positions per axis in mm or °, master 1 of a plane first.
        branches: 1, or 2 for a bilateral table: motion in positive, then in negative direction.
        periodic: The last node is the first one again (modulo axis, one axis only).
        inputs: Name of the input along each axis: ``position 1``, ``position 2`` if left out.
    """

    nodes: tuple[Float[np.ndarray, " _n"], ...]
    branches: int = 1
    periodic: bool = False
    inputs: tuple[str, ...] = ()
    least = READ

    def __post_init__(self) -> None:
        names = tuple(f"position {k + 1}" for k in range(len(self.nodes)))
        object.__setattr__(self, "inputs", self.inputs or names)

    def check(self) -> None:
        """Refuse nodes that do not ascend."""
        for axis, nodes in enumerate(self.nodes):
            if len(nodes) > 1 and not (nodes[1:] > nodes[:-1]).all():
                msg = f"nodes along axis {axis + 1} must ascend."
                raise FitError(msg)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the values: ``(n,)``, ``(2, n)`` or ``(n2, n1)``; a periodic end is repeated."""
        counts = tuple(len(nodes) for nodes in reversed(self.nodes))
        return counts if self.branches == 1 else (self.branches, *counts)

    @cached_property
    def model(self) -> Plane | Leadscrew:
        """The controller's model of such a table, all values 0."""
        axes = [axis_nodes(line) for line in self.nodes]
        if len(axes) == 2:
            first, second = axes
            return Plane(first, second, jnp.zeros((second.count, first.count)))
        empty = jnp.zeros(axes[0].count)
        neg = None if self.branches == 1 else empty
        return Leadscrew(axes[0], empty, neg, self.periodic or None)

    @cached_property
    def offsets(self) -> tuple[int, ...]:
        """Distances between unknowns of one cell, ascending."""
        if len(self.nodes) == 2:
            fast = min(len(nodes) for nodes in self.nodes)
            return tuple(sorted({0, 1, fast - 1, fast, fast + 1}))
        return (0, 1, 2) if self.periodic else (0, 1)

    @property
    def size(self) -> int:
        return len(self.prior.order)

    @cached_property
    def place(self) -> Int[np.ndarray, " m"]:
        """Unknown of each node of the model, flattened; the end of a ring is its start."""
        if len(self.nodes) == 2:
            first, second = (len(nodes) for nodes in self.nodes)
            grid = np.arange(first * second)
            if first <= second:
                return grid
            return np.ascontiguousarray(grid.reshape(first, second).T).reshape(-1)
        count = len(self.nodes[0]) - int(self.periodic)
        index = np.arange(count)
        if self.periodic:
            # Both neighbours of a node stand at most two places from it.
            folded = np.where(2 * index < count, 2 * index, 2 * (count - index) - 1)
            index = np.append(folded, folded[0])
        return np.concatenate([index + count * k for k in range(self.branches)])

    @cached_property
    def unknowns(self) -> Int[np.ndarray, " n"]:
        """Unknown of each value in the order of the list, the end of a ring left out."""
        places = self.place.reshape(self.branches, -1)
        return places[:, :-1].reshape(-1) if self.periodic else places.reshape(-1)

    @cached_property
    def prior(self) -> Smooth:  # pyright: ignore[reportIncompatibleMethodOverride]
        """See `AbstractEffect`: differences along the axes of the table."""
        if len(self.nodes) == 2:
            first, second = (chain(nodes) for nodes in self.nodes)
            order = np.arange(first.size * second.size)
            if first.size <= second.size:
                return Smooth((second, first), 1, order, (2, 1))
            return Smooth((first, second), 1, order, (1, 2))
        axis = chain(self.nodes[0], self.periodic)
        return Smooth((axis,), self.branches, self.unknowns)

    def design(self, readings: Readings) -> Design:
        columns = [readings.inputs[name] for name in self.inputs]
        direction = None if self.branches == 1 else readings.inputs["direction"]
        nodes, shares = touched(self.model, np.stack(columns, axis=1), direction)
        return self.place[nodes], shares

    def to_values(self, table: np.ndarray) -> np.ndarray:
        """Return the unknowns of an array of the model's shape; the last of a ring ignored."""
        result = np.empty(self.size, dtype=table.dtype)
        result[self.place[::-1]] = table.reshape(-1)[::-1]
        return result

    def to_table(self, values: np.ndarray) -> np.ndarray:
        """Return unknowns in the shape of the table."""
        return np.ascontiguousarray(values[self.place].reshape(self.shape))


def node_shares(
    places: Float[np.ndarray, " t"], nodes: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "t n"]:
    """Return the share of each node at each place, NaN where that is NaN.

    Those of all laws of `axcomp.models` over given points: linear between, the ends held.
    """
    rows, (first, shares) = np.arange(len(places)), linear_weights(nodes, places)
    result = np.zeros((len(places), len(nodes) + 1))  # a table may have one node
    result[rows, first], result[rows, first + 1] = shares
    result[~np.isfinite(places)] = np.nan
    return result[:, :-1]


@final
@dataclasses.dataclass(frozen=True, eq=False)
class ColumnsEffect(AbstractEffect):
    """Unknowns whose design the caller has already, and never asks for here.

    Attributes:
        given: Prior of the unknowns.
        ridge, least: See `AbstractEffect`.
    """

    given: AbstractPrior
    ridge: float = 0.0
    least: float | Float[np.ndarray, " n"] = 0.0

    @property
    def prior(self) -> AbstractPrior:
        return self.given

    @property
    def size(self) -> int:
        return len(self.given.straight)

    def design(self, readings: Readings) -> Design:
        """See `AbstractEffect`; never called where the design is given."""
        raise AssertionError


@final
@dataclasses.dataclass(frozen=True, eq=False)
class GroupEffect(AbstractEffect):
    """Offsets of groups of readings (``run``), as contrasts; with a trend within each, too.

    What stands beside them keeps the mean of all groups that count; a ridge holds what no
    reading determines.

    Attributes:
        counted: Groups that count in the mean.
        trend: Name of the input with the centred place within it; None: offsets only.
        kept: Offsets, then trends, of each group that what stands beside them does as well, and
            keeps; orthonormal columns.
    """

    counted: Bool[np.ndarray, " g"]
    trend: str | None
    kept: Float[np.ndarray, "pg k"]

    ridge = 1e-9

    @cached_property
    def by_group(self) -> Float[np.ndarray, "pg c"]:
        """Offsets, then trends, of each group, by unknowns: orthonormal columns."""
        counts = self.counted if self.counted.any() else np.ones_like(self.counted)
        shown = self.kept * np.tile(counts, self.parts)[:, None]
        return np.asarray(scipy.linalg.null_space(shown.T))

    @property
    def parts(self) -> int:
        """Effects of each group: an offset, and a trend where there is one."""
        return 1 if self.trend is None else 2

    @property
    def size(self) -> int:
        return int(self.by_group.shape[1])

    @property
    def prior(self) -> AbstractPrior:
        return NoPrior(self.size)

    def design(self, readings: Readings) -> Design:
        run, groups = readings.inputs["run"], len(self.counted)
        shares = self.by_group[run]
        if self.trend is not None:
            place = readings.inputs[self.trend][:, None]
            shares = shares + self.by_group[groups + run] * place
        return np.broadcast_to(np.arange(self.size), shares.shape), shares
