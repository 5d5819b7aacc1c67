"""The keys of a temperature compensation in a job."""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from .._keys import Fault, FitSpec, JobPart, KeyPath, Positive, not_linear
from . import KIND

if TYPE_CHECKING:
    from ...job.file._schema import JobFile

Effect = Literal["offset", "coefficient"]
_Nodes = Annotated[int, Field(ge=2, le=20)]


class Plateau(JobPart, frozen=True):
    """Readings that count: those while a sensor stays where it is."""

    sensor: str
    """Name of the temperature. Example: `"scale"`."""
    within: Positive
    """K by which it may move. Example: `0.2`."""
    level: float | None = None
    """Temperature in °C that it stays at; left out: any. Example: `20.0`."""


class Spec(FitSpec, frozen=True):
    """Thermal line of an axis."""

    lacking = ("smoothness", "max_points")
    parts: ClassVar = {"steady": Plateau}

    compensation: Literal["temperature"]
    sensor: str | None = None
    """Temperature that both offset and coefficient follow. Example: `"scale"`."""
    sensors: Annotated[dict[Effect, str], Field(min_length=1)] | None = None
    """Temperature of each effect; an effect that is left out is not fitted. Example: `{
    offset = "frame", coefficient = "scale" }`."""
    reference: Literal["intersection"] | float | None = None
    """Position in mm that the coefficient turns about; `"intersection"`: where the
    lines meet. Example: `0.0`."""
    law: dict[Effect, Literal["constant", "linear"] | _Nodes] | None = None
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

    @property
    def plc_files(self) -> tuple[str, ...]:
        # The table, the program, and its blocks for XAE.
        blocks = (f"{block}.TcPOU" for block in block_names(self.axis))
        stem = f"temperature_{plain_name(self.axis)}"
        return f"{stem}.csv", f"{stem}.st", *blocks

    def faults(self, job: "JobFile", where: KeyPath) -> Iterator[Fault]:
        why = "the unit of the coefficient is not defined for others"
        yield from not_linear(job, self.axis, (*where, "axis"), why)
        assert KIND.cycles is not None
        most = KIND.cycles[1]
        if self.n_cycles is not None and self.n_cycles > most:
            # P-AXIS-00275 must stay below 20 in one place of the manual (S-44).
            reason = f"found {self.n_cycles}, expected at most {most}"
            yield (*where, "n_cycles"), reason
        if self.sensor is not None and self.sensors is not None:
            yield (*where, "sensors"), "found beside sensor, expected one of them"
        if self.law is not None:
            expected = list(self.sensors or ("offset", "coefficient"))
            if set(self.law) != set(expected):
                found = ", ".join(self.law) or "nothing"
                reason = f"found {found}, expected a law for {' and '.join(expected)}"
                yield (*where, "law"), reason
        measured = [name for name in self.sources if name in job.measurements]
        if len({job.measurements[name].reference_temperature for name in measured}) > 1:
            found = "found measurements with different reference temperatures"
            yield where, f"{found}, expected the same one for all that are joined"
        for name in measured:
            yield from self._of_measurement(job, name)
        if self.steady is not None and self.group is not None:
            reason = (
                f"found in group {self.group!r}, whose other fits need all readings,"
                " expected no steady"
            )
            yield (*where, "steady"), reason

    def _of_measurement(self, job: "JobFile", name: str) -> Iterator[Fault]:
        measured = job.measurements[name]
        if measured.expansion is not None or measured.already_compensated:
            key = "expansion" if measured.expansion is not None else None
            yield (
                ("measurements", name, key or "already_compensated"),
                f"found lengths referred to {measured.reference_temperature:g} °C, from"
                " which the growth of the axis is gone that a temperature fit looks for,"
                " expected them as measured",
            )
        if self.compensation in measured.active:
            yield (
                ("measurements", name, "active"),
                "found temperature active while measuring: what it added is known to"
                " the PLC alone, expected a measurement with COMP OFF TEMP",
            )


def plain_name(text: str) -> str:
    """Return a name that is safe in a file name and an identifier of the PLC."""
    # IEC 61131-3 knows neither doubled underscores nor one at the end.
    cleaned = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")
    return cleaned or "axis"


def block_names(axis: str) -> tuple[str, str]:
    """Return the names of the function blocks of an axis: the law, and what is called."""
    name = plain_name(axis)
    return f"FB_TempCompLaw_{name}", f"FB_TempComp_{name}"
