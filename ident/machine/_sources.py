"""Known errors of a machine, each of a physical cause, and the state that they depend on."""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float, Int

Column = Float[np.ndarray, " t"]
"""A value per instant, cycle or reading."""
Columns = Mapping[str, Column]
"""By axis, part or sensor."""
HALL = 20.0
"""Temperature in °C of the hall, at which nothing is wrong."""


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
class ErrorSource:
    """A cause that makes one axis miss its command.

    Attributes:
        axis: The axis that ends up in the wrong place.
        compensation: The one of the controller that is meant for it.
        error: Returns actual − encoder in mm (at standstill actual − commanded) in a state
            that holds the positions that the error depends on.
    """

    axis: str
    compensation: str
    error: Callable[[State], Column]


def screw_pitch(
    axis: str, slope: float, bow: float, length: float, periodic: float, lead: float
) -> ErrorSource:
    """Return a ball screw whose pitch is off: along its length, and once per turn.

    Args:
        axis: That it drives.
        slope: Progressive error in mm per mm.
        bow: Height of a half wave over the length, in mm.
        length: Of the screw in mm.
        periodic: Amplitude of the error that repeats with every turn, in mm.
        lead: Travel per turn in mm.
    """

    def error(at: State) -> Column:
        place = at.position[axis]
        long = slope * place + bow * np.sin(np.pi * place / length)
        return long + periodic * np.sin(2 * np.pi * place / lead)

    return ErrorSource(axis, "leadscrew", error)


def reversal(
    axis: str,
    at_start: float,
    at_end: float,
    length: float,
    compensation: str = "leadscrew",
) -> ErrorSource:
    """Return lost motion: coming from the other side, the axis stops short.

    Its size in mm is ``at_start`` at position 0 and ``at_end`` at ``length`` in mm.
    """

    def error(at: State) -> Column:
        share = np.clip(at.position[axis] / length, 0.0, 1.0)
        play = at_start + (at_end - at_start) * share
        # Half on either side: the mean of both directions is not shifted.
        return -at.direction[axis] * play / 2

    return ErrorSource(axis, compensation, error)


def beam_bow(
    axis: str, along: str, bow: float, length: float, wave: float, wavelength: float
) -> ErrorSource:
    """Return a beam that is not straight: moving along it pushes another axis sideways.

    Args:
        axis: That is pushed.
        along: Axis that moves on the beam.
        bow: Height of the arc over ``length`` in mm.
        length: In mm.
        wave: Amplitude of a wave on top of it, in mm.
        wavelength: Of that wave in mm.
    """

    def error(at: State) -> Column:
        place = at.position[along]
        share = place / length
        arc = 4 * bow * share * (1 - share)
        return arc + wave * np.sin(2 * np.pi * place / wavelength)

    return ErrorSource(axis, "cross", error)


def table_flatness(
    axis: str,
    across: tuple[str, str],
    size: tuple[float, float],
    twist: float,
    sag: float,
    dent: float,
) -> ErrorSource:
    """Return a table that is not flat: twisted, sagging in the middle, with a worn spot.

    Args:
        axis: That its height moves.
        across: The two axes that span the table.
        size: Its length along each of them in mm.
        twist: Height of the corners in mm.
        sag: Depth of the middle in mm.
        dent: Depth of the worn spot in mm, as wide as a sixth of the table, at one
            third of both lengths.
    """

    def error(at: State) -> Column:
        first, second = (
            2 * at.position[name] / extent - 1
            for name, extent in zip(across, size, strict=True)
        )
        bowl = sag * np.cos(np.pi * first / 2) * np.cos(np.pi * second / 2)
        squares = np.square(first + 1 / 3) + np.square(second + 1 / 3)
        spot = dent * np.exp(-squares / (2 * (1 / 6) ** 2))
        return twist * first * second - bowl - spot

    return ErrorSource(axis, "plane", error)


def part_growth(
    axis: str,
    part: str,
    shift: float = 0.0,
    stretch: float = 0.0,
    reference: float = 0.0,
) -> ErrorSource:
    """Return a part that grows as it warms: it shifts the axis, and it stretches it.

    Args:
        axis: That it moves.
        part: Its name; the temperature of the part counts.
        shift: In mm per K.
        stretch: In mm per mm and K.
        reference: Position in mm that the stretching leaves where it is.
    """

    def error(at: State) -> Column:
        warmer = at.temperature.get(part, np.full(at.rows, HALL)) - HALL
        distance = at.position[axis] - reference if stretch else 0.0
        return warmer * (shift + stretch * distance)

    return ErrorSource(axis, "temperature", error)


def nodding(
    axis: str,
    master: str,
    along: str,
    at_start: float,
    at_end: float,
    length: float,
    braking: float,
) -> ErrorSource:
    """Return a column that nods as another axis accelerates, the more the higher it reaches.

    Args:
        axis: That its top moves.
        master: Axis that accelerates.
        along: Axis whose position sets how far it nods.
        at_start: Error in mm per 1000 mm/s² at position 0 of ``along``.
        at_end: The same at ``length``.
        length: In mm.
        braking: Share of it that remains where the acceleration is negative.
    """

    def error(at: State) -> Column:
        if master not in at.acceleration:
            return np.zeros(at.rows)
        rate = at.acceleration[master] / 1000.0
        size = at_start + (at_end - at_start) * (at.position[along] / length)
        return size * np.where(rate < 0.0, braking, 1.0) * rate

    return ErrorSource(axis, "crosstalk", error)
