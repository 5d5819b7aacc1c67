"""How much a reading counts, given how far it lies from the fit.

Estimation goes through *pseudo-readings*: fit + ψ(residual) / mean ψ'. They have the
influence that the loss allows, and the Gaussian theory (evidence, standard deviations)
applied to them gives the right variance of the robust estimate.

Source: D. D. Cox, Asymptotics for M-type smoothing splines, Ann. Statist. 11(2), 1983;
H.-S. Oh, D. Nychka, T. Lee, The role of pseudo data for robust smoothing, Biometrika 94(4), 2007.
"""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float, Int
from scipy.special import gammaln

from ...data.signals import NORMAL

LOSSES = "student", "huber", "trim", "gauss"
WILD = 7.0
"""Readings further off than this many scales carry no information on the fit at all."""
HUBER = 1.345
"""Corner of the Huber loss: 95 % efficiency for Gaussian noise."""
FEW = 8.0
"""Spare readings at which twice the distance is asked of a wild one."""
FREEDOMS = (4.0, 6.0, 10.0, 20.0, 100.0)
"""Degrees of freedom of Student's t that are tried."""
_PLENTY = 200
"""Readings from which on the tails of their distribution can be told."""


@final
@dataclasses.dataclass(frozen=True)
class Loss:
    """Student's t with a Huber corner and a limit; without any of them least squares.

    Attributes:
        scale: Of the residuals, in the unit of the readings.
        freedom: Degrees of freedom of Student's t; infinite for Gaussian noise.
        corner: Residual in scales from which on the influence is constant (Huber).
        limit: Residual in scales from which on a reading is wild and has no influence.
        wild_from: Residual in scales from which on a reading is left out of the noise.
    """

    scale: float = 1.0
    freedom: float = np.inf
    corner: float = np.inf
    limit: float = np.inf
    wild_from: float = np.inf

    @property
    def unevenness(self) -> float:
        """Variance of ψ' over the square of its mean, where noise is Gaussian.

        The variance of a robust estimate grows by (1 + unevenness · unknowns / readings)²:
        P. J. Huber, Robust Statistics, 1981, section 7.6.
        """
        # Huber: (1 − P) / P with P = 0.82 of Gaussian noise inside the corner. Student's t at
        # the scale that suits such noise: 0.43, 0.23, 0.10 for a freedom of 4, 6, 10.
        outside = 0.22 if np.isfinite(self.corner) else 0.0
        return outside + 7.0 / self.freedom**2

    def influence(
        self, ratio: Float[np.ndarray, " t"]
    ) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
        """Return ψ(x)/x in 0…1 and ψ'(x) for residuals in scales."""
        size = np.abs(ratio)
        share = 1.0 / (1.0 + np.square(ratio) / self.freedom)
        slope = (2.0 * share - 1.0) * share
        if np.isfinite(self.corner):
            share = np.minimum(share, self.corner / np.maximum(size, 1e-300))
        slope = np.where(size <= min(self.corner, self.limit), slope, 0.0)
        return np.where(size <= self.limit, share, 0.0), slope

    def share(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return ψ(x)/x in 0…1 for residuals in scales; 0 for those that are rejected outright."""
        return self.influence(ratio)[0]


def choose_loss(
    name: str,
    size: Float[np.ndarray, " t"],
    inflation: float,
    floor: float,
    count: Int[np.ndarray, " t"],
    freedoms: tuple[float, ...] = FREEDOMS,
) -> Loss:
    """Return the loss with its scale taken from the residuals.

    Args:
        name: ``"student"``, ``"huber"``, ``"gauss"``, or ``"trim"``: least squares but for wild.
        size: Of residuals, ascending.
        inflation: Factor ≥ 1 that undoes the shrinkage of residuals by the fitted parameters.
        floor: Smallest scale.
        count: How many readings have each size.
        freedoms: Degrees of freedom of Student's t to choose from; of several the heaviest
            tails, unless there are plenty of readings.
    """
    total = int(count.sum())
    median = float(size[np.searchsorted(np.cumsum(count), 0.5 * total)])
    robust = max(NORMAL * median * inflation, floor)
    if name == "gauss":
        return Loss(robust)
    if name == "trim":
        return Loss(robust, limit=WILD, wild_from=WILD)
    if name == "huber":
        return Loss(robust, corner=HUBER, wild_from=WILD)
    # A scale from a handful of readings is uncertain itself.
    limit = WILD * (1.0 + FEW * inflation**2 / total)
    inner = size <= limit * robust / inflation
    square = np.square(size[inner] * inflation)
    counts = count[inner].astype(float)
    # Too few readings cannot tell the tails: stay with heavy ones.
    trials = freedoms if counts.sum() >= _PLENTY else freedoms[:1]
    fits = [
        (*_student_fit(square, counts, robust, freedom), freedom) for freedom in trials
    ]
    _, scale, freedom = min(fits)
    return Loss(max(scale, floor), freedom, limit=limit, wild_from=limit)


def _student_fit(
    square: Float[np.ndarray, " t"],
    count: Float[np.ndarray, " t"],
    start: float,
    freedom: float,
) -> tuple[float, float]:
    """Return minus the log-likelihood per reading, and the scale that minimises it."""
    total, scale2 = float(count.sum()), start**2
    for _ in range(30):
        share = (freedom + 1.0) / (freedom + square / scale2)
        new = float(count @ (share * square)) / total
        done = abs(new - scale2) <= 1e-3 * scale2
        scale2 = max(new, 1e-300)
        if done:
            break
    spread = float(count @ np.log1p(square / (freedom * scale2))) / total
    cost = 0.5 * (freedom + 1.0) * spread + 0.5 * float(np.log(scale2 * freedom))
    cost += float(gammaln(freedom / 2) - gammaln((freedom + 1) / 2))
    return cost, float(np.sqrt(scale2))
