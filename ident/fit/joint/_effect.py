"""Readings of several axes, and what every effect on them has: a name, inputs, columns."""

import abc
import dataclasses
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import ClassVar, final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from ...core import FitError, Smooth, TableEffect
from ...kinds.temperature import Clocked, clocked

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
Ranges = Mapping[tuple[str, str], tuple[float, float]]
"""From where to where an input goes, by channel of `JointData` and name."""
ANYWHERE = np.nan, np.nan
"""Range of an input that makes a difference at any size."""


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
        for channel in CHANNELS:
            for name, values in getattr(self, channel).items():
                yield f"{channel} of {name}", values
        if self.time is not None:
            yield "time", self.time
        if self.run is not None:
            yield "run", self.run

    def run_of(self, axis: str) -> Int[np.ndarray, " t"] | None:
        """Return the runs that may have an offset of their own on an axis."""
        return self.runs.get(axis, self.run)

    def take(self, keep: Bool[np.ndarray, " t"] | Int[np.ndarray, " r"]) -> "JointData":
        """Return the readings that are kept (a mask, or row numbers).

        What remembers (the lag of a temperature) then knows only these rows: to leave rows out
        of a fit give `fit_joint` the whole recording and a mask.
        """
        channels = {
            channel: {
                name: np.asarray(values)[keep]
                for name, values in getattr(self, channel).items()
            }
            for channel in CHANNELS
        }
        return JointData(
            **channels,
            time=None if self.time is None else self.time[keep],
            run=None if self.run is None else self.run[keep],
            runs={
                axis: None if run is None else run[keep]
                for axis, run in self.runs.items()
            },
        )

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
            if self.time is None:
                msg = f"{wanted}: a lag needs the time of every reading, found none."
                raise FitError(msg)
            self._clocks[sensor] = clocked(np.asarray(self.time, float), values)
        return self._clocks[sensor]

    @cached_property
    def _clocks(self) -> dict[str, Clocked]:
        return {}


@dataclasses.dataclass(frozen=True)
class Block:
    """An effect over some rows: ``error = columns @ values``.

    Attributes:
        columns: Shape ``(t, p)``; zero in rows that lack an input.
        known: Rows that have all inputs.
        labels: What each value is, in words.
        prior: Smoothness prior of the values; None = no value knows another.
        table: The table as an effect of the estimator, where it is one.
    """

    columns: sp.csr_array
    known: Bool[np.ndarray, " t"]
    labels: tuple[str, ...]
    prior: Smooth | None = None
    table: TableEffect | None = None


@dataclasses.dataclass(frozen=True)
class AbstractEffect(abc.ABC):
    """One compensation as a function that is linear in its values; signs are of the *error*.

    Attributes:
        axis: Compensated axis.
    """

    axis: str

    compensation: ClassVar[str]
    """Kind of compensation: ``"leadscrew"``, ``"cross"``, ``"plane"`` and so on."""

    @cached_property
    def masters(self) -> tuple[str, ...]:
        """Axes on which it depends."""
        return (self.axis,)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Temperature sensors on which it depends, each once."""
        return ()

    @property
    def name(self) -> str:
        """What it is, in words: ``"plane of Z over X and Y"``."""
        return f"{self.compensation} of {self.axis}"

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of values."""

    @property
    @abc.abstractmethod
    def ranges(self) -> Ranges:
        """Its inputs, and from where to where each of them makes a difference."""

    def placed(self, data: JointData) -> "AbstractEffect":
        """Return the effect with everything fixed that was to be read off the data."""
        del data
        return self

    @abc.abstractmethod
    def block(self, data: JointData) -> Block:
        """Return the effect over the rows of these data.

        Raises:
            FitError: If an input was not recorded.
        """

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return values in the shape in which lists hold them."""
        return values


def few_columns(columns: Float[np.ndarray, "t p"], labels: tuple[str, ...]) -> Block:
    """Return a block of few columns, NaN in rows that lack an input."""
    known = np.asarray(np.isfinite(columns).all(axis=1))
    dense = np.where(known[:, None], columns, 0.0)
    return Block(sp.csr_array(dense), known, labels)


def sparse_rows(
    index: Int[np.ndarray, "t k"],
    weight: Float[np.ndarray, "t k"],
    known: Bool[np.ndarray, " t"],
    size: int,
) -> sp.csr_array:
    """Return the matrix with a fixed number of entries per row; zero where not known."""
    count, width = index.shape
    weight = np.where(known[:, None], weight, 0.0)
    parts = (weight.reshape(-1), index.reshape(-1).astype(np.int32))
    matrix = sp.csr_array((*parts, np.arange(count + 1) * width), shape=(count, size))
    matrix.sum_duplicates()
    return matrix


@final
@dataclasses.dataclass(frozen=True)
class BacklashEffect(AbstractEffect):
    r"""Backlash of an axis; its one value is the width in mm, signed as P-AXIS-00103.

    Error moving positive − error moving negative is minus the width:
    $e = -w\,(d - r)/2$ with the direction $d$ and the reference direction $r$, in which the
    axis is right (`axcomp.models.Backlash`).

    Attributes:
        reference: Direction without an error of its own, 1 or −1 (P-AXIS-00021 = 1 or 2).
    """

    reference: int = 1

    compensation = "backlash"

    def __post_init__(self) -> None:
        if self.reference not in (1, -1):
            msg = f"{self.name}: found reference {self.reference}, expected 1 or -1."
            raise FitError(msg)

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return 1

    @property
    def ranges(self) -> Ranges:
        """See `AbstractEffect`."""
        return {("direction", self.axis): ANYWHERE}

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        way = data.column("direction", self.axis, self.name)
        return few_columns(-0.5 * (way[:, None] - self.reference), ("width",))


@final
@dataclasses.dataclass(frozen=True)
class DelayEffect(AbstractEffect):
    r"""Reference late behind the encoder of an axis in motion: $e = -(\tau + \rho\,(t-t_0))\,v$.

    No compensation carries it: it stands beside the others so that they are free of it.
    Values: the delay τ in s at the middle of the recording, and its rate ρ in s/s: the clocks
    may run apart.

    Attributes:
        origin: Instant $t_0$ in s; None = middle of the data.
    """

    origin: float | None = None

    compensation = "delay"

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return 2

    @property
    def ranges(self) -> Ranges:
        """See `AbstractEffect`."""
        return {("velocity", self.axis): ANYWHERE}

    def placed(self, data: JointData) -> "DelayEffect":
        """See `AbstractEffect`."""
        if self.origin is not None:
            return self
        clock = self._clock(data)
        clock = clock[np.isfinite(clock)]
        middle = 0.5 * float(clock.min() + clock.max()) if len(clock) else 0.0
        return dataclasses.replace(self, origin=middle)

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        speed = data.column("velocity", self.axis, self.name)
        late = self._clock(data) - (self.placed(data).origin or 0.0)
        columns = -np.column_stack([speed, speed * late])
        return few_columns(columns, ("delay", "rate of the delay"))

    def _clock(self, data: JointData) -> Float[np.ndarray, " t"]:
        if data.time is None:
            msg = f"{self.name}: a rate needs the time of every reading, found none."
            raise FitError(msg)
        return np.asarray(data.time, float)
