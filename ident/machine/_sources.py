"""Known errors of a machine: each a physical cause, in mm over positions in mm."""

import abc
import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float

from ._state import State


@dataclasses.dataclass(frozen=True)
class AbstractErrorSource(abc.ABC):
    """A cause that makes one axis miss its command.

    Attributes:
        axis: The axis that ends up in the wrong place.
    """

    axis: str

    @property
    @abc.abstractmethod
    def compensation(self) -> str:
        """Compensation of the controller that is meant for it."""

    @property
    @abc.abstractmethod
    def inputs(self) -> tuple[str, ...]:
        """Axes whose positions the error depends on."""

    @property
    def masters(self) -> tuple[str, ...]:
        """Axes that the compensation looks at, other than the axis itself."""
        return tuple(axis for axis in self.inputs if axis != self.axis)

    @abc.abstractmethod
    def error(self, at: State) -> Float[np.ndarray, " t"]:
        """Return actual − encoder in mm, at standstill actual − commanded.

        Args:
            at: State of the machine, with the positions of at least the axes in `inputs`.
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

    @property
    def compensation(self) -> str:
        return "leadscrew"

    @property
    def inputs(self) -> tuple[str, ...]:
        return (self.axis,)

    def error(self, at: State) -> Float[np.ndarray, " t"]:
        place = at.position[self.axis]
        long = self.slope * place + self.bow * np.sin(np.pi * place / self.length)
        return long + self.periodic * np.sin(2 * np.pi * place / self.lead)


@final
@dataclasses.dataclass(frozen=True)
class Reversal(AbstractErrorSource):
    """Lost motion: coming from the other side, the axis stops short.

    The loss changes along the travel, which a single backlash value cannot express.

    Attributes:
        at_start: Lost motion in mm at position 0.
        at_end: Lost motion in mm at ``length``.
        length: In mm.
    """

    at_start: float
    at_end: float
    length: float

    @property
    def compensation(self) -> str:
        return "leadscrew"

    @property
    def inputs(self) -> tuple[str, ...]:
        return (self.axis,)

    def error(self, at: State) -> Float[np.ndarray, " t"]:
        share = np.clip(at.position[self.axis] / self.length, 0.0, 1.0)
        lost = self.at_start + (self.at_end - self.at_start) * share
        # Half on either side: the mean of both directions is not shifted.
        return -at.direction[self.axis] * lost / 2


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

    @property
    def compensation(self) -> str:
        return "cross"

    @property
    def inputs(self) -> tuple[str, ...]:
        return (self.along,)

    def error(self, at: State) -> Float[np.ndarray, " t"]:
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

    @property
    def compensation(self) -> str:
        return "plane"

    @property
    def inputs(self) -> tuple[str, ...]:
        return self.across

    def error(self, at: State) -> Float[np.ndarray, " t"]:
        first, second = (
            2 * at.position[axis] / size - 1
            for axis, size in zip(self.across, self.size, strict=True)
        )
        twist = self.twist * first * second
        sag = -self.sag * np.cos(np.pi * first / 2) * np.cos(np.pi * second / 2)
        near = np.square(first + 1 / 3) + np.square(second + 1 / 3)
        return twist + sag - self.dent * np.exp(-near / (2 * (1 / 6) ** 2))
