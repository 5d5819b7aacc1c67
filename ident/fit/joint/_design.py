"""All columns of one compensated axis side by side: effects, datum, runs."""

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from ...core import (
    ColumnsEffect,
    FitError,
    Independent,
    NoPrior,
    Smooth,
    Stack,
    TableEffect,
    chain,
    node_shares,
)
from ._data import JointData
from ._effect import AbstractEffect, Block
from ._temperature import TemperatureEffect
from ._wander import Bridges, steps_of

BANDED = 400
"""Nodes of a plane from which on its part of the matrix is kept as a band."""


@dataclasses.dataclass(frozen=True)
class Component:
    """A part of the unknowns that has a meaning of its own.

    Attributes:
        name: In words.
        kind: Kind of compensation, ``"datum"``, ``"runs"`` or ``"wander"``; a thermal line
            falls into ``"temperature offset"`` and ``"temperature coefficient"``.
        effect: Number of the effect, −1 for datum, runs and wander.
        places: Column of each of its values.
        prior: Prior of its values, None without.
        table: The table as an effect, where its columns form a band.
    """

    name: str
    kind: str
    effect: int
    places: Int[np.ndarray, " p"]
    prior: Smooth | Independent | None = None
    table: TableEffect | None = None

    @property
    def prior_names(self) -> tuple[str, ...]:
        """Names of its weights."""
        return () if self.prior is None else self.prior.names

    @property
    def straight(self) -> Float[np.ndarray, "p z"]:
        """What its smoothness leaves alone, columns over its values."""
        if self.prior is None:
            return np.eye(len(self.places))
        return self.prior.straight


@dataclasses.dataclass(frozen=True)
class Design:
    """Columns of one axis over its usable rows.

    The nodes of the largest plane come first, in the order in which they are banded.

    Attributes:
        axis: Compensated axis.
        effects: Its effects, nodes placed.
        rows: Rows of the data that are used.
        columns: Shape ``(r, n)``.
        components: Effects, then the datum, then the runs and what they wander, if any.
        banded: Number of leading columns that form a band.
        labels: Of the values, per effect.
        knots: Run and place within it (0 to 1) of each run column.
        spans: First and last instant of each run in s; empty without drift.
        bridges: Between the knots; None without drift.
    """

    axis: str
    effects: tuple[AbstractEffect, ...]
    rows: Int[np.ndarray, " r"]
    columns: sp.csr_array
    components: tuple[Component, ...]
    banded: int
    labels: tuple[tuple[str, ...], ...]
    knots: tuple[tuple[int, float], ...]
    spans: tuple[tuple[float, float], ...] = ()
    bridges: Bridges | None = None

    @property
    def stated(self) -> tuple[Component, ...]:
        """Components that someone asked for: all but the wander."""
        return tuple(part for part in self.components if part.kind != "wander")

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return sum(len(component.places) for component in self.components)

    @property
    def datum(self) -> int:
        """Column of the datum."""
        return next(int(c.places[0]) for c in self.components if c.kind == "datum")

    @cached_property
    def stack(self) -> Stack:
        """The components as a stack, in the order of their columns."""
        ordered = sorted(self.components, key=lambda part: int(part.places.min()))
        effects = [
            ColumnsEffect(part.prior or NoPrior(len(part.places)), len(part.places))
            if part.table is None
            else part.table
            for part in ordered
        ]
        return Stack(tuple(effects), bool(self.banded))

    @cached_property
    def named(self) -> tuple[Component, ...]:
        """Components with weights, in the order of the weights."""
        ordered = sorted(self.components, key=lambda part: int(part.places.min()))
        return tuple(part for part in ordered if part.prior is not None)

    @cached_property
    def dense(self) -> tuple[Int[np.ndarray, "r k"], Float[np.ndarray, "r k"]]:
        """The columns as unknowns and shares per row, those of the band first."""
        counts = np.diff(self.columns.indptr)
        width = int(counts.max(initial=1))
        nodes = np.zeros((len(counts), width), np.int64)
        shares = np.zeros((len(counts), width))
        row = np.repeat(np.arange(len(counts)), counts)
        place = np.arange(len(row)) - np.repeat(self.columns.indptr[:-1], counts)
        nodes[row, place], shares[row, place] = self.columns.indices, self.columns.data
        return nodes, shares

    def places_of(self, effect: int) -> Int[np.ndarray, " p"]:
        """Return the columns of an effect's values, in their order."""
        own = [c.places for c in self.components if c.effect == effect]
        return np.concatenate(own)


def design_of(
    axis: str,
    effects: Sequence[AbstractEffect],
    data: JointData,
    drift: int,
    use: Bool[np.ndarray, " t"] | None,
    measured: bool = True,
    wander: bool = True,
) -> Design:
    """Return the columns of one axis.

    Args:
        axis: Compensated axis.
        effects: Its effects, nodes placed.
        data: Readings.
        drift: Pieces of the drift of each run; 0 = an offset only.
        use: Rows that may be used; None = all.
        measured: Only rows with an error count.
        wander: Whether a drift wanders between its knots.

    Raises:
        FitError: If no row is complete.
    """
    keep = np.ones(len(data), bool) if use is None else np.asarray(use, bool)
    if measured:
        keep = keep & np.isfinite(data.column("error", axis, "the fit"))
    if data.run_of(axis) is not None or drift:
        keep = keep & _clocked(data, drift)
    blocks = [effect.block(data) for effect in effects]
    for block in blocks:
        keep = keep & block.known
    rows = np.flatnonzero(keep)
    if not len(rows):
        names = ", ".join(effect.name for effect in effects)
        msg = f"axis {axis}: no reading has all that {names} need."
        raise FitError(msg)
    taken = data.take(rows)
    large = [
        (effect.size, k)
        for k, effect in enumerate(effects)
        if effect.compensation == "plane" and effect.size > BANDED
    ]
    first = max(large)[1] if large else -1
    sequence = sorted(range(len(blocks)), key=lambda k: (k != first, k))
    parts: list[sp.csr_array] = []
    components: dict[int, list[Component]] = {}
    count = 0
    for k in sequence:
        part = blocks[k].columns[rows]
        places = np.arange(count, count + effects[k].size)
        table = blocks[k].table if k == first else None
        if table is not None:
            # In the order of the table's unknowns, so that the matrix is a band.
            places = table.unknowns
            part = sp.csr_array(part[:, np.argsort(places)])
        parts.append(part)
        components[k] = _components(k, effects[k], blocks[k], places, table)
        count += effects[k].size
    ordered = [each for k in range(len(blocks)) for each in components[k]]
    parts.append(sp.csr_array(np.ones((len(rows), 1))))
    ordered.append(Component(f"datum of {axis}", "datum", -1, np.array([count])))
    count += 1
    run_columns, knots, spans, bridges = _run_columns(
        taken, taken.run_of(axis), drift, len(data)
    )
    if knots:
        parts.append(run_columns)
        places = np.arange(count, count + len(knots))
        ordered.append(_run_component(f"runs of {axis}", places, drift + 1))
        count += len(knots)
    if wander and bridges is not None and bridges.size:
        parts.append(bridges.columns())
        places = np.arange(count, count + bridges.size)
        name = f"wander of {axis}"
        ordered.append(Component(name, "wander", -1, places, bridges.prior))
    return Design(
        axis=axis,
        effects=tuple(effects),
        rows=rows,
        columns=sp.csr_array(sp.hstack(parts, format="csr")),
        components=tuple(ordered),
        banded=effects[first].size if large else 0,
        labels=tuple(block.labels for block in blocks),
        knots=knots,
        spans=spans,
        bridges=bridges if wander else None,
    )


def _run_component(name: str, places: Int[np.ndarray, " p"], per: int) -> Component:
    """Return the runs; a drift of several pieces is smooth, how smooth the readings say."""
    if per < 3:
        return Component(name, "runs", -1, places)
    runs = len(places) // per
    prior = Smooth(
        chain(np.linspace(0.0, 1.0, per)), None, runs, np.arange(len(places))
    )
    return Component(name, "runs", -1, places, prior)


def _components(
    number: int,
    effect: AbstractEffect,
    block: Block,
    places: Int[np.ndarray, " p"],
    table: TableEffect | None,
) -> list[Component]:
    if isinstance(effect, TemperatureEffect):
        result, first = [], 0
        for law, nodes in effect.nodes.items():
            own = places[first : first + len(nodes)]
            name = f"{law} of the {effect.name}"
            result.append(Component(name, f"temperature {law}", number, own))
            first += len(nodes)
        return result
    return [
        Component(effect.name, effect.compensation, number, places, block.prior, table)
    ]


def _clocked(data: JointData, drift: int) -> Bool[np.ndarray, " t"]:
    if drift and data.time is None:
        msg = "a drift needs the time of every reading, found none."
        raise FitError(msg)
    if drift and data.time is not None:
        return np.asarray(np.isfinite(data.time))
    return np.ones(len(data), bool)


def _run_columns(
    data: JointData, run: Int[np.ndarray, " t"] | None, drift: int, recorded: int
) -> tuple[
    sp.csr_array,
    tuple[tuple[int, float], ...],
    tuple[tuple[float, float], ...],
    Bridges | None,
]:
    """Return an offset per run, or the knots of its drift, when each run began and ended.

    One run alone has no offset. A drift has bridges between its knots, as many as all rows of
    the recording can tell.
    """
    count = len(data)
    run = np.zeros(count, np.int64) if run is None else run
    labels, index = np.unique(run, return_inverse=True)
    if len(labels) < 2 and not drift:
        return sp.csr_array((count, 0)), (), (), None
    per = drift + 1 if drift else 1
    share = np.ones((count, 1))
    spans: tuple[tuple[float, float], ...] = ()
    bridges: Bridges | None = None
    if drift and data.time is not None:
        low = np.full(len(labels), np.inf)
        high = np.full(len(labels), -np.inf)
        np.minimum.at(low, index, data.time)
        np.maximum.at(high, index, data.time)
        span = np.maximum(high - low, 1e-12)
        place = (data.time - low[index]) / span[index]
        share = node_shares(place, np.linspace(0.0, 1.0, per))
        spans = tuple(zip(low.tolist(), (low + span).tolist(), strict=True))
        steps = steps_of(recorded, len(labels), drift)
        bridges = Bridges(index, place, span, drift, steps)
    columns = index[:, None] * per + np.arange(per)
    matrix = sp.csr_array(
        (share.reshape(-1), columns.reshape(-1), np.arange(count + 1) * per),
        shape=(count, len(labels) * per),
    )
    knots = tuple(
        (int(label), float(place))
        for label in labels
        for place in (np.linspace(0.0, 1.0, per) if drift else (0.5,))
    )
    return matrix, knots, spans, bridges
