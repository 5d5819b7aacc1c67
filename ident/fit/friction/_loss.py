"""Which samples of a friction recording count.

A friction law is never quite the truth: what it leaves is in good part the law's own error,
and a loss that bends away from least squares within a few scales would weigh speeds against
each other. So samples count in full up to four scales and not at all from eight on.
"""

import dataclasses
from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core._errors import FitError
from ...core._loss import HUBER, AbstractLoss, HuberLoss, choose_loss
from ._lanes import Lanes, Shares

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


def check_loss(name: str) -> None:
    """Refuse the name of a loss that there is not.

    Raises:
        FitError: If the name is unknown.
    """
    if name not in LOSSES:
        words = ", ".join(repr(each) for each in LOSSES)
        msg = f"loss: found {name!r}, expected one of {words}."
        raise FitError(msg)


def weigh(
    name: str,
    residual: Float[np.ndarray, "w s"],
    lanes: Lanes,
    inflation: Float[np.ndarray, " w"],
    floor: Float[np.ndarray, " w"],
    kept: Sequence[AbstractLoss] | None = None,
) -> tuple[Shares, list[AbstractLoss]]:
    """Return how much each row counts in each fit, and the losses that say so.

    Args:
        name: ``"trim"`` or one of the table fits' losses.
        residual: In units of the current.
        lanes: Rows that each fit uses.
        inflation: Factors ≥ 1 that undo the shrinkage by the fitted parameters.
        floor: Smallest scale of each fit.
        kept: Losses with scales to keep; taken from the residuals where left out.
    """
    if name not in ("trim", "huber"):
        others = list(kept or ()) or [
            choose_loss(name, each[use > 0], float(factor), float(least))
            for each, use, factor, least in zip(
                residual, lanes.use, inflation, floor, strict=True
            )
        ]
        return _weigh_by(others, residual, lanes), others
    trim = name == "trim"
    # 1.4826 makes the median of magnitudes the standard deviation of Gaussian noise.
    factor, least = 1.4826 * inflation, np.asarray(floor, float)
    scale = np.empty(len(residual))
    if kept is not None:
        scale[:] = [each.scale for each in kept]
        least = np.full(len(scale), -1.0)
    lane, row = far_off(residual, lanes, least, factor, _FULL if trim else HUBER, scale)
    losses: list[AbstractLoss] = [
        TrimLoss(each) if trim else HuberLoss(each) for each in scale.tolist()
    ]
    if not len(lane):
        return lanes.all_rows(), losses
    full = lanes.use.copy()
    full[lane, row] = losses[0].share(residual[lane, row] / scale[lane])
    return Shares(lanes, full), losses


def far_off(
    residual: Float[np.ndarray, "w s"],
    lanes: Lanes,
    least: Float[np.ndarray, " w"],
    factor: Float[np.ndarray, " w"],
    limit: float,
    scale: Float[np.ndarray, " w"],
) -> tuple[Int[np.ndarray, " _"], Int[np.ndarray, " _"]]:
    """Return the fits and rows of all residuals that are large against their scale.

    Args:
        residual: In units of the current.
        lanes: Rows that each fit uses.
        least: Smallest scale of each fit; where negative, its scale is given.
        factor: Its scale where the median of its residuals' magnitudes is 1.
        limit: What counts as large, in scales.
        scale: Given scales; the others are written here.
    """
    from . import _noise_kernel

    lane, row = np.empty((2, residual.size), np.int64)
    many = _noise_kernel.far(
        residual, lanes.use, least, factor, limit, scale, lane, row
    )
    return lane[:many], row[:many]


def _weigh_by(
    losses: Sequence[AbstractLoss], residual: Float[np.ndarray, "w s"], lanes: Lanes
) -> Shares:
    """Return how much each row counts under given losses."""
    shares = [
        each.share(row / each.scale) for each, row in zip(losses, residual, strict=True)
    ]
    return Shares(lanes, lanes.use * np.stack(shares))
