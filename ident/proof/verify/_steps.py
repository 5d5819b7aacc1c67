"""Channels that the axis list alone sets up: backlash and temperature."""

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ....models import Backlash, Conventions, TemperatureLine
from ._channel import AbstractChannel, Change, Parts
from ._motion import LogMotion


@dataclasses.dataclass(eq=False)
class BacklashChannel(AbstractChannel):
    """Backlash: an offset that steps where the axis reverses (S-45).

    Attributes:
        read: The backlash that the axis list makes under some conventions.
    """

    axis: int
    motion: LogMotion
    conventions: Conventions
    read: Callable[[Conventions], Backlash | None]
    compensation: str = "backlash"
    relevant: tuple[str, ...] = ("backlash_reference", "filter_delay")

    def __post_init__(self) -> None:
        self.masters = (self.axis,)
        self.cycles = self._law(self.conventions).cycles
        if self.told_by_actual():
            self.relevant = (*self.relevant, "direction_source")

    def parts(
        self,
        change: Change,
        rows: Int[np.ndarray, " r"] | slice,
        shift: Float[np.ndarray, "r k"] | None = None,
    ) -> Parts:
        del shift
        count = len(self.motion.position(self.axis, "for its backlash")[rows])
        law = self._law(change.conventions)
        ways = np.asarray(law.offset(jnp.array([1.0, -1.0])))
        return Parts(np.full(count, ways[0]), np.full(count, ways[1] - ways[0]))

    def _law(self, conventions: Conventions) -> Backlash:
        law = self.read(conventions)
        assert law is not None  # the axis list switches it on
        return law


@dataclasses.dataclass(eq=False)
class TemperatureChannel(AbstractChannel):
    """Temperature: a straight line over the position (S-43).

    Attributes:
        read: The line that the axis list makes under some conventions.
    """

    axis: int
    motion: LogMotion
    conventions: Conventions
    read: Callable[[Conventions], TemperatureLine | None]
    compensation: str = "temperature"
    relevant: tuple[str, ...] = ("temperature_filter",)

    def __post_init__(self) -> None:
        self.masters = (self.axis,)
        line = self.read(self.conventions)
        assert line is not None  # the axis list switches it on
        self.listed = line.cycles

    def cycles_under(self, conventions: Conventions) -> int:
        return self.listed if conventions.temperature_filter == "values" else 0

    def parts(
        self,
        change: Change,
        rows: Int[np.ndarray, " r"] | slice,
        shift: Float[np.ndarray, "r k"] | None = None,
    ) -> Parts:
        del shift
        place = self.motion.position(self.axis, "for its temperature compensation")
        line = self.read(change.conventions)
        assert line is not None
        some: Float[np.ndarray, " r"] = place[rows]
        cold = jnp.zeros((len(some), 0))
        return Parts(np.asarray(line.offset(jnp.asarray(some), cold)))
