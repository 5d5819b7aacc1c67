"""The job file as data: every key, its type and its default (interface.md)."""

import contextlib
import datetime
import functools
import operator
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import AfterValidator, Field

from ....data.measurements import AXIS_NAME, ColumnSpec, Lines
from ....data.units import small_unit
from ...diagnosis import AXIS_WORD
from ...kinds import NAMES, kind
from ...kinds._keys import FitSpec, JobPart
from ...proof import GateLimits

if TYPE_CHECKING:  # both follow from the table of kinds
    Compensation = str
    AnyFit = FitSpec
else:
    Compensation = Literal[NAMES]
    AnyFit = Annotated[
        functools.reduce(operator.or_, (kind(name).keys for name in NAMES)),
        Field(discriminator="compensation"),
    ]
Number = Annotated[int, Field(ge=1, le=65534)]
Range = Annotated[list[float], Field(min_length=2, max_length=2)]


def _plain(name: str) -> str:
    # An axis name stands in a list: what would start a comment or needs another
    # encoding there is refused here, not written and misread.
    if not name.isascii() or not name.isprintable() or set(name) & set("#();\"'/*{}"):
        msg = "expected a name of plain ASCII letters, digits, blanks, '_' and '-'"
        raise ValueError(msg)
    return name


def _begins_roles(name: str) -> str:
    if AXIS_NAME.fullmatch(name) is None:
        msg = (
            "expected a letter, and then letters, digits, '_' and '-' alone: the roles of columns"
            ' begin with it, as in "X.position"'
        )
        raise ValueError(msg)
    return name


def _day(value: datetime.date | str) -> datetime.date:
    if not isinstance(value, str):
        return value
    for form in (datetime.date, datetime.datetime):
        with contextlib.suppress(ValueError):
            return form.fromisoformat(value)
    try:
        return datetime.datetime.strptime(value.strip(), "%d.%m.%Y").date()
    except ValueError:
        msg = "expected a date like 2026-11-20 or 20.11.2026"
        raise ValueError(msg) from None


class Machine(JobPart, frozen=True):
    """Identity of the machine, for trends and stored conventions."""

    id: str | None = None
    """Name of the machine, for trends. Example: `"mill-7"`."""
    measured_at: (
        Annotated[datetime.date | datetime.datetime | str, AfterValidator(_day)] | None
    ) = None
    """When it was measured. Example: `2026-11-20`."""
    conventions: str | None = None
    """File with the rules that a measurement has settled (`axcomp verify --save`); left
    out: the defaults, marked *assumed*. Example: `"mill-7.conventions.toml"`."""


class Controller(JobPart, frozen=True):
    """The controller that will load the lists."""

    build: str | None = None
    """Build of the controller; it decides which parameters exist. Left out: the newest.
    Example: `"V3.1.3108.4"`."""
    cycle_time: Annotated[float, Field(gt=0, le=0.1)] = 0.001
    """Cycle of the controller in s. Example: `0.002`."""


class Axis(JobPart, frozen=True):
    """One axis; lengths in mm or °."""

    number: Number
    """Logical number of the axis (`kopf.achs_nr`). Example: `3`."""
    name: (
        Annotated[str, Field(min_length=1, max_length=16), AfterValidator(_plain)]
        | None
    ) = None
    """Name of the axis in its list (`kopf.log_achs_name`), for people only; left out: the
    first 16 letters of the key. Example: `"Z_ACHSE"`."""
    nc_name: Annotated[str, Field(pattern=f"^{AXIS_WORD}$")] | None = None
    """Word of the axis in NC programs, as the channel calls it: A, B, C, Q or U to Z, then up to
    15 letters and digits; left out: the key. Example: `"X1"`."""
    channel: Annotated[int, Field(ge=1)] = 1
    """Channel of the controller whose NC programs move the axis. Example: `2`."""
    kind: Literal["linear", "rotary", "spindle"] = Field("linear", alias="type")
    """What moves: mm or °. Example: `"rotary"`."""
    limits: Range | None = None
    """Software limits in mm or °: the range over which a list is judged. Example:
    `[-10.0, 410.0]`."""
    listing: str | None = Field(None, alias="list")
    """Compensation list that the axis has now: it is edited, all else in it stays.
    Example: `"achskw3.lis"`."""
    machine_data: str | None = None
    """Axis list that it has now, likewise. Example: `"achsmds3.lis"`."""
    increment: Annotated[float, Field(gt=0)] | None = None
    """mm or ° per encoder increment, for lists and logs in increments. Example:
    `1.0e-6`."""
    modulo: Range | None = None
    """Range in ° of an axis that turns. Example: `[0.0, 360.0]`."""
    gantry: str | None = None
    """The other axis of a gantry: both need the same lists. Example: `"Y2"`."""

    @property
    def files(self) -> dict[str, str]:
        """The lists that it has now, by the key that names each."""
        pair = {"list": self.listing, "machine_data": self.machine_data}
        return {key: file for key, file in pair.items() if file is not None}

    @property
    def unit(self) -> str:
        """Unit of its positions: mm or °."""
        return "mm" if self.kind == "linear" else "°"

    @property
    def turn(self) -> float | None:
        """How far it goes round until it is where it was; None: it does not."""
        return None if self.modulo is None else self.modulo[1] - self.modulo[0]

    def in_turn(self, place: Float[np.ndarray, "*t"]) -> Float[np.ndarray, "*t"]:
        """Return positions within the modulo range, those of other axes as they are."""
        if self.modulo is None or self.turn is None:
            return place
        return self.modulo[0] + np.mod(place - self.modulo[0], self.turn)

    @property
    def plain_unit(self) -> str:
        """``mm`` or ``deg``, as results name it."""
        return "mm" if self.kind == "linear" else "deg"

    @property
    def small_unit(self) -> str:
        """Thousandths of it, in which errors are read."""
        return small_unit(self.plain_unit)


class ColumnChoice(JobPart, frozen=True):
    """A column of a measurement file and its unit, or one value for all rows.

    `file` says which file, where there are several.
    """

    column: str | None = None
    """Name of the column in the file. Example: `"dz"`."""
    unit: str | None = None
    """Unit of its numbers: m, mm, um, nm, in, thou, deg, mdeg, arcsec, rad, s, ms, degC, K,
    A, Nm, %, inc …; left out: mm, °, s, °C, A. Example: `"um"`."""
    file: str | None = None
    """File that holds it, where the measurement has several. Example:
    `"logger.csv"`."""
    value: float | None = None
    """One value for all rows, in the unit. Example: `1`."""
    interval: float = 0.0
    """What the value grows by from row to row, where the file does not hold positions that
    are evenly spaced. Example: `40.0`."""
    sign: Literal[1, -1] = 1
    """-1: the column holds the negative, as corrections (trims) are the negative of errors.
    Example: `-1`."""
    positive: str | None = None
    """Word of a column of directions that is the positive one, and the other one is not.
    Example: `"CW"`."""


class ColumnOfRun(JobPart, frozen=True):
    """One of the columns of a role in a table with a column per run and direction."""

    column: str
    """Name of the column in the file. Example: `"dz"`."""
    unit: str | None = None
    """Unit of its numbers. Example: `"um"`."""
    run: Annotated[int, Field(ge=0)] | None = None
    """Number of the run that it holds. Example: `1`."""
    direction: Literal[1, -1] | None = None
    """Direction of its motion. Example: `-1`."""
    sign: Literal[1, -1] = 1
    """-1: it holds the negative, as corrections (trims) are the negative of errors.
    Example: `-1`."""


Line = Annotated[int, Field(ge=1)]


class Datum(JobPart, frozen=True):
    """Where the error is zero: one position per master, mm or °."""

    at: float | Annotated[list[float], Field(min_length=1, max_length=2)]
    """Position in mm or ° where the error is zero; one per master. Example: `0.0`."""


class MeasurementSpec(JobPart, frozen=True):
    """One measurement: its file, columns and what was done while measuring."""

    file: str | None = None
    """File of the measurement, relative to the job. Example: `"laser.csv"`."""
    profile: str | None = None
    """Name of the mesh, where a Klipper file holds several. Example: `"default"`."""
    skip: Annotated[int, Field(ge=0)] | list[Line] = 0
    """Lines that are left out (rows, of a file without lines): so many at the top, or which.
    Example: `[17, 40]`."""
    header: Line | list[Line] | None = None
    """Lines with the names of the columns; `[]`: there are none, and columns are called
    1, 2, 3 …; left out: found. Example: `[5, 6]`."""
    rows: Annotated[list[Line], Field(min_length=2, max_length=2)] | None = None
    """First and last line of the numbers; left out: found. Example: `[8, 28]`."""
    files: Annotated[list[str], Field(min_length=2)] | None = None
    """Several files of one measurement, put onto one clock. Example: `["gauge.csv",
    "logger.csv"]`."""
    offsets: list[float] | None = None
    """What is added to the clock of each further file, in s; left out: fitted. Example:
    `[0.35]`."""
    axis: str | None = None
    """Axis of the columns that name none, such as `target, error, run`. Example:
    `"X"`."""
    active: list[Compensation] = Field(default_factory=list)
    """Compensations that were on while measuring; `[]`: all were off. Example:
    `["leadscrew"]`."""
    columns: dict[
        str, str | ColumnChoice | Annotated[list[ColumnOfRun], Field(min_length=1)]
    ] = Field(default_factory=dict)
    """Role by column: which column is which quantity of which axis. Example: `{
    "X.position" = "x", "X.error" = { column = "dx", unit = "um" } }`."""
    datum: Datum | None = None
    """Where the error is zero: the zero of the instrument is arbitrary. Example: `{ at
    = 0.0 }`."""
    remove: Literal["none", "offset", "line"] = "none"
    """What of the readings is the instrument's: nothing, a constant, or a constant and
    a slope. Example: `"offset"`."""
    drift: Annotated[int, Field(ge=0, le=100)] = 0
    """Pieces of the slow drift of an instrument that are fitted per run; 0: none.
    Example: `4`."""
    expansion: float | None = None
    """Expansion of the axis in µm/m per K, to refer lengths to the reference
    temperature. Example: `11.5`."""
    material_temperature: float | str | None = None
    """Temperature of the axis in °C while measuring, or the sensor that shows it: `spindle`
    of a column of the role `temperature.spindle`. Example: `22.4`."""
    reference_temperature: float = 20.0
    """Temperature in °C to which lengths refer. Example: `20.0`."""
    already_compensated: bool = False
    """Whether the instrument has referred its lengths to the reference temperature
    itself. Example: `true`."""
    stream: Literal["auto"] | bool = "auto"
    """Whether a log is read in pieces, for logs larger than memory; `"auto"`: above 2 ×
    10⁷ cells. Example: `true`."""

    @property
    def zeroed(self) -> bool:
        """Whether the zero of its readings is the instrument's."""
        return self.remove != "none" or self.datum is not None

    @property
    def at_reference(self) -> bool:
        """Whether lengths are those at the reference temperature."""
        stated = None not in (self.expansion, self.material_temperature)
        return self.already_compensated or stated

    @property
    def column_specs(self) -> dict[str, ColumnSpec]:
        """Where the values of each role are; empty: as the file says."""
        return {role: _column_spec(choice) for role, choice in self.columns.items()}

    @property
    def lines(self) -> Lines | None:
        """Which lines of its files count, or None where the job says nothing of them."""
        rows = None if self.rows is None else (self.rows[0], self.rows[1])
        return Lines.of(self.skip, self.header, rows)

    @property
    def stated_active(self) -> frozenset[str] | None:
        """Compensations that were on, or None where the job does not say which."""
        return frozenset(self.active) if "active" in self.model_fields_set else None

    def file_of(self, role: str) -> str | None:
        """Return the file that holds a role, where the job names it."""
        choice = self.columns[role]
        return choice.file if isinstance(choice, ColumnChoice) else None


def _column_spec(choice: str | ColumnChoice | list[ColumnOfRun]) -> ColumnSpec:
    if isinstance(choice, str):
        return ColumnSpec(choice)
    if isinstance(choice, list):
        parts = [ColumnSpec(**one.model_dump(exclude_unset=True)) for one in choice]
        return ColumnSpec("", parts=tuple(parts))
    stated = choice.model_dump(exclude={"column", "file"}, exclude_unset=True)
    return ColumnSpec(choice.column or "", **stated)


class Verify(JobPart, frozen=True):
    """The job of a measurement that was made with the lists of this one loaded."""

    job: str
    """Job of a measurement made with the lists of this one loaded. Example:
    `"after.toml"`."""


class JobFile(JobPart, frozen=True):
    """A whole job."""

    title: str = ""
    """Stands at the top of the report. Example: `"Portal mill 7"`."""
    machine: Machine = Machine()
    """Which machine it is."""
    controller: Controller = Controller()
    """The controller that will load the lists."""
    axes: Annotated[
        dict[Annotated[str, AfterValidator(_begins_roles)], Axis], Field(min_length=1)
    ]
    """The axes, by the name that the job uses for them."""
    measurements: Annotated[dict[str, MeasurementSpec], Field(min_length=1)]
    """The measurements, by a name of your choice."""
    fits: list[AnyFit] = Field(default_factory=list)
    """The compensations to fit, in the order of the report; `discover` and `doctor`
    need none."""
    gate: GateLimits = GateLimits()
    """Limits that a list must keep to be written."""
    verify: Verify | None = None
    """The second measurement."""

    def nc_word(self, axis: str) -> str:
        """Return the word of an axis in NC programs: ``nc_name``, or its key."""
        return self.axes[axis].nc_name or axis

    def partners(self, axis: str) -> tuple[str, ...]:
        """Return the other axes of the gantry of an axis, whichever of them says so."""
        return tuple(
            name
            for name, other in self.axes.items()
            if name == self.axes[axis].gantry or other.gantry == axis
        )

    @property
    def groups(self) -> dict[str, tuple[int, ...]]:
        """The fits of each group, by its name.

        A group of one is that fit alone, unless its measurement drifts: that is allowed
        for in groups.
        """
        groups: dict[str, tuple[int, ...]] = {}
        for k, fit in enumerate(self.fits):
            if fit.group is not None:
                groups[fit.group] = (*groups.get(fit.group, ()), k)
        drifting = {name for name, spec in self.measurements.items() if spec.drift > 0}
        return {
            name: indices
            for name, indices in groups.items()
            if len(indices) > 1
            or any(drifting.intersection(self.fits[k].sources) for k in indices)
        }

    @property
    def grouped(self) -> frozenset[int]:
        """The fits that are identified together with others."""
        return frozenset(k for group in self.groups.values() for k in group)
