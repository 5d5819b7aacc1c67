"""The losses of `.._loss`, lane by lane: how much each reading of each fit counts."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import gammaln

from ...core._loss import FEW, FREEDOMS, HUBER, WILD
from .._runs import row_medians


@dataclasses.dataclass(frozen=True)
class Scale:
    """Loss of every lane with its scale; arrays of shape ``(k, 1)``."""

    name: str
    scale: Float[np.ndarray, "k 1"]
    limit: Float[np.ndarray, "k 1"]
    freedom: Float[np.ndarray, "k 1"]

    def wild(self, ratio: Float[np.ndarray, "k t"]) -> Bool[np.ndarray, "k t"]:
        """Return which residuals in scales are rejected outright."""
        if self.name != "student":
            return np.zeros(ratio.shape, bool)
        return np.asarray(np.abs(ratio) > self.limit)

    def share(self, ratio: Float[np.ndarray, "k t"]) -> Float[np.ndarray, "k t"]:
        """Return ψ(x)/x in 0…1 for residuals in scales."""
        if self.name == "gauss":
            return np.ones_like(ratio)
        if self.name == "huber":
            return np.asarray(
                np.minimum(1.0, HUBER / np.maximum(np.abs(ratio), 1e-300))
            )
        square = ratio * ratio / self.freedom
        return np.where(self.wild(ratio), 0.0, 1.0 / (1.0 + square))

    def slope(self, ratio: Float[np.ndarray, "k t"]) -> Float[np.ndarray, "k t"]:
        """Return ψ'(x) for residuals in scales."""
        if self.name == "gauss":
            return np.ones_like(ratio)
        if self.name == "huber":
            return np.asarray(np.abs(ratio) <= HUBER, float)
        square = ratio * ratio / self.freedom
        near = 1.0 + square
        return np.where(self.wild(ratio), 0.0, (1.0 - square) / (near * near))

    def take(self, lanes: Int[np.ndarray, " k"]) -> "Scale":
        """Return some of the lanes."""
        parts = (part[lanes] for part in (self.scale, self.limit, self.freedom))
        return Scale(self.name, *parts)


def choose_scale(
    name: str,
    residual: Float[np.ndarray, "k t"],
    inflation: Float[np.ndarray, " k"],
    floor: Float[np.ndarray, " k"],
) -> Scale:
    """Return the losses with scales taken from the residuals (× √weight).

    Args:
        name: ``"student"``, ``"huber"`` or ``"gauss"``.
        residual: Residuals × √weight.
        inflation: Factors ≥ 1 that undo the shrinkage of residuals by the fitted parameters.
        floor: Smallest scales.
    """
    size = np.abs(residual)
    robust = np.maximum(1.4826 * row_medians(size) * inflation, floor)[:, None]
    limit, freedom = np.full_like(robust, WILD), np.full_like(robust, FREEDOMS[0])
    if name != "student":
        return Scale(name, robust, limit, freedom)
    louder = inflation[:, None]
    limit = WILD * (1.0 + FEW * louder * louder / residual.shape[1])
    inside = size <= limit * robust / louder
    square = residual * louder
    square = np.where(inside, square * square, 0.0)
    count = inside.sum(axis=1, keepdims=True).astype(float)
    scale = _student_scale(square, count, robust, FREEDOMS[0])
    # Too few readings cannot tell the tails: stay with heavy ones.
    many = np.flatnonzero(count[:, 0] >= 200)
    if len(many):
        part = (square[many], count[many], robust[many])
        fits = [_student_scale(*part, freedom) for freedom in FREEDOMS]
        costs = np.stack(
            [
                _student_cost(part[0], part[1], fit, freedom)
                for fit, freedom in zip(fits, FREEDOMS, strict=True)
            ]
        )
        best = np.argmin(costs, axis=0)
        scale[many] = np.stack(fits)[best, np.arange(len(many))]
        freedom[many] = np.array(FREEDOMS)[best][:, None]
    return Scale(name, np.maximum(scale, floor[:, None]), limit, freedom)


def _student_scale(
    square: Float[np.ndarray, "k t"],
    count: Float[np.ndarray, "k 1"],
    start: Float[np.ndarray, "k 1"],
    freedom: float,
) -> Float[np.ndarray, "k 1"]:
    """Return the scale with the best likelihood; readings left out have ``square`` 0."""
    scale2 = start * start
    going, now = np.arange(len(square)), scale2.copy()
    for _ in range(20):
        # In place: fresh memory for every term would take a quarter of the time.
        counts = square / now
        counts += freedom
        np.divide(freedom + 1.0, counts, out=counts)
        counts *= square
        new = counts.sum(axis=1, keepdims=True) / count
        scale2[going] = np.maximum(new, 1e-300)
        moving = (np.abs(new - now) > 1e-3 * now)[:, 0]
        if not moving.all():
            going, square, count = going[moving], square[moving], count[moving]
            if not len(going):
                break
        now = scale2[going]
    return np.asarray(np.sqrt(scale2))


def _student_cost(
    square: Float[np.ndarray, "k t"],
    count: Float[np.ndarray, "k 1"],
    scale: Float[np.ndarray, "k 1"],
    freedom: float,
) -> Float[np.ndarray, " k"]:
    """Return minus the log-likelihood per reading."""
    scale2 = scale * scale
    near = np.log1p(square / (freedom * scale2)).sum(axis=1) / count[:, 0]
    cost = 0.5 * (freedom + 1.0) * near + 0.5 * np.log(scale2 * freedom)[:, 0]
    constant = float(gammaln(freedom / 2) - gammaln((freedom + 1) / 2))
    return np.asarray(cost + constant)
