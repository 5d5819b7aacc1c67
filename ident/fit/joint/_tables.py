"""Tables as effects, over the stencils of the controller: leadscrew, cross, plane, crosstalk."""

import abc
import dataclasses
import itertools
from collections.abc import Sequence
from functools import cached_property
from typing import final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ....models import Conventions, Crosstalk, surface_through
from ...core import FitError, Readings, Smooth, TableEffect
from ...core._readings import padded
from ...kinds.crosstalk import BRANCHES, MOST_TESTS
from ._effect import AbstractEffect, Inputs, Ranges, Rows

_LEAST_ROWS = 1024
"""Rows are filled up to powers of two from here on, so that compiled code is used again."""


@dataclasses.dataclass(frozen=True, eq=False)
class AbstractTable(AbstractEffect):
    """A table over one or two masters; its values are in the order of the list.

    The end of a ring has no value of its own, it is the start again.
    """

    def __post_init__(self) -> None:
        for nodes in self.table_effect.nodes:
            if len(nodes) < 2 or not (np.diff(nodes) > 0).all():
                msg = f"{self.name}: expected at least two nodes in ascending order."
                raise FitError(msg)

    @cached_property
    @abc.abstractmethod
    def table_effect(self) -> TableEffect:
        """The table as an effect of the estimator, inputs by the names of the masters."""

    @property
    def name(self) -> str:
        """See `AbstractEffect`."""
        return f"{self.compensation} of {self.axis} over {' and '.join(self.masters)}"

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return self.table_effect.size

    @property
    def inputs(self) -> Inputs:
        """See `AbstractEffect`."""
        way = (("direction", self.axis),) if self.table_effect.way else ()
        return (*(("position", master) for master in self.masters), *way)

    @property
    def ranges(self) -> Ranges:
        """See `AbstractEffect`."""
        return {
            ("position", master): (float(nodes[0]), float(nodes[-1]))
            for master, nodes in zip(self.masters, self.table_effect.nodes, strict=True)
        }

    @cached_property
    def _place(self) -> Int[np.ndarray, " p"]:
        """Number of the value of each unknown of the estimator."""
        return np.argsort(self.table_effect.unknowns)

    @cached_property
    def prior(self) -> Smooth:
        """See `AbstractEffect`."""
        prior = self.table_effect.prior
        return dataclasses.replace(prior, order=self._place[prior.order])

    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        """See `AbstractEffect`."""
        table = self.table_effect
        names = table.inputs if table.way is None else (*table.inputs, table.way)
        inputs = dict(zip(names, columns, strict=True))
        nodes, shares = table.design(Readings(np.zeros(len(columns[0])), inputs))
        return self._place[nodes], shares

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        table = self.table_effect
        ways = (", moving positive", ", moving negative") if table.way else ("",)
        grid = [nodes[: len(nodes) - table.ring] for nodes in reversed(table.nodes)]
        places = [
            ", ".join(
                f"{master} = {value:g}"
                for master, value in zip(self.masters, reversed(place), strict=True)
            )
            for place in itertools.product(*grid)
        ]
        return tuple(place + way for way in ways for place in places)

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(n,)``, ``(2, n)`` or ``(n2, n1)``; the end of a ring repeated."""
        unknowns = np.empty_like(values)
        unknowns[self.table_effect.unknowns] = values
        return self.table_effect.to_table(unknowns)


def _floats(*nodes: Float[np.ndarray, " _n"]) -> tuple[Float[np.ndarray, " _n"], ...]:
    return tuple(np.asarray(each, float) for each in nodes)


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
    def table_effect(self) -> TableEffect:
        """See `AbstractTable`."""
        way = "direction" if self.bilateral else None
        return TableEffect(_floats(self.nodes), self.masters, way, self.periodic)


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
    def table_effect(self) -> TableEffect:
        """See `AbstractTable`."""
        return TableEffect(_floats(self.nodes), self.masters, None, self.periodic)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class PlaneEffect(AbstractTable):
    """Error of an axis over the positions of two masters, mm.

    Values: node 1 of master 2 with all nodes of master 1, then node 2 …

    Attributes:
        masters: The two axes over whose positions it runs.
        nodes: Along master 1 and along master 2 in mm or °, ascending.
    """

    masters: tuple[str, str] = dataclasses.field()  # pyright: ignore[reportIncompatibleVariableOverride]
    nodes: tuple[Float[np.ndarray, " _n1"], Float[np.ndarray, " _n2"]] = (
        dataclasses.field()
    )

    compensation = "plane"

    @cached_property
    def table_effect(self) -> TableEffect:
        """See `AbstractTable`."""
        return TableEffect(_floats(*self.nodes), self.masters)


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
    def branches(self) -> tuple[int, ...]:
        """Row of the values that stands for each row of `BRANCHES`."""
        if self.velocity_dependent:
            return (0, 1, 2, 3)
        return (0, 0, 1, 1) if self.rules.of_crosstalk["own_deceleration"] else (0,) * 4

    @property
    def inputs(self) -> Inputs:
        """See `AbstractEffect`."""
        motion = (("acceleration", self.master), ("velocity", self.master))
        return (*motion, *(("position", axis) for axis in self.adaptation))

    @property
    def ranges(self) -> Ranges:
        """See `AbstractEffect`."""
        top = 1.2 * max(self.acceleration, -self.deceleration)
        found = {
            ("position", axis): (float(places.min()), float(places.max()))
            for axis, places in zip(self.adaptation, self.points.T, strict=True)
        }
        return found | {("acceleration", self.master): (-top, top)}

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

    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        """See `AbstractEffect`."""
        count, tests = len(columns[0]), len(self.points)
        filled = padded({str(k): own for k, own in enumerate(columns)}, _LEAST_ROWS)
        pull, speed, *places = filled.values()
        stencil = self.model(np.zeros((4, tests))).stencil(
            pull, speed, np.reshape(places, (-1, len(pull))).T
        )
        branch, test = np.divmod(np.asarray(stencil.nodes)[:count], tests)
        index = np.array(self.branches)[branch] * tests + test
        return index, np.asarray(stencil.weights)[:count]

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        words: tuple[str, ...] = BRANCHES
        if not self.velocity_dependent:
            words = ("acceleration", "deceleration")[: self.branches[-1] + 1]
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
        return values.reshape(-1, len(self.points))[list(self.branches)]
