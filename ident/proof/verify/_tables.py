"""What a log shows of a table over positions."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Float

from ....models import Conventions
from ...exchange import Model, offset_at
from ._channel import AbstractChannel, Change, Edge, LogRows, Parts, Way


def ways_of(model: Model, ends: bool = True) -> tuple[Way, ...]:
    """Return the extent of a table per master, with or without edges."""
    places = (np.asarray(line.positions, dtype=float) for line in model.ways)
    return tuple(Way.of(nodes, ends) for nodes in places)


class TableChannel(AbstractChannel):
    """A table over positions of its masters."""

    def prepare(self) -> None:
        law = self.law(self.conventions)
        self.ways, self.two_way = ways_of(law), len(law.tables) > 1
        names = self.one.kind.cycles
        self.listed = self.one.listing.integer(names[0]) or 0 if names else 0
        self.places(self.masters)  # a log without a master is refused at once

    def law(self, conventions: Conventions) -> Any:
        """Return the table, its edge held: what lies beyond is judged apart."""
        return super().law(dataclasses.replace(conventions, cross_edge="hold"))

    def cycles_under(self, conventions: Conventions) -> int:
        return self.listed if conventions.table_filter == "values" else 0

    def positions(self, change: Change) -> Float[np.ndarray, "t d"]:
        """Return the positions that are looked up, in mm or °."""
        return self.places(change.masters or self.masters)

    def parts(self, change: Change, rows: LogRows) -> Parts:
        places = change.moved(self.positions(change)[rows])
        model: Model = self.law(change.conventions)
        edge = change.edge or self.edge(change.conventions)
        ahead = self._beyond(model, places, 1, edge)
        if len(model.tables) == 1:
            return Parts(ahead)
        behind = self._beyond(model, places, -1, edge)
        return (
            Parts(behind, ahead - behind)
            if change.turned
            else Parts(ahead, behind - ahead)
        )

    def places(
        self, masters: tuple[int, ...], actual: bool = False
    ) -> Float[np.ndarray, "t d"]:
        """Return positions of the masters, commanded or actual, a column each."""
        purpose = f"for the {self.compensation} table of A{self.axis}"
        place = self.motion.actual if actual else self.motion.position
        return np.stack([place(axis, purpose) for axis in masters], axis=1)

    def _beyond(
        self, model: Model, places: Float[np.ndarray, "r d"], direction: int, edge: Edge
    ) -> Float[np.ndarray, " r"]:
        """Return the offset with another rule for the rows beyond the table."""
        offset = _at(model, places, direction)
        if edge == "held" or not self.ways[0].ends:
            return offset
        low = np.array([master.low for master in self.ways])
        high = np.array([master.high for master in self.ways])
        clamped = np.clip(places, low, high)
        excess = places - clamped
        is_outside = excess.any(axis=1)
        if edge == "zero":
            return np.where(is_outside, 0.0, offset)
        for k, master in enumerate(self.ways):
            rows = np.flatnonzero(excess[:, k])
            if rows.size:
                # All rows once more and not these alone: another number of rows would
                # be another program to compile.
                inner = clamped.copy()
                inner[rows, k] -= np.sign(excess[rows, k]) * 0.5 * master.step
                nearby = _at(model, inner, direction)[rows]
                slope = (offset[rows] - nearby) / (0.5 * master.step)
                offset[rows] += np.abs(excess[rows, k]) * slope
        return offset


def _at(
    model: Model, places: Float[np.ndarray, "r d"], direction: int
) -> Float[np.ndarray, " r"]:
    return np.array(offset_at(model, places, np.full(len(places), direction)))
