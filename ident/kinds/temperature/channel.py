"""What a log shows of the temperature."""

from typing import final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ....models import Conventions, TemperatureLine
from ...proof.verify import AbstractChannel, Change, LogRows, Parts
from .entries import temperature_from_list


@final
class TemperatureChannel(AbstractChannel):
    """A straight line over the position (S-43)."""

    def prepare(self) -> None:
        self.listed = self.law(self.conventions).cycles
        self.relevant = ("temperature_filter",)

    def law(self, conventions: Conventions) -> TemperatureLine:
        """Return the line of the list: what a log shows of it needs no unit."""
        line: TemperatureLine | None = temperature_from_list(
            self.one.listing, conventions
        )
        assert line is not None  # the axis list switches it on
        return line

    def cycles_under(self, conventions: Conventions) -> int:
        return self.listed if conventions.temperature_filter == "values" else 0

    def parts(self, change: Change, rows: LogRows) -> Parts:
        place = self.motion.position(self.axis, "for its temperature compensation")
        line = self.law(change.conventions)
        positions: Float[np.ndarray, " r"] = place[rows]
        cold = jnp.zeros((len(positions), 0))
        return Parts(np.asarray(line.offset(jnp.asarray(positions), cold)))


CHANNEL = TemperatureChannel
