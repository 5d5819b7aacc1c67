"""Backlash as an effect: one value that changes sides with the direction."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float

from ...core._errors import FitError
from ._data import JointData
from ._effect import AbstractOwnEffect, Block, sparse_rows


@final
@dataclasses.dataclass(frozen=True)
class BacklashEffect(AbstractOwnEffect):
    r"""Backlash of an axis; its one value is the width in mm, signed as P-AXIS-00103.

    Error moving positive − error moving negative is minus the width:
    $e = -w\,(d - r)/2$ with the direction $d$ and the reference direction $r$, in which the
    axis is right (`axcomp.models.Backlash`).

    Attributes:
        reference: Direction without an error of its own, 1 or −1 (P-AXIS-00021 = 1 or 2).
    """

    reference: int = 1

    def __post_init__(self) -> None:
        if self.reference not in (1, -1):
            msg = f"{self.name}: found reference {self.reference}, expected 1 or -1."
            raise FitError(msg)

    @property
    def compensation(self) -> str:
        """See `AbstractEffect`."""
        return "backlash"

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return 1

    def placed(self, data: JointData) -> "BacklashEffect":
        """See `AbstractEffect`."""
        del data
        return self

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        way = data.column("direction", self.axis, self.name)
        known = np.isfinite(way)
        weight = -0.5 * (np.where(known, way, 0.0) - self.reference)
        index = np.zeros((len(way), 1), np.int64)
        columns = sparse_rows(index, weight[:, None], known, 1)
        return Block(columns, known, ("width",), ("mm",))

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(1,)``."""
        return values
