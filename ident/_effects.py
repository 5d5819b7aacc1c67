"""Effects as a user states them: one per compensation, with the keys of the job file.

Each knows the roles that it needs, its place in a joint fit, and the model of the controller
that its fitted values make.
"""

import abc
import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, final

import numpy as np
from jaxtyping import Float

from .. import models
from ._parameters import as_float
from .core import FitError
from .fit import joint

Number = float | int
Numbers = Sequence[Number] | Float[np.ndarray, " n"]

_DIGITS = 10
"""Of node positions in mm or °: ``3 * 0.1`` is the reading that says 0.3."""


@dataclasses.dataclass(frozen=True)
class AbstractEffect(abc.ABC):
    """One compensation of one axis.

    Attributes:
        axis: Name of the compensated axis.
    """

    axis: str

    compensation: ClassVar[str]
    """As in the job file."""

    @property
    @abc.abstractmethod
    def roles(self) -> tuple[str, ...]:
        """Roles of the readings that it needs, such as ``"X.position"``."""

    @abc.abstractmethod
    def to_joint(self) -> joint.AbstractEffect:
        """Return the effect as a joint fit takes it."""

    def to_keys(self) -> dict[str, Any]:
        """Return the keys of a fit in a job file."""
        return _keys(self)

    @property
    def grid(self) -> tuple[Float[np.ndarray, " _n"], ...]:
        """Nodes along each master of a table; empty for what is none."""
        return ()

    def offsets(
        self, model: Any, *places: Float[np.ndarray, " _n"]
    ) -> Float[np.ndarray, "..."]:
        """Return what a model of the controller adds in mm or °, shaped like the list.

        Args:
            model: Of this compensation.
            places: Along each master; left out: at the nodes.

        Raises:
            FitError: If the effect is no table and no backlash.
        """
        msg = f"active: found {self.compensation}, expected a table or backlash"
        raise FitError(msg)

    @abc.abstractmethod
    def to_model(self, table: Any, sign: float, effect: Any) -> Any:
        """Return the controller's model of fitted values.

        Args:
            table: Values in the shape of the list, as the error has them.
            sign: −1 for values (the controller takes the error off), +1 for deviations.
            effect: As fitted, by `to_joint`.
        """


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


def _keys(effect: Any) -> dict[str, Any]:
    own = {
        field.name: getattr(effect, field.name)
        for field in dataclasses.fields(effect)
        if getattr(effect, field.name) != field.default
    }
    return {"compensation": effect.compensation, **own}


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

    @property
    def roles(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        way = (f"{self.axis}.direction",) if self.bilateral else ()
        return (f"{self.axis}.position", *way)

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.LeadscrewEffect(self.axis, self.nodes, self.bilateral, self.modulo)

    def offsets(
        self, model: models.Leadscrew, *places: Float[np.ndarray, " _n"]
    ) -> Float[np.ndarray, "..."]:
        """See `AbstractEffect`."""
        (place,) = places or self.grid
        ways = (1, -1) if self.bilateral else (1,)
        rows = [np.asarray(model.offset(place, np.full(len(place), w))) for w in ways]
        return np.stack(rows) if self.bilateral else rows[0]

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

    @property
    def roles(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return (f"{self.master}.position",)

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.CrossEffect(self.axis, self.master, self.nodes, self.modulo)

    def to_keys(self) -> dict[str, Any]:
        """See `AbstractEffect`; whether the master is a ring is said by its axis."""
        return {key: value for key, value in _keys(self).items() if key != "modulo"}

    def offsets(
        self, model: models.Cross, *places: Float[np.ndarray, " _n"]
    ) -> Float[np.ndarray, "..."]:
        """See `AbstractEffect`."""
        return np.asarray(model.offset(*(places or self.grid)))

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

    @property
    def roles(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return tuple(f"{master}.position" for master in self.masters)

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.PlaneEffect(self.axis, self.masters, self.grid)

    @property
    def grid(self) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " m"]]:
        """See `AbstractEffect`."""
        each = zip(self.start, self.interval, self.points, strict=True)
        first, second = (_grid(*axis) for axis in each)
        return first, second

    def offsets(
        self, model: models.Plane, *places: Float[np.ndarray, " _n"]
    ) -> Float[np.ndarray, "..."]:
        """See `AbstractEffect`."""
        first, second = np.meshgrid(*(places or self.grid))
        rows = np.column_stack([first.ravel(), second.ravel()])
        return np.asarray(model.offset(rows)).reshape(first.shape)

    def to_model(self, table: Any, sign: float, effect: Any) -> Any:
        """See `AbstractEffect`."""
        return models.Plane.rectangular(
            (float(self.start[0]), float(self.start[1])),
            (float(self.interval[0]), float(self.interval[1])),
            sign * table,
        )


@final
@dataclasses.dataclass(frozen=True)
class Backlash(AbstractEffect):
    """Backlash of an axis in mm or °.

    Attributes:
        reference: Direction of motion without an error of its own, 1 or −1.
    """

    reference: Literal[1, -1] = 1

    compensation: ClassVar[str] = "backlash"

    @property
    def roles(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return (f"{self.axis}.direction",)

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.BacklashEffect(self.axis, self.reference)

    def to_keys(self) -> dict[str, Any]:
        """See `AbstractEffect`; the reference is that of the controller."""
        return {"compensation": self.compensation, "axis": self.axis}

    def offsets(
        self, model: models.Backlash, *places: Float[np.ndarray, " _n"]
    ) -> Float[np.ndarray, "..."]:
        """See `AbstractEffect`; the width is taken off as it stands."""
        return -np.atleast_1d(np.asarray(model.width))

    def to_model(self, table: Any, sign: float, effect: Any) -> Any:
        """See `AbstractEffect`; the width is taken off as it stands."""
        return models.Backlash(table[0], self.reference)


@final
@dataclasses.dataclass(frozen=True)
class Temperature(AbstractEffect):
    """Thermal line of an axis: an offset and a coefficient over temperatures in °C.

    Attributes:
        sensor: Sensor of both; or `sensors`.
        sensors: Sensor of ``"offset"`` and of ``"coefficient"``, or of one of them.
        reference: Position in mm at which the offset counts.
        lag: Time constant in s by which the structure follows its sensors, or ``"fit"``.
        law: How each depends on its temperature: ``"linear"``, or a number of nodes.
        reference_temperature: In °C, where nothing is corrected.
    """

    sensor: str | None = dataclasses.field(default=None, kw_only=True)
    sensors: Mapping[str, str] | None = dataclasses.field(default=None, kw_only=True)
    reference: Number = dataclasses.field(default=0.0, kw_only=True)
    lag: Number | Literal["fit"] = dataclasses.field(default=0.0, kw_only=True)
    law: Mapping[str, str | int] = dataclasses.field(default_factory=dict, kw_only=True)
    reference_temperature: Number = dataclasses.field(default=20.0, kw_only=True)

    compensation: ClassVar[str] = "temperature"

    def __post_init__(self) -> None:
        if (self.sensor is None) == (self.sensors is None):
            msg = f"temperature of {self.axis}: expected either sensor or sensors"
            raise FitError(msg)

    @property
    def _sensors(self) -> dict[str, str]:
        if self.sensors is not None:
            return dict(self.sensors)
        assert self.sensor is not None
        return {"offset": self.sensor, "coefficient": self.sensor}

    @property
    def roles(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        clock = () if self.lag == 0.0 else ("time",)
        place = (f"{self.axis}.position",) if "coefficient" in self._sensors else ()
        warm = dict.fromkeys(f"temperature.{name}" for name in self._sensors.values())
        return (*place, *clock, *warm)

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.TemperatureEffect(
            self.axis,
            self._sensors,
            float(self.reference),
            dict(self.law),
            self.lag if isinstance(self.lag, str) else float(self.lag),
            float(self.reference_temperature),
        )

    def to_keys(self) -> dict[str, Any]:
        """See `AbstractEffect`."""
        lag = {"fit": "auto", 0.0: "none"}.get(self.lag, self.lag)
        other = (
            "lag",
            "reference_temperature",
        )  # the latter is a key of the measurement
        own = {key: value for key, value in _keys(self).items() if key not in other}
        return own | {"lag": lag, "reference": float(self.reference)}

    def to_model(self, table: Any, sign: float, effect: Any) -> Any:
        """See `AbstractEffect`; sensors are numbered as `TemperatureLine` wants them."""
        order = list(dict.fromkeys(self._sensors.values()))
        curves: dict[str, Any] = {"offset": 0.0, "coefficient": 0.0}
        for name, values in effect.split(table).items():
            number = order.index(self._sensors[name])
            nodes = effect.nodes[name]
            curves[name] = (
                models.TemperatureCurve.of(nodes, sign * values, number)
                if len(nodes) > 1
                else float(sign * values[0])
            )
        return models.TemperatureLine(
            as_float(self.reference), curves["offset"], curves["coefficient"]
        )


@final
@dataclasses.dataclass(frozen=True)
class Crosstalk(AbstractEffect):
    """Error of an axis from the acceleration of another.

    Attributes:
        master: Axis that accelerates.
        acceleration: Specified, above 0, in mm/s².
        deceleration: Specified, below 0, in mm/s².
        adaptation: Axes on whose position the entries depend, none, one or two.
        positions: Of the tests along them in mm, one row each.
        velocity_dependent: Each direction has entries of its own.
    """

    master: str
    acceleration: Number = dataclasses.field(kw_only=True)
    deceleration: Number = dataclasses.field(kw_only=True)
    adaptation: tuple[str, ...] = dataclasses.field(default=(), kw_only=True)
    positions: Sequence[Numbers] | Float[np.ndarray, "p k"] | None = dataclasses.field(
        default=None, kw_only=True
    )

    velocity_dependent: bool = dataclasses.field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        if self.positions is not None:
            rows = tuple(tuple(map(float, row)) for row in self.positions)
            object.__setattr__(self, "positions", rows)

    compensation: ClassVar[str] = "crosstalk"

    @property
    def _points(self) -> Float[np.ndarray, "p k"]:
        if self.positions is None:
            return np.zeros((1, 0))
        return np.asarray(self.positions, np.float64)

    @property
    def roles(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        places = (f"{axis}.position" for axis in self.adaptation)
        return (f"{self.master}.acceleration", f"{self.master}.velocity", *places)

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.CrosstalkEffect(
            self.axis,
            self.master,
            float(self.acceleration),
            float(self.deceleration),
            self.adaptation,
            self._points,
            1 + len(self.adaptation),
            self.velocity_dependent,
        )

    def to_model(self, table: Any, sign: float, effect: Any) -> Any:
        """See `AbstractEffect`."""
        return models.Crosstalk(
            models.surface_through(self._points),
            sign * table,
            as_float(self.acceleration),
            as_float(self.deceleration),
            velocity_dependent=self.velocity_dependent,
        )


@final
@dataclasses.dataclass(frozen=True)
class Friction:
    """Friction law of an axis, from the current of its drive; fitted by itself.

    Attributes:
        axis: Name of the axis.
        inertia: ``"fit"``, or known, in drive units per mm/s².
    """

    axis: str
    inertia: Number | Literal["fit"] = "fit"

    compensation: ClassVar[str] = "friction"

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the readings that it needs."""
        kinds = ("velocity", "acceleration", "current")
        return ("time", *(f"{self.axis}.{kind}" for kind in kinds))

    def to_keys(self) -> dict[str, Any]:
        """Return the keys of a fit in a job file."""
        return _keys(self)
