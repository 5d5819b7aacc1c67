"""What a log shows of the offset."""

from typing import final

import numpy as np

from axcomp.ident.proof.verify import AbstractChannel, Change, LogRows, Parts


@final
class OffsetChannel(AbstractChannel):
    """The same in every row."""

    def prepare(self) -> None:
        self.law(self.conventions)

    def parts(self, change: Change, rows: LogRows) -> Parts:
        count = len(np.arange(self.motion.rows)[rows])
        return Parts(np.full(count, float(self.law(change.conventions).value)))


CHANNEL = OffsetChannel
