"""Known errors of a machine, each a physical cause, and the state that they depend on."""

import abc
import dataclasses
from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Float, Int

Column = Float[np.ndarray, " t"]
"""A value per instant, cycle or reading."""
Columns = Mapping[str, Column]
"""By axis, part or sensor."""


@dataclasses.dataclass(frozen=True)
class State:
    """A machine at ``t`` instants; what is left out does not matter or is at rest.

    Attributes:
        position: Of the axes in mm, where their encoders have them.
        direction: Of the last motion of the axes, ±1.
        acceleration: Of the axes in mm/s²; an axis left out does not accelerate.
        temperature: Of the parts of the machine in °C (the parts, not their sensors); a
            part left out has the temperature at which it was set up.
    """

    position: Columns
    direction: Mapping[str, Column | Int[np.ndarray, " t"]]
    acceleration: Columns = dataclasses.field(default_factory=dict)
    temperature: Columns = dataclasses.field(default_factory=dict)

    @property
    def rows(self) -> int:
        """Number of instants."""
        columns = [*self.position.values(), *self.direction.values()]
        return len(columns[0]) if columns else 0


@dataclasses.dataclass(frozen=True)
class AbstractErrorSource(abc.ABC):
    """A cause that makes one axis miss its command.

    Attributes:
        axis: The axis that ends up in the wrong place.
        compensation: The one of the controller that is meant for it.
    """

    axis: str
    compensation: str = dataclasses.field(kw_only=True)

    @abc.abstractmethod
    def error(self, at: State) -> Column:
        """Return actual − encoder in mm, at standstill actual − commanded.

        Args:
            at: State of the machine, with the positions that the error depends on.
        """


@final
@dataclasses.dataclass(frozen=True)
class ScrewPitch(AbstractErrorSource):
    """A ball screw whose pitch is off: along its length, and once per turn.

    Attributes:
        slope: Progressive error in mm per mm.
        bow: Height of a half wave over the length, in mm.
        length: Of the screw in mm.
        periodic: Amplitude of the error that repeats with every turn, in mm.
        lead: Travel per turn in mm.
    """

    slope: float
    bow: float
    length: float
    periodic: float
    lead: float

    compensation: str = dataclasses.field(default="leadscrew", kw_only=True)

    def error(self, at: State) -> Column:
        place = at.position[self.axis]
        long = self.slope * place + self.bow * np.sin(np.pi * place / self.length)
        return long + self.periodic * np.sin(2 * np.pi * place / self.lead)


@final
@dataclasses.dataclass(frozen=True)
class Reversal(AbstractErrorSource):
    """Lost motion: coming from the other side, the axis stops short.

    Attributes:
        at_start: Lost motion in mm at position 0.
        at_end: Lost motion in mm at ``length``.
        length: In mm.
    """

    at_start: float
    at_end: float
    length: float
    compensation: str = dataclasses.field(default="leadscrew", kw_only=True)

    def error(self, at: State) -> Column:
        share = np.clip(at.position[self.axis] / self.length, 0.0, 1.0)
        play = self.at_start + (self.at_end - self.at_start) * share
        # Half on either side: the mean of both directions is not shifted.
        return -at.direction[self.axis] * play / 2


@final
@dataclasses.dataclass(frozen=True)
class BeamBow(AbstractErrorSource):
    """A beam that is not straight: moving along it pushes another axis sideways.

    Attributes:
        along: Axis that moves on the beam.
        bow: Height of the arc over ``length`` in mm.
        length: In mm.
        wave: Amplitude of a wave on top of it, in mm.
        wavelength: Of that wave in mm.
    """

    along: str
    bow: float
    length: float
    wave: float
    wavelength: float

    compensation: str = dataclasses.field(default="cross", kw_only=True)

    def error(self, at: State) -> Column:
        place = at.position[self.along]
        share = place / self.length
        arc = 4 * self.bow * share * (1 - share)
        return arc + self.wave * np.sin(2 * np.pi * place / self.wavelength)


@final
@dataclasses.dataclass(frozen=True)
class TableFlatness(AbstractErrorSource):
    """A table that is not flat: twisted, sagging in the middle, with a worn spot.

    Attributes:
        across: The two axes that span the table.
        size: Its length along each of them in mm.
        twist: Height of the corners in mm.
        sag: Depth of the middle in mm.
        dent: Depth of the worn spot in mm, as wide as a sixth of the table, at one
            third of both lengths.
    """

    across: tuple[str, str]
    size: tuple[float, float]
    twist: float
    sag: float
    dent: float

    compensation: str = dataclasses.field(default="plane", kw_only=True)

    def error(self, at: State) -> Column:
        first, second = (
            2 * at.position[axis] / size - 1
            for axis, size in zip(self.across, self.size, strict=True)
        )
        twist = self.twist * first * second
        sag = -self.sag * np.cos(np.pi * first / 2) * np.cos(np.pi * second / 2)
        squares = np.square(first + 1 / 3) + np.square(second + 1 / 3)
        return twist + sag - self.dent * np.exp(-squares / (2 * (1 / 6) ** 2))


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

    compensation: str = dataclasses.field(default="temperature", kw_only=True)

    def error(self, at: State) -> Column:
        if self.part not in at.temperature:
            return np.zeros(at.rows)
        warmer = at.temperature[self.part] - self.neutral
        if not self.stretch:
            return self.shift * warmer
        distance = at.position[self.axis] - self.reference
        return warmer * (self.shift + self.stretch * distance)


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

    compensation: str = dataclasses.field(default="crosstalk", kw_only=True)

    def error(self, at: State) -> Column:
        if self.master not in at.acceleration:
            return np.zeros(at.rows)
        rate = at.acceleration[self.master] / 1000.0
        reach = at.position[self.along] / self.length
        size = self.at_start + (self.at_end - self.at_start) * reach
        return size * np.where(rate < 0.0, self.braking, 1.0) * rate
