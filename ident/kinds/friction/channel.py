"""What a log shows of the friction compensation."""

from typing import final

import numpy as np

from ...proof.verify import AbstractChannel, Change, LogRows, Parts


@final
class FrictionChannel(AbstractChannel):
    """A current over the speed of the axis."""

    unit = ""

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


CHANNEL = FrictionChannel
