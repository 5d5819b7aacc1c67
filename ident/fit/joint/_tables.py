"""Tables as effects, over the stencils of the controller: leadscrew, cross and plane."""

import abc
import contextlib
import dataclasses
import itertools
from collections.abc import Sequence
from functools import cached_property
from typing import Any, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from .... import models
from ...core import FitError, Readings, Smooth, TableEffect, axis_nodes
from ._effect import AbstractEffect, Component, Inputs, Number, Rank, Rows, numbers_of

Numbers = Sequence[Number] | Float[np.ndarray, " n"]
_DIGITS = 10
"""Of node positions in mm or °: ``3 * 0.1`` is the reading that says 0.3."""


@dataclasses.dataclass(frozen=True, eq=False)
class AbstractTable(AbstractEffect):
    """A table over one or two masters; its values are in the order of the list, a ring cut open."""

    def __post_init__(self) -> None:
        for nodes in self.grid:
            ascending = np.isfinite(nodes).all() and (np.diff(nodes) > 0).all()
            if len(nodes) < 2 or not ascending:
                msg = f"{self.name}: expected at least two nodes in ascending order."
                raise FitError(msg)

    @cached_property
    @abc.abstractmethod
    def table_effect(self) -> TableEffect:
        """The table as an effect of the estimator, inputs by the names of the masters."""

    @property
    def name(self) -> str:
        return f"{self.compensation} of {self.axis} over {' and '.join(self.masters)}"

    @property
    def size(self) -> int:
        return self.table_effect.size

    @property
    def inputs(self) -> Inputs:
        both = self.table_effect.branches == 2
        direction = (("direction", self.axis),) if both else ()
        return (*(("position", master) for master in self.masters), *direction)

    @cached_property
    def _place(self) -> Int[np.ndarray, " p"]:
        """Number of the value of each unknown of the estimator."""
        return np.argsort(self.table_effect.unknowns)

    @cached_property
    def prior(self) -> Smooth:
        """See `AbstractEffect`: that of the estimator, values in the order of the list."""
        prior = self.table_effect.prior
        return dataclasses.replace(prior, order=self._place[prior.order])

    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        table = self.table_effect
        inputs = dict(zip((*table.inputs, "direction"), columns, strict=False))
        nodes, shares = table.design(Readings(np.zeros(len(columns[0])), inputs))
        return self._place[nodes], shares

    @cached_property
    def labels(self) -> tuple[str, ...]:
        table = self.table_effect
        ways = (", moving positive", ", moving negative")
        motions = ways if table.branches == 2 else ("",)
        grid = [
            [f"{master} = {value:g}" for value in nodes[: len(nodes) - table.periodic]]
            for master, nodes in zip(self.masters, table.nodes, strict=True)
        ]
        places = [", ".join(reversed(at)) for at in itertools.product(*grid[::-1])]
        return tuple(place + motion for motion in motions for place in places)

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(n,)``, ``(2, n)`` or ``(n2, n1)``; the end of a ring repeated."""
        return self.table_effect.to_table(values[self._place])

    def offsets(
        self, model: Any, *places: Float[np.ndarray, " _n"]
    ) -> Float[np.ndarray, "..."]:
        mesh = np.stack(np.meshgrid(*(places or self.grid)), axis=-1)
        rows = mesh.reshape(-1, mesh.shape[-1])
        signs = (1, -1)[: self.table_effect.branches]
        offsets = [
            np.asarray(model.offset(*model.looked_up(rows, np.full(len(rows), sign))))
            for sign in signs
        ]
        return np.reshape(offsets, ((2,) if len(signs) > 1 else ()) + mesh.shape[:-1])


def _nodes_of(
    name: str, key: str, given: Any, start: Any, interval: Any, points: Any
) -> Float[np.ndarray, " n"]:
    """Return nodes along a line: given one by one under a key, or else equidistant.

    Raises:
        FitError: If they are given in both ways or in none, or are no numbers.
    """
    missing = [each is None for each in (start, interval, points)]
    if given is not None and all(missing):
        return np.asarray(given, np.float64)
    if given is not None or any(missing):
        msg = f"{name}: expected either {key} or start, interval and points"
        raise FitError(msg)
    with contextlib.suppress(TypeError, ValueError):
        if int(points) == points:
            nodes = float(start) + float(interval) * np.arange(int(points))
            return np.round(nodes, _DIGITS)
    msg = (
        f"{name}: found start {start!r}, interval {interval!r} and points {points!r},"
        " expected two numbers and a whole number"
    )
    raise FitError(msg)


@dataclasses.dataclass(frozen=True, eq=False)
class AbstractLine(AbstractTable):
    """A table along one axis, its nodes one by one or equidistant.

    Attributes:
        setpoints: Positions of the nodes in mm or °, ascending; or instead of them:
        start: Position of the first node.
        interval: Distance of nodes.
        points: Number of nodes.
        modulo: The last node is the first one again (modulo axis).
    """

    setpoints: Numbers | None = None
    modulo: bool = dataclasses.field(default=False, kw_only=True)
    start: Number | None = dataclasses.field(default=None, kw_only=True)
    interval: Number | None = dataclasses.field(default=None, kw_only=True)
    points: int | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if self.setpoints is not None:
            nodes = np.atleast_1d(numbers_of(self.setpoints))
            if nodes.ndim > 1:
                nodes = np.zeros(0)  # rows and columns are no line
            object.__setattr__(self, "setpoints", tuple(nodes.tolist()))
        super().__post_init__()

    @cached_property
    def nodes(self) -> Float[np.ndarray, " n"]:
        """Positions of the nodes in mm or °."""
        name, line = f"{self.compensation} of {self.axis}", (self.start, self.interval)
        return _nodes_of(name, "setpoints", self.setpoints, *line, self.points)

    @cached_property
    def table_effect(self) -> TableEffect:
        return TableEffect((self.nodes,), periodic=self.modulo, inputs=self.masters)

    @property
    def _model_nodes(self) -> models.EquidistantNodes | models.Setpoints:
        if self.setpoints is not None:
            return models.Setpoints(jnp.asarray(self.nodes))
        return axis_nodes(self.nodes)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Leadscrew(AbstractLine):
    """Leadscrew error table of an axis over its own position, mm or °.

    Values: one per node; bilateral: all for positive direction, then all for negative.

    Attributes:
        bilateral: One table per direction of motion.
        modulo: The points include the repeated end.
    """

    bilateral: bool = False

    compensation = "leadscrew"
    rank = Rank.LEADSCREW
    remedy = "measure {axis} in both directions."

    @cached_property
    def table_effect(self) -> TableEffect:
        return dataclasses.replace(super().table_effect, branches=1 + self.bilateral)

    @property
    def name(self) -> str:
        return f"leadscrew of {self.axis}"

    def components(self, places: Int[np.ndarray, " p"]) -> list[Component]:
        """See `AbstractEffect`; two directions give way to the backlash."""
        (component,) = super().components(places)
        if not self.bilateral:
            return [component]
        rule = f"the {self.name} has the same mean in both directions"
        return [dataclasses.replace(component, rank=Rank.BILATERAL, rule=rule)]

    def to_model(self, table: Any, sign: float) -> Any:
        """See `AbstractEffect`; entries of this list are errors."""
        del sign
        pos, neg = table if self.bilateral else (table, None)
        return models.Leadscrew(self._model_nodes, pos, neg, self.modulo or None)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Cross(AbstractLine):
    """Cross (sag) table of an axis over the position of another, mm or °; one value per node.

    Attributes:
        master: Axis over whose position the table runs.
        modulo: The points include the repeated end of the master.
    """

    master: str = dataclasses.field(kw_only=True)

    compensation = "cross"
    rank = Rank.CROSS
    no_keys = ("modulo",)  # its axis says so

    def __post_init__(self) -> None:
        super().__post_init__()
        found = f"the axis {self.axis} twice"
        self.expect(self.axis != self.master, found, "another master")

    @cached_property
    def masters(self) -> tuple[str, ...]:
        return (self.master,)

    def to_model(self, table: Any, sign: float) -> Any:
        nodes = self._model_nodes
        line = models.ModuloNodes(nodes) if self.modulo else nodes
        return models.Cross(line, sign * table)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Plane(AbstractTable):
    """Plane table of an axis over the positions of two masters, mm or °.

    Values: node 1 of master 2 with all nodes of master 1, then node 2 …

    Attributes:
        masters: Master 1 and master 2.
        nodes: Along master 1 and along master 2, ascending; or instead of them:
        start: Position of the first node along each.
        interval: Distance of nodes along each.
        points: Number of nodes along each.
    """

    masters: tuple[str, str] = dataclasses.field()  # pyright: ignore[reportIncompatibleVariableOverride]
    nodes: tuple[Float[np.ndarray, " _n1"], Float[np.ndarray, " _n2"]] | None = None
    start: Sequence[Number] | None = dataclasses.field(default=None, kw_only=True)
    interval: Sequence[Number] | None = dataclasses.field(default=None, kw_only=True)
    points: Sequence[int] | None = dataclasses.field(default=None, kw_only=True)

    compensation = "plane"
    rank = Rank.PLANE
    no_keys = ("nodes",)

    def __post_init__(self) -> None:
        for key in ("masters", "start", "interval", "points"):
            if key != "masters" and getattr(self, key) is None:
                continue
            value: Any = getattr(self, key)
            if np.shape(value) != (2,):
                msg = f"plane of {self.axis}: found {key} {value!r}, expected two, one per master"
                raise FitError(msg)
            object.__setattr__(self, key, tuple(value))  # lists do as well
        super().__post_init__()
        first, second = self.masters
        self.expect(first != second, f"the axis {first} twice", "another master")

    @cached_property
    def table_effect(self) -> TableEffect:
        given = (self.nodes, self.start, self.interval, self.points)
        lines = zip(*(each or (None, None) for each in given), strict=True)
        nodes = tuple(_nodes_of(self.name, "nodes", *line) for line in lines)
        return TableEffect(nodes, inputs=self.masters)

    def components(self, places: Int[np.ndarray, " p"]) -> list[Component]:
        (component,) = super().components(places)
        along = "the readings along every line that the other can follow"
        rule = f"the {self.name} has mean zero over {along}"
        return [dataclasses.replace(component, rule=rule)]

    def to_model(self, table: Any, sign: float) -> Any:
        first, second = (axis_nodes(line) for line in self.grid)
        return models.Plane(first, second, sign * table)
