r"""Robust regression on few columns, with noise that drifts.

For curves (thermal line, backlash, acceleration events): a stack of a few columns without a
prior, fitted by `Passes`. The information of the columns decides what the readings
determine, and the covariance is that of the estimate under residuals that remember: white noise
plus a drift that forgets with a time constant. Covariance of two readings: $\sigma_w^2/w_t$ on
the diagonal, plus $\sigma_d^2 e^{-|t-t'|/\tau}$ (Ornstein-Uhlenbeck). The drift has a
tridiagonal precision over the instants, so likelihood and products cost a pass over the readings.
Variances and time constant are those of restricted maximum likelihood: a slow drift beside a slow
temperature leaves few independent readings, however many were taken.

Source: G. E. Uhlenbeck, L. S. Ornstein, Phys. Rev. 36, 1930; H. D. Patterson, R. Thompson,
Biometrika 58(3), 1971.
"""

import dataclasses
import itertools

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float
from scipy.linalg import get_lapack_funcs
from scipy.optimize import minimize

from ._effect import ColumnsEffect
from ._prior import NoPrior
from ._readings import FitError, Readings
from ._robust import Estimate, Passes, memory
from ._stack import Stack

dpttrf, dpttrs = get_lapack_funcs(("pttrf", "pttrs"), dtype=np.float64)

_RIDGE = 1e-9
"""Precision that holds what no readings or only wild ones show, relative to that of all others."""
_MAGNITUDES = 10
"""Passes of least magnitudes, which only begin."""
SINGULAR = 1e-9
"""Information on a direction of scaled unknowns below which nothing is known, and smallness of
what is 0 beside the largest of its kind."""
_EXACT = 1e-6
"""Smallest scatter relative to the spread of the readings."""
_THIN = 20_000
"""Readings that tell their spread."""
_BELIEF = 2.0
"""Readings that a scatter known beforehand counts for."""
_QUIETEST = 0.5
"""Share of it that a few readings which agree by luck may scatter by."""
_MANY = 4_000
"""Readings from which the variances are sought on a part of them."""
_RATIOS, _TIMES = (1e-3, 1e3, 9), 7
"""Variances of the drift, relative to the noise: from, to, and how many; and time constants, from
the best of which the search starts."""
_SURELY = 0.01
"""Probability below which a drift is left out of account."""
_WORTH = 4.0
"""Gain in twice the log-likelihood below which there is no drift to speak of."""
_FEW = 10
"""Spare readings below which a drift is nothing that could be seen."""
_LEAST_FREE = 3.0
"""Independent readings that are granted to a drift, however slow."""


@dataclasses.dataclass(frozen=True)
class DriftNoise:
    """How residuals scatter.

    Attributes:
        white: Standard deviation of a reading about the drift, unit of the readings.
        drift: Standard deviation of the drift, same unit; 0 = independent readings.
        time_constant: Time in which the drift forgets, in the unit of the clock; 0 without one.
        likely: Others that the residuals do not exclude, each by its variances, white and of
            the drift, times its probability, and its time constant; itself is among them.
    """

    white: float
    drift: float = 0.0
    time_constant: float = 0.0
    likely: tuple[tuple[float, float, float], ...] = ()


def _instants(
    time: Float[np.ndarray, " t"],
) -> tuple[Float[np.ndarray, " g"], sp.csr_array]:
    """Return the gaps between the instants at which the drift lives, and the readings of each."""
    instants, index = np.unique(time, return_inverse=True)
    entries = np.ones(len(time)), (index.reshape(-1), np.arange(len(time)))
    return np.diff(instants), sp.csr_array(entries, (len(instants), len(time)))


def _precision(
    gaps: Float[np.ndarray, " g"], time_constant: float
) -> tuple[Float[np.ndarray, " u"], Float[np.ndarray, " g"], float]:
    """Return diagonal, side diagonal and log-det of the precision of a drift of variance 1."""
    innovation = -np.expm1(-2.0 * gaps / time_constant)
    correlation = np.exp(-gaps / time_constant)
    diagonal = np.append(1.0, 1.0 / innovation)
    diagonal[:-1] += correlation**2 / innovation
    return diagonal, -correlation / innovation, -float(np.log(innovation).sum())


def find_drift(
    time: Float[np.ndarray, " t"],
    columns: Float[np.ndarray, "t k"],
    residual: Float[np.ndarray, " t"],
) -> DriftNoise:
    """Return variances and time constant of residuals by restricted maximum likelihood.

    Args:
        time: Of each reading, in any order.
        columns: What was fitted; its degrees of freedom are taken off.
        residual: Readings minus fit.
    """
    step = -(-len(time) // _MANY)
    time, columns, residual = time[::step], columns[::step], residual[::step]
    free = len(time) - columns.shape[1]
    square = float(residual @ residual)
    white_only = DriftNoise(float(np.sqrt(square / max(free, 1))))
    gaps, at_instants = _instants(time)
    counts = at_instants.sum(axis=1)
    if free < _FEW or len(counts) < _FEW or not square > 0:
        return white_only
    right = np.column_stack([columns, residual])
    gram, gathered = right.T @ right, np.asfortranarray(at_instants @ right)

    def deviance(sums: Float[np.ndarray, "m m"], spread: float) -> tuple[float, float]:
        """Return minus twice the log-likelihood, and the variance of a reading.

        Of what the columns leave: a residual of smoothed values holds some of them.
        """
        try:
            # The residuals come last: their own element is what the columns leave.
            pivots = np.diag(np.linalg.cholesky(sums))
        except np.linalg.LinAlgError:
            return np.inf, np.nan
        variance = float(pivots[-1]) ** 2 / free
        shrink = 2.0 * float(np.log(pivots[:-1]).sum())
        return spread + shrink + free * float(np.log(variance)), variance

    def cost(parameters: Float[np.ndarray, " 2"]) -> tuple[float, float]:
        ratio, time_constant = np.exp(parameters)
        diagonal, side, logdet = _precision(gaps, float(time_constant))
        pivots, factor, failed = dpttrf(diagonal / ratio + counts, side / ratio)
        if failed:
            return np.inf, np.nan
        sums = gram - gathered.T @ dpttrs(pivots, factor, gathered)[0]
        spread = float(np.log(pivots).sum()) - logdet
        return deviance(sums, spread + len(counts) * float(np.log(ratio)))

    independent, _ = deviance(gram, 0.0)
    low, high = np.log(float(np.median(gaps))), np.log(float(gaps.sum()))
    # A drift longer than the log cannot be separated from a level, which the columns hold.
    ratios, times = np.log(np.geomspace(*_RATIOS)), np.linspace(low, high, _TIMES)
    points = list(itertools.product(ratios, times))
    tried = [(*cost(np.array(point)), *np.exp(point)) for point in points]
    start = min(range(len(tried)), key=lambda k: tried[k][0])
    if not np.isfinite(tried[start][0]):
        return white_only  # residuals without any scatter
    bounds = [(np.log(1e-4), np.log(1e6)), (low - 2.0, high + 1.0)]
    optimum = minimize(
        lambda point: cost(point)[0], points[start], method="Nelder-Mead", bounds=bounds,
        options={"xatol": 0.02, "fatol": 0.02, "maxiter": 120},
    )  # fmt: skip
    value, variance = cost(optimum.x)
    if not value < independent - _WORTH:
        return white_only
    ratio, time_constant = np.exp(optimum.x)
    white, drift = np.sqrt([variance, variance * ratio]).tolist()
    # The best alone forgets too soon where it is hardly known for how long a drift remembers.
    chance = np.exp(-0.5 * (np.array([each[0] for each in tried]) - value))
    chance[chance < _SURELY * chance.sum()] = 0.0
    chance /= chance.sum()
    likely = tuple(
        (share * noise, share * noise * size, tau)
        for share, (_, noise, size, tau) in zip(chance.tolist(), tried, strict=True)
        if share
    )
    return DriftNoise(white, drift, float(time_constant), likely)


def scatter_of_sums(
    noise: DriftNoise, time: Float[np.ndarray, " t"], columns: Float[np.ndarray, "t k"]
) -> Float[np.ndarray, "k k"]:
    """Return the covariance of the sums Σ x r of residuals r that scatter so."""
    parts = noise.likely or ((noise.white**2, noise.drift**2, noise.time_constant),)
    result = sum(part[0] for part in parts) * (columns.T @ columns)
    if any(part[1] for part in parts):
        gaps, at_instants = _instants(time)
        sums = at_instants @ columns
        total = np.zeros_like(sums)
        for _, variance, time_constant in parts:
            diagonal, side, _ = _precision(gaps, time_constant)
            total += variance * dpttrs(*dpttrf(diagonal, side)[:2], sums)[0]
        result = result + sums.T @ total
    return np.asarray(result)


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
    basis, null = rooted(design.T @ design)
    if noise is None and null.shape[1]:
        msg = "the readings cannot tell the columns apart."
        raise FitError(msg)
    size = basis.shape[1]
    reduced = design @ basis
    floor = max(least_scale(target), _QUIETEST * (noise or 0.0))
    start = _least_magnitudes(reduced, target, loss)
    fit = estimate_columns(reduced, target, loss, floor, start)
    residual = target - reduced @ fit.centre
    wild = fit.loss.share(residual / fit.loss.scale) == 0.0
    rows = ~wild
    if wild.any() and int(rows.sum()) <= size:
        msg = "the readings that agree with each other are too few to fit."
        raise FitError(msg)
    pseudo = fit.pseudo(residual)[rows]
    clock = np.arange(count, dtype=float) if time is None else np.asarray(time)
    clock, active = clock[rows], design[rows]
    span, kernel = rooted(active.T @ active)
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
    free_each = np.maximum(independent if drifting.drift > 0 else free, _LEAST_FREE)
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


def rooted(
    matrix: Float[np.ndarray, "k k"],
) -> tuple[Float[np.ndarray, "k r"], Float[np.ndarray, "k z"]]:
    """Return R with R Rᵀ the inverse in directions that are known, and the other directions.

    Of an information matrix; it is judged with a unit diagonal.
    """
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    known = values > SINGULAR
    root = vectors[:, known] / np.sqrt(values[known]) / size[:, None]
    return root, vectors[:, ~known] / size[:, None]


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
