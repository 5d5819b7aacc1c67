"""What is seen of the offset at the machine: in a log, and in a probe."""

from collections.abc import Mapping
from typing import final

import numpy as np

from axcomp.ident.diagnosis import Masters, Outcome, Outcomes, ProbeAxis, Probed
from axcomp.ident.kinds._protocol import AbstractProbe
from axcomp.ident.proof.verify import AbstractChannel, Change, LogRows, Parts
from axcomp.models import Conventions

from .entries import VALUE


@final
class OffsetChannel(AbstractChannel):
    """The same in every row."""

    def prepare(self) -> None:
        self.law(self.conventions)

    def parts(self, change: Change, rows: LogRows) -> Parts:
        count = len(np.arange(self.motion.rows)[rows])
        return Parts(np.full(count, float(self.law(change.conventions).value)))


@final
class OffsetProbe(AbstractProbe):
    """10 µm everywhere."""

    def entries(
        self, probed: Probed, axes: Mapping[int, ProbeAxis], conventions: Conventions
    ) -> dict[str, int | str]:
        return {VALUE: 100}

    def outcomes(self, probed: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        return (Outcome(f"+{axis.height_text}", "the value is added as it stands"),)


CHANNEL, PROBE = OffsetChannel, OffsetProbe()
