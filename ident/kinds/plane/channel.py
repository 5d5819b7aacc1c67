"""What a log shows of a plane."""

from typing import final

import numpy as np
from jaxtyping import Float

from ...proof.verify import Change, TableChannel


@final
class PlaneChannel(TableChannel):
    """A table over two masters."""

    def prepare(self) -> None:
        super().prepare()
        first, second = self.masters
        self.swaps = ((second, first),)
        actual = self.motion.has_actual(first, second)
        matters = {"table_filter": self.listed > 1, "plane_input": actual}
        self.relevant = ("plane_index", *(name for name, on in matters.items() if on))

    def positions(self, change: Change) -> Float[np.ndarray, "t d"]:
        actual = change.conventions.plane_input == "actual"
        return self.places(change.masters or self.masters, actual)


CHANNEL = PlaneChannel
