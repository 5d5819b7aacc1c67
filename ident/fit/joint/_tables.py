"""Tables as effects, over the stencils of the controller: leadscrew, cross, plane, crosstalk."""

import abc
import dataclasses
import itertools
from functools import cached_property
from typing import final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ....models import Conventions, Crosstalk, surface_through
from ...core import FitError
from ...kinds.crosstalk import BRANCHES, MOST_TESTS
from .._types import Samples, TableLayout
from ._effect import ANYWHERE, AbstractEffect, Block, JointData, Ranges, sparse_rows

_LEAST_ROWS = 1024
"""Rows are filled up to powers of two from here on, so that compiled code is used again."""


@dataclasses.dataclass(frozen=True, eq=False)
class AbstractTable(AbstractEffect):
    """A table over one or two masters; its values are in the order of the list.

    The end of a ring has no value of its own, it is the start again.
    """

    def __post_init__(self) -> None:
        for nodes in self.layout.nodes:
            if len(nodes) < 2 or not (np.diff(nodes) > 0).all():
                msg = f"{self.name}: expected at least two nodes in ascending order."
                raise FitError(msg)

    @property
    @abc.abstractmethod
    def layout(self) -> TableLayout:
        """Where the nodes lie."""

    @property
    def name(self) -> str:
        """See `AbstractEffect`."""
        return f"{self.compensation} of {self.axis} over {' and '.join(self.masters)}"

    @cached_property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return self.layout.effect.size

    @property
    def ranges(self) -> Ranges:
        """See `AbstractEffect`."""
        layout = self.layout
        ways = {("direction", self.axis): ANYWHERE} if layout.branches == 2 else {}
        return ways | {
            ("position", master): (float(nodes[0]), float(nodes[-1]))
            for master, nodes in zip(self.masters, layout.nodes, strict=True)
        }

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        layout, table = self.layout, self.layout.effect
        places = np.column_stack(
            [data.column("position", master, self.name) for master in self.masters]
        )
        known, side = np.asarray(np.isfinite(places).all(axis=1)), None
        if layout.branches == 2:
            way = data.column("direction", self.axis, self.name)
            known, side = known & np.isfinite(way), (way < 0).astype(np.int64)
        # What is not known goes to the first node, with share zero.
        filled = np.where(known[:, None], places, [nodes[0] for nodes in layout.nodes])
        samples = Samples(filled, np.zeros(len(known)), side)
        nodes, shares = table.design(layout.readings(samples))
        own = np.argsort(table.unknowns)
        columns = sparse_rows(own[nodes], shares, known, table.size)
        prior = dataclasses.replace(table.prior, order=own[table.prior.order])
        return Block(columns, known, self._labels(), prior, table)

    def _labels(self) -> tuple[str, ...]:
        layout = self.layout
        ways: tuple[str, ...] = ("",)
        if layout.branches == 2:
            ways = (", moving positive", ", moving negative")
        own = [
            nodes[: len(nodes) - int(layout.periodic)]
            for nodes in reversed(layout.nodes)
        ]
        return tuple(
            ", ".join(
                f"{master} = {value:g}"
                for master, value in zip(self.masters, reversed(place), strict=True)
            )
            + way
            for way in ways
            for place in itertools.product(*own)
        )

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(n,)``, ``(2, n)`` or ``(n2, n1)``; the end of a ring repeated."""
        table = self.layout.effect
        unknowns = np.empty(table.size, np.asarray(values).dtype)
        unknowns[table.unknowns] = values
        return table.to_table(unknowns)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class LeadscrewEffect(AbstractTable):
    """Error of an axis over its own position, mm.

    Values: one per node; bilateral: all for positive direction, then all for negative.

    Attributes:
        nodes: Along the axis in mm or °, ascending.
        bilateral: Whether each direction of motion has values of its own.
        periodic: The last node is the first one again (modulo axis).
    """

    nodes: Float[np.ndarray, " n"]
    bilateral: bool = False
    periodic: bool = False

    compensation = "leadscrew"

    @property
    def name(self) -> str:
        """See `AbstractEffect`."""
        return f"leadscrew of {self.axis}"

    @cached_property
    def layout(self) -> TableLayout:
        """See `AbstractTable`."""
        nodes = (np.asarray(self.nodes, float),)
        return TableLayout(nodes, 2 if self.bilateral else 1, self.periodic)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class CrossEffect(AbstractTable):
    """Error of an axis over the position of another, mm; one value per node.

    Attributes:
        master: Axis over whose position the table runs.
        nodes: Along the master in mm or °, ascending.
        periodic: The last node is the first one again (modulo master).
    """

    master: str
    nodes: Float[np.ndarray, " n"]
    periodic: bool = False

    compensation = "cross"

    @cached_property
    def masters(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return (self.master,)

    @cached_property
    def layout(self) -> TableLayout:
        """See `AbstractTable`."""
        return TableLayout((np.asarray(self.nodes, float),), periodic=self.periodic)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class PlaneEffect(AbstractTable):
    """Error of an axis over the positions of two masters, mm.

    Values: node 1 of master 2 with all nodes of master 1, then node 2 …

    Attributes:
        masters: The two axes over whose positions it runs.
        nodes: Along master 1 and along master 2 in mm or °, ascending.
    """

    masters: tuple[str, str] = dataclasses.field()
    nodes: tuple[Float[np.ndarray, " _n1"], Float[np.ndarray, " _n2"]] = (
        dataclasses.field()
    )

    compensation = "plane"

    @cached_property
    def layout(self) -> TableLayout:
        """See `AbstractTable`."""
        return TableLayout(tuple(np.asarray(nodes, float) for nodes in self.nodes))


@final
@dataclasses.dataclass(frozen=True, eq=False)
class CrosstalkEffect(AbstractEffect):
    """Error of an axis from the acceleration of another: entries of the tests in mm.

    Values: rows of `BRANCHES`, each with one value per test; where the directions do not
    differ, only the rows for acceleration and for deceleration, or the first of them where
    the controller has it for both (`Conventions.crosstalk_undirected`).

    Attributes:
        master: Axis that accelerates.
        acceleration: Specified, in mm/s², above 0.
        deceleration: Specified, in mm/s², below 0.
        adaptation: Axes on whose position the entries depend (mode − 1 of them).
        positions: Of the tests in mm, shape ``(p, k)``; None = one test.
        mode: 1, 2 or 3.
        velocity_dependent: Each direction has entries of its own.
        conventions: How signs and directions are told apart; None = the defaults.
    """

    master: str
    acceleration: float
    deceleration: float
    adaptation: tuple[str, ...] = ()
    positions: Float[np.ndarray, "p k"] | None = None
    mode: int = 1
    velocity_dependent: bool = False
    conventions: Conventions | None = None

    def __post_init__(self) -> None:
        if self.mode != 1 + len(self.adaptation) or self.mode not in (1, 2, 3):
            msg = (
                f"{self.name}: found mode {self.mode} with {len(self.adaptation)} "
                "adaptation axes, expected one axis less than the mode (1, 2 or 3)."
            )
            raise FitError(msg)
        if not (self.acceleration > 0 > self.deceleration):
            msg = (
                f"{self.name}: found acceleration {self.acceleration:g} and deceleration "
                f"{self.deceleration:g} mm/s², expected one above and one below 0."
            )
            raise FitError(msg)
        points = self.points
        if (
            points.shape[1] != len(self.adaptation)
            or not 1 <= len(points) <= MOST_TESTS
        ):
            msg = (
                f"{self.name}: found positions of shape {points.shape}, expected 1 to "
                f"{MOST_TESTS} tests along {len(self.adaptation)} adaptation axes."
            )
            raise FitError(msg)

    compensation = "crosstalk"

    @cached_property
    def masters(self) -> tuple[str, ...]:
        """The axis that accelerates, then the adaptation axes."""
        return (self.master, *self.adaptation)

    @property
    def name(self) -> str:
        """See `AbstractEffect`."""
        return f"crosstalk of {self.axis} from {self.master}"

    @property
    def points(self) -> Float[np.ndarray, "p k"]:
        """Positions of the tests in mm."""
        if self.positions is None:
            return np.zeros((1, 0))
        return np.asarray(self.positions, float)

    @property
    def rules(self) -> Conventions:
        """How signs and directions are told apart."""
        return Conventions() if self.conventions is None else self.conventions

    @property
    def rows(self) -> tuple[int, ...]:
        """Row of the values that stands for each row of `BRANCHES`."""
        if self.velocity_dependent:
            return (0, 1, 2, 3)
        return (0, 0, 1, 1) if self.rules.of_crosstalk["own_deceleration"] else (0,) * 4

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return (self.rows[-1] + 1) * len(self.points)

    @property
    def ranges(self) -> Ranges:
        """See `AbstractEffect`."""
        top = 1.2 * max(self.acceleration, -self.deceleration)
        found = {
            ("position", axis): (float(places.min()), float(places.max()))
            for axis, places in zip(self.adaptation, self.points.T, strict=True)
        }
        found["velocity", self.master] = ANYWHERE
        found["acceleration", self.master] = -top, top
        return found

    def model(self, values: Float[np.ndarray, "4 p"]) -> Crosstalk:
        """Return the controller's model with these entries in mm, their sign left alone.

        Raises:
            FitError: If the tests span no surface.
        """
        try:
            surface = surface_through(self.points)
        except ValueError as error:
            msg = f"{self.name}: {error}"
            raise FitError(msg) from error
        return Crosstalk(
            surface,
            jnp.asarray(values),
            jnp.asarray(float(self.acceleration)),
            jnp.asarray(float(self.deceleration)),
            velocity_dependent=self.velocity_dependent,
            **self.rules.of_crosstalk,
        )

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        inputs = [
            data.column("acceleration", self.master, self.name),
            data.column("velocity", self.master, self.name),
        ]
        inputs += [data.column("position", axis, self.name) for axis in self.adaptation]
        stacked = np.stack(inputs)
        known = np.asarray(np.isfinite(stacked).all(axis=0))
        count = len(known)
        size = max(_LEAST_ROWS, 1 << max(count - 1, 1).bit_length())
        padded = np.zeros((len(inputs), size))
        padded[:, :count] = np.where(known, stacked, 0.0)
        tests = len(self.points)
        model = self.model(np.zeros((4, tests)))
        stencil = model.stencil(
            padded[0], padded[1], np.ascontiguousarray(padded[2:].T)
        )
        branch, test = np.divmod(np.asarray(stencil.nodes)[:count], tests)
        index = np.array(self.rows)[branch] * tests + test
        weight = np.asarray(stencil.weights)[:count]
        columns = sparse_rows(index, weight, known, self.size)
        return Block(columns, known, self._labels())

    def _labels(self) -> tuple[str, ...]:
        words: tuple[str, ...] = BRANCHES
        if not self.velocity_dependent:
            words = ("acceleration", "deceleration")[: self.rows[-1] + 1]
        places = [
            "".join(
                f", {axis} = {value:g}"
                for axis, value in zip(self.adaptation, point, strict=True)
            )
            for point in self.points
        ]
        return tuple(word + place for word in words for place in places)

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(4, p)``, rows as `BRANCHES`; equal rows where directions do not differ."""
        return values.reshape(-1, len(self.points))[list(self.rows)]
