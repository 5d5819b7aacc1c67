"""How much a reading counts, given how far it lies from the table.

Estimation goes through *pseudo-readings*: fit + ψ(residual) / mean ψ'. They have the
influence that the loss allows, and the Gaussian theory (evidence, standard deviations)
applied to them gives the right variance of the robust estimate.

Source: D. D. Cox, Asymptotics for M-type smoothing splines, Ann. Statist. 11(2), 1983;
H.-S. Oh, D. Nychka, T. Lee, The role of pseudo data for robust smoothing, Biometrika 94(4), 2007.
"""

import abc
import dataclasses
from typing import final

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import gammaln

from ._errors import FitError

WILD = 7.0
"""Readings further off than this many scales carry no information on the table at all."""
HUBER = 1.345
"""Corner of the Huber loss: 95 % efficiency for Gaussian noise."""
FEW = 8.0
"""Spare readings at which twice the distance is asked of a wild one."""
FREEDOMS = (4.0, 6.0, 10.0, 20.0, 100.0)


@dataclasses.dataclass(frozen=True)
class AbstractLoss(abc.ABC):
    """A loss with its scale, in the unit of the readings (weight 1)."""

    scale: float
    limit: float = WILD
    """Residual in scales from which on a reading is wild."""

    @abc.abstractmethod
    def share(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return ψ(x)/x in 0…1 for residuals in scales."""

    @abc.abstractmethod
    def slope(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return ψ'(x) for residuals in scales."""

    @abc.abstractmethod
    def wild(self, ratio: Float[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
        """Return which residuals in scales are rejected outright."""


@final
@dataclasses.dataclass(frozen=True)
class GaussLoss(AbstractLoss):
    """Least squares: every reading counts in full."""

    def share(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        return np.ones_like(ratio)

    def slope(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        return np.ones_like(ratio)

    def wild(self, ratio: Float[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        return np.zeros(ratio.shape, bool)


@final
@dataclasses.dataclass(frozen=True)
class HuberLoss(AbstractLoss):
    """Quadratic in the middle, linear outside; never rejects."""

    def share(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        return np.asarray(np.minimum(1.0, HUBER / np.maximum(np.abs(ratio), 1e-300)))

    def slope(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        return np.asarray(np.abs(ratio) <= HUBER, float)

    def wild(self, ratio: Float[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        return np.zeros(ratio.shape, bool)


@final
@dataclasses.dataclass(frozen=True)
class StudentLoss(AbstractLoss):
    """Student's t: far readings count less and less, hopeless ones not at all."""

    freedom: float = 4.0

    def share(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        # In place: with many readings the temporaries would cost more than the sums.
        share = np.asarray(np.square(ratio))
        share /= self.freedom
        share += 1.0
        np.reciprocal(share, out=share)
        np.copyto(share, 0.0, where=self.wild(ratio))
        return share

    def slope(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        # (1 − q) / (1 + q)² with q = ratio² / freedom, by the share 1 / (1 + q).
        share = self.share(ratio)
        slope = 2.0 * share
        slope -= 1.0
        slope *= share
        return slope

    def wild(self, ratio: Float[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
        """See `AbstractLoss`."""
        return np.asarray(np.abs(ratio) > self.limit)


def choose_loss(
    name: str, residual: Float[np.ndarray, " t"], inflation: float, floor: float
) -> AbstractLoss:
    """Return the loss with its scale taken from the residuals.

    Args:
        name: ``"student"``, ``"huber"`` or ``"gauss"``.
        residual: Residuals × √weight.
        inflation: Factor ≥ 1 that undoes the shrinkage of residuals by the fitted parameters.
        floor: Smallest scale.

    Raises:
        FitError: If the name is unknown.
    """
    if name not in ("student", "huber", "gauss"):
        msg = f"loss: found {name!r}, expected 'student', 'huber' or 'gauss'."
        raise FitError(msg)
    # 1.4826 makes the median of magnitudes the standard deviation of Gaussian noise.
    robust = max(1.4826 * float(np.median(np.abs(residual))) * inflation, floor)
    if name == "gauss":
        return GaussLoss(robust)
    if name == "huber":
        return HuberLoss(robust)
    # A scale from a handful of readings is uncertain itself.
    limit = WILD * (1.0 + FEW * inflation**2 / len(residual))
    inner = residual[np.abs(residual) <= limit * robust / inflation] * inflation
    # Too few readings cannot tell the tails: stay with heavy ones.
    freedoms = FREEDOMS if len(inner) >= 200 else FREEDOMS[:1]
    fits = [(_student_fit(inner, robust, freedom), freedom) for freedom in freedoms]
    (_, scale), freedom = min(fits)
    return StudentLoss(max(scale, floor), limit, freedom)


def _student_fit(
    residual: Float[np.ndarray, " t"], start: float, freedom: float
) -> tuple[float, float]:
    """Return minus the log-likelihood per reading, and the scale that minimises it."""
    square = residual**2
    scale2 = start**2
    for _ in range(20):
        share = (freedom + 1.0) / (freedom + square / scale2)
        new = float((share * square).mean())
        done = abs(new - scale2) <= 1e-3 * scale2
        scale2 = max(new, 1e-300)
        if done:
            break
    cost = 0.5 * (freedom + 1.0) * float(np.log1p(square / (freedom * scale2)).mean())
    cost += 0.5 * float(np.log(scale2 * freedom))
    cost += float(gammaln(freedom / 2) - gammaln((freedom + 1) / 2))
    return cost, float(np.sqrt(scale2))
