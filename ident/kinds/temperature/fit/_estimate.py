"""The thermal line of an axis as readings determine it, and what they say beside it."""

import dataclasses
import functools
import math
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from ....core import DriftNoise, node_shares
from ....fit.joint import Temperature

Effect = Literal["level", "offset", "slope", "slope change"]
"""Level of the error, temperature at the offset, slope over the position, and how that
changes with the temperature."""
Meeting = Literal[
    "met", "given", "parallel", "unsure slope", "two sensors", "too far", "too few",
    "not one point", "uncertain",
]  # fmt: skip
"""Whether the lines of all temperatures meet at the reference, or why it was not taken."""


@dataclasses.dataclass(frozen=True)
class Law:
    """A parameter of the line over the temperature: linear between nodes, held outside.

    Attributes:
        sensor: Number of the sensor, from 0.
        temperature: Nodes in °C, ascending; one = constant, two = linear.
        value: At the nodes, in mm (offset) or mm/mm (coefficient); the sign of the *error*.
        covariance: Of the values.
    """

    sensor: int
    temperature: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]

    @property
    def standard_deviation(self) -> Float[np.ndarray, " n"]:
        """Of the values, same unit."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def kind(self) -> str:
        """The law in a word."""
        return {1: "constant", 2: "linear"}.get(len(self.value), "piecewise linear")

    @property
    def slope(self) -> float:
        """Change of the value per K between the first and the last node."""
        return float(self._ends @ self.value)

    @property
    def slope_deviation(self) -> float:
        """Standard deviation of that."""
        return math.sqrt(max(float(self._ends @ self.covariance @ self._ends), 0.0))

    @property
    def _ends(self) -> Float[np.ndarray, " n"]:
        ends = np.zeros(len(self.value))
        if len(ends) > 1:
            ends[[0, -1]] = np.array([-1.0, 1.0]) / np.ptp(self.temperature)
        return ends

    def at(self, temperature: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return the value at temperatures in °C."""
        return np.asarray(node_shares(temperature, self.temperature) @ self.value)

    def deviation_at(
        self, temperature: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return the standard deviation of the value at temperatures in °C."""
        share = node_shares(temperature, self.temperature)
        variance = ((share @ self.covariance) * share).sum(axis=1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


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
        line: Temperatures of its values, its reference $s_0$ in mm, its lags.
        sensors: Names, as columns of the temperatures.
        values: Of the offset $o(T)$ in mm, then of the coefficient $c(T)$ in mm/mm.
        covariance: Of the values, then of the intersection (mm) and of the logarithms of the
            time constants.
        names: Of the parameters, in the order of the covariance.
        meeting: Whether the lines of all temperatures meet at the reference, where the offset
            is a constant, or why that was not taken.
        meeting_deviation: Standard deviation in mm of the intersection, where there is one.
        lags: One per sensor that is used.
        noise: How residuals scatter, in mm and s.
        independent: Independent readings that would leave the same uncertainty of the least
            sure value.
        used: Rows that were complete.
        wild: Rows that the loss rejected outright (missed steps, glitches).
        predicted: Error − line fitted without the block of time of each reading, in mm per
            row; NaN where a reading was missed.
        temperature: Of the structure as the laws see it, per row and sensor in °C.
        scores: Laws compared by hold-out; empty where the law was given.
        confounded: What these readings cannot tell apart.
        support: Readings that touch each node of offset and coefficient.
        converged: Whether the iterations converged.
    """

    line: Temperature
    sensors: tuple[str, ...]
    values: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "k k"]
    names: tuple[str, ...]
    meeting: Meeting
    lags: tuple[Lag, ...]
    noise: DriftNoise
    independent: float
    used: Bool[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    temperature: Float[np.ndarray, "t s"]
    support: tuple[int, ...]
    converged: bool
    meeting_deviation: float | None = None
    scores: tuple[LawScore, ...] = ()
    confounded: tuple[Confusion, ...] = ()

    @functools.cached_property
    def laws(self) -> dict[str, Law]:
        """Offset and coefficient by name."""
        places = self.line.split(np.arange(self.line.size))
        return {
            name: Law(
                self.sensors.index(self.line.sensors[name]),
                self.line.nodes[name],
                self.values[own],
                self.covariance[np.ix_(own, own)],
            )
            for name, own in places.items()
        }

    @property
    def offset(self) -> Law:
        """$o(T)$ in mm: 0 where nothing but the coefficient was fitted."""
        if "offset" in self.laws:
            return self.laws["offset"]
        other = self.laws["coefficient"]
        none = np.zeros((1, 1))
        return Law(other.sensor, other.temperature[:1], none[0], none)

    @property
    def coefficient(self) -> Law | None:
        """$c(T)$ in mm/mm; None where the error was measured at one position."""
        return self.laws.get("coefficient")

    @property
    def moving(self) -> tuple[Law, ...]:
        """Offset and coefficient, as far as they follow their sensor."""
        return tuple(law for law in self.laws.values() if len(law.value) > 1)

    @property
    def reference(self) -> float:
        """$s_0$ in mm."""
        return float(self.line.reference)

    @property
    def reference_deviation(self) -> float | None:
        """Standard deviation of the reference in mm; None where lines do not meet there."""
        return self.meeting_deviation if self.intersects else None

    @property
    def intersects(self) -> bool:
        """Whether the lines of all temperatures meet at the reference."""
        return self.meeting == "met"

    @property
    def slope(self) -> tuple[float, float]:
        """Change of the offset in mm/K over the measured temperatures, and its deviation."""
        return self.offset.slope, self.offset.slope_deviation

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
        size, here = self.line.size, np.array([temperature])
        move = np.eye(len(self.covariance))
        for name, own in self.line.split(np.arange(size)).items():
            move[np.ix_(own, own)] -= node_shares(here, self.line.nodes[name])
        return dataclasses.replace(
            self,
            values=move[:size, :size] @ self.values,
            covariance=move @ self.covariance @ move.T,
        )
