"""All columns of one compensated axis side by side: effects, datum, runs.

A reference may drift within its runs, and wander between the knots of that drift. Upon the
straight line between two knots such a walk is a bridge that begins and ends at zero. Its
variance per second is one weight beside those of the tables, by evidence. Bridges are noise, not
an effect: they cannot be confused with anything.
"""

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.ndimage import maximum, minimum

from ....models import linear_weights
from ... import core
from ..._recording import JointData
from .._identifiable import pins_of
from .._steps import Steps
from ._effect import AbstractEffect, Component, Rank

_BANDED = 400
"""Nodes of a plane from which on its part of the matrix is kept as a band."""
_REACHED = 0.1
"""Sum of squared shares, in readings, from which on an unknown counts as measured."""
_STEPS, _READINGS = 300, 50
"""Steps of all bridges together, at most, and readings per step, at least."""


@dataclasses.dataclass(frozen=True, eq=False)
class Course:
    """Where the reference of one axis stands in each run: linear between even instants.

    Attributes:
        runs: Their numbers; none where one run alone has no offset.
        spans: First and last instant of each run in s; empty without a drift.
        pieces: Of the stated drift of each run; 0 = an offset alone.
        steps: Of the bridge upon each piece; one has no bridge.
        counted: Whether the zero of each run is the machine's; empty: all are alike.
    """

    runs: tuple[int, ...] = ()
    spans: tuple[tuple[float, float], ...] = ()
    pieces: int = 0
    steps: int = 1
    counted: tuple[bool, ...] = ()

    @property
    def walk(self) -> core.Independent:
        """Prior of the bridges: a walk, of which a step of mean length has weight 1."""
        steps = np.diff(np.eye(self.steps + 1), axis=0)[:, 1:-1]
        length = np.array([high - low for low, high in self.spans])
        length = np.maximum(length, max(1e-6 * float(length.max()), 1e-300))
        share = np.repeat(length.mean() / length, self.pieces)
        matrix = sp.kron(sp.diags_array(np.sqrt(share)), steps)
        return core.Independent(sp.csr_array(matrix))

    def columns(
        self, data: JointData, axis: str, rows: Int[np.ndarray, " r"]
    ) -> dict[Rank, Any]:
        """Return the columns of offsets and bridges; rows of other runs have none of them."""
        if not self.runs:
            return {}
        run, labels = run_of(data, axis, rows), np.array(self.runs)
        index = np.minimum(np.searchsorted(labels, run), len(labels) - 1)
        place = np.zeros(len(rows))
        if self.spans and data.time is not None:
            low, high = np.array(self.spans).T
            since = data.time[rows] - low[index]
            place = np.clip(since / (high - low)[index], 0.0, 1.0)
        cells = self.pieces * self.steps
        instants = np.arange(cells + 1.0)
        cell, shares = linear_weights(instants, place * cells)
        first = index * (cells + 1)
        nodes = first + cell, first + np.minimum(cell + 1, cells)
        entries = (np.tile(np.arange(len(rows)), 2), np.concatenate(nodes))
        shares *= labels[index] == run
        shape = (len(rows), len(labels) * (cells + 1))
        at = sp.csr_array((shares.reshape(-1), entries), shape=shape)
        # At each instant of a run: shares of the knots of its drift, and of the bridges between.
        knots = core.node_shares(instants / self.steps, np.arange(self.pieces + 1.0))
        bridges = np.eye(cells + 1)[:, instants % self.steps > 0]
        parts = {Rank.RUNS: knots, Rank.WANDER: bridges}
        unit = sp.eye_array(len(labels))
        return {
            rank: sp.csr_array(at @ sp.kron(unit, block, format="csr"))
            for rank, block in parts.items()
            if block.shape[1]
        }


@dataclasses.dataclass(frozen=True, eq=False)
class Design:
    """Columns of one axis over its usable rows.

    Attributes:
        axis: Compensated axis.
        effects: Its effects, nodes placed; the largest plane first, its nodes in the order in
            which they are banded.
        data: All readings.
        rows: Rows of the data that are used.
        columns: Shape ``(r, n)``.
        components: Effects, then the datum, then the runs and what they wander, if any.
        course: What the reference does within its runs.
        aside: Runs that contradict the others, and do not count in their mean.
    """

    axis: str
    effects: tuple[AbstractEffect, ...]
    data: JointData
    rows: Int[np.ndarray, " r"]
    columns: sp.csr_array
    components: tuple[Component, ...]
    course: Course
    aside: tuple[int, ...] = ()

    @property
    def stated(self) -> tuple[Component, ...]:
        """Components that someone asked for: all but the wander."""
        return tuple(part for part in self.components if part.rank != Rank.WANDER)

    @cached_property
    def error(self) -> Float[np.ndarray, " r"]:
        """Readings of these rows in mm or °."""
        return np.asarray(self.data.error[self.axis][self.rows], float)

    @cached_property
    def steps(self) -> Steps:
        """Steps in which the instrument reads; a place is one of all axes."""
        columns = [*self.data.position.values(), *self.data.direction.values()]
        places = [np.nan_to_num(column)[self.rows] for column in columns]
        return Steps.of(self.error, places)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(np.asarray(self.columns.shape)[1])

    @property
    def datum(self) -> int:
        """Column of the datum."""
        return int(self.places_of_rank(Rank.DATUM)[0])

    def take(self, keep: Bool[np.ndarray, " r"]) -> "Design":
        """Return the design of some of its rows."""
        if keep.all():
            return self
        rows, columns = self.rows[keep], self.columns[keep]
        return dataclasses.replace(self, rows=rows, columns=columns)

    def places_of(self, effect: str) -> Int[np.ndarray, " p"]:
        """Return the columns of the values of an effect with this name, in their order."""
        return np.concatenate([c.places for c in self.components if c.owner == effect])

    def places_of_rank(self, rank: Rank) -> Int[np.ndarray, " p"]:
        """Return the columns of the datum, the runs or the wander; none without."""
        places = [c.places for c in self.components if c.rank == rank]
        return places[0] if places else np.zeros(0, np.int64)

    @cached_property
    def stack(self) -> core.Stack:
        """The components as a stack."""
        effects = [
            part.table
            or core.ColumnsEffect(
                part.prior or core.NoPrior(len(part.places)),
                least=core.TableEffect.least * self.largest[part.places],
            )
            for part in self.components
        ]
        return core.Stack(tuple(effects), self.components[0].table is not None)

    @cached_property
    def information(self) -> sp.csr_array:
        """Information of all rows on the unknowns, Σ x xᵀ, whatever was measured in them."""
        return sp.csr_array(self.columns.T @ self.columns)

    def counts_of_runs(self, seen: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Return how much each value of the runs counts in the mean of all: 1, or 0."""
        runs = self.course.runs
        counted = np.array(self.course.counted or [True] * len(runs))
        counted &= ~np.isin(runs, self.aside)
        result = np.repeat(counted, len(seen) // len(counted)) * (seen > 0.0)
        return result.astype(float) if result.any() else seen

    def over(self, shapes: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "m m"]:
        """Return the information on mixtures of the unknowns."""
        return np.asarray(shapes.T @ (self.information @ shapes))

    def spread(self, basis: Sequence[np.ndarray]) -> Float[np.ndarray, "n m"]:
        """Return shapes of the values of each stated component over all unknowns."""
        shapes = np.asarray(scipy.linalg.block_diag(*basis))
        result = np.zeros((self.size, shapes.shape[1]))
        result[np.concatenate([part.places for part in self.stated])] = shapes
        return result

    @cached_property
    def unheld(self) -> Float[np.ndarray, "n g"]:
        """Directions that neither rows nor smoothness hold, one per column."""
        priors = (prior.straight for prior, _, _ in self.stack.priors)
        straight = np.asarray(scipy.linalg.block_diag(*priors))
        return np.asarray(straight @ core.rooted(self.over(straight))[1])

    @property
    def pins(self) -> Float[np.ndarray, " n"]:
        """Precisions of single unknowns that hold these directions."""
        return pins_of(self.unheld, self.diagonal)

    @property
    def free(self) -> int:
        """Number of directions that the prior leaves alone and the readings tell."""
        return self.stack.free - int(self.unheld.shape[1])

    @cached_property
    def diagonal(self) -> Float[np.ndarray, " n"]:
        """Information on each unknown alone."""
        return np.asarray(self.information.diagonal())

    @cached_property
    def reached(self) -> Bool[np.ndarray, " n"]:
        """Unknowns that readings tell anything of: more than the noise of a position does."""
        least = _REACHED * np.square(self.largest)
        return np.asarray((self.diagonal >= least) & (self.diagonal > 0.0))

    @cached_property
    def largest(self) -> Float[np.ndarray, " n"]:
        """What a reading sees of each unknown at most; of all of one unit, as of lengths, alike."""
        largest = abs(self.columns).max(axis=0).toarray().reshape(-1)
        for component in self.components:
            places, effect = component.places, component.effect
            if effect is None or effect.one_unit:
                largest[places] = largest[places].max()
        return np.asarray(largest)


def design_of(
    axis: str,
    effects: Sequence[AbstractEffect],
    data: JointData,
    drift: int,
    use: Bool[np.ndarray, " t"] | None = None,
    measured: bool = True,
) -> Design:
    """Return the columns of one axis, the nodes of its effects placed.

    Arguments are as for `fit_joint`; rows without an error count unless ``measured``, and no drift
    wanders between its knots then.

    Raises:
        FitError: If no row is complete.
    """
    # The part of a large plane in the matrix is worth a band.
    planes = [e for e in effects if len(e.grid) == 2 and e.size > _BANDED]
    first = max(planes, key=lambda effect: effect.size, default=None)
    ordered = sorted(effects, key=lambda effect: effect is not first)
    blocks = [effect.block(data) for effect in ordered]
    keep = np.ones(len(data), bool) if use is None else np.asarray(use, bool)
    if measured:
        keep = keep & np.isfinite(data.column("error", axis, "the fit"))
    if drift:
        keep = keep & np.isfinite(data.clock_for("a drift"))
    rows = np.flatnonzero(np.all([keep, *(known for _, known in blocks)], axis=0))
    if not len(rows):
        names = ", ".join(effect.name for effect in effects)
        msg = f"axis {axis}: no reading has all that {names} need."
        raise core.FitError(msg)
    columns = [block[rows] for block, _ in blocks]
    components: list[Component] = []
    count = 0
    for effect in ordered:
        places = np.arange(count, count + effect.size)
        table = effect.table_effect if effect is first else None
        if table is not None:
            # In the order of the table's unknowns, so that the matrix is a band.
            places = table.unknowns
            columns[0] = sp.csr_array(columns[0][:, np.argsort(places)])
        parts = effect.components(places)
        components += [dataclasses.replace(part, table=table) for part in parts]
        count += effect.size
    course = _course(data, axis, rows, drift, measured)
    nuisance = course.columns(data, axis, rows)
    constant: Any = sp.csr_array(np.ones((len(rows), 1)))
    for rank, block in {Rank.DATUM: constant, **nuisance}.items():
        places = np.arange(count, count + block.shape[1])
        columns.append(block)
        components.append(_nuisance(axis, rank, places, course))
        count += block.shape[1]
    matrix = sp.csr_array(sp.hstack(columns, format="csr"))
    return Design(axis, tuple(ordered), data, rows, matrix, tuple(components), course)


def _nuisance(
    axis: str, rank: Rank, places: Int[np.ndarray, " p"], course: Course
) -> Component:
    """Return datum, runs or wander; a drift of several pieces is smooth, how much by evidence."""
    prior: core.Smooth | core.Independent | None = (
        course.walk if rank == Rank.WANDER else None
    )
    if rank == Rank.RUNS and course.pieces > 1:
        line = core.chain(np.linspace(0.0, 1.0, course.pieces + 1))
        prior = core.Smooth((line,), len(course.runs), np.arange(len(places)))
    name = f"{rank.name.lower()} of {axis}"
    level = "the run effects sum up to zero"
    if course.counted:
        level = "those of runs whose zero is the machine's sum up to zero"
    return Component(name, rank, places, prior=prior, level=level)


def run_of(
    data: JointData, axis: str, rows: Int[np.ndarray, " r"]
) -> Int[np.ndarray, " r"]:
    """Return the run of some rows; 0 without runs."""
    run = data.run_of(axis)
    return np.zeros(len(rows), np.int64) if run is None else run[rows]


def _course(
    data: JointData, axis: str, rows: Int[np.ndarray, " r"], drift: int, wander: bool
) -> Course:
    """Return what the reference does; one run alone has no offset."""
    labels, index = np.unique(run_of(data, axis, rows), return_inverse=True)
    runs = tuple(labels.tolist())
    counted: tuple[bool, ...] = ()
    if data.own_zero is not None and len(runs) > 1:
        counted = tuple((np.bincount(index, data.own_zero[rows]) > 0).tolist())
    counted = counted if any(counted) and not all(counted) else ()
    if not drift or data.time is None:
        return Course(runs if len(runs) > 1 else (), counted=counted)
    time, numbers = data.time[rows], np.arange(len(runs))
    low, high = (np.asarray(end(time, index, numbers)) for end in (minimum, maximum))
    if not high.max() > low.min():
        msg = f"axis {axis}: all readings have one time, expected a clock that runs for a drift."
        raise core.FitError(msg)
    # A clock may stand still within a run.
    high = np.maximum(high, np.nextafter(low, np.inf))
    spans = tuple(zip(low.tolist(), high.tolist(), strict=True))
    most = min(_STEPS, len(data) // _READINGS) // (len(runs) * drift)
    return Course(runs, spans, drift, max(most, 1) if wander else 1, counted)
