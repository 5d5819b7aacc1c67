"""The step of a probe for a leadscrew table."""

from collections.abc import Mapping
from typing import final

from ....data.lists import Value
from ....models import Conventions
from ...diagnosis.probe._probe import (
    FIRST,
    Masters,
    Outcomes,
    ProbeAxis,
    Probed,
    both_signs,
)
from .._protocol import AbstractProbe
from .entries import PREFIX


@final
class LeadscrewProbe(AbstractProbe):
    """A plateau along the axis itself."""

    plateaus = (FIRST,)

    def entries(
        self, probed: Probed, axes: Mapping[int, ProbeAxis], conventions: Conventions
    ) -> dict[str, Value]:
        entries = super().entries(probed, axes, conventions)
        # The input without other offsets: the plateau stays where it is (S-23).
        return {**entries, f"{PREFIX}.set_pos_without_comp": 1}

    def outcomes(self, probed: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        return both_signs(axis, "leadscrew_sign", entry="error")


PROBE = LeadscrewProbe()
