r"""How large each term is: variances of groups of coefficients by their evidence.

$e = \sum_g \Phi_g \theta_g + \epsilon$ with $\theta_g \sim N(0, \tau_g^2 I)$; every
$\tau_g$ and the noise maximise the marginal likelihood, by the fixed-point rule of D. J. C.
MacKay, Neural Computation 4(3), 1992. What is not there gets a variance of 0. Offsets of
runs and drifts are groups like the others, so that they take what terms do not explain,
and no more. All of it rests on weighted sums of products of features.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import cho_factor, cho_solve, get_blas_funcs, get_lapack_funcs

from ._terms import Term

(_SQUARE,) = get_blas_funcs(["syrk"], dtype=np.float64)
(_INVERSE,) = get_lapack_funcs(["potri"], dtype=np.float64)
_STEPS = 40
_CHANGE = 5e-3
"""Relative change of every contribution at which the search ends."""
_WARM = 4
"""Steps before anything is taken as absent."""


@dataclasses.dataclass(frozen=True)
class Design:
    """Columns of all terms side by side.

    Attributes:
        terms: Candidates; what comes after them is nuisance.
        columns: Features.
        slices: Columns of each term, then those of each group of nuisance.
    """

    terms: tuple[Term, ...]
    columns: Float[np.ndarray, "t p"]
    slices: tuple[slice, ...]


def design_of(
    terms: Sequence[Term],
    blocks: Sequence[Float[np.ndarray, "t _"]],
    nuisance: Sequence[Float[np.ndarray, "t _"]],
) -> Design:
    """Return the columns of terms and nuisance, one behind the other."""
    parts = [*blocks, *(part for part in nuisance if part.shape[1])]
    ends = np.cumsum([0, *(part.shape[1] for part in parts)]).tolist()
    slices = tuple(slice(start, end) for start, end in itertools.pairwise(ends))
    return Design(tuple(terms), np.concatenate(parts, axis=1), slices)


@dataclasses.dataclass(frozen=True)
class Sums:
    """Weighted sums over rows; of many pieces of a recording where it has a first index.

    Attributes:
        products: Of every two columns.
        right: Of every column with the error.
        square: Of the error with itself.
        weight: Sum of the weights.
    """

    products: Float[np.ndarray, "*b p p"]
    right: Float[np.ndarray, "*b p"]
    square: Float[np.ndarray, "*b"]
    weight: Float[np.ndarray, "*b"]

    def total(self, pieces: Int[np.ndarray, " k"] | None = None) -> "Sums":
        """Return the sums over some of the pieces, or over all."""
        rows: Int[np.ndarray, " k"] | slice = slice(None) if pieces is None else pieces
        every = (self.products, self.right, self.square, self.weight)
        return Sums(*(np.asarray(part[rows].sum(axis=0)) for part in every))


def sums_of(
    columns: Float[np.ndarray, "t p"],
    error: Float[np.ndarray, " t"],
    weight: Float[np.ndarray, " t"],
    block: Int[np.ndarray, " t"] | None = None,
) -> Sums:
    """Return the sums of each piece of a recording, or of the whole."""
    if block is not None:
        pieces = [np.flatnonzero(block == number) for number in range(block.max() + 1)]
        each = [sums_of(columns[r], error[r], weight[r]) for r in pieces]
        names = ("products", "right", "square", "weight")
        return Sums(*(np.stack([getattr(one, name) for one in each]) for name in names))
    root = np.sqrt(weight)
    own, read = columns * root[:, None], error * root
    # One triangle only: half the work of a full product.
    upper = _SQUARE(1.0, own.T)
    products = np.triu(upper) + np.triu(upper, 1).T
    return Sums(
        products, own.T @ read, np.asarray(read @ read), np.asarray(weight.sum())
    )


@dataclasses.dataclass(frozen=True)
class Variances:
    r"""Variances of groups and noise, with the coefficients that they give.

    Attributes:
        group: $\tau_g^2$ of each group in the square of the unit; 0 = absent.
        noise: Standard deviation of a reading.
        values: Coefficients; 0 where a group is absent.
        rms: Contribution of each group over the readings.
    """

    group: Float[np.ndarray, " g"]
    noise: float
    values: Float[np.ndarray, " p"]
    rms: Float[np.ndarray, " g"]

    def without(self, groups: Sequence[int] | Bool[np.ndarray, " g"]) -> "Variances":
        """Return the same with some groups absent."""
        group = self.group.copy()
        group[groups] = 0.0
        return dataclasses.replace(self, group=group)


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
        least: Contribution below which a group counts as absent.
        start: Where to start from; groups that are absent there stay so.
    """
    count = max(float(sums.weight), 1.0)
    square = max(float(sums.square), 1e-24)
    group = np.full(len(slices), square / count)
    variance = 0.1 * square / count
    if start is not None:
        group, variance = start.group.copy(), start.noise**2
    values = np.zeros(len(sums.right))
    rms = np.zeros(len(slices))
    for step in range(_STEPS):
        index, owner = present(slices, group)
        if not index.size:
            variance = square / count
            break
        precision = sums.products[np.ix_(index, index)] / variance
        precision[np.diag_indices(len(index))] += 1.0 / group[owner]
        factor = np.linalg.cholesky(precision)
        values = np.zeros(len(sums.right))
        values[index] = cho_solve((factor, True), sums.right[index] / variance)
        spread = np.diag(_INVERSE(factor, lower=True)[0])
        before, rms, used = rms, np.zeros(len(slices)), 0.0
        for g in np.unique(owner).tolist():
            mine, rows = slices[g], owner == g
            part = values[mine]
            free = float(rows.sum() - spread[rows].sum() / group[g])
            used += free
            group[g] = float(part @ part) / max(free, 1e-9)
            power = float(part @ sums.products[mine, mine] @ part) / count
            rms[g] = np.sqrt(max(power, 0.0))
            if (step >= _WARM and rms[g] < least) or not group[g] > 0:
                group[g], values[mine], rms[g] = 0.0, 0.0, 0.0
        left = square - float((2.0 * sums.right - sums.products @ values) @ values)
        variance = max(left, 1e-12 * square) / max(count - used, 1.0)
        change = np.abs(rms - before)
        if step > _WARM and np.all(change <= _CHANGE * np.maximum(rms, least)):
            break
    return Variances(group, float(np.sqrt(variance)), values, rms)


def log_evidence(sums: Sums, slices: Sequence[slice], variances: Variances) -> float:
    """Return the logarithm of the marginal likelihood, up to a constant."""
    noise = variances.noise**2
    result = float(sums.weight) * np.log(noise)
    result += posterior(sums, slices, variances)[1] / noise
    index, owner = present(slices, variances.group)
    if index.size:
        prior = variances.group[owner]
        matrix = sums.products[np.ix_(index, index)] * prior / noise
        matrix[np.diag_indices(len(index))] += 1.0
        result += float(np.linalg.slogdet(matrix)[1])
    return -0.5 * float(result)


def evidence_gain(
    sums: Sums,
    slices: Sequence[slice],
    variances: Variances,
    groups: Sequence[int],
    nuisance: int,
    least: float,
) -> float:
    """Return twice the log evidence that groups add to the others that are present.

    Args:
        sums: Of the readings.
        slices: Columns of each group.
        variances: Of every group; terms that are absent stay so.
        groups: What is judged.
        nuisance: First group of what stands in for them, such as a drift: its variances are
            estimated anew with and without them.
        least: Contribution below which a group counts as absent.
    """
    group = variances.group.copy()
    group[nuisance:] = float(sums.square) / max(float(sums.weight), 1.0)
    both = dataclasses.replace(variances, group=group)
    starts = both, both.without(groups)
    found = [estimate_variances(sums, slices, least, start) for start in starts]
    with_it, without = (log_evidence(sums, slices, each) for each in found)
    return 2.0 * (with_it - without)


def posterior(
    sums: Sums, slices: Sequence[slice], variances: Variances
) -> tuple[Float[np.ndarray, " p"], float]:
    """Return the coefficients of the groups present, and the penalised sum of squares."""
    values = np.zeros(len(sums.right))
    index, owner = present(slices, variances.group)
    if not index.size:
        return values, float(sums.square)
    matrix = sums.products[np.ix_(index, index)]
    matrix[np.diag_indices(len(index))] += variances.noise**2 / variances.group[owner]
    values[index] = cho_solve(cho_factor(matrix, lower=True), sums.right[index])
    return values, max(float(sums.square - sums.right @ values), 0.0)


def without_groups(
    sums: Sums, slices: Sequence[slice], variances: Variances, keep: slice
) -> Sums:
    """Return the sums of some columns with all present groups of others taken out.

    Args:
        sums: Of the readings.
        slices: Columns of the groups that are taken out.
        variances: Of these.
        keep: Columns that stay.
    """
    index, owner = present(slices, variances.group)
    products, right = sums.products[keep, keep], sums.right[keep]
    if not index.size:
        return Sums(products, right, sums.square, sums.weight)
    matrix = sums.products[np.ix_(index, index)]
    matrix[np.diag_indices(len(index))] += variances.noise**2 / variances.group[owner]
    cross = np.column_stack([sums.products[index, keep], sums.right[index]])
    taken = cross.T @ cho_solve(cho_factor(matrix, lower=True), cross)
    return Sums(
        products - taken[:-1, :-1],
        right - taken[:-1, -1],
        np.asarray(sums.square - taken[-1, -1]),
        sums.weight,
    )


def present(
    slices: Sequence[slice], group: Float[np.ndarray, " g"]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Return the columns of the groups that are present, and the group of each."""
    here = [(g, each) for g, each in enumerate(slices) if group[g] > 0]
    index = [k for _, each in here for k in range(each.start, each.stop)]
    owner = [g for g, each in here for _ in range(each.start, each.stop)]
    return np.array(index, dtype=np.int64), np.array(owner, dtype=np.int64)
