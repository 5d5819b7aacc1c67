"""One compensation of one axis, a table above all, and how a controller may apply it otherwise."""

import abc
import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float, Int

from ....models import Conventions, step_response
from ...exchange import InUse, Model, Reading, offset_at
from ...exchange.controller._motion import Column
from ._log import LogMotion

Edge = Literal["hold", "zero", "line"]
"""Beyond the table: its last value, no offset, or a straight line onward, which no rule says."""

EDGES: tuple[Edge, ...] = ("hold", "zero", "line")
"""All of them."""

LogRows = Int[np.ndarray, " r"] | slice
"""Rows of a log, each as often as it is wanted."""

_AT_ONCE = 1 << 17
"""Rows that are evaluated at once."""


@dataclasses.dataclass(frozen=True)
class Change:
    """How a controller applies a compensation.

    Attributes:
        conventions: Rules of the controller.
        masters: Axes whose positions enter, instead of those of the list; or None.
        edge: Instead of what the conventions say; or None.
        shift: By how much the table lies further, in mm or ° per master; or empty. Where
            several places are tried at once, a line of it per row.
        cycles: Length of the filter instead of that of the lists; or None.
        turned: Each direction of motion gets what the list has for the other one.
    """

    conventions: Conventions
    masters: tuple[int, ...] | None = None
    edge: Edge | None = None
    shift: tuple[float, ...] | Float[np.ndarray, "r k"] = ()
    cycles: int | None = None
    turned: bool = False

    @property
    def is_shifted(self) -> bool:
        """Whether the table lies elsewhere."""
        return bool(np.any(self.shift))

    def moved(self, places: Float[np.ndarray, "r k"]) -> Float[np.ndarray, "r k"]:
        """Return where positions of the masters lie on the table."""
        return places - np.asarray(self.shift) if self.is_shifted else places


@dataclasses.dataclass(frozen=True)
class Way:
    """Extent of a table along one master, in mm or °.

    Attributes:
        low: First node.
        high: Last node.
        step: Shortest distance of two nodes.
        ends: Whether it has edges: a modulo table has none.
    """

    low: float
    high: float
    step: float
    ends: bool = True

    @classmethod
    def of(cls, places: Float[np.ndarray, " n"], ends: bool = True) -> "Way":
        """Return the extent of nodes in any order."""
        distinct = np.unique(places)
        step = float(np.min(np.diff(distinct))) if len(distinct) > 1 else 1.0
        return cls(float(distinct[0]), float(distinct[-1]), step, ends)


@dataclasses.dataclass(frozen=True)
class Parts:
    """What a channel adds: ``ahead + share · change``, share being that of reversal.

    Attributes:
        ahead: In positive direction of motion, per row, in mm or °.
        change: What the other direction changes of it; None where it does not matter.
    """

    ahead: Float[np.ndarray, " r"]
    change: Float[np.ndarray, " r"] | None = None


@dataclasses.dataclass(eq=False)
class AbstractChannel(abc.ABC):
    """One compensation of one axis along the motion of a log.

    Attributes:
        one: The compensation, and where it stands.
        motion: Of the log.
        reading: How its list is read.
        conventions: As they are assumed.
        reversal: Cycles over which a reversal is spread (P-AXIS-00243).
        others: Channels of the same axis, whose offsets may enter its look-up.
        axis: Logical number of the compensated axis.
        compensation: As in a job file.
        masters: Logical numbers of the axes that it looks at.
        ways: Extent of the table per master, the last ones; empty where there is none.
        swaps: Masters that a controller could take instead.
        two_way: Whether its list has other entries for the other direction of motion.
        cycles: Length of the filter, 0 or 1 where there is none.
        listed: Length that a list states for a filter that acts on switching alone.
        coarse: Why the log does not tell when something comes, in words; or nothing.
        relevant: Names of the conventions that it depends on, beside sign and edge.
        edge_rule: Name of the convention that says what happens beyond its table; empty:
            the last value is held.
    """

    one: InUse
    motion: LogMotion
    reading: Reading
    reversal: int = 0
    others: "Mapping[str, AbstractChannel]" = dataclasses.field(default_factory=dict)
    ways: tuple[Way, ...] = dataclasses.field(default=(), init=False)
    swaps: tuple[tuple[int, ...], ...] = dataclasses.field(default=(), init=False)
    two_way: bool = dataclasses.field(default=False, init=False)
    cycles: int = dataclasses.field(default=0, init=False)
    listed: int = dataclasses.field(default=0, init=False)
    coarse: str = dataclasses.field(default="", init=False)
    relevant: tuple[str, ...] = dataclasses.field(default=(), init=False)

    edge_rule: ClassVar[str] = ""

    def __post_init__(self) -> None:
        self.axis, self.compensation = self.one.axis, self.one.name
        self.masters = self.one.masters
        self.conventions = self.reading.conventions
        self._laws: dict[Conventions, Any] = {}
        self.prepare()

    @abc.abstractmethod
    def prepare(self) -> None:
        """Find the attributes that follow from list and motion.

        Raises:
            ExchangeError: If the list makes no model, or the log lacks what it looks at.
        """

    @abc.abstractmethod
    def parts(self, change: Change, rows: LogRows) -> Parts:
        """Return what is added at some rows of the log, before any filter."""

    def law(self, conventions: Conventions) -> Any:
        """Return the model that the list makes under some conventions."""
        if conventions not in self._laws:
            reading = dataclasses.replace(self.reading, conventions=conventions)
            self._laws[conventions] = self.one.model(reading)
        return self._laws[conventions]

    def edge(self, conventions: Conventions) -> Edge:
        """Return what conventions say of the rows beyond the table."""
        return getattr(conventions, self.edge_rule) if self.edge_rule else "hold"

    def cycles_under(self, conventions: Conventions) -> int:
        """Return the length of the filter under some conventions."""
        return self.cycles

    def cycles_of(self, change: Change) -> int:
        """Return the length of the filter."""
        if change.cycles is not None:
            return change.cycles
        return self.cycles_under(change.conventions)

    def share(self, change: Change) -> Column:
        """Return the share of the negative direction, 0 or 1 per row."""
        start = change.conventions.start_direction
        purpose = f"for the {self.compensation} of A{self.axis}"
        actual = change.conventions.direction_source == "actual"
        directions = self.motion.direction(self.axis, purpose, start, actual)
        return (directions < 0).astype(float)

    def distinguishes_actual(self) -> bool:
        """Return whether a log can tell directions of the command from actual ones."""
        timed = self.motion.has_actual(self.axis) and self.motion.cycle is not None
        return timed and self.axis not in self.motion.directions

    def rules(self, conventions: Conventions) -> list[Conventions]:
        """Return conventions with another choice each of those that matter."""
        return [
            conventions.from_dict({**conventions.to_dict(), convention.name: choice})
            for convention in conventions.listing()
            if convention.name in self.relevant
            for choice in convention.choices
            if choice != convention.value
        ]

    @property
    def plain(self) -> Change:
        """The channel as lists and conventions have it."""
        return Change(self.conventions)

    @functools.cached_property
    def acting(self) -> Column | None:
        """Share that acts per row, switched over cycles; None where the log does not say."""
        state = self.motion.acting.get((self.axis, self.compensation))
        if state is None:
            return None
        cycles = 0 if self.motion.cycle is None else self.listed
        return smoothed(state.astype(float), cycles)

    def column(self, change: Change) -> Column:
        """Return what is added per row, in mm or °."""
        return self.over_cycles(self.parts(change, slice(None)), change)

    def columns_at(
        self,
        change: Change,
        shifts: Float[np.ndarray, "s k"],
        rows: Int[np.ndarray, " r"],
    ) -> Float[np.ndarray, "s r"]:
        """Return what is added at some rows, in mm or °, for several places of the table.

        These are taken instead of that of the change; nothing lasts over cycles.

        All in one evaluation: a table takes longer to call than to look up.
        """
        share = None
        pieces = []
        batch = max(1, _AT_ONCE // max(len(rows), 1))
        for start in range(0, len(shifts), batch):
            batch_shifts = shifts[start : start + batch]
            tiled = np.tile(rows, len(batch_shifts))
            row_shifts = np.repeat(batch_shifts, len(rows), axis=0)
            parts = self.parts(dataclasses.replace(change, shift=row_shifts), tiled)
            ahead = parts.ahead.reshape(len(batch_shifts), len(rows))
            if parts.change is not None:
                share = self.share(change)[rows] if share is None else share
                ahead = ahead + share * parts.change.reshape(ahead.shape)
            if self.acting is not None:
                ahead = ahead * self.acting[rows]
            pieces.append(ahead)
        return np.concatenate(pieces)

    def over_cycles(self, parts: Parts, change: Change) -> Column:
        """Return what is added per cycle in mm or °, filter included."""
        cycles = 0 if self.motion.cycle is None else self.cycles_of(change)
        delay = change.conventions.filter_delay
        if parts.change is None:
            offset = smoothed(parts.ahead, cycles, delay)
        else:
            share = smoothed(self.share(change), cycles, delay)
            offset = np.asarray(parts.ahead + share * parts.change)
        if self.acting is not None:
            offset = offset * self.acting
        return delayed(offset, self.motion.clock)


def smoothed(values: Column, cycles: int, late: int = 0) -> Column:
    """Return values with each change distributed over cycles by sin² (S-06)."""
    if cycles <= 1:
        return values
    taps = np.diff(step_response(cycles, late), prepend=0.0)
    before = np.full(len(taps) - 1, values[0])
    filtered = np.convolve(np.concatenate([before, values]), taps, mode="valid")
    return np.asarray(filtered)


def delayed(values: Column, cycles: float) -> Column:
    """Return values that are read some cycles later, in between by a straight line."""
    if not cycles:
        return values
    rows = np.arange(len(values), dtype=float)
    return np.asarray(np.interp(rows - cycles, rows, values))


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
        if change.turned:
            ahead, behind = behind, ahead
        return Parts(ahead, behind - ahead)

    def places(
        self, masters: tuple[int, ...], actual: bool = False
    ) -> Float[np.ndarray, "t d"]:
        """Return positions of the masters, commanded or actual, a column each."""
        purpose = f"for the {self.compensation} table of A{self.axis}"
        columns = [self.motion.place(axis, purpose, actual) for axis in masters]
        return np.stack(columns, axis=1)

    def _beyond(
        self, model: Model, places: Float[np.ndarray, "r d"], direction: int, edge: Edge
    ) -> Float[np.ndarray, " r"]:
        """Return the offset with another rule for the rows beyond the table."""

        def at(rows: Float[np.ndarray, "r d"]) -> Float[np.ndarray, " r"]:
            return np.array(offset_at(model, rows, np.full(len(rows), direction)))

        offset = at(places)
        if edge == "hold" or not self.ways[0].ends:
            return offset
        low, high = np.array([(master.low, master.high) for master in self.ways]).T
        clamped = np.clip(places, low, high)
        excess = places - clamped
        if edge == "zero":
            return np.where(excess.any(axis=1), 0.0, offset)
        for k, master in enumerate(self.ways):
            if excess[:, k].any():
                inner = clamped.copy()
                inner[:, k] -= np.sign(excess[:, k]) * 0.5 * master.step
                slope = (offset - at(inner)) / (0.5 * master.step)
                offset += np.abs(excess[:, k]) * slope
        return offset
