"""Columns of a law over the temperature, and where its nodes lie."""

import dataclasses

import numpy as np
from jaxtyping import Float

MOST_NODES = 5
"""A law that the PLC interpolates needs no more."""
_SUPPORT = 4
"""Readings between two nodes below which no node is set."""


@dataclasses.dataclass(frozen=True)
class Shape:
    """Number of nodes of offset and coefficient: 1 constant, 2 linear, more piecewise."""

    offset: int
    coefficient: int = 0

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.offset + self.coefficient


def nodes_over(
    temperature: Float[np.ndarray, " t"], count: int
) -> Float[np.ndarray, " n"] | None:
    """Return equidistant nodes over the measured temperatures in °C.

    None where the readings between two of them are too few.
    """
    low, high = float(temperature.min()), float(temperature.max())
    if count == 1:
        return np.array([0.5 * (low + high)])
    nodes = np.linspace(low, high, count)
    if count > 2 and np.histogram(temperature, nodes)[0].min() < _SUPPORT:
        return None
    return nodes


def hats(
    temperature: Float[np.ndarray, " t"], nodes: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "t n"]:
    """Return the share of each node at each temperature; the ends are held."""
    if len(nodes) == 1:
        return np.ones((len(temperature), 1))
    cell = np.clip(
        np.searchsorted(nodes, temperature, side="right") - 1, 0, len(nodes) - 2
    )
    share = (temperature - nodes[cell]) / (nodes[cell + 1] - nodes[cell])
    share = np.clip(share, 0.0, 1.0)
    result = np.zeros((len(temperature), len(nodes)))
    rows = np.arange(len(temperature))
    result[rows, cell] = 1.0 - share
    result[rows, cell + 1] = share
    return result
