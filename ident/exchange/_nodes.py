"""Node positions as a list holds them: on a grid or one by one, also over axes that turn."""

import dataclasses
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...models import AbstractNodes, EquidistantNodes, ModuloNodes, Setpoints
from ._units import LIST_UNITS, ExchangeError, exact_in_list, expect


def as_array(
    values: Float[np.ndarray, "..."] | Float[Array, "..."] | float,
) -> Float[Array, "..."]:
    """Return numbers as the 64-bit array that a model holds."""
    return jnp.array(np.asarray(values, dtype=np.float64))


@dataclasses.dataclass(frozen=True)
class ListNodes:
    """Ascending nodes in list units: an even grid, or single setpoints.

    Attributes:
        integers: Their positions.
        interval: Of the grid; 0 for setpoints.
    """

    integers: tuple[int, ...]
    interval: int = 0

    @classmethod
    def grid(cls, start: int, interval: int, count: int) -> "ListNodes":
        """Return equidistant nodes."""
        return cls(tuple(start + interval * k for k in range(count)), interval)

    @property
    def count(self) -> int:
        """Number of nodes."""
        return len(self.integers)

    @property
    def positions(self) -> Float[np.ndarray, " n"]:
        """Positions in mm or °."""
        return np.asarray(self.integers, dtype=np.int64) / LIST_UNITS

    def model(self) -> EquidistantNodes | Setpoints:
        """Return the nodes of a model."""
        if not self.interval:
            return Setpoints(as_array(self.positions))
        start, step = (
            as_array(k / LIST_UNITS) for k in (self.integers[0], self.interval)
        )
        return EquidistantNodes(start, step, self.count)


def grid_nodes(start: float, interval: float, count: int, name: str) -> ListNodes:
    """Return equidistant nodes given in mm or °.

    Raises:
        ExchangeError: If start or interval is no multiple of a list unit, the interval
            is not positive, there are fewer than two nodes, or they leave SGN32.
    """
    expect(interval > 0, f"{name}.interval", f"{interval:g}", "more than 0")
    expect(count >= 2, f"{name}.points", count, "at least 2")
    first = int(exact_in_list(start, f"{name}.start"))
    step = int(exact_in_list(interval, f"{name}.interval"))
    exact_in_list(start + interval * (count - 1), f"{name}: last node")
    return ListNodes.grid(first, step, count)


def point_nodes(setpoints: Float[np.ndarray, " n"], name: str) -> ListNodes:
    """Return single nodes given in mm or °.

    Raises:
        ExchangeError: If one is no multiple of a list unit, they do not ascend, there
            are fewer than two, or they leave SGN32.
    """
    name, count = f"{name}.setpoints", len(setpoints)
    expect(count >= 2, name, f"{count} of them", "at least 2")
    integers = exact_in_list(setpoints, name)
    refuse_unordered(setpoints, name)
    return ListNodes(tuple(int(k) for k in integers))


def nodes_of_model(nodes: AbstractNodes, name: str) -> ListNodes:
    """Return the nodes of a model in list units; other places than multiples are refused."""
    if isinstance(nodes, ModuloNodes):
        nodes = nodes.nodes
    if isinstance(nodes, EquidistantNodes):
        return grid_nodes(float(nodes.start), float(nodes.interval), nodes.count, name)
    return point_nodes(np.asarray(nodes.positions, dtype=float), name)


def refuse_unordered(
    points: Float[np.ndarray, " n"] | Int[np.ndarray, " n"],
    name: str,
    expected: str = "ascending setpoints",
) -> None:
    """Raise where points are none, or at the first that is not above the one before."""
    expect(len(points), name, "no points", "at least one")
    for at in np.flatnonzero(np.diff(points) <= 0).tolist():
        pair = f"{points[at + 1]:g} after {points[at]:g} (index {at + 1})"
        raise ExchangeError(name, pair, expected)


Ranges = Mapping[int, tuple[float, float]]
"""Modulo range in mm or ° by axis number, for the axes that have one."""


def wrapped(
    nodes: EquidistantNodes | Setpoints, span: tuple[float, float] | None
) -> EquidistantNodes | Setpoints | ModuloNodes:
    """Return the nodes as the look-up of their axis uses them."""
    return nodes if span is None else ModuloNodes(nodes, span)


def refuse_jump(
    nodes: AbstractNodes, values: Int[np.ndarray, "_p ..."], name: str
) -> None:
    """Raise where a table over a modulo axis jumps at the transition (S-20).

    Nodes lie outside the range of the axis, or the first and the last value differ: between
    them and the ends of the range they are held. Values are in list units, the axis of the
    nodes first; the name is that of the entries.
    """
    if not isinstance(nodes, ModuloNodes):
        return
    places = np.asarray(nodes.positions)
    low, high = nodes.limits or (float(places[0]), float(places[-1]))
    slack = 1e-5 / LIST_UNITS
    words = f"nodes from {places[0]:g} to {places[-1]:g}"
    expected = f"nodes within the modulo range of their axis, {low:g} to {high:g}"
    within = low - slack <= places[0] and places[-1] <= high + slack
    expect(within, name, words, expected)
    refuse_unequal_ends(values, name)


def refuse_unequal_ends(values: Int[np.ndarray, "_p ..."], name: str) -> None:
    """Raise where a table that goes round has another value at its end, in list units."""
    ends = np.stack([np.ravel(values[0]), np.ravel(values[-1])], axis=1)
    for first, last in ends[ends[:, 0] != ends[:, 1]]:
        words = f"{first} at the start and {last} at the end"
        raise ExchangeError(name, words, "equal values at both ends of a modulo table")
