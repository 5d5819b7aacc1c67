"""In which state a machine is when its error is asked for."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

Positions = Mapping[str, Float[np.ndarray, " t"]]
"""Position per axis in mm."""


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

    position: Positions
    direction: Mapping[str, Float[np.ndarray, " t"] | Int[np.ndarray, " t"]]
    acceleration: Mapping[str, Float[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )
    temperature: Mapping[str, Float[np.ndarray, " t"]] = dataclasses.field(
        default_factory=dict
    )

    @property
    def rows(self) -> int:
        """Number of instants."""
        known = [*self.position.values(), *self.direction.values()]
        return len(known[0]) if known else 0

    def take(self, rows: slice | np.ndarray) -> "State":
        """Return the state at some of the instants."""
        return State(
            *(
                {name: values[rows] for name, values in part.items()}
                for part in (
                    self.position,
                    self.direction,
                    self.acceleration,
                    self.temperature,
                )
            )
        )
