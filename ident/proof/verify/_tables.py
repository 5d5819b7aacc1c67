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
    places = (np.asarray(one.positions, dtype=float) for one in model.ways)
    return tuple(Way.of(each, ends) for each in places)


class TableChannel(AbstractChannel):
    """A table over positions of its masters."""

    def prepare(self) -> None:
        law = self.law(self.conventions)
        self.ways, self.two_way = ways_of(law), len(law.tables) > 1
        entry = self.one.kind.cycles
        self.listed = self.one.listing.integer(entry[0]) or 0 if entry else 0
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
        back = self._beyond(model, places, -1, edge)
        return (
            Parts(back, ahead - back) if change.turned else Parts(ahead, back - ahead)
        )

    def places(
        self, masters: tuple[int, ...], actual: bool = False
    ) -> Float[np.ndarray, "t d"]:
        """Return positions of the masters, commanded or actual, a column each."""
        why = f"for the {self.compensation} table of A{self.axis}"
        place = self.motion.actual if actual else self.motion.position
        return np.stack([place(axis, why) for axis in masters], axis=1)

    def _beyond(
        self, model: Model, places: Float[np.ndarray, "r d"], way: int, edge: Edge
    ) -> Float[np.ndarray, " r"]:
        """Return the offset with another rule for the rows beyond the table."""
        found = _at(model, places, way)
        if edge == "held" or not self.ways[0].ends:
            return found
        low = np.array([one.low for one in self.ways])
        high = np.array([one.high for one in self.ways])
        held = np.clip(places, low, high)
        out = places - held
        outside = out.any(axis=1)
        if edge == "zero":
            return np.where(outside, 0.0, found)
        for k, one in enumerate(self.ways):
            rows = np.flatnonzero(out[:, k])
            if rows.size:
                # All rows once more and not these alone: another number of rows would
                # be another program to compile.
                inner = held.copy()
                inner[rows, k] -= np.sign(out[rows, k]) * 0.5 * one.step
                nearby = _at(model, inner, way)[rows]
                slope = (found[rows] - nearby) / (0.5 * one.step)
                found[rows] += np.abs(out[rows, k]) * slope
        return found


def _at(
    model: Model, places: Float[np.ndarray, "r d"], way: int
) -> Float[np.ndarray, " r"]:
    return np.array(offset_at(model, places, np.full(len(places), way)))
