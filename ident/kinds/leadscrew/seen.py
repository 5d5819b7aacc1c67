"""What is seen of a leadscrew table at the machine: in a log, and in a probe."""

from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Float

from ....data.lists import Value
from ....models import Conventions, Leadscrew
from ...diagnosis.probe._probe import FIRST, ProbeAxis, Probed
from ...proof.verify import Change, TableChannel, ways_of
from .._protocol import AbstractProbe
from .entries import PREFIX


@final
class LeadscrewChannel(TableChannel):
    """A table over the position of the axis itself, with what the others add (S-23)."""

    def prepare(self) -> None:
        super().prepare()
        listing = self.one.listing
        screw: Leadscrew = self.law(self.conventions)
        self.ways = ways_of(screw, ends=not screw.modulo)
        self.cycles = self.reversal if screw.bilateral else 0
        raw_input = listing.boolean(f"{PREFIX}.set_pos_without_comp")
        self._added: Float[np.ndarray, " t"] | None = None
        if self.others and not raw_input:
            others = (c for c in self.others.values() if not c.one.kind.adds_current)
            added = (channel.column(channel.plain) for channel in others)
            self._added = sum(added, np.zeros(self.motion.rows))
        matters = {
            "leadscrew_input": self._added is not None,
            "filter_delay": self.cycles > 1,
            "direction_source": screw.bilateral and self.distinguishes_actual(),
        }
        self.relevant = tuple(name for name, on in matters.items() if on)

    def cycles_under(self, conventions: Conventions) -> int:
        return self.cycles

    def positions(self, change: Change) -> Float[np.ndarray, "t d"]:
        places = super().positions(change)
        if self._added is None or change.conventions.leadscrew_input == "none":
            return places
        return np.asarray(places + self._added[:, None])


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


CHANNEL, PROBE = LeadscrewChannel, LeadscrewProbe()
