"""What is seen of a cross table at the machine: in a log, and in a probe."""

from typing import final

from ...diagnosis.probe._probe import (
    SECOND,
    Masters,
    Outcome,
    Outcomes,
    ProbeAxis,
    Probed,
    number_text,
)
from ...proof.verify import TableChannel
from .._protocol import AbstractProbe


@final
class CrossChannel(TableChannel):
    """A table over one master."""

    edge_rule = "cross_edge"

    def prepare(self) -> None:
        super().prepare()
        axes = sorted(self.motion.positions)
        self.swaps = tuple((axis,) for axis in axes if (axis,) != self.masters)
        self.relevant = ("table_filter",) if self.listed > 1 else ()


@final
class CrossProbe(AbstractProbe):
    """A plateau along the master."""

    plateaus = (SECOND,)

    def outcomes(self, probed: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        (master,) = masters
        low, high = (number_text(master.at(float(tenths))) for tenths in SECOND)
        observed = (
            f"nothing on {axis.name}, but {master.name} moves by {axis.height_text} when"
            f" {axis.name} stands at {low} to {high} (where it does not reach that: a list of"
            f" {master.name} with the number of {axis.name} as its master acts on {axis.name})"
        )
        return (
            *super().outcomes(probed, axis, masters),
            Outcome(
                observed,
                "the list belongs to the master axis and names its slave",
                {"cross_list": "master"},
            ),
        )


CHANNEL, PROBE = CrossChannel, CrossProbe()
