"""The step of a probe for a plane."""

from typing import final

from ...diagnosis.probe._probe import (
    FIRST,
    SECOND,
    Masters,
    Outcome,
    Outcomes,
    ProbeAxis,
    Probed,
    both_signs,
    number_text,
)
from .._protocol import AbstractProbe


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
            *both_signs(axis, "plane_sign", entry="offset"),
            Outcome(
                f"nothing there, but {axis.height_text} with {swapped}",
                "the first index of the table counts along master 1",
                {"plane_index": "ij"},
            ),
        )


PROBE = PlaneProbe()
