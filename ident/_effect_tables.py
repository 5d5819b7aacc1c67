"""Tables as a user states them: leadscrew, cross and plane, by their nodes."""

import dataclasses
from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float

from .. import models
from ._effects import AbstractEffect, Number, Numbers
from ._parameters import as_float
from .core import FitError
from .fit import joint

_DIGITS = 10
"""Of node positions in mm or °: ``3 * 0.1`` is the reading that says 0.3."""


@dataclasses.dataclass(frozen=True)
class _Line(AbstractEffect):
    """A table along one axis, its nodes equidistant or one by one."""

    start: Number | None = dataclasses.field(default=None, kw_only=True)
    interval: Number | None = dataclasses.field(default=None, kw_only=True)
    points: int | None = dataclasses.field(default=None, kw_only=True)
    setpoints: Numbers | None = dataclasses.field(default=None, kw_only=True)
    modulo: bool = dataclasses.field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        if self.setpoints is not None:
            object.__setattr__(self, "setpoints", tuple(map(float, self.setpoints)))

    @property
    def nodes(self) -> Float[np.ndarray, " n"]:
        """Positions of the nodes in mm or °."""
        grid = (self.start, self.interval, self.points)
        if self.setpoints is not None and grid == (None, None, None):
            return np.asarray(self.setpoints, np.float64)
        if self.setpoints is None and None not in grid:
            return _grid(*grid)  # type: ignore[arg-type]
        msg = (
            f"{self.compensation} of {self.axis}: expected either setpoints or start, "
            "interval and points"
        )
        raise FitError(msg)

    @property
    def grid(self) -> tuple[Float[np.ndarray, " n"], ...]:
        """See `AbstractEffect`."""
        return (self.nodes,)

    def _model_nodes(self) -> Any:
        if self.setpoints is not None:
            return models.Setpoints(as_float(self.nodes))
        assert self.points is not None
        start, interval = as_float(self.start), as_float(self.interval)
        return models.EquidistantNodes(start, interval, self.points)


def _grid(start: Number, interval: Number, points: int) -> Float[np.ndarray, " n"]:
    return np.round(float(start) + float(interval) * np.arange(points), _DIGITS)


@final
@dataclasses.dataclass(frozen=True)
class Leadscrew(_Line):
    """Leadscrew error table of an axis over its own position, mm or °.

    ``start``, ``interval`` and ``points``, or ``setpoints``; ``modulo``: the points include
    the repeated end.

    Attributes:
        bilateral: One table per direction of motion.
    """

    bilateral: bool = dataclasses.field(default=False, kw_only=True)

    compensation: ClassVar[str] = "leadscrew"

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.LeadscrewEffect(self.axis, self.nodes, self.bilateral, self.modulo)

    def offsets(
        self, model: models.Leadscrew, *places: Float[np.ndarray, " _n"]
    ) -> Float[np.ndarray, "..."]:
        """See `AbstractEffect`."""
        (place,) = places or self.grid
        ways = np.array([1.0, -1.0] if self.bilateral else [1.0])
        rows = [model.offset(place, np.full(len(place), way)) for way in ways]
        return np.stack(rows) if self.bilateral else np.asarray(rows[0])

    def to_model(self, table: Any, sign: float, effect: Any) -> Any:
        """See `AbstractEffect`; entries of this list are errors."""
        pos, neg = table if self.bilateral else (table, None)
        return models.Leadscrew(self._model_nodes(), pos, neg, self.modulo or None)


@final
@dataclasses.dataclass(frozen=True)
class Cross(_Line):
    """Cross (sag) table of an axis over the position of another, mm or °.

    ``start``, ``interval`` and ``points``, or ``setpoints``; ``modulo`` of the master.

    Attributes:
        master: Axis over whose position the table runs.
    """

    master: str = dataclasses.field(kw_only=True)

    compensation: ClassVar[str] = "cross"
    no_keys: ClassVar[tuple[str, ...]] = ("modulo",)  # its axis says so

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.CrossEffect(self.axis, self.master, self.nodes, self.modulo)

    def to_model(self, table: Any, sign: float, effect: Any) -> Any:
        """See `AbstractEffect`."""
        nodes = self._model_nodes()
        return models.Cross(
            models.ModuloNodes(nodes) if self.modulo else nodes, sign * table
        )


@final
@dataclasses.dataclass(frozen=True)
class Plane(AbstractEffect):
    """Plane table of an axis over the positions of two masters, mm or °.

    Attributes:
        masters: Master 1 and master 2.
        start: Position of the first node along each.
        interval: Distance of nodes along each.
        points: Number of nodes along each.
    """

    masters: tuple[str, str]
    start: tuple[Number, Number] = dataclasses.field(kw_only=True)
    interval: tuple[Number, Number] = dataclasses.field(kw_only=True)
    points: tuple[int, int] = dataclasses.field(kw_only=True)

    compensation: ClassVar[str] = "plane"

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.PlaneEffect(self.axis, self.masters, self.grid)

    @property
    def grid(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " m"]]:
        """See `AbstractEffect`."""
        each = zip(self.start, self.interval, self.points, strict=True)
        first, second = (_grid(*axis) for axis in each)
        return first, second

    def to_model(self, table: Any, sign: float, effect: Any) -> Any:
        """See `AbstractEffect`."""
        return models.Plane.rectangular(
            (float(self.start[0]), float(self.start[1])),
            (float(self.interval[0]), float(self.interval[1])),
            sign * table,
        )
