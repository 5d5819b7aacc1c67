"""Channels of the tables: cross, plane, leadscrew."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from ....models import Conventions, Cross, Leadscrew, Plane
from ...exchange import Model, offset_at
from ._channel import AbstractChannel, Change, Edge, Parts, Way
from ._motion import LogMotion


def ways_of(model: Model) -> tuple[Way, ...]:
    """Return the extent of a table per master."""
    ends = not (isinstance(model, Leadscrew) and model.modulo)
    found = []
    for one in model.ways:
        places = np.asarray(one.positions, dtype=float)
        step = float(np.min(np.diff(places))) if len(places) > 1 else 1.0
        found.append(Way(float(places[0]), float(places[-1]), step, ends))
    return tuple(found)


@dataclasses.dataclass(eq=False)
class TableChannel(AbstractChannel):
    """A table over positions of its masters.

    Attributes:
        read: The table that the list makes under some conventions.
        masters: Logical numbers, master 1 first.
        added: What else enters the position that is looked up, in mm or °, under some
            conventions (leadscrew with ``set_pos_without_comp`` 0).
    """

    axis: int
    compensation: str
    motion: LogMotion
    conventions: Conventions
    masters: tuple[int, ...]
    read: Callable[[Conventions], Model]
    swaps: tuple[tuple[int, ...], ...] = ()
    cycles: int = 0
    listed: int = 0
    relevant: tuple[str, ...] = ()
    added: Callable[[Conventions], Float[np.ndarray, " t"] | None] | None = None

    def __post_init__(self) -> None:
        self._models: dict[Conventions, Model] = {}
        self._stacked: dict[tuple[tuple[int, ...], bool], np.ndarray] = {}
        self.ways = ways_of(self.model(self.conventions))
        if self.listed <= 1 and self.compensation != "leadscrew":
            self.relevant = tuple(n for n in self.relevant if n != "table_filter")
        if self.cycles > 1:
            self.relevant = (*self.relevant, "filter_delay")
        if self.compensation == "plane" and self.motion.has_actual(*self.masters):
            self.relevant = (*self.relevant, "plane_input")
        model = self.model(self.conventions)
        bilateral = isinstance(model, Leadscrew) and model.neg is not None
        if bilateral and self.told_by_actual():
            self.relevant = (*self.relevant, "direction_source")
        self._places(self.masters)  # a log without a master is refused at once

    def model(self, conventions: Conventions) -> Model:
        """Return the table, its edge held: what lies beyond is judged apart."""
        if conventions not in self._models:
            held = dataclasses.replace(conventions, cross_edge="hold")
            self._models[conventions] = self.read(held)
        return self._models[conventions]

    def edge(self, conventions: Conventions) -> Edge:
        zero = self.compensation == "cross" and conventions.cross_edge == "zero"
        return "zero" if zero else "held"

    def cycles_under(self, conventions: Conventions) -> int:
        if self.compensation == "leadscrew":
            return self.cycles
        return self.listed if conventions.table_filter == "values" else 0

    def parts(
        self,
        change: Change,
        rows: Int[np.ndarray, " r"] | slice,
        shift: Float[np.ndarray, "r k"] | None = None,
    ) -> Parts:
        actual = (
            self.compensation == "plane" and change.conventions.plane_input == "actual"
        )
        places = self._places(change.masters or self.masters, actual)
        if self.added is not None:
            extra = self.added(change.conventions)
            if extra is not None:
                places = places + extra[:, None]
        places = places[rows]
        if shift is not None:
            places = places - shift
        elif change.is_shifted:
            places = places - np.asarray(change.shift)
        model = self.model(change.conventions)
        edge = change.edge or self.edge(change.conventions)
        ahead = self._beyond(model, places, 1, edge)
        if not isinstance(model, Leadscrew) or model.neg is None:
            return Parts(ahead)
        return Parts(ahead, self._beyond(model, places, -1, edge) - ahead)

    def _places(
        self, masters: tuple[int, ...], actual: bool = False
    ) -> Float[np.ndarray, "t d"]:
        if (masters, actual) not in self._stacked:
            why = f"for the {self.compensation} table of A{self.axis}"
            place = self.motion.actual if actual else self.motion.position
            columns = [place(axis, why) for axis in masters]
            self._stacked[masters, actual] = np.stack(columns, axis=1)
        return self._stacked[masters, actual]

    def _beyond(
        self, model: Model, places: Float[np.ndarray, "r d"], way: int, edge: Edge
    ) -> Float[np.ndarray, " r"]:
        """Return the offset with another rule for the rows beyond the table."""
        found = self._at(model, places, way)
        if edge == "held" or (isinstance(model, Leadscrew) and model.modulo):
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
                nearby = self._at(model, inner, way)[rows]
                slope = (found[rows] - nearby) / (0.5 * one.step)
                found[rows] += np.abs(out[rows, k]) * slope
        return found

    def _at(
        self, model: Model, places: Float[np.ndarray, "r d"], way: int
    ) -> Float[np.ndarray, " r"]:
        if isinstance(model, Cross | Plane):
            return np.array(offset_at(model, places))
        return np.array(offset_at(model, places, np.full(len(places), way)))
