r"""The thermal line of an axis as readings determine it, fitted alone or in a group.

Where the lines of all temperatures meet only the slope changes (`about_meeting`). At a distance
$a$ from the reference the error is $o(T) + c(T)\,a$, which there is the same at all temperatures.
Offset and coefficient are estimates with a covariance: $a$ is that of generalised least squares
over what both change with the temperature, what is left must be within its deviation, and the
law is then the one given that nothing is left.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import Literal, cast

import numpy as np
from jaxtyping import Bool, Float, Int

from ..._recording import JointData
from ...core import DriftNoise, node_shares, scatter_of_sums
from ...fit.joint import LAWS, Temperature

Meeting = Literal[
    "met", "given", "parallel", "two sensors", "not one point", "uncertain", "no offset"
]
"""Whether the lines of all temperatures meet at the reference, or why it was not taken."""
Warmth = Mapping[str, Float[np.ndarray, " t"]]
"""Temperatures in °C by name of the sensor."""
_SURE = 3.0
"""Deviations by which the coefficient must change, and up to which lines meet in a point."""
_ROUNDS = 4
"""In which the weights of the temperatures follow the position."""
_FAR = 1e3
"""Distance of the position, in measured ranges, from which on there is none."""


@dataclasses.dataclass(frozen=True)
class Law:
    """A parameter of the line over the temperature: linear between nodes, held outside.

    Attributes:
        sensor: That it follows.
        temperature: Nodes in °C, ascending; one = constant, two = linear.
        value: At the nodes, in mm (offset) or mm/mm (coefficient); the sign of the *error*.
        covariance: Of the values.
    """

    sensor: str
    temperature: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]

    @property
    def kind(self) -> str:
        """The law in a word."""
        return {1: "constant", 2: "linear"}.get(len(self.value), "piecewise linear")

    @property
    def slope(self) -> tuple[float, float]:
        """Change of the value per K from the first to the last node, and its deviation."""
        ends = np.zeros(len(self.value))
        if len(ends) > 1:
            ends[[0, -1]] = np.array([-1.0, 1.0]) / np.ptp(self.temperature)
        variance = max(float(ends @ self.covariance @ ends), 0.0)
        return float(ends @ self.value), float(np.sqrt(variance))

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
        sensor: Its name.
        time_constant: Of the first-order lag in s; 0 = none that the readings show.
        deviation: Standard deviation of it in s.
    """

    sensor: str
    time_constant: float
    deviation: float = 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """From which to which value it may be (95 %), in s."""
        if not self.applied:
            return 0.0, 0.0
        factor = math.exp(min(1.96 * self.deviation / self.time_constant, 50.0))
        return self.time_constant / factor, self.time_constant * factor

    @property
    def applied(self) -> bool:
        """Whether the law is one of the lagged temperature, T' = (sensor − T) / constant."""
        return self.time_constant > 0.0


@dataclasses.dataclass(frozen=True)
class TemperatureFit:
    """The thermal line of an axis; signs are those of the *error*.

    $e = o(T) + c(T) (s - s_0)$, which is 0 at the reference temperature, or the measured one next
    to it: a constant and a slope over the position belong to the tables of the axis.

    Attributes:
        line: Temperatures of its values, its reference $s_0$ in mm, its lags.
        data: The complete readings.
        rows: Which of all readings each of them was.
        structure: Temperature in °C of what lies behind each sensor of the line, by its name.
        values: Of the offset $o(T)$ in mm, then of the coefficient $c(T)$ in mm/mm.
        covariance: Of the values.
        lags: One per sensor.
        noise: How residuals scatter, in mm and s.
        wild: Readings that the loss rejected outright (missed steps, glitches).
        predicted: Error − line fitted without the block of time of each reading, in mm.
        support: Readings that touch each value.
        converged: Whether the iterations converged.
        meeting: Whether the lines of all temperatures meet at the reference, where the offset
            is a constant, or why that was not taken.
        reference_deviation: Standard deviation in mm of a reference where they meet.
        missed: Number of readings that were incomplete.
    """

    line: Temperature
    data: JointData
    rows: Int[np.ndarray, " t"]
    structure: Warmth
    values: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    lags: tuple[Lag, ...]
    noise: DriftNoise
    wild: Bool[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    support: tuple[int, ...]
    converged: bool
    meeting: Meeting = "given"
    reference_deviation: float | None = None
    missed: int = 0

    @property
    def independent(self) -> float:
        """Readings without a drift that would tell a constant as well, about."""
        count, noise = len(self.error), self.noise
        mean = np.full((count, 1), 1.0 / count)
        variance = float(scatter_of_sums(noise, self.data.order, mean)[0, 0])
        return (noise.white**2 + noise.drift**2) / max(variance, 1e-300)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Those that it follows."""
        return self.line.sensor_names

    @property
    def error(self) -> Float[np.ndarray, " t"]:
        """In mm."""
        return np.asarray(self.data.error[self.line.axis])

    @property
    def position(self) -> Float[np.ndarray, " t"] | None:
        """In mm; None where no coefficient was asked for."""
        return self.data.position.get(self.line.axis)

    @functools.cached_property
    def laws(self) -> dict[str, Law]:
        """Offset and coefficient by name."""
        line, laws = self.line, {}
        for name, rows in line.split(np.arange(line.size)).items():
            value, covariance = self.values[rows], self.covariance[np.ix_(rows, rows)]
            laws[name] = Law(line.sensors[name], line.nodes[name], value, covariance)
        return laws

    @property
    def offset(self) -> Law:
        """$o(T)$ in mm: 0 where nothing but the coefficient was fitted."""
        if "offset" in self.laws:
            return self.laws["offset"]
        coefficient = self.laws["coefficient"]
        zeros = np.zeros((1, 1))
        return Law(coefficient.sensor, coefficient.temperature[:1], zeros[0], zeros)

    @property
    def coefficient(self) -> Law | None:
        """$c(T)$ in mm/mm; None where it was not asked for."""
        return self.laws.get("coefficient")

    @property
    def moving(self) -> tuple[Law, ...]:
        """Offset and coefficient, as far as they follow their sensor."""
        return tuple(law for law in self.laws.values() if len(law.value) > 1)

    @property
    def reference(self) -> float:
        """$s_0$ in mm."""
        return float(self.line.reference)

    def predict(
        self, structure: Warmth, position: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return the error in mm at temperatures as `structure` and positions in mm."""
        inputs = [structure[law.sensor] for law in self.laws.values()]
        return np.asarray(self.line.rows([*inputs, position])[1] @ self.values)


def bent_to_meet(line: Temperature) -> Temperature:
    """Return a line whose offset bends as its coefficient does, as it does where lines meet.

    The line itself where it bends so already, or has no coefficient that could meet.
    """
    sensor, law = line.sensors.get("coefficient"), line.law
    if sensor is None or line.sensors.get("offset", sensor) != sensor:
        return line
    offset, coefficient = (cast("int", law.get(name, 1)) for name in LAWS)
    if offset >= coefficient:
        return line
    law = dict.fromkeys(LAWS, law["coefficient"])
    return dataclasses.replace(line, sensors=dict.fromkeys(LAWS, sensor), law=law)


def about_meeting(fit: TemperatureFit) -> TemperatureFit:
    """Return a line about the position where those of all temperatures meet.

    Where they do not, it stays as it is, with the reason; and where its offset cannot bend
    as the coefficient does.
    """

    def unchanged(meeting: Meeting) -> TemperatureFit:
        return dataclasses.replace(fit, meeting=meeting)

    line, size = fit.line, fit.line.size
    nodes, index = line.nodes, line.split(np.arange(size))
    assert fit.position is not None  # there is a coefficient
    span = float(np.ptp(fit.position))
    if len(fit.sensors) > 1:
        return unchanged("two sensors")
    if len(nodes["offset"]) < len(nodes["coefficient"]):
        return fit
    warm = np.union1d(nodes["offset"], nodes["coefficient"])
    # Rows that make offset and slope at each temperature of all that was fitted.
    offset, slope = np.zeros((2, len(warm), size))
    offset[:, index["offset"]] = node_shares(warm, nodes["offset"])
    slope[:, index["coefficient"]] = node_shares(warm, nodes["coefficient"])
    rise, tilt = offset - offset.mean(axis=0), slope - slope.mean(axis=0)
    shift, change = rise @ fit.values, tilt @ fit.values
    variance = ((tilt @ fit.covariance) * tilt).sum(axis=1)
    if not (change**2 > _SURE**2 * variance).any():
        return unchanged("parallel")
    weight, rounds = np.eye(len(warm)), 0
    while True:
        rounds += 1
        pull = weight @ change
        distance = -float(pull @ shift) / float(pull @ change)
        rows = rise + distance * tilt
        spread = rows @ fit.covariance @ rows.T
        if rounds == _ROUNDS or not spread.any():
            break
        # What moves together counts once: the rows sum to zero.
        weight = np.linalg.pinv(spread, rcond=1e-6, hermitian=True)
    moves = -(pull @ rows) / float(pull @ change)
    deviation = float(np.sqrt(max(moves @ fit.covariance @ moves, 0.0)))
    if abs(distance) > _FAR * span:
        return unchanged("parallel")
    if ((rows @ fit.values) ** 2 > _SURE**2 * np.maximum(np.diag(spread), 1e-18)).any():
        return unchanged("not one point")
    if not deviation < max(10.0 * span, abs(fit.reference + distance)):
        return unchanged("uncertain")
    # The laws given that the lines meet.
    gain = fit.covariance @ rows.T @ weight
    value = fit.values - gain @ (rows @ fit.values)
    conditional = np.eye(size) - gain @ (rows + np.outer(change, moves))
    # Where they meet nothing is corrected at the reference temperature, so nowhere.
    transform = np.vstack([np.zeros(size), conditional[index["coefficient"]]])
    warm = nodes["coefficient"]
    law = {"offset": warm.mean(keepdims=True), "coefficient": warm}
    return dataclasses.replace(
        fit,
        line=dataclasses.replace(line, law=law, reference=fit.reference + distance),
        values=np.append(0.0, value[index["coefficient"]]),
        covariance=transform @ fit.covariance @ transform.T,
        support=(int((~fit.wild).sum()), *fit.support[len(index["offset"]) :]),
        meeting="met",
        reference_deviation=deviation,
    )
