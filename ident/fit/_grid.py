"""The nodes of a table in the order in which the normal matrix is banded.

Every table is brought to one form: a slow index ``l`` along the longest axis and a fast
index ``s``. For a plane ``s`` runs along the shorter axis, for a 1-D table it is the branch
(one or two directions of motion). The matrix is then banded with half-bandwidth a few
times the length of the short side, and a bilateral table is two chains side by side.
"""

import dataclasses
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from ._types import Samples, TableLayout

MANY = 100_000
"""From this many readings on, compiled code pays for loading the compiler."""


_EVEN = 1e-9
"""Nodes count as equidistant when they lie on a straight line to this share of a cell."""


def spacing_of(nodes: Float[np.ndarray, " n"]) -> float | None:
    """Return the distance of equidistant nodes, None where they are not."""
    interval = (nodes[-1] - nodes[0]) / max(len(nodes) - 1, 1)
    even = nodes[0] + interval * np.arange(len(nodes))
    if np.abs(nodes - even).max() <= _EVEN * interval:
        return float(interval)
    return None


@dataclasses.dataclass(frozen=True)
class Located:
    """Cell and place within it of every reading: the stencil in compact form.

    Corner ``(a, b)`` of cell ``(l, s)`` is node ``(l + a, s + b)`` with weight
    ``(u if a else 1 - u) · (v if b else 1 - v)``; branches have ``b = 0`` only.
    """

    l: Int[np.ndarray, " t"]
    s: Int[np.ndarray, " t"]
    u: Float[np.ndarray, " t"]
    v: Float[np.ndarray, " t"]

    def take(self, keep: Bool[np.ndarray, " t"] | Int[np.ndarray, " n"]) -> "Located":
        """Return the readings for which ``keep`` is true, or those of these rows."""
        return Located(self.l[keep], self.s[keep], self.u[keep], self.v[keep])


@dataclasses.dataclass(frozen=True)
class Grid:
    """Slow and fast axis of a layout, and the way back to the shape of the table."""

    layout: TableLayout

    @cached_property
    def planar(self) -> bool:
        """Whether the fast axis carries positions (a plane) and not branches."""
        return len(self.layout.nodes) == 2

    @cached_property
    def slow_column(self) -> int:
        """Column of the positions that runs along the slow axis."""
        if not self.planar:
            return 0
        n1, n2 = (len(nodes) for nodes in self.layout.nodes)
        return 1 if n2 >= n1 else 0

    @cached_property
    def slow_nodes(self) -> Float[np.ndarray, " n"]:
        """Node positions along the slow axis; the repeated end of a modulo table included."""
        return np.asarray(self.layout.nodes[self.slow_column], float)

    @cached_property
    def fast_nodes(self) -> Float[np.ndarray, " n"]:
        """Node positions along the fast axis of a plane."""
        return np.asarray(self.layout.nodes[1 - self.slow_column], float)

    @cached_property
    def slow(self) -> int:
        """Number of different nodes along the slow axis."""
        return len(self.slow_nodes) - int(self.layout.periodic)

    @cached_property
    def fast(self) -> int:
        """Number of nodes along the fast axis, or of branches."""
        return len(self.fast_nodes) if self.planar else self.layout.branches

    @cached_property
    def size(self) -> int:
        """Number of unknown node values."""
        return self.slow * self.fast

    @cached_property
    def rank(self) -> Int[np.ndarray, " slow"]:
        """Place of each slow index in the band; folded for a ring, so that it stays banded."""
        index = np.arange(self.slow)
        if not self.layout.periodic:
            return index
        return np.where(2 * index < self.slow, 2 * index, 2 * (self.slow - index) - 1)

    def spread(self, reach: int) -> int:
        """Half-bandwidth along the slow axis of a coupling over ``reach`` neighbours."""
        reach = min(reach, self.slow - 1)
        return min(2 * reach, self.slow - 1) if self.layout.periodic else reach

    def locate(self, samples: Samples) -> Located:
        """Return the cell of every reading; the edge of the table is held outside."""
        l, u = _locate(
            samples.positions[:, self.slow_column],
            self.slow_nodes,
            self.layout.periodic,
        )
        if self.planar:
            s, v = _locate(
                samples.positions[:, 1 - self.slow_column], self.fast_nodes, False
            )
        else:
            branch = samples.branch
            # Directions mean nothing to a table that has only one.
            s = (
                np.zeros(len(l), l.dtype)
                if branch is None or self.layout.branches == 1
                else branch.astype(l.dtype)
            )
            v = np.zeros(len(l))
        return Located(l, s, u, v)

    def neighbour(
        self, l: Int[np.ndarray, " t"], step: int = 1
    ) -> Int[np.ndarray, " t"]:
        """Return the slow index ``step`` further, around the ring where there is one."""
        return (l + step) % self.slow if self.layout.periodic else l + step

    def to_table(self, values: np.ndarray) -> np.ndarray:
        """Bring an array over ``(slow, fast)`` to `TableLayout.shape`."""
        if self.planar:
            return np.ascontiguousarray(values if self.slow_column == 1 else values.T)
        if self.layout.periodic:
            values = np.concatenate([values, values[:1]])
        return np.ascontiguousarray(
            values.T if self.layout.branches == 2 else values[:, 0]
        )

    def from_table(self, table: np.ndarray) -> np.ndarray:
        """Bring an array of `TableLayout.shape` to ``(slow, fast)``."""
        if self.planar:
            return np.ascontiguousarray(table if self.slow_column == 1 else table.T)
        values = table.T if self.layout.branches == 2 else table[:, None]
        return np.ascontiguousarray(values[: self.slow])


def _locate(
    position: Float[np.ndarray, " t"], nodes: Float[np.ndarray, " n"], periodic: bool
) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    if len(nodes) == 1:
        return np.zeros(len(position), np.int64), np.zeros(len(position))
    if len(position) >= MANY:
        return _locate_many(position, nodes, periodic)
    if periodic:
        position = nodes[0] + np.mod(position - nodes[0], nodes[-1] - nodes[0])
    cell = np.searchsorted(nodes, position, side="right") - 1
    # Of a few numbers `numpy.clip` would take most of the time.
    cell = np.minimum(np.maximum(cell, 0), len(nodes) - 2)
    start = nodes[cell]
    fraction = (position - start) / (nodes[cell + 1] - start)
    return cell, np.minimum(np.maximum(fraction, 0.0), 1.0)


def _locate_many(
    position: Float[np.ndarray, " t"], nodes: Float[np.ndarray, " n"], periodic: bool
) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, " t"]]:
    from . import _compiled

    axis = _compiled.axis_nodes(nodes, periodic)
    blocks = [
        _compiled.locate(part, axis)
        for (part,) in _compiled.blocks_of(np.ascontiguousarray(position))
    ]
    cell, fraction = (
        np.concatenate([np.asarray(block[part]) for block in blocks])[: len(position)]
        for part in (0, 1)
    )
    return cell, fraction
