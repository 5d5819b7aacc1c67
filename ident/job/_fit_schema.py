"""The ``[[fits]]`` of a job file: the keys that each compensation understands."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=2)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Place = Annotated[list[float], Field(min_length=1, max_length=2)]


class JobPart(BaseModel, frozen=True):
    """A table of the job file: no other keys, no text for a number, no NaN."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class FitSpec(JobPart, frozen=True):
    """Keys that every fit has."""

    compensation: str
    axis: str
    measurement: str | None = None
    measurements: Annotated[list[str], Field(min_length=1)] | None = None
    smoothness: Literal["auto"] | Annotated[float, Field(ge=0)] = "auto"
    loss: Literal["student", "huber", "gauss"] = "student"
    max_points: Annotated[int, Field(ge=1, le=2**32 - 2)] | None = None
    n_cycles: Annotated[int, Field(ge=0, le=20)] | None = None
    manual_activation: bool | None = None
    group: str | None = None

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the measurements, joined for this fit."""
        if self.measurement is not None:
            return (self.measurement,)
        return tuple(self.measurements or ())


class PlaneSpec(FitSpec, frozen=True):
    """A plane: error of the axis over the positions of two masters."""

    compensation: Literal["plane"]
    masters: Annotated[list[str], Field(min_length=2, max_length=2)]
    start: Pair | None = None
    interval: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = None
    points: Annotated[list[Count], Field(min_length=2, max_length=2)] | None = None


class LineSpec(FitSpec, frozen=True):
    """Nodes along one position: single setpoints, or a grid."""

    setpoints: Annotated[list[float], Field(min_length=2)] | None = None
    start: float | None = None
    interval: Positive | None = None
    points: Count | None = None


class CrossSpec(LineSpec, frozen=True):
    """A cross table: error of the axis over the position of one master."""

    compensation: Literal["cross"]
    master: str


class LeadscrewSpec(LineSpec, frozen=True):
    """A leadscrew table: error of the axis over its own position."""

    compensation: Literal["leadscrew"]
    bilateral: bool = False
    modulo: bool = False


class BacklashSpec(FitSpec, frozen=True):
    """Backlash; no keys of its own."""

    compensation: Literal["backlash"]


Effect = Literal["offset", "coefficient"]


class Plateau(JobPart, frozen=True):
    """Readings that count: those while a sensor stays where it is."""

    sensor: str
    within: Positive
    level: float | None = None


class TemperatureSpec(FitSpec, frozen=True):
    """Thermal line of an axis."""

    compensation: Literal["temperature"]
    sensor: str | None = None
    sensors: Annotated[dict[Effect, str], Field(min_length=1)] | None = None
    reference: Literal["intersection"] | float | None = None
    law: (
        dict[Effect, Literal["constant", "linear"] | Annotated[int, Field(ge=2, le=20)]]
        | None
    ) = None
    lag: Literal["auto", "none"] | Annotated[float, Field(ge=0)] = "auto"
    steady: Plateau | None = None

    @property
    def effects(self) -> dict[Effect, str] | None:
        """Sensor of each effect that is fitted; None: the only one that there is."""
        if self.sensor is not None:
            return {"offset": self.sensor, "coefficient": self.sensor}
        return self.sensors


class FrictionSpec(FitSpec, frozen=True):
    """Friction of a drive."""

    compensation: Literal["friction"]
    table_entries: Count | None = None
    inertia: Literal["fit"] | Positive | None = None
    method: Literal["inverse", "output_error"] = "inverse"
    solver: Literal["optimistix", "ipopt"] = "optimistix"
    constraints: list[Literal["non-negative"]] = []
    reversal: bool = False
    level: Annotated[float, Field(ge=0)] | None = None
    rated_current: Positive | None = None
    rated_torque: Positive | None = None
    torque_unit: Positive | None = None


class CrosstalkSpec(FitSpec, frozen=True):
    """Crosstalk between two axes."""

    compensation: Literal["crosstalk"]
    master: str
    adaptation: str | list[str] | None = None
    mode: Literal[1, 2, 3, "auto"] = "auto"
    velocity_dependent: bool | None = None
    acceleration: Positive | None = None
    deceleration: Annotated[float, Field(lt=0)] | None = None
    positions: list[Place] | None = None


TableSpec = PlaneSpec | CrossSpec | LeadscrewSpec
"""Fits that are built; the others are understood, and refused in one line."""

AnyFit = Annotated[
    PlaneSpec
    | CrossSpec
    | LeadscrewSpec
    | BacklashSpec
    | TemperatureSpec
    | FrictionSpec
    | CrosstalkSpec,
    Field(discriminator="compensation"),
]
