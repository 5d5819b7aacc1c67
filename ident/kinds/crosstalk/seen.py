"""What is seen of crosstalk at the machine: in a log, and in a probe."""

import dataclasses
from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Float

from ....data.signals import resolution
from ....models import BilinearGrid, Conventions, Crosstalk
from ...diagnosis.probe._probe import Masters, Outcome, Outcomes, ProbeAxis, Probed
from ...exchange._identity import optional
from ...exchange._machine_lists import InUse
from ...exchange._nodes import as_array
from ...proof.verify import AbstractChannel, Change, LogRows, Parts, Way
from .._protocol import AbstractProbe
from .entries import PREFIX, entries_of_crosstalk

_BLURRED = 0.01
"""Noise of an acceleration, in that of the list, from which on it makes up delays and filters."""
QUADRANTS = (0.010, 0.008, 0.006, 0.004)
"""In mm, one height per quadrant, in the order of the list's entries."""


@final
class CrosstalkChannel(AbstractChannel):
    """An offset over the acceleration of another axis."""

    def prepare(self) -> None:
        law = self.law(self.conventions)
        self.cycles = law.cycles
        dynamic, *places = self.masters
        undirected = False
        if isinstance(law, Crosstalk):
            points = np.asarray(law.surface.points)
            self.ways = tuple(Way.of(column, ends=False) for column in points.T)
            undirected = not law.velocity_dependent
        axes = sorted(self.motion.positions)
        swaps = [(number, *places) for number in axes if number != dynamic]
        if len(places) == 2:
            swaps.insert(0, (dynamic, places[1], places[0]))
        self.swaps = tuple(swaps)
        _ = self.parts(self.plain, slice(0, 1))  # a log without a master is refused
        cycle, given = self.motion.cycle, dynamic in self.motion.accelerations
        step = resolution(self.motion.positions.get(dynamic, np.zeros(0)))
        # Rounded positions, differenced twice.
        noise = 0.0 if cycle is None or given else step / (np.sqrt(2.0) * cycle**2)
        if noise > _BLURRED * float(law.acceleration):
            name = f"A{dynamic}"
            self.coarse = (
                f"{name}.position is in steps of {1e3 * step:.2g} µm, from which accelerations"
                f" follow to {noise:.2g} mm/s² only. Log {name}.velocity and"
                f" {name}.acceleration as well"
            )
        asked = {
            "crosstalk_accelerate": True,
            "crosstalk_velocity": True,
            "crosstalk_above": True,
            "filter_delay": not self.coarse,
            "crosstalk_undirected": undirected,
            "crosstalk_outside": bool(places),
            "crosstalk_surface": len(places) == 2,
            "crosstalk_input": cycle is not None
            and self.motion.has_actual(dynamic, self.axis),
        }
        self.relevant = tuple(name for name, is_asked in asked.items() if is_asked)

    def parts(self, change: Change, rows: LogRows) -> Parts:
        purpose = f"for the crosstalk of A{self.axis}"
        dynamic, *places = change.masters or self.masters
        actual = change.conventions.crosstalk_input == "actual"
        velocity, acceleration = self.motion.required_rates(dynamic, purpose, actual)
        if change.conventions.crosstalk_velocity == "slave":
            velocity = self.motion.required_rates(self.axis, purpose, actual)[0]
        law = self.law(change.conventions)
        columns = [self.motion.position(axis, purpose)[rows] for axis in places]
        place: Float[np.ndarray, "r k"] | None = None
        if columns:
            place = change.moved(np.stack(columns, axis=1))
        offset = law.offset(acceleration[rows], velocity[rows], place)
        return Parts(np.asarray(offset))


@final
class CrosstalkProbe(AbstractProbe):
    """A height per quadrant of acceleration and velocity."""

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


CHANNEL, PROBE = CrosstalkChannel, CrosstalkProbe()
