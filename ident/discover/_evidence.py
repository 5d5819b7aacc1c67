r"""How large each term is: variances of groups of coefficients by their evidence.

$e = \sum_g \Phi_g \theta_g + \epsilon$ with $\theta_g \sim N(0, \tau_g^2 I)$; every
$\tau_g$ and the noise maximise the marginal likelihood, by the fixed-point rule of D. J. C.
MacKay, Neural Computation 4(3), 1992. What is not there gets a variance of 0. Offsets of
runs and drifts are groups like the others, so that they take what terms do not explain,
and no more.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve, get_lapack_funcs

from ._sums import Sums

(_INVERSE,) = get_lapack_funcs(["potri"], dtype=np.float64)
_STEPS = 40
_SETTLED = 5e-3
"""Relative change of every contribution at which the variances have settled."""
_WARM = 4
"""Steps before anything is taken as absent."""


@dataclasses.dataclass(frozen=True)
class Variances:
    r"""Variances of groups and noise, with the coefficients that they give.

    Attributes:
        group: $\tau_g^2$ of each group in mm² (or °²); 0 = absent.
        noise: Standard deviation of a reading in mm or °.
        values: Coefficients; 0 where a group is absent.
        rms: Contribution of each group over the readings.
    """

    group: Float[np.ndarray, " g"]
    noise: float
    values: Float[np.ndarray, " p"]
    rms: Float[np.ndarray, " g"]


def estimate_variances(
    sums: Sums,
    slices: Sequence[slice],
    least: float,
    start: Variances | None = None,
) -> Variances:
    """Return the variances that make what was measured likeliest.

    Args:
        sums: Of the readings.
        slices: Columns of each group.
        least: Contribution in mm or ° below which a group counts as absent.
        start: Where to start from; groups that are absent there stay so.
    """
    size = len(sums.right)
    count = max(sums.weight, 1.0)
    total = sums.square / count
    group = np.full(len(slices), max(total, 1e-24))
    variance = 0.1 * max(total, 1e-24)
    if start is not None:
        group, variance = start.group.copy(), start.noise**2
    values = np.zeros(size)
    rms = np.zeros(len(slices))
    alive = group > 0
    for step in range(_STEPS):
        index = _columns_of(slices, alive)
        if not index.size:
            variance = total
            break
        owner = _owners(slices, alive)
        own = sums.products[np.ix_(index, index)]
        precision = own / variance
        precision[np.diag_indices(len(index))] += 1.0 / group[owner]
        factor = np.linalg.cholesky(precision)
        found = cho_solve((factor, True), sums.right[index] / variance)
        values = np.zeros(size)
        values[index] = found
        inverse, _ = _INVERSE(factor, lower=True)
        spread = np.diag(inverse)
        before = rms
        rms = np.zeros(len(slices))
        used = 0.0
        for g in np.flatnonzero(alive).tolist():
            mine = slices[g]
            rows = owner == g
            part = values[mine]
            free = float(rows.sum() - spread[rows].sum() / group[g])
            used += free
            group[g] = float(part @ part) / max(free, 1e-9)
            rms[g] = np.sqrt(
                max(float(part @ sums.products[mine, mine] @ part) / count, 0.0)
            )
            if (step >= _WARM and rms[g] < least) or not group[g] > 0:
                alive[g], group[g], values[mine] = False, 0.0, 0.0
        left = sums.square - 2.0 * float(sums.right @ values)
        left += float(values @ sums.products @ values)
        variance = max(left, 1e-12 * sums.square) / max(count - used, 1.0)
        change = np.abs(rms - before)
        if step > _WARM and np.all(change <= _SETTLED * np.maximum(rms, least)):
            break
    rms[~alive] = 0.0
    return Variances(group, float(np.sqrt(max(variance, 1e-300))), values, rms)


def log_evidence(sums: Sums, slices: Sequence[slice], variances: Variances) -> float:
    """Return the logarithm of the marginal likelihood, up to a constant."""
    alive = variances.group > 0
    noise = variances.noise**2
    _, left = posterior(sums, slices, variances, alive)
    result = sums.weight * np.log(noise) + left / noise
    index = _columns_of(slices, alive)
    if index.size:
        prior = variances.group[_owners(slices, alive)]
        matrix = sums.products[np.ix_(index, index)] * prior / noise
        matrix[np.diag_indices(len(index))] += 1.0
        result += float(np.linalg.slogdet(matrix)[1])
    return -0.5 * float(result)


def _columns_of(slices: Sequence[slice], alive: np.ndarray) -> np.ndarray:
    pairs = zip(slices, alive, strict=True)
    parts = [np.arange(each.start, each.stop) for each, on in pairs if on]
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)


def _owners(slices: Sequence[slice], alive: np.ndarray) -> np.ndarray:
    """Return the group of each column of the groups that are alive."""
    groups = np.flatnonzero(alive).tolist()
    return np.repeat(groups, [slices[g].stop - slices[g].start for g in groups])


def posterior(
    sums: Sums, slices: Sequence[slice], variances: Variances, keep: np.ndarray
) -> tuple[Float[np.ndarray, " p"], float]:
    """Return the coefficients of some groups alone, and the penalised sum of squares.

    Args:
        sums: Of the readings.
        slices: Columns of each group.
        variances: As they were found.
        keep: Which groups take part; absent ones never do.
    """
    alive = keep & (variances.group > 0)
    index = _columns_of(slices, alive)
    values = np.zeros(len(sums.right))
    if not index.size:
        return values, sums.square
    owner = _owners(slices, alive)
    noise = variances.noise**2
    matrix = sums.products[np.ix_(index, index)].copy()
    matrix[np.diag_indices(len(index))] += noise / variances.group[owner]
    right = sums.right[index]
    found = cho_solve(cho_factor(matrix, lower=True), right)
    values[index] = found
    return values, max(sums.square - float(right @ found), 0.0)
