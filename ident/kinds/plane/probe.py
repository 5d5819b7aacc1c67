"""The step of a probe for a plane."""

from collections.abc import Mapping
from typing import final

import numpy as np

from ....models import Conventions, Plane
from ...diagnosis.probe._probe import (
    FIRST,
    HEIGHT,
    SECOND,
    Masters,
    Outcome,
    Outcomes,
    ProbeAxis,
    Probed,
    both_signs,
    number_text,
    plateau,
)
from ...exchange._nodes import as_array
from .._protocol import AbstractProbe
from .entries import entries_of_plane


@final
class PlaneProbe(AbstractProbe):
    """A plateau over both masters, at different places of each."""

    plateaus = (FIRST, SECOND)

    def entries(
        self, one: Probed, axes: Mapping[int, ProbeAxis], conventions: Conventions
    ) -> dict[str, int | str]:
        nodes1, nodes2 = (axes[master].grid.model() for master in one.masters)
        values = np.outer(plateau(SECOND), plateau(FIRST)) / HEIGHT
        plane = Plane(nodes1, nodes2, as_array(values))
        return entries_of_plane(plane, one.masters, conventions)

    def outcomes(self, one: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
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
