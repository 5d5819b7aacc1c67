r"""Residuals that remember: white noise plus a drift that forgets with a time constant.

Covariance of two readings: $\sigma_w^2/w_t$ on the diagonal, plus
$\sigma_d^2 e^{-|t-t'|/\tau}$ (Ornstein-Uhlenbeck). The drift has a tridiagonal precision over the
instants, so likelihood and products cost a pass over the readings. Variances and time constant
are those of restricted maximum likelihood: a slow drift beside a slow temperature leaves few
independent readings, however many were taken.

Source: G. E. Uhlenbeck, L. S. Ornstein, Phys. Rev. 36, 1930; H. D. Patterson, R. Thompson,
Biometrika 58(3), 1971.
"""

import dataclasses
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import get_lapack_funcs
from scipy.optimize import minimize

dpttrf, dpttrs = get_lapack_funcs(("pttrf", "pttrs"), dtype=np.float64)

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
LEAST_FREE = 3.0
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


@dataclasses.dataclass(frozen=True)
class _Chain:
    """Instants at which the drift lives, and which reading belongs to which."""

    gaps: Float[np.ndarray, " g"]
    index: Int[np.ndarray, " t"]

    @cached_property
    def size(self) -> int:
        return len(self.gaps) + 1

    def precision(
        self, time_constant: float
    ) -> tuple[Float[np.ndarray, " u"], Float[np.ndarray, " g"], float]:
        """Return diagonal, side diagonal and log-det of the precision of a drift of variance 1."""
        innovation = -np.expm1(-2.0 * self.gaps / time_constant)
        correlation = np.exp(-self.gaps / time_constant)
        diagonal = np.append(1.0, 1.0 / innovation)
        diagonal[:-1] += correlation**2 / innovation
        return diagonal, -correlation / innovation, -float(np.log(innovation).sum())

    def gather(self, columns: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "u k"]:
        """Return the sums of the readings at each instant."""
        sums = [np.bincount(self.index, column, self.size) for column in columns.T]
        return np.reshape(sums, (-1, self.size)).T


def _chain(time: Float[np.ndarray, " t"]) -> _Chain:
    instants, index = np.unique(time, return_inverse=True)
    return _Chain(np.diff(instants), index.reshape(-1))


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
    chain = _chain(time)
    if free < _FEW or chain.size < _FEW or not square > 0:
        return white_only
    right = np.column_stack([columns, residual])
    gram, gathered, counts = (
        right.T @ right,
        chain.gather(right),
        np.bincount(chain.index),
    )

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
        diagonal, side, logdet = chain.precision(float(time_constant))
        pivots, factor, failed = dpttrf(diagonal / ratio + counts, side / ratio)
        if failed:
            return np.inf, np.nan
        sums = gram - gathered.T @ dpttrs(pivots, factor, gathered)[0]
        spread = float(np.log(pivots).sum()) - logdet
        return deviance(sums, spread + chain.size * float(np.log(ratio)))

    independent, _ = deviance(gram, 0.0)
    span = float(chain.gaps.sum())
    low, high = np.log(float(np.median(chain.gaps))), np.log(span)
    # A drift longer than the log cannot be separated from a level, which the columns hold.
    points = [
        (np.log(ratio), tau)
        for ratio in np.geomspace(*_RATIOS)
        for tau in np.linspace(low, high, _TIMES)
    ]
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
    noise: DriftNoise,
    time: Float[np.ndarray, " t"],
    columns: Float[np.ndarray, "t k"],
) -> Float[np.ndarray, "k k"]:
    """Return the covariance of the sums Σ x r of residuals r that scatter so."""
    parts = noise.likely or ((noise.white**2, noise.drift**2, noise.time_constant),)
    result = sum(part[0] for part in parts) * (columns.T @ columns)
    if any(part[1] for part in parts):
        chain = _chain(time)
        sums = chain.gather(columns)
        total = np.zeros_like(sums)
        for _, variance, time_constant in parts:
            diagonal, side, _ = chain.precision(time_constant)
            total += variance * dpttrs(*dpttrf(diagonal, side)[:2], sums)[0]
        result = result + sums.T @ total
    return np.asarray(result)
