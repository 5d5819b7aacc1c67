"""Regression on few columns whose residuals may drift.

For curves (thermal line, backlash, acceleration events) what the fit of a table is for tables:
the same robust passes (`estimate`), over columns that need not be independent. What the readings
determine is told by a pivoted factor, and the covariance is that of the estimate under residuals
that drift (`_drift`).
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solve_triangular

from ._drift import DriftNoise, find_drift, scatter_of_sums
from ._effect import ColumnsEffect
from ._errors import FitError
from ._factor import PivotedFactor
from ._prior import NoPrior
from ._readings import Readings
from ._robust import estimate, memory
from ._stack import Stack

_MAGNITUDES = 10
"""Passes of least magnitudes, which only begin."""
_HELD = 1e-12
"""Ridge of what only wild readings tell, relative to the information of the others."""
_EXACT = 1e-6
"""Smallest scatter relative to the spread of the readings."""
_MEMBER = 0.3
"""Share of a column in a direction without information from which it is named."""
_LEAST_FREE = 3.0
"""Independent readings that are granted to a drift, however slow."""
_BELIEF = 2.0
"""Readings that a scatter known beforehand counts for."""


@dataclasses.dataclass(frozen=True)
class Regression:
    """A fitted model.

    Attributes:
        coefficients: One per column, then one per non-linear parameter; 0 where undetermined.
        covariance: Of the coefficients, drift of the residuals counted in; infinite on the
            diagonal where undetermined; zeros where it was left out.
        noise: How the residuals scatter, wild ones left out.
        residual: Reading − fit per row.
        pseudo: Pseudo-readings of the last pass about the estimate before it, 0 where wild.
        share: Weight that the loss left each reading, 0 to 1.
        wild: Readings that the loss rejected outright.
        independent: Number of independent readings of the same total scatter that would leave
            the same uncertainty, per coefficient; the rows kept where nothing drifts.
        undetermined: Coefficients that the readings that were kept do not determine.
        converged: Whether the robust passes converged.
    """

    coefficients: Float[np.ndarray, " k"]
    covariance: Float[np.ndarray, "k k"]
    noise: DriftNoise
    residual: Float[np.ndarray, " t"]
    pseudo: Float[np.ndarray, " t"]
    share: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    independent: Float[np.ndarray, " k"]
    undetermined: Bool[np.ndarray, " k"]
    converged: bool

    @property
    def standard_deviation(self) -> Float[np.ndarray, " k"]:
        """Of the coefficients; infinite where undetermined."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def regress(
    columns: Float[np.ndarray, "t k"],
    target: Float[np.ndarray, " t"],
    *,
    time: Float[np.ndarray, " t"] | None = None,
    weight: Float[np.ndarray, " t"] | None = None,
    names: Sequence[str] = (),
    loss: str = "student",
    quick: bool = False,
    noise: float | None = None,
) -> Regression:
    r"""Return the factors of columns that explain readings.

    M-estimate through pseudo-readings; covariance $A^{-1} X^T W \Sigma W X A^{-1}$ with
    $A = X^T W X$ and the $\Sigma$ of `DriftNoise`, fitted to the pseudo-residuals. The estimate
    itself does not lean on the drift model, only its standard deviation does.

    Args:
        columns: Known functions per reading.
        target: Readings.
        time: Of each reading; None = in the order of the rows, one per unit.
        weight: Known relative weights (1/variance ratio), or None.
        names: Of the columns, for messages.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.
        quick: Coefficients only: covariance and drift are left out (hold-out folds).
        noise: Scatter of a reading of weight 1 as it is known beforehand, of readings that are
            independent: counts as two readings, lets as many unknowns be fitted as there are
            readings, and columns that cannot be separated are undetermined, not refused.

    Raises:
        FitError: If the columns cannot be separated or there are too few readings.
    """
    count, size = columns.shape
    known = np.ones(count) if weight is None else np.asarray(weight, float)
    weighted = columns * np.sqrt(known)[:, None]
    if noise is not None:
        size = len(_scaled_factor(weighted)[0].kept)
    if count < size or (count == size and noise is None):
        msg = f"{count} readings for {size} unknowns, expected more than {size}."
        raise FitError(msg)
    if noise is None:
        refuse_confounded(weighted, names)
    found = fit_columns(columns, target, known, loss, least_scale(target, noise))
    return found if quick else with_covariance(found, columns, known, time, noise)


def fit_columns(
    columns: Float[np.ndarray, "t k"],
    target: Float[np.ndarray, " t"],
    known: Float[np.ndarray, " t"],
    loss: str,
    floor: float,
    shapes: Float[np.ndarray, " s"] | None = None,
) -> Regression:
    """Return the factors of columns by robust passes, without their covariance.

    Args:
        columns: Those that are sums of others get 0.
        target: Readings.
        known: Their weights.
        loss: As for `regress`.
        floor: Smallest scale to believe in.
        shapes: Non-linear parameters of the columns, which come after the factors.

    Raises:
        FitError: If the loss rejects all but as many readings as there are columns.
    """
    root = np.sqrt(known)
    factor, scale = _scaled_factor(columns * root[:, None])
    kept = factor.kept
    # Orthonormal combinations: no pass loses digits, however alike the columns are.
    basis = (columns / scale)[:, kept]
    basis = solve_triangular(factor.triangle, basis.T, trans=1).T
    effect = ColumnsEffect(NoPrior(len(kept)), len(kept), _HELD)
    stack = Stack((effect,), banded=False)
    found = estimate(
        stack,
        memory(stack, Readings(target, {}, known), basis),
        loss=loss,
        weights=lambda problem: np.zeros(0),
        floor=floor,
        start=_least_magnitudes(basis * root[:, None], target * root, loss),
    )
    about = root * (target - basis @ found.centre)
    wild, residual = found.wild(about), target - basis @ found.values
    if wild.any() and int((~wild).sum()) <= len(kept):
        msg = "the readings that agree with each other are too few to fit."
        raise FitError(msg)
    factors = np.zeros(columns.shape[1])
    factors[kept] = solve_triangular(factor.triangle, found.values) / scale[kept]
    coefficients = np.append(factors, [] if shapes is None else shapes)
    size = len(coefficients)
    return Regression(
        coefficients=coefficients,
        covariance=np.zeros((size, size)),
        noise=DriftNoise(found.noise),
        residual=residual,
        pseudo=found.pseudo(about) / root,
        share=np.where(wild, 0.0, found.loss.share(root * residual / found.loss.scale)),
        wild=wild,
        independent=np.full(size, float(len(target))),
        undetermined=np.zeros(size, bool),
        converged=found.converged,
    )


def with_covariance(
    result: Regression,
    columns: Float[np.ndarray, "t k"],
    known: Float[np.ndarray, " t"],
    time: Float[np.ndarray, " t"] | None,
    belief: float | None = None,
) -> Regression:
    """Return the result with covariance, drift and what is not determined.

    Args:
        result: A fit without.
        columns: Change of the fit with each coefficient.
        known: Weights of the readings.
        time: As for `regress`.
        belief: `noise` of `regress`.
    """
    rows = ~result.wild
    clock = np.arange(len(rows), dtype=float) if time is None else np.asarray(time)
    scale = _scaled_factor(columns * np.sqrt(known)[:, None])[1]
    weight, part = known[rows], columns[rows] / scale
    factor = PivotedFactor.of(np.sqrt(weight)[:, None] * part)
    pseudo, lacking = result.pseudo[rows], factor.undetermined
    # The likelihood needs the columns that stand by themselves only.
    own = part[:, np.sort(factor.kept)]
    if belief is None:
        noise = find_drift(clock[rows], own, pseudo, weight)
    else:
        # Known beforehand: counts as a few readings.
        square = float((weight * pseudo**2).sum()) + _BELIEF * belief**2
        free = float(rows.sum() - own.shape[1]) + _BELIEF
        noise = DriftNoise(float(np.sqrt(square / max(free, 1.0))))
    inverse = factor.inverse()
    scatter = scatter_of_sums(noise, clock[rows], part, weight)
    covariance = inverse @ scatter @ inverse / np.outer(scale, scale)
    plain = (noise.white**2 + noise.drift**2) * np.diag(inverse) / scale**2
    swell = np.diag(covariance) / np.maximum(plain, 1e-300)
    independent = float(rows.sum()) / np.maximum(swell, 1.0)
    if noise.drift > 0:
        # The variances themselves rest on as many readings: the variance of Student's t.
        free = np.maximum(independent, _LEAST_FREE)
        heavy = np.sqrt(free / (free - 2.0))
        covariance = covariance * np.outer(heavy, heavy)
    covariance[lacking, :] = covariance[:, lacking] = 0.0
    covariance[lacking, lacking] = np.inf
    return dataclasses.replace(
        result,
        coefficients=np.where(lacking, 0.0, result.coefficients),
        covariance=covariance,
        noise=noise,
        independent=np.where(lacking, 0.0, independent),
        undetermined=lacking,
    )


def _scaled_factor(
    weighted: Float[np.ndarray, "t k"],
) -> tuple[PivotedFactor, Float[np.ndarray, " k"]]:
    """Return the factor of weighted columns of length 1, and how long they were; 1 for 0."""
    scale = np.sqrt(np.square(weighted).sum(axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    return PivotedFactor.of(weighted / scale), scale


def refuse_confounded(
    columns: Float[np.ndarray, "t k"], names: Sequence[str] = ()
) -> None:
    """Refuse columns that the readings cannot tell apart.

    Raises:
        FitError: Naming the columns between which a shift changes nothing.
    """
    scale = np.sqrt(np.square(columns).sum(axis=0))
    called = [
        names[k] if k < len(names) else f"column {k + 1}" for k in range(len(scale))
    ]
    for k in np.flatnonzero(scale == 0.0):
        msg = f"no reading tells {called[int(k)]}: it is 0 in all of them."
        raise FitError(msg)
    null = PivotedFactor.of(columns / scale).null
    if not null.shape[1]:
        return
    weak = np.abs(null[:, 0])
    members = [called[k] for k in np.flatnonzero(weak > _MEMBER * weak.max())]
    msg = f"the readings cannot tell apart {', '.join(members)}."
    raise FitError(msg)


def _least_magnitudes(
    design: Float[np.ndarray, "t k"], target: Float[np.ndarray, " t"], loss: str
) -> Float[np.ndarray, " k"]:
    """Return least squares, or least magnitudes where wild readings are expected."""
    value = np.linalg.lstsq(design, target, rcond=None)[0]
    if loss == "gauss":
        return np.asarray(value)
    for _ in range(_MAGNITUDES):
        size = np.abs(target - design @ value)
        least = max(0.05 * float(np.median(size)), 1e-300)
        weighted = design / np.maximum(size, least)[:, None]
        value = np.linalg.lstsq(weighted.T @ design, weighted.T @ target, rcond=None)[0]
    return np.asarray(value)


def least_scale(target: Float[np.ndarray, " t"], noise: float | None = None) -> float:
    """Return the smallest scale of residuals to believe in."""
    spread = float(np.ptp(np.quantile(target, (0.05, 0.95))))
    floor = max(_EXACT * spread, 1e-12, 0.1 * (noise or 0.0))
    different = np.unique(target)
    if 1 < len(different) < 0.3 * len(target):
        # A coarse instrument repeats itself; that is no proof of its accuracy.
        floor = max(floor, float(np.median(np.diff(different))) / np.sqrt(12.0))
    return floor
