r"""Temperature compensation: a straight line over the position, per temperature."""

import abc
from typing import TYPE_CHECKING, Any, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._filter import SineSquaredFilter
from ._nodes import Setpoints, Values, float_array
from ._primitive import interpolate


class AbstractParameter(eqx.Module):
    """A parameter of the temperature line, as the PLC sets it from the temperatures."""

    @abc.abstractmethod
    def __call__(self, temperature: Float[Array, "t s"]) -> Float[Array, " t"]:
        """Return the parameter per cycle, from all sensors' temperatures in °C."""


@final
class ConstantParameter(AbstractParameter):
    """A parameter that no temperature changes."""

    value: Float[Values, ""] = eqx.field(converter=float_array)
    """In the unit of the parameter."""

    def __call__(self, temperature: Float[Array, "t s"]) -> Float[Array, " t"]:
        """Return the value, once per cycle."""
        return jnp.broadcast_to(self.value, temperature.shape[:1])


@final
class TemperatureCurve(AbstractParameter):
    """A parameter that follows one sensor: linear between given temperatures.

    Outside, the nearest value is held: nothing is known of temperatures that nobody
    measured. The derivative with respect to the temperature is the right-hand one.
    """

    nodes: Setpoints
    """Temperatures in °C, strictly ascending."""
    values: Float[Values, " p"] = eqx.field(converter=float_array)
    """Of the parameter at these temperatures."""
    sensor: int = eqx.field(default=0, static=True)
    """Number of the sensor, from 0."""

    def __check_init__(self) -> None:
        if self.values.shape != (self.nodes.count,):
            msg = (
                f"values must have one entry per temperature, ({self.nodes.count},), "
                f"got shape {self.values.shape}."
            )
            raise ValueError(msg)
        if self.sensor < 0:
            msg = f"sensor must be a number from 0 on, got {self.sensor!r}."
            raise ValueError(msg)

    @classmethod
    def of(cls, temperatures: Any, values: Any, sensor: int = 0) -> "TemperatureCurve":
        """Return the curve through these values at these temperatures in °C."""
        return cls(Setpoints(float_array(temperatures)), float_array(values), sensor)

    def __call__(self, temperature: Float[Array, "t s"]) -> Float[Array, " t"]:
        """Return the parameter per cycle.

        Raises:
            ValueError: If there is no such sensor.
        """
        if self.sensor >= temperature.shape[1]:
            msg = (
                f"Sensor {self.sensor} does not exist, there are "
                f"{temperature.shape[1]} sensors, from 0."
            )
            raise ValueError(msg)
        place = self.nodes.coordinate(temperature[:, self.sensor])
        return interpolate(self.values, (place,), (self.nodes.count,))


def parameter(value: Any) -> AbstractParameter:
    """Return the parameter itself, or a number as a constant one."""
    if isinstance(value, AbstractParameter):
        return value
    return ConstantParameter(value)


if TYPE_CHECKING:
    Parameter = Any
else:
    Parameter = AbstractParameter
"""A field that takes numbers as well (`parameter`), also for a checker of types."""


@final
class TemperatureLine(eqx.Module):
    r"""Temperature compensation of one axis (P-AXIS-00271 … 00275, 00482).

    $\Delta s = \mathrm{offset}_0(T) + \mathrm{coefficient}(T) (s - s_0(T))$, added as
    it stands (S-43). Units: mm in, mm out.
    """

    position_0: Parameter = eqx.field(converter=parameter)
    """Reference position $s_0$ in mm (P-AXIS-00272)."""
    offset_0: Parameter = eqx.field(converter=parameter)
    """Deviation at the reference position in mm (P-AXIS-00273)."""
    coefficient: Parameter = eqx.field(converter=parameter)
    """Deviation per distance from there in mm/mm, 1e-6 per µm/m (P-AXIS-00274)."""
    cycles: int = eqx.field(default=0, static=True)
    """Cycles of the sin² filter; 0 and 1: at once (P-AXIS-00275)."""
    sign: float = eqx.field(default=1.0, static=True)
    """Offset per Δs: +1 or −1 (S-43)."""

    def __check_init__(self) -> None:
        _ = SineSquaredFilter(self.cycles)  # refuses a negative number of cycles

    def entry(
        self,
        position: Float[Array | np.ndarray, " t"],
        temperature: Float[Array | np.ndarray, "t s"],
    ) -> Float[Array, " t"]:
        """Return Δs in mm at positions in mm and temperatures in °C, without filter."""
        sensors = jnp.asarray(temperature, dtype=jnp.float64)
        place = jnp.asarray(position, dtype=jnp.float64)
        distance: Array = place - self.position_0(sensors)
        offset: Array = self.offset_0(sensors) + self.coefficient(sensors) * distance
        return offset

    def offset(
        self,
        position: Float[Array | np.ndarray, " t"],
        temperature: Float[Array | np.ndarray, "t s"],
    ) -> Float[Array, " t"]:
        """Return what the controller adds to the axis in mm, without filter."""
        return self.sign * self.entry(position, temperature)
