"""Known errors that position alone does not tell: play, warmth, acceleration."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float

from ._sources import AbstractErrorSource
from ._state import State


@final
@dataclasses.dataclass(frozen=True)
class Play(AbstractErrorSource):
    """Play of a nut, the same everywhere: coming from above the axis stops short.

    Attributes:
        width: In mm.
    """

    width: float

    @property
    def compensation(self) -> str:
        return "backlash"

    @property
    def inputs(self) -> tuple[str, ...]:
        return (self.axis,)

    def error(self, at: State) -> Float[np.ndarray, " t"]:
        return -0.5 * self.width * np.asarray(at.direction[self.axis], dtype=float)


@final
@dataclasses.dataclass(frozen=True)
class PartGrowth(AbstractErrorSource):
    """A part that grows as it warms: it shifts the axis, and it stretches it.

    Attributes:
        part: Name of the part, whose temperature counts.
        shift: In mm per K.
        stretch: In mm per mm and K.
        reference: Position in mm that the stretching leaves where it is.
        neutral: Temperature in °C at which nothing is wrong.
    """

    part: str
    shift: float = 0.0
    stretch: float = 0.0
    reference: float = 0.0
    neutral: float = 20.0

    @property
    def compensation(self) -> str:
        return "temperature"

    @property
    def inputs(self) -> tuple[str, ...]:
        return (self.axis,) if self.stretch else ()

    def error(self, at: State) -> Float[np.ndarray, " t"]:
        if self.part not in at.temperature:
            return np.zeros(at.rows)
        warmer = at.temperature[self.part] - self.neutral
        if not self.stretch:
            return self.shift * warmer
        away = at.position[self.axis] - self.reference
        return warmer * (self.shift + self.stretch * away)


@final
@dataclasses.dataclass(frozen=True)
class Nodding(AbstractErrorSource):
    """A column that nods as another axis accelerates, the more the higher it reaches.

    Attributes:
        master: Axis that accelerates.
        along: Axis whose position sets how far it nods.
        at_start: Error in mm per 1000 mm/s² at position 0 of ``along``.
        at_end: The same at ``length``.
        length: In mm.
        braking: Share of it that remains where the acceleration is negative.
    """

    master: str
    along: str
    at_start: float
    at_end: float
    length: float
    braking: float = 1.0

    @property
    def compensation(self) -> str:
        return "crosstalk"

    @property
    def inputs(self) -> tuple[str, ...]:
        return (self.master, self.along)

    def error(self, at: State) -> Float[np.ndarray, " t"]:
        if self.master not in at.acceleration:
            return np.zeros(at.rows)
        rate = at.acceleration[self.master] / 1000.0
        reach = at.position[self.along] / self.length
        size = self.at_start + (self.at_end - self.at_start) * reach
        return size * np.where(rate < 0.0, self.braking, 1.0) * rate
