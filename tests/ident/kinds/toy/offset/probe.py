"""The step of a probe for the offset."""

from collections.abc import Mapping
from typing import final

from axcomp.ident.diagnosis import Masters, Outcome, Outcomes, ProbeAxis, Probed
from axcomp.ident.kinds._protocol import AbstractProbe
from axcomp.models import Conventions

from .entries import VALUE


@final
class OffsetProbe(AbstractProbe):
    """10 µm everywhere."""

    def entries(
        self, probed: Probed, axes: Mapping[int, ProbeAxis], conventions: Conventions
    ) -> dict[str, int | str]:
        return {VALUE: 100}

    def outcomes(self, probed: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        return (Outcome(f"+{axis.height_text}", "the value is added as it stands"),)


PROBE = OffsetProbe()
