"""What an error may depend on: terms that a compensation stands for, and others."""

import dataclasses
import enum


class Kind(enum.Enum):
    """How a term depends on what was recorded."""

    OWN = "position"
    REVERSAL = "direction"
    OWN_REVERSAL = "position and direction"
    LINE = "position of another axis"
    SURFACE = "positions of two other axes together"
    HEAT_OFFSET = "temperature"
    HEAT_SLOPE = "temperature times position"
    PUSH = "acceleration of another axis"
    PUSH_WAY = "acceleration of another axis, by its direction"
    PUSH_PLACE = "acceleration of another axis, by a position"
    PUSH_PLACES = "acceleration of another axis, by two positions"
    SPEED = "own velocity"
    SPEED_OTHER = "velocity of another axis"
    PULL = "own acceleration"
    REVERSAL_OTHER = "direction of another axis"
    OWN_LINE = "own position and that of another axis together"
    MEMORY = "distance since the reversal"
    HEAT_LINE = "temperature times position of another axis"
    GROWTH = "time times position"
    DRIFT = "time"
    INERTIA = "current over acceleration"
    LOAD = "constant current"
    COULOMB = "current over direction"
    VISCOUS = "current over velocity"
    DRAG = "current over the square of velocity"
    STRIBECK = "current over slow velocity"
    VISCOUS_WAY = "current over velocity, by direction"
    LOAD_PLACE = "current over position"
    COULOMB_PLACE = "current over position and direction"
    COULOMB_HEAT = "current over temperature and direction"


FOREIGN = frozenset(
    {
        Kind.SPEED,
        Kind.SPEED_OTHER,
        Kind.PULL,
        Kind.REVERSAL_OTHER,
        Kind.OWN_LINE,
        Kind.MEMORY,
        Kind.HEAT_LINE,
        Kind.GROWTH,
    }
)
"""Terms for which the controller has no compensation."""

HEAT = (Kind.HEAT_OFFSET, Kind.HEAT_SLOPE)
FRICTION = (Kind.COULOMB, Kind.VISCOUS, Kind.DRAG, Kind.STRIBECK)
"""Odd functions of the velocity: what a friction list can hold."""
PUSHES = (Kind.PUSH, Kind.PUSH_WAY, Kind.PUSH_PLACE, Kind.PUSH_PLACES)


@dataclasses.dataclass(frozen=True)
class Term:
    """One term of the error of an axis.

    Attributes:
        kind: Of what it is a function.
        axis: Axis whose error it is part of.
        masters: Other axes that it depends on; of crosstalk first the one that
            accelerates, then those whose positions adapt it.
        sensor: Temperature that it follows.
        lag: Seconds by which it follows its sensor.
    """

    kind: Kind
    axis: str
    masters: tuple[str, ...] = ()
    sensor: str | None = None
    lag: float = 0.0

    @property
    def in_kernel(self) -> bool:
        """Whether the controller has a compensation for it."""
        return self.kind not in FOREIGN

    @property
    def words(self) -> str:
        """Its name in a sentence."""
        axis, sensor = self.axis, self.sensor
        first = self.masters[0] if self.masters else ""
        both = " and ".join(self.masters)
        rest = " and ".join(self.masters[1:])
        return {
            Kind.OWN: f"leadscrew of {axis}",
            Kind.REVERSAL: f"backlash of {axis}",
            Kind.OWN_REVERSAL: f"bilateral leadscrew of {axis}",
            Kind.LINE: f"cross of {axis} over {first}",
            Kind.SURFACE: f"plane of {axis} over {both}",
            Kind.HEAT_OFFSET: f"temperature offset of {axis} by {sensor}",
            Kind.HEAT_SLOPE: f"temperature coefficient of {axis} by {sensor}",
            Kind.PUSH: f"crosstalk of {axis} from {first}",
            Kind.PUSH_WAY: f"crosstalk of {axis} from {first} by direction",
            Kind.PUSH_PLACE: f"crosstalk of {axis} from {first}, adapted to {rest}",
            Kind.PUSH_PLACES: f"crosstalk of {axis} from {first}, adapted to {rest}",
            Kind.SPEED: f"error of {axis} that follows its velocity",
            Kind.SPEED_OTHER: f"error of {axis} that follows the velocity of {first}",
            Kind.PULL: f"error of {axis} that follows its own acceleration",
            Kind.REVERSAL_OTHER: f"jump of {axis} where {first} reverses",
            Kind.OWN_LINE: f"error of {axis} over {axis} that changes with {first}",
            Kind.MEMORY: f"error of {axis} that builds up after its reversal",
            Kind.HEAT_LINE: f"error of {axis} over {first} that grows with {sensor}",
            Kind.GROWTH: f"error of {axis} over {axis} that grows with time",
            Kind.DRIFT: f"drift of the instrument at {axis}",
            Kind.INERTIA: f"inertia of {axis}",
            Kind.LOAD: f"constant load of {axis}",
            Kind.COULOMB: f"Coulomb friction of {axis}",
            Kind.VISCOUS: f"viscous friction of {axis}",
            Kind.DRAG: f"friction of {axis} over the square of its velocity",
            Kind.STRIBECK: f"Stribeck friction of {axis}",
            Kind.VISCOUS_WAY: f"direction-dependent viscous friction of {axis}",
            Kind.LOAD_PLACE: f"position-dependent load of {axis}",
            Kind.COULOMB_PLACE: f"position-dependent friction of {axis}",
            Kind.COULOMB_HEAT: f"friction of {axis} that changes with {sensor}",
        }[self.kind]
