"""The step of a probe for crosstalk."""

import dataclasses
from collections.abc import Mapping
from typing import final

import numpy as np

from ....models import BilinearGrid, Conventions, Crosstalk
from ...diagnosis.probe._probe import Masters, Outcome, Outcomes, ProbeAxis, Probed
from ...exchange._identity import optional
from ...exchange._machine_lists import InUse
from ...exchange._nodes import as_array
from .._protocol import AbstractProbe
from .entries import PREFIX, entries_of_crosstalk

QUADRANTS = (0.010, 0.008, 0.006, 0.004)
"""In mm, one height per quadrant, in the order of the list's entries."""


@final
class CrosstalkProbe(AbstractProbe):
    """A height per quadrant of acceleration and velocity."""

    moving = True

    def probed(self, in_use: InUse) -> Probed:
        rate = optional(in_use.listing, f"{PREFIX}.acceleration")
        probed = Probed(in_use.axis, in_use.name, in_use.masters[:1])
        return dataclasses.replace(probed, acceleration=rate) if rate > 0 else probed

    def entries(
        self, probed: Probed, axes: Mapping[int, ProbeAxis], conventions: Conventions
    ) -> dict[str, int | str]:
        rate = float(probed.acceleration)
        crosstalk = Crosstalk(
            surface=BilinearGrid((), (0,)),
            values=as_array(np.array(QUADRANTS)[:, None]),
            acceleration=as_array(rate),
            deceleration=as_array(-rate),
        )
        return entries_of_crosstalk(crosstalk, probed.masters)

    def outcomes(self, probed: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        first, second, third, fourth = (f"{1000 * value:g}" for value in QUADRANTS)
        name = masters[0].name
        return (
            Outcome(
                f"+{first} µm for a > 0, v > 0; +{second} for a > 0, v < 0;"
                f" +{third} for a < 0, v > 0; +{fourth} for a < 0, v < 0 of {name} (in"
                f" proportion to a, up to {probed.acceleration} mm/s²)",
                "the sign of a decides; entries are added as they stand",
                {"crosstalk_accelerate": "sign", "crosstalk_sign": 1},
            ),
            Outcome(
                f"+{fourth} µm for a > 0, v < 0 and +{second} for a < 0, v < 0",
                "it counts whether the speed grows or shrinks",
                {"crosstalk_accelerate": "speed", "crosstalk_sign": 1},
            ),
            Outcome(
                f"+{first} µm for a > 0 and +{third} for a < 0, whichever way {name} moves",
                f"the direction of {axis.name} decides, which stands",
                {"crosstalk_velocity": "slave"},
            ),
            Outcome(
                "the same with the other sign",
                f"entries are subtracted from {axis.name}",
                {"crosstalk_sign": -1},
            ),
        )


PROBE = CrosstalkProbe()
