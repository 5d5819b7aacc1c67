"""Which samples of a friction recording count.

A friction law is never quite the truth: what it leaves is in good part the law's own error,
and a loss that bends away from least squares within a few scales would weigh speeds against
each other. So samples count in full up to four scales and not at all from eight on.
"""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Bool, Float

from .._errors import FitError
from .._loss import AbstractLoss, choose_loss

_FULL = 4.0
"""Residual in scales up to which a sample counts in full."""
_NONE = 8.0
"""Residual in scales from which on it does not count."""
LOSSES = ("trim", "student", "huber", "gauss")


@final
@dataclasses.dataclass(frozen=True)
class TrimLoss(AbstractLoss):
    """Least squares within four scales, nothing beyond eight, a straight line between."""

    limit: float = _NONE

    def share(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        far = (self.limit - np.abs(ratio)) / (self.limit - _FULL)
        return np.asarray(np.clip(far, 0.0, 1.0))

    def slope(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        size = np.abs(ratio)
        taper = (self.limit - 2.0 * size) / (self.limit - _FULL)
        return np.where(size <= _FULL, 1.0, np.where(size < self.limit, taper, 0.0))

    def wild(self, ratio: Float[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        return np.asarray(np.abs(ratio) >= self.limit)


def friction_loss(
    name: str, residual: Float[np.ndarray, " t"], inflation: float, floor: float
) -> AbstractLoss:
    """Return the loss with its scale taken from the residuals.

    Args:
        name: ``"trim"`` or one of the table fits' losses.
        residual: In units of the current.
        inflation: Factor ≥ 1 that undoes the shrinkage by the fitted parameters.
        floor: Smallest scale.

    Raises:
        FitError: If the name is unknown.
    """
    if name not in LOSSES:
        words = ", ".join(repr(each) for each in LOSSES)
        msg = f"loss: found {name!r}, expected one of {words}."
        raise FitError(msg)
    if name != "trim":
        return choose_loss(name, residual, inflation, floor)
    # 1.4826 makes the median of magnitudes the standard deviation of Gaussian noise.
    scale = 1.4826 * float(np.median(np.abs(residual))) * inflation
    return TrimLoss(max(scale, floor))
