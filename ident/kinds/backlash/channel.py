"""What a log shows of the backlash."""

from typing import final

import jax.numpy as jnp
import numpy as np

from ...proof.verify import AbstractChannel, Change, LogRows, Parts


@final
class BacklashChannel(AbstractChannel):
    """An offset that steps where the axis reverses (S-45)."""

    def prepare(self) -> None:
        self.cycles = self.law(self.conventions).cycles
        self.relevant = ("backlash_reference", "filter_delay")
        if self.distinguishes_actual():
            self.relevant = (*self.relevant, "direction_source")

    def parts(self, change: Change, rows: LogRows) -> Parts:
        count = len(self.motion.position(self.axis, "for its backlash")[rows])
        law = self.law(change.conventions)
        offset = np.asarray(law.offset(jnp.array([1.0, -1.0])))
        return Parts(np.full(count, offset[0]), np.full(count, offset[1] - offset[0]))


CHANNEL = BacklashChannel
