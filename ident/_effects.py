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


@dataclasses.dataclass(frozen=True)
class AbstractStated(abc.ABC):
    """One compensation of one axis.

    Attributes:
        axis: Name of the compensated axis.
    """

    axis: str

    compensation: ClassVar[str]
    """As in the job file."""
    no_keys: ClassVar[tuple[str, ...]] = ()
    """Fields that are no keys of a fit in a job file."""

    @property
    @abc.abstractmethod
    def roles(self) -> tuple[str, ...]:
        """Roles of the readings that it needs, such as ``"X.position"``."""

    def to_keys(self) -> dict[str, Any]:
        """Return the keys of a fit in a job file."""
        own = {
            field.name: value
            for field in dataclasses.fields(self)
            if (value := getattr(self, field.name)) != field.default
        }
        kept = {key: value for key, value in own.items() if key not in self.no_keys}
        return {"compensation": self.compensation, **kept}


@dataclasses.dataclass(frozen=True)
class AbstractEffect(AbstractStated):
    """One compensation by the position, direction, acceleration or temperature."""

    @abc.abstractmethod
    def to_joint(self) -> joint.AbstractEffect:
        """Return the effect as a joint fit takes it."""

    @property
    def roles(self) -> tuple[str, ...]:
        """See `AbstractStated`."""
        effect = self.to_joint()
        roles = [
            f"temperature.{name}" if channel == "temperature" else f"{name}.{channel}"
            for channel, name in effect.inputs
        ]
        return (*roles, *(("time",) if effect.timed else ()))

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
        grid = places or self.grid
        if not grid:
            msg = f"active: found {self.compensation}, expected a table or backlash"
            raise FitError(msg)
        mesh = np.meshgrid(*grid)
        rows = np.column_stack([each.ravel() for each in mesh])
        found = model.offset(rows if len(grid) > 1 else rows[:, 0])
        return np.asarray(found).reshape(mesh[0].shape)

    @abc.abstractmethod
    def to_model(self, table: Any, sign: float, effect: Any) -> Any:
        """Return the controller's model of fitted values.

        Args:
            table: Values in the shape of the list, as the error has them.
            sign: −1 for values (the controller takes the error off), +1 for deviations.
            effect: As fitted, by `to_joint`.
        """


@final
@dataclasses.dataclass(frozen=True)
class Backlash(AbstractEffect):
    """Backlash of an axis in mm or °.

    Attributes:
        reference: Direction of motion without an error of its own, 1 or −1.
    """

    reference: Literal[1, -1] = 1

    compensation: ClassVar[str] = "backlash"
    no_keys: ClassVar[tuple[str, ...]] = ("reference",)

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.BacklashEffect(self.axis, self.reference)

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
    law: Mapping[str, str | int] | None = dataclasses.field(default=None, kw_only=True)
    reference_temperature: Number = dataclasses.field(default=20.0, kw_only=True)

    compensation: ClassVar[str] = "temperature"
    no_keys: ClassVar[tuple[str, ...]] = ("reference_temperature",)

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

    def to_joint(self) -> joint.AbstractEffect:
        """See `AbstractEffect`."""
        return joint.TemperatureEffect(
            self.axis,
            self._sensors,
            float(self.reference),
            dict(self.law or {}),
            self.lag if isinstance(self.lag, str) else float(self.lag),
            float(self.reference_temperature),
        )

    def to_keys(self) -> dict[str, Any]:
        """See `AbstractEffect`."""
        lag = {"fit": "auto", 0.0: "none"}.get(self.lag, self.lag)
        return super().to_keys() | {"lag": lag, "reference": float(self.reference)}

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
        return effect.model(sign * table)


@final
@dataclasses.dataclass(frozen=True)
class Friction(AbstractStated):
    """Friction law of an axis, from the current of its drive; fitted by itself.

    Attributes:
        inertia: ``"fit"``, or known, in drive units per mm/s².
    """

    inertia: Number | Literal["fit"] = "fit"

    compensation: ClassVar[str] = "friction"

    @property
    def roles(self) -> tuple[str, ...]:
        """See `AbstractStated`."""
        kinds = ("velocity", "acceleration", "current")
        return ("time", *(f"{self.axis}.{kind}" for kind in kinds))
