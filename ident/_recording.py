r"""What several axes were measured with: the readings of joint fits and of `discover`.

A sensor is read on its clock: the structure behind it follows with a lag of first order,
$\theta' = (T - \theta)/\tau$, exact for a temperature that runs linearly between its readings.
The structure starts at the temperature of the sensor, as its first readings together have it.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import get_lapack_funcs

from .core import FitError

(dtbtrs,) = get_lapack_funcs(("tbtrs",), dtype=np.float64)

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

_FIRST = 30.0
"""Share of a lag that counts as its beginning is one over this."""
_PAUSE = 1e6
"""s between recordings of which each has a clock of its own: every lag has forgotten."""
_STRAIGHT = 4.0
"""Square of the readings' distance from a line, in their noise, up to which it is one."""
_HOT = 200.0
"""Temperature in °C of no machine tool: it is in kelvin."""

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


def lagged(
    time: Float[np.ndarray, " l"],
    temperature: Float[np.ndarray, " l"],
    time_constant: float,
) -> Float[np.ndarray, " l"]:
    """Return the temperature of the structure in °C at the instants of the sensor.

    A negative time constant gives the structure *before* the sensor, to first order: what a
    sensor shows that follows late.

    Args:
        time: Ascending, in s.
        temperature: Of the sensor in °C.
        time_constant: In s; 0 = the structure is at the temperature of the sensor.
    """
    if time_constant == 0.0 or len(time) < 2:
        return np.asarray(temperature)
    if time_constant < 0.0:
        return np.asarray(2.0 * temperature - lagged(time, temperature, -time_constant))
    share = np.diff(time) / time_constant
    kept = np.exp(-share)
    # (1 − e^−x)/x, which is 1 for readings of the same instant.
    mean = np.where(share > 0, -np.expm1(-share) / np.where(share > 0, share, 1.0), 1.0)
    rise = np.diff(temperature)
    right = np.empty_like(temperature)
    right[0] = temperature[0]
    right[1:] = temperature[1:] - kept * temperature[:-1] - mean * rise
    band = np.ones((2, len(time)))
    band[1, :-1] = -kept
    found, info = dtbtrs(band, right, uplo="L")
    assert info == 0
    return np.asarray(found)


@dataclasses.dataclass(frozen=True)
class Clocked:
    """Readings of one sensor in order of time.

    Attributes:
        known: Rows with time and reading.
        clock: Different instants in s, ascending.
        back: Instant of each known row.
        values: Mean reading at each instant in °C.
        count: Readings at each instant.
    """

    known: Bool[np.ndarray, " t"]
    clock: Float[np.ndarray, " l"]
    back: Int[np.ndarray, " k"]
    values: Float[np.ndarray, " l"]
    count: Int[np.ndarray, " l"]

    def structure(self, lag: float) -> Float[np.ndarray, " t"]:
        """Return the temperature of the structure in °C per row, NaN where it is not known."""
        result: Float[np.ndarray, " t"] = np.full(len(self.known), np.nan)
        if len(self.clock):
            result[self.known] = self._behind(lag)[self.back]
        return result

    def _behind(self, lag: float) -> Float[np.ndarray, " l"]:
        """Return the structure at the instants of the sensor.

        What a noisy first reading is off by would last for the whole lag: a line through
        the first readings begins instead.
        """
        if lag == 0.0 or len(self.clock) < 2:
            return self.values
        values = self.values.astype(float)
        values[0] = self._beginning(abs(lag))
        return lagged(self.clock, values, lag)

    def _beginning(self, lag: float) -> float:
        """Return where a line through the first readings begins, in °C.

        A sensor that jumps before the line knows its level is taken at its word.
        """
        since, values = self.clock - self.clock[0], self.values
        weight = self.count * np.exp(-_FIRST * since / lag)
        weight = weight / weight.sum()
        middle, level = float(weight @ since), float(weight @ values)
        spread = float(weight @ np.square(since - middle))
        if not spread > 0.0:
            return level
        slope = float(weight @ ((since - middle) * values)) / spread
        bent = values - level - slope * (since - middle)
        # Half of all steps from reading to reading: a jump is none of them.
        steps = np.abs(np.diff(values[: max(int((since < lag / 10.0).sum()), 3)]))
        noise = 0.5 * (1.4826 * float(np.median(steps))) ** 2
        if float(weight @ np.square(bent)) > _STRAIGHT * noise:
            return float(values[0])
        return level - slope * middle


def clocked(time: Float[np.ndarray, " t"], values: Float[np.ndarray, " t"]) -> Clocked:
    """Return readings in order of time; rows need not be.

    Args:
        time: In s, NaN = no clock.
        values: Of the sensor in °C, NaN = missed.
    """
    known = np.isfinite(time) & np.isfinite(values)
    clock, back = np.unique(time[known], return_inverse=True)
    count = np.bincount(back, minlength=len(clock))
    mean = np.bincount(back, values[known], len(clock)) / np.maximum(count, 1)
    return Clocked(known, clock, back, mean, count)


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
        clock_number: Of the clock that tells the time of each row; None where there is one.
        own_zero: Whether the zero of a row is the machine's, beside rows whose zero is
            arbitrary; None where all are alike.
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
    clock_number: Int[np.ndarray, " t"] | None = None
    own_zero: Bool[np.ndarray, " t"] | None = None

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
        for sensor, warm in self.temperature.items():
            known = warm[np.isfinite(warm)]
            if known.size and np.median(known) > _HOT:
                msg = (
                    f"temperature.{sensor}: found {np.median(known):.4g} °C, expected °C:"
                    ' of kelvin state unit = "K" in a job, or take 273.15 off'
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

    @property
    def order(self) -> Float[np.ndarray, " t"]:
        """Time of every reading in s; its row number where there is no clock."""
        rows = np.arange(len(self), dtype=float)
        return rows if self.time is None else np.asarray(self.time, dtype=float)

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
            if self.clock_number is not None:
                # A recording remembers nothing of the one before.
                known = time[np.isfinite(time)]
                time = time + (np.ptp(known) + _PAUSE) * self.clock_number
            self._clocks[sensor] = clocked(time, values)
        return self._clocks[sensor]

    @cached_property
    def _clocks(self) -> dict[str, Clocked]:
        return {}
