"""The step of a probe for a leadscrew table."""

from collections.abc import Mapping
from typing import final

from ....models import Conventions, Leadscrew
from ...diagnosis.probe._probe import (
    FIRST,
    Masters,
    Outcomes,
    ProbeAxis,
    Probed,
    both_signs,
    plateau,
)
from ...exchange._nodes import as_array
from .._protocol import AbstractProbe
from .entries import PREFIX, entries_of_leadscrew


@final
class LeadscrewProbe(AbstractProbe):
    """A plateau along the axis itself."""

    plateaus = (FIRST,)

    def entries(
        self, one: Probed, axes: Mapping[int, ProbeAxis], conventions: Conventions
    ) -> dict[str, int | str]:
        axis = axes[one.axis]
        screw = Leadscrew(
            nodes=axis.grid.model(),
            pos=as_array(plateau(FIRST)),
            modulo=axis.travel if axis.modulo else None,
        )
        # The input without other offsets: the plateau stays where it is (S-23).
        return entries_of_leadscrew(screw) | {f"{PREFIX}.set_pos_without_comp": 1}

    def outcomes(self, one: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        return both_signs(axis, "leadscrew_sign", entry="error")


PROBE = LeadscrewProbe()
