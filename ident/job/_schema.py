"""The job file as data: every key, its type and its default (interface.md)."""

import datetime
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from ._fit_schema import AnyFit, JobPart

Compensation = Literal[
    "backlash", "temperature", "cross", "plane", "leadscrew", "friction", "crosstalk"
]
Number = Annotated[int, Field(ge=1, le=65535)]
Range = Annotated[list[float], Field(min_length=2, max_length=2)]


def _plain(name: str) -> str:
    # An axis name stands in a list: what would start a comment or needs another
    # encoding there is refused here, not written and misread.
    if not name.isascii() or not name.isprintable() or set(name) & set("#();\"'/*{}"):
        msg = "expected a name of plain ASCII letters, digits, blanks, '_' and '-'"
        raise ValueError(msg)
    return name


class Machine(JobPart, frozen=True):
    """Identity of the machine, for trends and stored conventions."""

    id: str | None = None
    measured_at: datetime.date | datetime.datetime | str | None = None
    conventions: str | None = None


class Controller(JobPart, frozen=True):
    """The controller that will load the lists."""

    build: str | None = None
    cycle_time: Annotated[float, Field(gt=0)] = 0.001


class Axis(JobPart, frozen=True):
    """One axis; lengths in mm or °."""

    number: Number
    name: Annotated[str, Field(min_length=1), AfterValidator(_plain)] | None = None
    kind: Literal["linear", "rotary", "spindle"] = Field("linear", alias="type")
    limits: Range | None = None
    listing: str | None = Field(None, alias="list")
    machine_data: str | None = None
    increment: Annotated[float, Field(gt=0)] | None = None
    modulo: Range | None = None
    gantry: str | None = None


class ColumnChoice(JobPart, frozen=True):
    """A column of a measurement file and its unit, or one value for all rows.

    `file` says which file, where there are several.
    """

    column: str | None = None
    unit: str | None = None
    file: str | None = None
    value: float | None = None


class ColumnOfRun(JobPart, frozen=True):
    """One of the columns of a role in a table with a column per run and direction."""

    column: str
    unit: str | None = None
    run: Annotated[int, Field(ge=0)] | None = None
    direction: Literal[1, -1] | None = None


Line = Annotated[int, Field(ge=1)]


class Datum(JobPart, frozen=True):
    """Where the error is zero: one position per master, mm or °."""

    at: float | Annotated[list[float], Field(min_length=1, max_length=2)]


class MeasurementSpec(JobPart, frozen=True):
    """One measurement: its file, columns and what was done while measuring."""

    file: str | None = None
    profile: str | None = None
    skip: Annotated[
        Annotated[int, Field(ge=0)] | list[Line],
        Field(description="lines left out: so many at the top, or which"),
    ] = 0
    header: Annotated[
        Line | list[Line] | None,
        Field(description="lines with the names of the columns; []: there are none"),
    ] = None
    rows: Annotated[
        Annotated[list[Line], Field(min_length=2, max_length=2)] | None,
        Field(description="first and last line of the rows"),
    ] = None
    files: Annotated[list[str], Field(min_length=2)] | None = None
    offsets: list[float] | None = None
    axis: str | None = None
    active: list[Compensation] = Field(default_factory=list)
    columns: dict[
        str, str | ColumnChoice | Annotated[list[ColumnOfRun], Field(min_length=1)]
    ] = Field(default_factory=dict)
    datum: Datum | None = None
    remove: Literal["none", "offset", "line"] = "none"
    drift: Annotated[int, Field(ge=0, le=100)] = 0
    expansion: float | None = None
    material_temperature: float | str | None = None
    reference_temperature: float = 20.0
    already_compensated: bool = False
    stream: Literal["auto"] | bool = "auto"


Limit = Annotated[float, Field(gt=0)]


class Gate(JobPart, frozen=True):
    """Limits of the gate; the defaults stand in `axcomp.ident.proof.GateLimits`."""

    max_correction: Limit | None = None
    max_slope: Limit | None = None
    max_step: Limit | None = None
    max_reversal: Limit | None = None
    feed: Limit | None = None
    max_velocity: Limit | None = None
    max_kink: Limit | None = None
    max_acceleration: Limit | None = None
    max_change: Limit | None = None
    max_current: Limit | None = None
    max_switching: Annotated[
        Limit | None,
        Field(description="mm (°) in one cycle where a compensation comes or goes"),
    ] = None
    max_jump: Annotated[
        Limit | None,
        Field(description="mm (°) by which the axis moves by itself then, in all"),
    ] = None


class Verify(JobPart, frozen=True):
    """The job of a measurement that was made with the lists of this one loaded."""

    job: str


class JobFile(JobPart, frozen=True):
    """A whole job."""

    title: str = ""
    machine: Machine = Machine()
    controller: Controller = Controller()
    axes: Annotated[dict[str, Axis], Field(min_length=1)]
    measurements: Annotated[dict[str, MeasurementSpec], Field(min_length=1)]
    fits: list[AnyFit] = Field(default_factory=list)
    gate: Gate = Gate()
    verify: Verify | None = None

    def resolved(self) -> dict[str, Any]:
        """Return the job with its defaults filled in, for the record."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)
