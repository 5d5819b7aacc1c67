"""Tables between lists and neighbouring formats: what they hold, and as a list."""

import dataclasses
from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Float

from ...data.lists import ListFile, new_list
from ...models import EquidistantNodes, Setpoints
from ..kinds import kind
from ._axis_models import AxisModels, load_model
from ._errors import ExchangeError
from ._units import LIST_UNITS

MASTERS = {"leadscrew": 0, "cross": 1, "plane": 2}
"""Compensations that are tables over positions, and how many masters each has."""
_GRID = 1e-3
"""mm or ° by which nodes may be off an even grid of whole list units."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class ExchangedTable:
    """A table as every format can say it; lengths in mm (or °).

    Attributes:
        compensation: ``leadscrew``, ``cross``, ``plane``; empty: the format does not say.
        axis: Number of the compensated axis, or None where the format does not say.
        masters: Numbers of the masters, master 1 first; empty where it does not say.
        nodes: Positions per master (leadscrew: of the axis itself).
        entries: As in the list: errors of a leadscrew, shape ``(1, n)`` or ``(2, n)`` by
            direction, offsets of a cross table ``(1, n)``, of a plane ``(j, i)``.
        modulo: A leadscrew table whose first and last node are the same place.
    """

    compensation: str
    axis: int | None
    masters: tuple[int, ...]
    nodes: tuple[Float[np.ndarray, " _"], ...]
    entries: Float[np.ndarray, "k n"]
    modulo: bool = False

    def stated(
        self, compensation: str | None, axis: int | None, masters: Sequence[int]
    ) -> "ExchangedTable":
        """Return the table with what the user states of it.

        Raises:
            ExchangeError: If the format says something else.
        """
        given = {"compensation": compensation, "axis": axis, "masters": tuple(masters)}
        changes = {key: value for key, value in given.items() if value}
        for key, value in changes.items():
            found = getattr(self, key)
            if found and found != value:
                raise ExchangeError(key, str(found), f"{value}, as stated")
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


def table_in(listing: ListFile, compensation: str | None = None) -> ExchangedTable:
    """Return the table that a compensation list holds.

    Args:
        listing: The list.
        compensation: Which one, where it holds several.

    Raises:
        ExchangeError: If there is none, or several and none is named.
    """
    held = load_model(listing)
    names = [name for name in MASTERS if name in held]
    if compensation is not None:
        names = [name for name in names if name == compensation]
    if len(names) != 1:
        found = f"tables {', '.join(names)}" if names else "no such table"
        expected = "one to convert: --compensation " + "|".join(MASTERS)
        raise ExchangeError(listing.source, found, expected)
    model = held[names[0]]
    nodes = tuple(np.asarray(way.positions) for way in model.ways)
    rows = np.stack([np.asarray(values) for values in model.tables])
    return ExchangedTable(
        compensation=names[0],
        axis=held.axis,
        masters=held.masters.get(names[0], ()),
        nodes=nodes,
        entries=rows[0] if len(nodes) == 2 else rows,
        modulo=bool(getattr(model, "modulo", None)),
    )


def list_with(table: ExchangedTable) -> tuple[ListFile, dict[str, int]]:
    """Return a new list that holds a table, and the entries to set in the axis list.

    Raises:
        ExchangeError: If axis, masters or compensation are not known, or a list cannot
            hold the nodes.
    """
    name = table.compensation
    if name not in MASTERS:
        raise ExchangeError(
            where="compensation", found=repr(name), expected=" or ".join(MASTERS)
        )
    if table.axis is None:
        raise ExchangeError(
            where="axis",
            found="no number",
            expected="--axis: the one that is compensated (kopf.achs_nr)",
        )
    if len(table.masters) != MASTERS[name]:
        found = f"{len(table.masters)} masters of a {name} table"
        expected = f"{MASTERS[name]}: --master and the number of each axis"
        raise ExchangeError(where="masters", found=found, expected=expected)
    rows = [table.entries] if len(table.nodes) == 2 else table.entries
    turning = {"modulo": True} if table.modulo else {}
    nodes = [_nodes(each) for each in table.nodes]
    model = kind(name).entries.models[0](*nodes, *rows, **turning)
    models = AxisModels(table.axis, {name: model}, {name: table.masters})
    entries, machine = models.to_entries()
    comment = (f"Compensation list of axis {table.axis}, converted by axcomp",)
    listing = new_list({"kopf.achs_nr": table.axis} | entries, comment=comment)
    return listing, {key: int(value) for key, value in machine.items()}


def _nodes(positions: Float[np.ndarray, " n"]) -> EquidistantNodes | Setpoints:
    """Return nodes at whole list units: evenly spaced where the positions are."""
    size = len(positions)
    if size > 1:
        start = _whole(positions[0])
        interval = _whole((positions[-1] - positions[0]) / (size - 1))
        if np.allclose(positions, start + interval * np.arange(size), 0.0, _GRID):
            return EquidistantNodes(np.asarray(start), np.asarray(interval), size)
    return Setpoints(np.round(positions * LIST_UNITS) / LIST_UNITS)


def _whole(value: float) -> float:
    return float(np.round(value * LIST_UNITS) / LIST_UNITS)
