"""The step of a probe for a cross table."""

from typing import final

from ...diagnosis.probe._probe import (
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
class CrossProbe(AbstractProbe):
    """A plateau along the master."""

    plateaus = (SECOND,)

    def outcomes(self, one: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        (master,) = masters
        between = [master.at(float(tenths)) for tenths in SECOND]
        there = f"{number_text(between[0])} to {number_text(between[1])}"
        if axis.at(0.0) <= between[0] and between[1] <= axis.at(10.0):
            seen = (
                f"nothing on {axis.name}, but {master.name} moves by {axis.height_text} when"
                f" {axis.name} stands at {there}"
            )
        else:
            seen = (
                f"nothing on {axis.name}, which does not reach {there}, and a list of"
                f" {master.name} with the number of {axis.name} as its master acts on"
                f" {axis.name}"
            )
        return (
            *both_signs(axis, "cross_sign", entry="offset"),
            Outcome(
                seen,
                "the list belongs to the master axis and names its slave",
                {"cross_list": "master"},
            ),
        )


PROBE = CrossProbe()
