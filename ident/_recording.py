"""What several axes were measured with: the readings of joint fits and of `discover`."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from .core import FitError
from .kinds.temperature._structure import Clocked, clocked

Columns = Mapping[str, np.ndarray]
"""Arrays of shape ``(t,)`` by the name of an axis or of a sensor."""
CHANNELS = (
    "position",
    "error",
    "direction",
    "velocity",
    "acceleration",
    "temperature",
)
"""Attributes of `JointData` that hold arrays by name."""

_R = TypeVar("_R", bound="JointData")


def stacked(
    parts: Sequence[Any], channel: str, counts: Sequence[int]
) -> dict[str, np.ndarray]:
    """Return a channel of several recordings one after the other; NaN where one lacks it.

    Args:
        parts: What holds the columns of each recording by name, as `JointData` does.
        channel: Name of the attribute.
        counts: Rows of each recording.
    """
    tables = [getattr(part, channel) for part in parts]
    return {
        name: np.concatenate(
            [
                own.get(name, np.full(count, np.nan))
                for own, count in zip(tables, counts, strict=True)
            ]
        )
        for name in dict.fromkeys(name for own in tables for name in own)
    }


@dataclasses.dataclass(frozen=True)
class JointData:
    """Readings of one or several axes; NaN = not measured in this row.

    A name that is absent was not recorded at all.

    Attributes:
        position: Commanded, in mm or °, by axis.
        error: Actual − commanded (at rest) or actual − encoder (in motion) in mm or °, by
            compensated axis.
        direction: Of the last motion, ±1, by axis.
        velocity: In mm/s, by axis.
        acceleration: In mm/s², by axis.
        temperature: In °C, by sensor.
        time: In s; None where there is no clock.
        run: Number of the repeated run or separate set-up; None where there is one.
        runs: The same by axis, for axes on which other runs than these (or none) may have
            an offset of their own.
    """

    position: Columns = dataclasses.field(default_factory=dict)
    error: Columns = dataclasses.field(default_factory=dict)
    direction: Columns = dataclasses.field(default_factory=dict)
    velocity: Columns = dataclasses.field(default_factory=dict)
    acceleration: Columns = dataclasses.field(default_factory=dict)
    temperature: Columns = dataclasses.field(default_factory=dict)
    time: Float[np.ndarray, " t"] | None = None
    run: Int[np.ndarray, " t"] | None = None
    runs: Mapping[str, Int[np.ndarray, " t"] | None] = dataclasses.field(
        default_factory=dict
    )

    channels: ClassVar[tuple[str, ...]] = CHANNELS
    """Attributes that hold arrays by name."""

    def __post_init__(self) -> None:
        count = len(self)
        for name, values in self._arrays():
            if np.shape(values) != (count,):
                msg = (
                    f"{name}: found shape {np.shape(values)}, expected one number per "
                    f"row, ({count},)."
                )
                raise FitError(msg)

    def __len__(self) -> int:
        return next((len(values) for _, values in self._arrays()), 0)

    def _arrays(self) -> Iterator[tuple[str, np.ndarray]]:
        for channel in self.channels:
            for name, values in getattr(self, channel).items():
                yield f"{channel} of {name}", values
        if self.time is not None:
            yield "time", self.time
        if self.run is not None:
            yield "run", self.run

    def run_of(self, axis: str) -> Int[np.ndarray, " t"] | None:
        """Return the runs that may have an offset of their own on an axis."""
        return self.runs.get(axis, self.run)

    def take(self: _R, keep: Bool[np.ndarray, " t"] | Int[np.ndarray, " r"]) -> _R:
        """Return the readings that are kept (a mask, or row numbers).

        What remembers (the lag of a temperature) then knows only these rows: to leave rows out
        of a fit give `fit_joint` the whole recording and a mask.
        """
        kept: dict[str, Any] = {
            field.name: value[keep]
            for field in dataclasses.fields(self)
            if isinstance(value := getattr(self, field.name), np.ndarray)
        }
        for channel in (*self.channels, "runs"):
            kept[channel] = {
                name: None if values is None else np.asarray(values)[keep]
                for name, values in getattr(self, channel).items()
            }
        return dataclasses.replace(self, **kept)

    def column(self, channel: str, name: str, wanted: str) -> Float[np.ndarray, " t"]:
        """Return one column.

        Args:
            channel: Name of the attribute.
            name: Of the axis or sensor.
            wanted: What needs it, for the message.

        Raises:
            FitError: If it was not recorded.
        """
        found = getattr(self, channel).get(name)
        if found is None:
            known = ", ".join(getattr(self, channel)) or "none"
            msg = f"{wanted}: needs the {channel} of {name}, the data have that of {known}."
            raise FitError(msg)
        return np.asarray(found, float)

    def clock_for(self, wanted: str) -> Float[np.ndarray, " t"]:
        """Return the time of every reading in s.

        Args:
            wanted: What needs it, for the message.

        Raises:
            FitError: If there is no clock.
        """
        if self.time is None:
            msg = f"{wanted} needs the time of every reading, found none."
            raise FitError(msg)
        return np.asarray(self.time, float)

    def clocked(self, sensor: str, wanted: str) -> Clocked:
        """Return the readings of a sensor on their clock, put in order once.

        Args:
            sensor: Name of the sensor.
            wanted: What needs it, for the message.

        Raises:
            FitError: If there is no clock, or no such sensor.
        """
        if sensor not in self._clocks:
            values = self.column("temperature", sensor, wanted)
            time = self.clock_for(f"{wanted}: a lag")
            self._clocks[sensor] = clocked(time, values)
        return self._clocks[sensor]

    @cached_property
    def _clocks(self) -> dict[str, Clocked]:
        return {}
