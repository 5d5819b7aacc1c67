"""What is seen of the friction compensation at the machine: in a log, and in a probe."""

from collections.abc import Mapping
from typing import final

import numpy as np

from ....data.lists import Value
from ....models import Conventions
from ...diagnosis.probe._probe import Masters, Outcome, Outcomes, ProbeAxis, Probed
from ...exchange._identity import optional
from ...exchange._machine_lists import InUse
from ...exchange._units import expect
from ...proof.verify import AbstractChannel, Change, LogRows, Parts
from .._protocol import AbstractProbe
from .entries import PREFIX

LEVEL = 0.15
"""Share of the loaded currents: 10 to 20 % shows the sign and harms no drive."""


@final
class FrictionChannel(AbstractChannel):
    """A current over the speed of the axis."""

    def prepare(self) -> None:
        self.relevant = (
            "friction_below",
            "friction_above",
            "friction_rest",
            "friction_build_up",
            "friction_decay",
        )
        if self.law(self.conventions).delay_cycles:
            self.relevant = (*self.relevant, "friction_delay")
        _ = self.motion.required_rates(self.axis, "for its friction compensation")

    def parts(self, change: Change, rows: LogRows) -> Parts:
        purpose = "for its friction compensation"
        velocity, _ = self.motion.required_rates(self.axis, purpose)
        law = self.law(change.conventions)
        if self.motion.cycle is None:
            return Parts(np.asarray(law.current(velocity))[rows])
        place = self.motion.position(self.axis, purpose)
        current, _ = law.run(law.start(), place, velocity)
        return Parts(np.asarray(current)[rows])


@final
class FrictionProbe(AbstractProbe):
    """The currents of the loaded list, scaled down; a list without any is not probed."""

    checks = (
        "the drive needs a torque interface, and its cyclic telegram the additive torque:"
        " SERCOS S-0-0081 (additive torque command value) and S-0-0084 (torque feedback"
        " value), CANopen 60B2 (torque offset) and 6077 (torque actual value).",
    )

    def probed(self, in_use: InUse) -> Probed:
        kept: dict[str, Value] = {}
        for entry in in_use.listing.entries:
            value = in_use.listing.integer(entry.name)
            if entry.name.startswith(f"{PREFIX}.") and value is not None:
                kept[entry.name] = value
        scaling = optional(in_use.listing, f"{PREFIX}.scaling_factor")
        low = round(LEVEL * scaling)
        where = f"{in_use.listing.source}: {PREFIX}.scaling_factor"
        words = "10 or more, of which 10 to 20 % can be written"
        expect(0.1 <= low / max(scaling, 1) <= 0.2, where, scaling, words)
        kept[f"{PREFIX}.scaling_factor"] = low
        return Probed(in_use.axis, in_use.name, in_use.masters, kept=kept)

    def entries(
        self, probed: Probed, axes: Mapping[int, ProbeAxis], conventions: Conventions
    ) -> Mapping[str, Value]:
        return probed.kept

    def outcomes(self, probed: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        return (
            Outcome(
                f"a current of the sign of the entries while {axis.name} moves positive",
                "entries are added as they stand",
                {"friction_sign": 1},
            ),
            Outcome(
                "the other sign",
                "entries are subtracted in positive motion",
                {"friction_sign": -1},
            ),
            Outcome(
                f"what the controller asks {axis.name} for beside it rises with it on",
                "the table works against the motion: take it out",
            ),
        )


CHANNEL, PROBE = FrictionChannel, FrictionProbe()
