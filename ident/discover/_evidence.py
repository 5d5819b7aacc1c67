r"""How large each term is: variances of groups of coefficients by their evidence.

$e = \sum_g \Phi_g \theta_g + \epsilon$ with $\theta_g \sim N(0, \tau_g^2 I)$; every
$\tau_g$ and the noise maximise the marginal likelihood, by the fixed-point rule of D. J. C.
MacKay, Neural Computation 4(3), 1992. What is not there gets a variance of 0. Offsets of runs
and drifts are groups like the others. All rests on weighted products, which add up.
"""

import dataclasses
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.signals import NORMAL
from ..core import ArrowFactor, choose_loss

_OUTER = 0.95
"""Quantile of the readings that is their scale before anything is known of them."""
_STEPS = 40
_CHANGE = 5e-3
"""Relative change of every contribution at which the search ends."""
_WARM = 4
"""Steps before anything is taken as absent."""


def gram_of(
    columns: Float[np.ndarray, "t p"],
    error: Float[np.ndarray, " t"],
    weight: Float[np.ndarray, " t"],
) -> Float[np.ndarray, "q q"]:
    """Return the weighted products of every two columns, the error as the last one."""
    rows = np.column_stack([columns, error]) * np.sqrt(weight)[:, None]
    return np.asarray(rows.T @ rows)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Groups:
    """Groups of coefficients with a variance each, and the readings that they explain.

    Attributes:
        gram: Weighted products of every two columns, the error as the last one.
        weight: Sum of the weights of the readings.
        slices: Columns of each group.
        variance: Of the coefficients of each group, in the square of the unit; 0 = absent.
        noise: Standard deviation of a reading.
    """

    gram: Float[np.ndarray, "q q"]
    weight: float
    slices: tuple[slice, ...]
    variance: Float[np.ndarray, " g"]
    noise: float

    @classmethod
    def of(
        cls,
        columns: Float[np.ndarray, "t p"],
        slices: Sequence[slice],
        error: Float[np.ndarray, " t"],
        weight: Float[np.ndarray, " t"],
    ) -> "Groups":
        """Return groups that are all there, of variances to begin with."""
        gram, total = gram_of(columns, error, weight), float(weight.sum())
        size = float(np.sqrt(max(float(gram[-1, -1]), 1e-24) / max(total, 1.0)))
        variance = np.full(len(slices), size**2)
        return cls(gram, total, tuple(slices), variance, 0.3 * size)

    @property
    def size(self) -> float:
        """Weighted root mean square of the readings."""
        return float(np.sqrt(self.gram[-1, -1] / max(self.weight, 1.0)))

    @cached_property
    def present(self) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
        """Columns of the groups that are present, and the group of each."""
        sizes = [place.stop - place.start for place in self.slices]
        owner = np.repeat(np.arange(len(sizes)), sizes)
        index = np.flatnonzero(self.variance[owner] > 0)
        return index, owner[index]

    def without(self, groups: Sequence[int] | Bool[np.ndarray, " g"]) -> "Groups":
        """Return the same with some groups absent."""
        variance = self.variance.copy()
        variance[groups] = 0.0
        return dataclasses.replace(self, variance=variance)

    def estimated(self, least: float) -> "Groups":
        """Return the variances that make what was measured likeliest.

        Groups that are absent stay so, as do those whose contribution falls below the least.
        """
        count, square = max(self.weight, 1.0), max(float(self.gram[-1, -1]), 1e-24)
        result, groups, rms = self, len(self.slices), np.zeros(len(self.slices))
        for step in range(_STEPS):
            index, owner = result.present
            inverse = np.diag(result._factor.border_inverse)
            used = 1.0 - result.noise**2 * inverse / result.variance[owner]
            freedom, part = np.bincount(owner, used, groups), result.values
            square_of = np.bincount(owner, part[index] ** 2, groups)
            variance = square_of / np.maximum(freedom, 1e-9)
            power = [part[s] @ self.gram[s, s] @ part[s] for s in self.slices]
            previous, rms = rms, np.sqrt(np.maximum(power, 0.0) / count)
            absent = ~(variance > 0) | ((step >= _WARM) & (rms < least))
            variance[absent] = rms[absent] = 0.0
            # Coefficients of the residual: minus the values, and 1 of the error.
            residual = np.append(-part, 1.0)
            residual[index[absent[owner]]] = 0.0
            square_left = max(float(residual @ self.gram @ residual), 1e-12 * square)
            noise = float(np.sqrt(square_left / max(count - float(freedom.sum()), 1.0)))
            result = dataclasses.replace(result, variance=variance, noise=noise)
            change = np.abs(rms - previous)
            if step > _WARM and np.all(change <= _CHANGE * np.maximum(rms, least)):
                break
        return result

    @cached_property
    def _factor(self) -> ArrowFactor:
        """Factor of the matrix of the groups that are present."""
        index, owner = self.present
        matrix = self.gram[np.ix_(index, index)]
        matrix[np.diag_indices(len(index))] += self.noise**2 / self.variance[owner]
        factor = ArrowFactor.of(np.zeros((0, 1)), np.zeros((len(index), 0)), matrix)
        assert factor is not None  # the variances hold every column
        return factor

    @cached_property
    def values(self) -> Float[np.ndarray, " p"]:
        """Coefficients; 0 where a group is absent."""
        result, (index, _) = np.zeros(len(self.gram) - 1), self.present
        result[index] = self._factor.solve(self.gram[index, -1])
        return result

    @cached_property
    def left(self) -> float:
        """Penalised sum of squares that the groups leave."""
        return max(float(self.gram[-1, -1] - self.gram[-1, :-1] @ self.values), 0.0)

    @property
    def evidence(self) -> float:
        """Logarithm of the marginal likelihood, up to a constant."""
        ratio = self.variance[self.present[1]] / self.noise**2
        result = self.weight * np.log(self.noise**2) + self.left / self.noise**2
        result += self._factor.logdet + np.sum(np.log(ratio))
        return float(-0.5 * result)

    def reduced(self, keep: slice) -> Float[np.ndarray, "k k"]:
        """Return the products of some columns and the error, all present groups taken out."""
        index, _ = self.present
        rows = np.r_[keep, len(self.gram) - 1]
        cross = self.gram[np.ix_(index, rows)]
        taken = cross.T @ self._factor.solve(cross)
        return np.asarray(self.gram[np.ix_(rows, rows)] - taken)

    def gain(self, groups: Sequence[int]) -> float:
        """Return what groups take of the penalised sum of squares, less what noise gives."""
        columns = sum(self.slices[g].stop - self.slices[g].start for g in groups)
        chance = columns * self.noise**2
        return float(self.without(groups).left - self.left - chance)

    def with_and_without(
        self, group: int, nuisance: int, least: float
    ) -> tuple["Groups", "Groups"]:
        """Return the likeliest variances with a group, and without it, those of nuisance anew."""
        variance = self.variance.copy()
        variance[nuisance:] = self.size**2
        full = dataclasses.replace(self, variance=variance)
        return full.estimated(least), full.without([group]).estimated(least)


def robust_groups(
    columns: Float[np.ndarray, "t p"],
    slices: Sequence[slice],
    error: Float[np.ndarray, " t"],
    least: Callable[[float], float],
) -> Groups:
    """Return groups whose variances no wild reading decides; ``least`` as of `estimated`."""
    # Before anything is known, no reading may decide alone.
    outer = float(np.quantile(np.abs(error), _OUTER)) or 1.0
    weight = 1.0 / (1.0 + (error / outer) ** 2)
    begun = Groups.of(columns, slices, error, weight)
    groups = begun.estimated(least(begun.size))
    # What wild readings have hidden at first is looked for anew.
    weight = weights_about(error - columns @ groups.values)
    begun = Groups.of(columns, slices, error, weight)
    return begun.estimated(least(begun.size))


def scatter_of(residual: Float[np.ndarray, " t"]) -> float:
    """Return the standard deviation that the middle half of residuals has."""
    off = np.abs(residual - np.median(residual))
    return max(NORMAL * float(np.median(off)), 1e-12)


def weights_about(residual: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    """Return how much each reading counts; 1 in the mean, 0 where it is wild."""
    size, once = np.sort(np.abs(residual)), np.ones(len(residual), np.int64)
    loss = choose_loss("student", size, 1.0, 1e-12, once)
    share = loss.share(residual / loss.scale)
    return np.asarray(share / np.mean(share[share > 0]))
