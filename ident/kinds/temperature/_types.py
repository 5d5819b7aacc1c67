"""What goes into a temperature fit and what comes out: arrays and their meaning."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from ...core import DriftNoise, node_shares
from ...fit.joint import Temperature

Effect = Literal["level", "offset", "slope", "slope change"]
"""Level of the error, temperature at the offset, slope over the position, and how that
changes with the temperature."""
Meeting = Literal[
    "met", "given", "parallel", "unsure slope", "two sensors", "too far", "too few",
    "not one point", "uncertain",
]  # fmt: skip
"""Whether the lines of all temperatures meet at the reference, or why it was not taken."""


@dataclasses.dataclass(frozen=True)
class ThermalReadings:
    """Errors of one axis at different temperatures; NaN = missed reading.

    Attributes:
        error: Actual − commanded in mm.
        temperature: Of each sensor in °C at the instant of each reading.
        position: Commanded position of the axis in mm; None = always the same.
        time: In s; None = the rows are in order of time, at equal distances.
    """

    error: Float[np.ndarray, " t"]
    temperature: Float[np.ndarray, "t s"]
    position: Float[np.ndarray, " t"] | None = None
    time: Float[np.ndarray, " t"] | None = None

    def take(self, keep: Bool[np.ndarray, " t"]) -> "ThermalReadings":
        """Return the readings for which ``keep`` is true."""
        position, time = self.position, self.time
        return ThermalReadings(
            self.error[keep],
            self.temperature[keep],
            None if position is None else position[keep],
            None if time is None else time[keep],
        )


@dataclasses.dataclass(frozen=True)
class Law:
    """A parameter of the line over the temperature: linear between nodes, held outside.

    Attributes:
        sensor: Number of the sensor, from 0.
        temperature: Nodes in °C, ascending; one = constant, two = linear.
        value: At the nodes, in mm (offset) or mm/mm (coefficient); the sign of the *error*.
        standard_deviation: Of the values, same unit.
    """

    sensor: int
    temperature: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    standard_deviation: Float[np.ndarray, " n"]

    @property
    def kind(self) -> str:
        """The law in a word."""
        return {1: "constant", 2: "linear"}.get(len(self.value), "piecewise linear")

    @property
    def slope(self) -> float:
        """Change of the value per K between the first and the last node."""
        if len(self.value) == 1:
            return 0.0
        rise = self.value[-1] - self.value[0]
        return float(rise / (self.temperature[-1] - self.temperature[0]))

    def at(self, temperature: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return the value at temperatures in °C."""
        return np.asarray(node_shares(temperature, self.temperature) @ self.value)


def laws_of(
    line: Temperature,
    sensors: Sequence[str],
    values: Float[np.ndarray, " p"],
    deviations: Float[np.ndarray, " p"],
) -> dict[str, Law]:
    """Return the laws of a fitted line by name.

    Args:
        line: With its nodes.
        sensors: All of them, in the order in which laws number them.
        values: At the nodes, those of the offset first.
        deviations: Standard deviations of the values.
    """
    own, spread = line.split(values), line.split(deviations)
    return {
        name: Law(sensors.index(line.sensors[name]), nodes, own[name], spread[name])
        for name, nodes in line.nodes.items()
    }


@dataclasses.dataclass(frozen=True)
class Lag:
    """How the structure follows a sensor.

    Attributes:
        sensor: Number of the sensor, from 0.
        time_constant: Of the first-order lag in s; 0 = none that the readings show.
        interval: From which to which value it may be (95 %), in s.
        applied: Whether the law is one of the lagged temperature, T' = (sensor − T) / constant.
        sensor_late: The sensor itself follows later than the structure; no filter undoes that.
    """

    sensor: int
    time_constant: float
    interval: tuple[float, float]
    applied: bool
    sensor_late: bool = False


@dataclasses.dataclass(frozen=True)
class LawScore:
    """How well a pair of laws predicts readings that it has not seen.

    Attributes:
        offset: Number of nodes of the offset.
        coefficient: Number of nodes of the coefficient; 0 = not fitted.
        held_out: Root mean square of the held-out residuals in mm, wild ones limited.
        chosen: Whether this is the one.
    """

    offset: int
    coefficient: int
    held_out: float
    chosen: bool


@dataclasses.dataclass(frozen=True)
class Confusion:
    """Two effects that the readings hardly tell apart, whatever the errors are.

    Attributes:
        first: One effect.
        second: The other.
        correlation: Of what they do to the readings, −1 to 1, the other effects taken off.
    """

    first: Effect
    second: Effect
    correlation: float


@dataclasses.dataclass(frozen=True)
class TemperatureFit:
    """The thermal line of an axis; signs are those of the *error*.

    $e = o(T) + c(T) (s - s_0)$.

    Attributes:
        offset: $o(T)$ in mm.
        coefficient: $c(T)$ in mm/mm; None where the error was measured at one position.
        reference: $s_0$ in mm; 0 without a coefficient.
        reference_deviation: Standard deviation of the intersection in mm; None where the
            reference was given.
        meeting: Whether the lines of all temperatures meet at the reference, where the offset
            is a constant, or why that was not taken.
        meeting_deviation: Standard deviation in mm of an intersection that was too uncertain.
        lags: One per sensor that is used.
        names: Of the parameters, in the order of the covariance.
        covariance: Of the node values of offset and coefficient, then of the intersection
            (mm) and of the logarithms of the time constants.
        noise: How residuals scatter, in mm and s.
        independent: Independent readings that would leave the same uncertainty of the least
            sure value.
        used: Rows that were complete.
        wild: Rows that the loss rejected outright (missed steps, glitches).
        residual: Error − line in mm per row; NaN where a reading was missed.
        temperature: Of the structure as the laws see it, per row and sensor in °C.
        scores: Laws compared by hold-out; empty where the law was given.
        confounded: What these readings cannot tell apart.
        support: Readings that touch each node of offset and coefficient.
        converged: Whether the iterations converged.
    """

    offset: Law
    coefficient: Law | None
    reference: float
    reference_deviation: float | None
    meeting: Meeting
    lags: tuple[Lag, ...]
    names: tuple[str, ...]
    covariance: Float[np.ndarray, "k k"]
    noise: DriftNoise
    independent: float
    used: Bool[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    residual: Float[np.ndarray, " t"]
    temperature: Float[np.ndarray, "t s"]
    scores: tuple[LawScore, ...]
    confounded: tuple[Confusion, ...]
    support: tuple[int, ...]
    converged: bool
    meeting_deviation: float | None = None

    @property
    def intersects(self) -> bool:
        """Whether the lines of all temperatures meet at the reference."""
        return self.meeting == "met"

    @property
    def _laws(self) -> list[tuple[Law, slice]]:
        """The laws, and where their nodes stand in the covariance."""
        count = len(self.offset.value)
        laws = [(self.offset, slice(0, count))]
        if self.coefficient is not None:
            end = count + len(self.coefficient.value)
            laws.append((self.coefficient, slice(count, end)))
        return laws

    @property
    def slope(self) -> tuple[float, float]:
        """Change of the offset in mm/K over the measured temperatures, and its deviation."""
        count = len(self.offset.value)
        if count == 1:
            return 0.0, 0.0
        span = float(self.offset.temperature[-1] - self.offset.temperature[0])
        ends = self.covariance[np.ix_([0, count - 1], [0, count - 1])]
        rise = float(ends[0, 0] + ends[1, 1] - 2.0 * ends[0, 1])
        return self.offset.slope, math.sqrt(max(rise, 0.0)) / span

    def predict(
        self,
        temperature: Float[np.ndarray, "t s"],
        position: Float[np.ndarray, " t"] | None = None,
    ) -> Float[np.ndarray, " t"]:
        """Return the error in mm at structure temperatures in °C and positions in mm."""
        result = self.offset.at(temperature[:, self.offset.sensor])
        if self.coefficient is None or position is None:
            return result
        slope = self.coefficient.at(temperature[:, self.coefficient.sensor])
        return np.asarray(result + slope * (position - self.reference))

    def relative_to(self, temperature: float) -> "TemperatureFit":
        """Return the laws with nothing to correct at this temperature in °C.

        What is taken off is the same at all temperatures: a constant and a slope over the
        position, which belong to the tables of the axis. Outside the measured temperatures
        the nearest is taken. The deviations become those of the difference.
        """
        here = np.array([temperature])
        move = np.eye(len(self.covariance))
        for law, part in self._laws:
            move[part, part] -= node_shares(here, law.temperature)
        covariance = move @ self.covariance @ move.T
        deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        laws = [
            dataclasses.replace(
                law, value=law.value - law.at(here), standard_deviation=deviation[part]
            )
            for law, part in self._laws
        ]
        coefficient = laws[1] if len(laws) > 1 else None
        return dataclasses.replace(
            self, offset=laws[0], coefficient=coefficient, covariance=covariance
        )

    def deviation_at(
        self, temperature: Float[np.ndarray, " t"]
    ) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
        """Return the deviations of offset (mm) and coefficient (mm/mm) at temperatures."""
        result = np.zeros((2, len(temperature)))
        for row, (law, part) in zip(result, self._laws, strict=False):
            share = node_shares(temperature, law.temperature)
            variance = ((share @ self.covariance[part, part]) * share).sum(axis=1)
            row[:] = np.sqrt(np.maximum(variance, 0.0))
        return result[0], result[1]
