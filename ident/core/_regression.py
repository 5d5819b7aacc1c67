"""Robust regression on few columns.

For curves (thermal line, backlash, acceleration events): a stack of a few columns without a
prior, fitted by `Passes`. The singular values of the design decide what the readings
determine, and the covariance is that of the estimate under residuals that drift (`_drift`).
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ._drift import LEAST_FREE, DriftNoise, find_drift, scatter_of_sums
from ._effect import ColumnsEffect
from ._errors import FitError
from ._prior import NoPrior
from ._readings import Readings
from ._robust import Estimate, Passes, memory
from ._stack import Stack

_RIDGE = 1e-9
"""Precision that holds what no readings or only wild ones show, relative to that of all others."""
_MAGNITUDES = 10
"""Passes of least magnitudes, which only begin."""
SINGULAR = 1e-9
"""Size of a combination of scaled columns, in that of the largest, from which on it is 0."""
_EXACT = 1e-6
"""Smallest scatter relative to the spread of the readings."""
_THIN = 20_000
"""Readings that tell their spread."""
_BELIEF = 2.0
"""Readings that a scatter known beforehand counts for."""


@dataclasses.dataclass(frozen=True)
class Regression:
    """Fitted factors of columns.

    Attributes:
        coefficients: One per column; 0 where undetermined.
        noise: How the residuals scatter, wild ones left out.
        residual: Reading − fit per row.
        wild: Readings that the loss rejected outright.
        converged: Whether the robust passes converged.
        covariance: Of the coefficients, drift of the residuals counted in; infinite on the
            diagonal where undetermined.
        independent: Number of independent readings of the same total scatter that would leave
            the same uncertainty, per coefficient; the rows kept where nothing drifts.
        undetermined: Coefficients that the readings that were kept do not determine.
    """

    coefficients: Float[np.ndarray, " k"]
    noise: DriftNoise
    residual: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    converged: bool
    covariance: Float[np.ndarray, "k k"]
    independent: Float[np.ndarray, " k"]
    undetermined: Bool[np.ndarray, " k"]

    @property
    def standard_deviation(self) -> Float[np.ndarray, " k"]:
        """Of the coefficients; infinite where undetermined."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def regress(
    columns: Float[np.ndarray, "t k"],
    target: Float[np.ndarray, " t"],
    *,
    time: Float[np.ndarray, " t"] | None = None,
    loss: str = "student",
    noise: float | None = None,
) -> Regression:
    r"""Return the factors of columns that explain readings.

    M-estimate through pseudo-readings; covariance $A^{-1} X^T \Sigma X A^{-1}$ with
    $A = X^T X$ and the $\Sigma$ of `DriftNoise`, fitted to the pseudo-residuals. The estimate
    itself does not lean on the drift model, only its standard deviation does.

    Args:
        columns: Known functions per reading.
        target: Readings.
        time: Of each reading; None = in the order of the rows, one per unit.
        loss: ``"student"``, ``"huber"``, ``"trim"`` or ``"gauss"``.
        noise: Scatter of a reading as it is known beforehand, of readings that are
            independent: counts as two readings, lets as many unknowns be fitted as there are
            readings, and columns that cannot be separated are undetermined, not refused.

    Raises:
        FitError: If the columns cannot be separated or there are too few readings.
    """
    count, size = columns.shape
    scale = np.sqrt(np.square(columns).sum(axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    design = columns / scale
    if noise is None and count <= size:
        msg = f"{count} readings for {size} unknowns, expected more than {size}."
        raise FitError(msg)
    # In an orthonormal basis of the columns the information is a unit matrix.
    basis, null = _spectrum(design)
    if noise is None and null.shape[1]:
        msg = "the readings cannot tell the columns apart."
        raise FitError(msg)
    size = basis.shape[1]
    reduced, floor = design @ basis, max(least_scale(target), 0.1 * (noise or 0.0))
    start = _least_magnitudes(reduced, target, loss)
    fit = estimate_columns(reduced, target, loss, floor, start)
    residual = target - reduced @ fit.centre
    ratio = residual / fit.loss.scale
    wild = fit.loss.wild(ratio)
    rows = ~wild
    if wild.any() and int(rows.sum()) <= size:
        msg = "the readings that agree with each other are too few to fit."
        raise FitError(msg)
    pseudo = (fit.loss.share(ratio) * residual / fit.posterior.problem.gain)[rows]
    clock = np.arange(count, dtype=float) if time is None else np.asarray(time)
    clock, active = clock[rows], design[rows]
    span, kernel = _spectrum(active)
    undetermined = (np.abs(kernel) > SINGULAR**0.5).any(axis=1)
    # The likelihood needs as many columns as the readings see.
    spanning = active @ span
    free = float(rows.sum() - spanning.shape[1])
    if noise is None:
        drifting = find_drift(clock, spanning, pseudo)
    else:
        square = float(pseudo @ pseudo) / max(free, 1.0)
        if square < noise**2:
            # Known beforehand: counts as a few readings. A larger scatter has other reasons.
            square = (free * square + _BELIEF * noise**2) / (free + _BELIEF)
            free += _BELIEF
        drifting = DriftNoise(float(np.sqrt(square)))
    inverse = span @ span.T
    scatter = scatter_of_sums(drifting, clock, active)
    covariance = inverse @ scatter @ inverse / np.outer(scale, scale)
    plain = (drifting.white**2 + drifting.drift**2) * np.diag(inverse) / scale**2
    inflation = np.diag(covariance) / np.maximum(plain, 1e-300)
    independent = float(rows.sum()) / np.maximum(inflation, 1.0)
    # The variances themselves rest on as many readings: the variance of Student's t.
    free_each = np.maximum(independent if drifting.drift > 0 else free, LEAST_FREE)
    heavy = np.sqrt(free_each / (free_each - 2.0)) * np.ones(len(scale))
    covariance = covariance * np.outer(heavy, heavy)
    covariance[undetermined, :] = covariance[:, undetermined] = 0.0
    covariance[undetermined, undetermined] = np.inf
    return Regression(
        coefficients=np.where(undetermined, 0.0, basis @ fit.values / scale),
        noise=drifting,
        residual=target - reduced @ fit.values,
        wild=wild,
        converged=fit.converged,
        covariance=covariance,
        independent=np.where(undetermined, 0.0, independent),
        undetermined=undetermined,
    )


def estimate_columns(
    columns: Float[np.ndarray, "t k"],
    target: Float[np.ndarray, " t"],
    loss: str,
    floor: float,
    start: Float[np.ndarray, " k"] | None = None,
) -> Estimate:
    """Return the fit of columns without a prior; arguments as of `regress` and `Passes`."""
    size = columns.shape[1]
    stack = Stack((ColumnsEffect(NoPrior(size), _RIDGE),), banded=False)
    over, none = memory(stack, Readings(target, {}), columns), np.zeros(0)
    return Passes(stack, over, loss, lambda _: none, floor).run(start)


def _spectrum(
    design: Float[np.ndarray, "t k"],
) -> tuple[Float[np.ndarray, "k r"], Float[np.ndarray, "k n"]]:
    """Return combinations of columns of about length 1: those that the readings see, and others.

    The first make orthonormal columns: their products with themselves are the inverse of the
    normal matrix, 0 for what the readings do not see.
    """
    size = design.shape[1]
    _, values, right = np.linalg.svd(np.linalg.qr(design, mode="r"))
    values = np.append(values, np.zeros(size - len(values)))
    positive = values > SINGULAR * max(float(values[0]), 1e-300)
    return right[positive].T / values[positive], right[~positive].T


def _least_magnitudes(
    design: Float[np.ndarray, "t k"], target: Float[np.ndarray, " t"], loss: str
) -> Float[np.ndarray, " k"]:
    """Return least squares, or least magnitudes where wild readings are expected."""
    value = np.linalg.lstsq(design, target, rcond=None)[0]
    if loss == "gauss":
        return np.asarray(value)
    for _ in range(_MAGNITUDES):
        size = np.abs(target - design @ value)
        floor = max(0.05 * float(np.median(size)), 1e-300)
        weighted = design / np.maximum(size, floor)[:, None]
        value = np.linalg.lstsq(weighted.T @ design, weighted.T @ target, rcond=None)[0]
    return np.asarray(value)


def least_scale(target: Float[np.ndarray, " t"]) -> float:
    """Return the smallest scale of residuals to believe in."""
    target = target[:: max(1, len(target) // _THIN)]
    spread = float(np.ptp(np.quantile(target, (0.05, 0.95))))
    floor = max(_EXACT * spread, 1e-12)
    different = np.unique(target)
    if 1 < len(different) < 0.3 * len(target):
        # A coarse instrument repeats itself; that is no proof of its accuracy.
        floor = max(floor, float(np.median(np.diff(different))) / np.sqrt(12.0))
    return floor
