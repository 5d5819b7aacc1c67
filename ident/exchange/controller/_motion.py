"""Commanded motion of a machine by axis number, and what follows from it."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ....data.measurements import Measurement
from ....models import DirectionState, directions
from ...core import filled
from .._nodes import Ranges
from .._units import ExchangeError, expect

Column = Float[np.ndarray, " t"]
"""A value per row of a motion."""
Columns = Mapping[int, Column]
"""By logical axis number."""

_COLUMNS = {
    "position": "positions",
    "direction": "directions",
    "velocity": "velocities",
    "acceleration": "accelerations",
    "actual": "actuals",
}
"""Attribute of a motion by role."""
_EVEN = 0.01
"""Share by which time steps may differ and still be cycles of one length."""


@dataclasses.dataclass(frozen=True)
class Motion:
    """Commanded motion of a machine, one row per cycle or independent position.

    Attributes:
        positions: By logical axis number, in mm or °.
        directions: ±1 by axis, where the user gives them.
        time: In s; None where the rows are independent positions.
        velocities: By axis in mm/s or °/s; derived where they are missing.
        accelerations: By axis in mm/s² or °/s²; derived where they are missing.
        temperatures: By sensor, in °C.
        actuals: Actual positions by axis, for conventions that take them.
        ranges: Of the axes that turn, in °.
        source: Where it comes from, for messages.
    """

    positions: Columns
    directions: Mapping[int, Int[np.ndarray, " t"]]
    time: Column | None
    velocities: Columns = dataclasses.field(default_factory=dict)
    accelerations: Columns = dataclasses.field(default_factory=dict)
    temperatures: Mapping[str, Column] = dataclasses.field(default_factory=dict)
    actuals: Columns = dataclasses.field(default_factory=dict)
    ranges: Ranges = dataclasses.field(default_factory=dict)
    source: str = "motion"

    @classmethod
    def of(cls, measured: Measurement, number: Callable[[str], int]) -> "Motion":
        """Return the motion that a measurement holds.

        Args:
            measured: With roles such as ``A1.position``.
            number: From the name of an axis to its logical number; it may raise.

        Raises:
            CellError: If a column holds a cell that cannot be used.
        """
        columns: dict[str, Any] = {"positions": {}, "directions": {}}
        temperatures: dict[str, np.ndarray] = {}
        for role in measured.values:
            name, _, quantity = role.partition(".")
            if name == "temperature":
                temperatures[quantity] = np.asarray(measured.values[role], float)
                continue
            axis = number(name) if quantity else 0
            if quantity in _COLUMNS:
                kind = np.int64 if quantity == "direction" else float
                values = np.asarray(measured.values[role], kind)
                columns.setdefault(_COLUMNS[quantity], {})[axis] = values
        time = measured.get("time")
        return cls(
            **columns,
            time=None if time is None else np.asarray(time, float),
            temperatures=temperatures,
            source=str(measured.source),
        )

    @property
    def rows(self) -> int:
        """Number of rows."""
        columns = self.positions, self.velocities, self.accelerations, self.temperatures
        every = (column for each in columns for column in each.values())
        return len(next(every, np.zeros(0)))

    def name(self, axis: int) -> str:
        """Return what sentences call an axis."""
        return f"A{axis}"

    def position(self, axis: int, why: str) -> Column:
        """Return the commanded position of an axis.

        Raises:
            ExchangeError: If the motion does not have it.
        """
        roles = ", ".join(f"{self.name(number)}.position" for number in self.positions)
        expected = f"{self.name(axis)}.position {why}"
        expect(axis in self.positions, self.source, roles or "no position", expected)
        return self.positions[axis]

    def check(self, cycle_time: float | None = None) -> None:
        """Refuse what no controller commands.

        Args:
            cycle_time: Of the controller in s, where it is known.

        Raises:
            ExchangeError: If a value is not finite, times do not ascend or columns
                differ in length, or the time step is not the cycle time.
        """
        columns = {
            f"A{number}.{role}": values
            for role, attribute in _COLUMNS.items()
            if role != "direction"
            for number, values in getattr(self, attribute).items()
        }
        columns |= {f"temperature.{name}": v for name, v in self.temperatures.items()}
        if self.time is not None:
            columns["time"] = self.time
        for name, values in columns.items():
            where, count = f"{self.source}: {name}", len(values)
            expected = f"{self.rows}, as in the other columns"
            expect(count == self.rows, where, f"{count} rows", expected)
            for at in np.flatnonzero(~np.isfinite(values)).tolist():
                fault = f"{values[at]} in row {at + 1}"
                raise ExchangeError(where, fault, "a finite number")
        if self.time is None or self.rows < 2:
            return
        where, steps = f"{self.source}: time", np.diff(self.time)
        at = int(np.argmin(steps > 0))
        before, after = self.time[at : at + 2]
        fault = f"{after:g} s after {before:g} s in row {at + 2}"
        expect(steps[at] > 0, where, fault, "ascending times")
        step = float(np.median(steps))
        if cycle_time is not None:
            fault = f"a time step of {1e3 * step:g} ms"
            expected = f"the cycle time of the controller, {1e3 * cycle_time:g} ms"
            even = abs(step - cycle_time) <= _EVEN * cycle_time
            expect(even, where, fault, expected)

    @property
    def is_even(self) -> bool:
        """Whether the rows are cycles of one length, none left out."""
        if self.time is None or len(self.time) < 2:
            return True
        steps = np.diff(self.time)
        step = np.median(steps)
        return bool(np.max(np.abs(steps - step)) <= _EVEN * step)

    def rates(
        self, axis: int, actual: bool = False
    ) -> tuple[Column | None, Column | None]:
        """Return velocity and acceleration in mm/s and mm/s², or °: given, else derived.

        Backward differences; before the first row the axis stood there. How an axis that
        moves from the first row on came to its velocity is not known: the first rows have
        the first acceleration that can be told. None where one cannot be had.

        Args:
            axis: Logical number.
            actual: As they were, of the actual positions; an axis without its own moves as
                it is commanded.
        """
        measured = actual and self.time is not None and axis in self.actuals
        velocity = None if measured else self.velocities.get(axis)
        acceleration = None if measured else self.accelerations.get(axis)
        first = 2 if velocity is None else 1
        places = self.actuals if measured else self.positions
        if velocity is None and self.time is not None and axis in places:
            velocity = self._rate(self.unwrapped(axis, places[axis]))
        if acceleration is None and self.time is not None and velocity is not None:
            acceleration = self._rate(velocity)
            moving = acceleration.size > first and velocity[first - 1] != 0.0
            acceleration[:first] = acceleration[first] if moving else 0.0
        return velocity, acceleration

    def unwrapped(self, axis: int, position: Column) -> Column:
        """Return positions of an axis, one that turns as one that goes on."""
        if axis not in self.ranges:
            return position
        low, high = self.ranges[axis]
        return np.unwrap(position, period=high - low)

    def lacks(self, axis: int, quantity: str) -> str:
        """Return in words what a ``velocity`` or ``acceleration`` cannot be had from."""
        if self.time is None:
            return f"there is neither A{axis}.{quantity} nor time"
        return f"there is neither A{axis}.{quantity} nor A{axis}.position"

    def _rate(self, values: Column) -> Column:
        assert self.time is not None
        steps = np.diff(self.time)
        if self.is_even and steps.size:
            # Times are rounded in files: one step for all is nearer to the truth.
            steps = np.full_like(steps, (self.time[-1] - self.time[0]) / steps.size)
        return np.concatenate([np.zeros(min(1, values.size)), np.diff(values) / steps])


def direction_of_motion(position: Column, start: int = 1) -> Int[np.ndarray, " t"]:
    """Return the direction of motion per cycle: that of the last step that was one.

    Args:
        position: Commanded, in mm or °.
        start: Direction before the first motion (S-21).
    """
    places = jnp.asarray(filled(position, 256))
    signs, _, _ = directions(DirectionState.start(start), places)
    return np.asarray(signs)[: len(position)].astype(np.int64)
