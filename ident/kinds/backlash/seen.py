"""What is seen of the backlash at the machine: in a log, and in a probe."""

from typing import final

import jax.numpy as jnp
import numpy as np

from ...diagnosis.probe._probe import (
    HEIGHT,
    Masters,
    Outcome,
    Outcomes,
    Places,
    ProbeAxis,
    Probed,
)
from ...exchange._machine_lists import REVERSAL_CYCLES
from ...exchange._units import LIST_UNITS
from ...proof.verify import AbstractChannel, Change, LogRows, Parts
from .._protocol import AbstractProbe
from . import KIND
from .entries import WIDTH


@final
class BacklashChannel(AbstractChannel):
    """An offset that steps where the axis reverses (S-45)."""

    def prepare(self) -> None:
        self.cycles = self.law(self.conventions).cycles
        self.relevant = ("backlash_reference", "filter_delay")
        if self.distinguishes_actual():
            self.relevant = (*self.relevant, "direction_source")

    def parts(self, change: Change, rows: LogRows) -> Parts:
        count = len(self.motion.position(self.axis, "for its backlash")[rows])
        law = self.law(change.conventions)
        offset = np.asarray(law.offset(jnp.array([1.0, -1.0])))
        return Parts(np.full(count, offset[0]), np.full(count, offset[1] - offset[0]))


@final
class BacklashProbe(AbstractProbe):
    """A lost motion of 10 µm."""

    def additions(self, axis: ProbeAxis) -> dict[str, int | str]:
        width = round(HEIGHT * LIST_UNITS)
        return {KIND.activation: 1, WIDTH: width, REVERSAL_CYCLES: 10}

    def places(self, axis: ProbeAxis, masters: Masters) -> tuple[Places, Places]:
        # Down, against the direction in which nothing is added.
        return {axis.name: axis.at(6.0)}, {axis.name: axis.at(5.0)}

    def outcomes(self, probed: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        return (
            Outcome(
                f"−{axis.height_text}, and nothing when it is done coming from below",
                "moving up is the reference; moving down the backlash is taken off",
                {"backlash_reference": 1},
            ),
            Outcome(
                f"nothing, and +{axis.height_text} when it is done coming from below",
                "moving down is the reference",
                {"backlash_reference": -1},
            ),
        )


CHANNEL, PROBE = BacklashChannel, BacklashProbe()
