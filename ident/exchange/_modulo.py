"""Masters that turn: tables over a modulo axis begin and end with the same value."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Int

from ...models import AbstractNodes, EquidistantNodes, ModuloNodes, Setpoints
from ._errors import ExchangeError
from ._units import LIST_UNITS

Ranges = Mapping[int, tuple[float, float]]
"""Modulo range in mm or ° by axis number, for the axes that have one."""


def wrapped(
    nodes: EquidistantNodes | Setpoints, span: tuple[float, float] | None
) -> EquidistantNodes | Setpoints | ModuloNodes:
    """Return the nodes as the look-up of their axis uses them."""
    return nodes if span is None else ModuloNodes(nodes, span)


def refuse_jump(
    nodes: AbstractNodes,
    values: Int[np.ndarray, "_p ..."],
    name: str,
) -> None:
    """Raise where a table over a modulo axis jumps at the transition (S-20).

    Args:
        nodes: Along the axis.
        values: In list units, the axis of the nodes first.
        name: Of the entries, for the message.

    Raises:
        ExchangeError: If nodes lie outside the range of the axis, or the first and the
            last value differ; between them and the ends of the range they are held.
    """
    if not isinstance(nodes, ModuloNodes):
        return
    places = np.asarray(nodes.positions)
    low, high = nodes.limits or (float(places[0]), float(places[-1]))
    slack = 1e-5 / LIST_UNITS
    if places[0] < low - slack or places[-1] > high + slack:
        raise ExchangeError(
            where=name,
            found=f"nodes from {places[0]:g} to {places[-1]:g}",
            expected=f"nodes within the modulo range of their axis, {low:g} to {high:g}",
        )
    refuse_unequal_ends(values, name)


def refuse_unequal_ends(values: Int[np.ndarray, "_p ..."], name: str) -> None:
    """Raise where a table that goes round has another value at its end.

    Raises:
        ExchangeError: Naming the first pair of values that differ.
    """
    unequal = np.flatnonzero(np.ravel(values[0] != values[-1]))
    if unequal.size:
        first, last = (np.ravel(values[k])[unequal[0]] for k in (0, -1))
        raise ExchangeError(
            where=name,
            found=f"{first} at the start and {last} at the end",
            expected="equal values at both ends of a modulo table",
        )
