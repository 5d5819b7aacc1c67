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

from .._errors import FitError
from .._loss import HUBER, AbstractLoss, HuberLoss, choose_loss
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
    size = np.abs(residual) * lanes.use
    if kept is not None:
        scale = np.array([each.scale for each in kept])
    else:
        # 1.4826 makes the median of magnitudes the standard deviation of Gaussian noise.
        typical = _medians(size, lanes.count)
        scale = np.maximum(1.4826 * typical * inflation, floor)
    limit = scale * (_FULL if name == "trim" else HUBER)
    kind = TrimLoss if name == "trim" else HuberLoss
    losses: list[AbstractLoss] = [kind(float(each)) for each in scale]
    partly = np.flatnonzero(size.max(axis=1) > limit)
    if not len(partly):
        return lanes.all_rows(), losses
    ratio = size[partly] / scale[partly, None]
    full = lanes.use.copy()
    full[partly] *= losses[0].share(ratio.ravel()).reshape(ratio.shape)
    return Shares(lanes, full), losses


def _weigh_by(
    losses: Sequence[AbstractLoss], residual: Float[np.ndarray, "w s"], lanes: Lanes
) -> Shares:
    """Return how much each row counts under given losses."""
    shares = [
        each.share(row / each.scale) for each, row in zip(losses, residual, strict=True)
    ]
    return Shares(lanes, lanes.use * np.stack(shares))


def _medians(
    size: Float[np.ndarray, "w s"], count: Int[np.ndarray, " w"]
) -> Float[np.ndarray, " w"]:
    """Return the median of the largest so many values of each row; the others are 0."""
    found = np.empty(len(size))
    for lane, (row, many) in enumerate(zip(size, count.tolist(), strict=True)):
        middle = len(row) - many + many // 2
        part = np.partition(row, middle)
        upper = part[middle]
        odd = many % 2 or not middle
        found[lane] = upper if odd else 0.5 * (part[:middle].max() + upper)
    return found
