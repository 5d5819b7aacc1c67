"""What is left of an instrument's delay in a log taken in motion: a nuisance, never written."""

import dataclasses
from typing import final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from ...core._errors import FitError
from ._data import JointData
from ._effect import AbstractOwnEffect, Block


@final
@dataclasses.dataclass(frozen=True)
class DelayEffect(AbstractOwnEffect):
    r"""Reference late behind the encoder of an axis in motion: $e = -(\tau + \rho\,(t-t_0))\,v$.

    No compensation carries it: it stands beside the others so that they are free of it.
    Values: the delay τ in s at the middle of the recording; with a clock, its rate ρ in s/s.

    Attributes:
        origin: Instant $t_0$ in s; None = middle of the data.
        rate: Whether the clocks run apart as well.
    """

    origin: float | None = None
    rate: bool = True

    @property
    def compensation(self) -> str:
        """``"delay"``: none that a list could hold."""
        return "delay"

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return 2 if self.rate else 1

    def placed(self, data: JointData) -> "DelayEffect":
        """See `AbstractEffect`."""
        if not self.rate or self.origin is not None:
            return self
        if data.time is None:
            msg = f"{self.name}: a rate needs the time of every reading, found none."
            raise FitError(msg)
        clock = data.time[np.isfinite(data.time)]
        middle = 0.5 * float(clock.min() + clock.max()) if len(clock) else 0.0
        return dataclasses.replace(self, origin=middle)

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        speed = data.column("velocity", self.axis, self.name)
        known = np.isfinite(speed)
        columns = [-np.where(known, speed, 0.0)]
        origin = self.placed(data).origin
        if self.rate and data.time is not None and origin is not None:
            known = known & np.isfinite(data.time)
            columns.append(columns[0] * np.where(known, data.time - origin, 0.0))
        dense = np.where(known[:, None], np.column_stack(columns), 0.0)
        labels = ("delay", "rate of the delay")[: self.size]
        return Block(sp.csr_array(dense), known, labels, ("s", "s/s")[: self.size])

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(1,)`` or ``(2,)``."""
        return values
