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
    """Which compensation. Example: `"leadscrew"`."""
    axis: str
    """The axis that is compensated. Example: `"X"`."""
    measurement: str | None = None
    """Name of the measurement. Example: `"laser"`."""
    measurements: Annotated[list[str], Field(min_length=1)] | None = None
    """Names, where there are several. Example: `["monday", "friday"]`."""
    smoothness: Literal["auto"] | Annotated[float, Field(ge=0)] = "auto"
    """Weight of the squared second differences per node distance, relative to 1/noise²;
    0: each node rests on its own readings; `"auto"`: by evidence. Example: `0.0`."""
    loss: Literal["student", "huber", "gauss"] = "student"
    """How readings far from the others count: `"gauss"` takes every one as it stands.
    Example: `"huber"`."""
    max_points: Annotated[int, Field(ge=1, le=2**32 - 2)] | None = None
    """Size of the table in the controller; left out: written only where the default is
    too small. Example: `200`."""
    n_cycles: Annotated[int, Field(ge=0, le=20)] | None = None
    """Cycles over which switching is spread; left out: chosen such that the gate holds.
    Example: `10`."""
    manual_activation: bool | None = None
    """Whether the compensation waits for `COMP ON` in the NC program. Example:
    `true`."""
    group: str | None = None
    """Fits of one name are identified together. Example: `"Z"`."""

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
    """The two axes over which the error is tabulated. Example: `["X", "Y"]`."""
    start: Pair | None = None
    """First node over each master in mm or °. Example: `[-40.0, -70.0]`."""
    interval: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = None
    """Distance of the nodes. Example: `[10.0, 10.0]`."""
    points: Annotated[list[Count], Field(min_length=2, max_length=2)] | None = None
    """Number of nodes. Example: `[41, 41]`."""


class LineSpec(FitSpec, frozen=True):
    """Nodes along one position: single setpoints, or a grid."""

    setpoints: Annotated[list[float], Field(min_length=2)] | None = None
    """Single nodes in mm or °, ascending; instead of a grid. Example: `[0.0, 25.0,
    100.0]`."""
    start: float | None = None
    """First node of a grid in mm or °. Example: `0.0`."""
    interval: Positive | None = None
    """Distance of its nodes. Example: `10.0`."""
    points: Count | None = None
    """Number of its nodes. Example: `81`."""


class CrossSpec(LineSpec, frozen=True):
    """A cross table: error of the axis over the position of one master."""

    compensation: Literal["cross"]
    master: str
    """The axis over which the error is tabulated. Example: `"X"`."""


class LeadscrewSpec(LineSpec, frozen=True):
    """A leadscrew table: error of the axis over its own position."""

    compensation: Literal["leadscrew"]
    bilateral: bool = False
    """One table per direction; it contains the backlash. Example: `true`."""
    modulo: bool = False
    """Whether the points include the repeated end: first = last. Example: `true`."""


class BacklashSpec(FitSpec, frozen=True):
    """Backlash; no keys of its own."""

    compensation: Literal["backlash"]


Effect = Literal["offset", "coefficient"]


class Plateau(JobPart, frozen=True):
    """Readings that count: those while a sensor stays where it is."""

    sensor: str
    """Name of the temperature. Example: `"scale"`."""
    within: Positive
    """K by which it may move. Example: `0.2`."""
    level: float | None = None
    """Temperature in °C that it stays at; left out: any. Example: `20.0`."""


class TemperatureSpec(FitSpec, frozen=True):
    """Thermal line of an axis."""

    compensation: Literal["temperature"]
    sensor: str | None = None
    """Temperature that both offset and coefficient follow. Example: `"scale"`."""
    sensors: Annotated[dict[Effect, str], Field(min_length=1)] | None = None
    """Temperature of each effect; an effect that is left out is not fitted. Example: `{
    offset = "frame", coefficient = "scale" }`."""
    reference: Literal["intersection"] | float | None = None
    """Position in mm that the coefficient turns about; `"intersection"`: where the
    lines meet. Example: `0.0`."""
    law: (
        dict[Effect, Literal["constant", "linear"] | Annotated[int, Field(ge=2, le=20)]]
        | None
    ) = None
    """Shape of each effect over the temperature: constant, linear, or a curve of so
    many nodes; left out: chosen on readings held out. Example: `{ offset = "linear"
    }`."""
    lag: Literal["auto", "none"] | Annotated[float, Field(ge=0)] = "auto"
    """Time constant in s by which the machine follows the sensor. Example: `600.0`."""
    steady: Plateau | None = None
    """Only readings while a sensor stays where it is count. Example: `{ sensor =
    "scale", within = 0.2 }`."""

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
    """Most knots of the list; left out: as many as it takes. Example: `8`."""
    inertia: Literal["fit"] | Positive | None = None
    """Current per acceleration where it is known; left out: fitted. Example:
    `"fit"`."""
    method: Literal["inverse", "output_error"] = "inverse"
    """Whether the current is explained (`inverse`), or the motion that it makes.
    Example: `"output_error"`."""
    solver: Literal["optimistix", "ipopt"] = "optimistix"
    """Solver of the output-error fit. Example: `"ipopt"`."""
    constraints: list[Literal["non-negative"]] = []
    """What the law must keep; with ipopt. Example: `["non-negative"]`."""
    reversal: bool = False
    """Whether lookahead, distance and delay at reversals are fitted. Example:
    `true`."""
    level: Annotated[float, Field(ge=0)] | None = None
    """Share of the friction that the list gives; left out: 0.15 until `friction_sign`
    is verified. Example: `0.5`."""
    rated_current: Positive | None = None
    """Rated current of the drive in A. Example: `12.0`."""
    rated_torque: Positive | None = None
    """Rated torque in N·m, where the recording holds a torque. Example: `8.5`."""
    torque_unit: Positive | None = None
    """Share of the rated value that one unit of the list is; left out: the law is
    reported, and no list is written. Example: `0.001`."""


class CrosstalkSpec(FitSpec, frozen=True):
    """Crosstalk between two axes."""

    compensation: Literal["crosstalk"]
    master: str
    """The axis whose acceleration bends this one. Example: `"X"`."""
    adaptation: str | list[str] | None = None
    """The axis, or two, over whose position the effect changes. Example: `["Z"]`."""
    mode: Literal[1, 2, 3, "auto"] = "auto"
    """How the controller goes between the tests. Example: `2`."""
    velocity_dependent: bool | None = None
    """Whether the direction of motion counts. Example: `true`."""
    acceleration: Positive | None = None
    """Acceleration of the tests in mm/s². Example: `5000.0`."""
    deceleration: Annotated[float, Field(lt=0)] | None = None
    """Deceleration of the tests in mm/s², negative. Example: `-5000.0`."""
    positions: list[Place] | None = None
    """Places of the tests in mm, one list per place. Example: `[[0.0], [400.0]]`."""


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
