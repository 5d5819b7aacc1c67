"""What is seen of a plane at the machine: in a log, and in a probe."""

from typing import final

import numpy as np
from jaxtyping import Float

from ...diagnosis.probe._probe import (
    FIRST,
    SECOND,
    Masters,
    Outcome,
    Outcomes,
    ProbeAxis,
    Probed,
    number_text,
)
from ...proof.verify import Change, TableChannel
from .._protocol import AbstractProbe


@final
class PlaneChannel(TableChannel):
    """A table over two masters."""

    def prepare(self) -> None:
        super().prepare()
        first, second = self.masters
        self.swaps = ((second, first),)
        actual = self.motion.has_actual(first, second)
        matters = {"table_filter": self.listed > 1, "plane_input": actual}
        self.relevant = ("plane_index", *(name for name, on in matters.items() if on))

    def positions(self, change: Change) -> Float[np.ndarray, "t d"]:
        actual = change.conventions.plane_input == "actual"
        return self.places(change.masters or self.masters, actual)


@final
class PlaneProbe(AbstractProbe):
    """A plateau over both masters, at different places of each."""

    plateaus = (FIRST, SECOND)

    def outcomes(self, probed: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        first, second = masters
        swapped = (
            f"{first.name} at {number_text(first.at(0.5 * sum(SECOND)))} and {second.name} at"
            f" {number_text(second.at(0.5 * sum(FIRST)))}"
        )
        return (
            *super().outcomes(probed, axis, masters),
            Outcome(
                f"nothing there, but {axis.height_text} with {swapped}",
                "the first index of the table counts along master 1",
                {"plane_index": "ij"},
            ),
        )


CHANNEL, PROBE = PlaneChannel, PlaneProbe()
