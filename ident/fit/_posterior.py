"""The Gaussian posterior of a table: node values, run effects, evidence, variances."""

import dataclasses
from collections.abc import Iterable
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ._band import BandFactor, factorise
from ._information import assemble
from ._prior import Smoothness
from ._problem import Problem
from ._root import stiff_factor

BEARS = 1e6
"""Largest precision of the prior, relative to the readings, that a plain factor bears: beyond
it the rounding of the evidence leads the search for its best weights."""
_REFINED, _TIMES = 1e-13, 4
"""Relative change at which the refinement of a solution ends, and how often at most."""


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Solution of a `Problem` for one set of smoothness weights; variances are lazy."""

    problem: Problem
    smoothness: Smoothness
    factor: BandFactor
    values: Float[np.ndarray, "l s"]
    effects: Float[np.ndarray, " r"]
    residual_square: float
    penalty: float
    gain: Float[np.ndarray, "n r"]
    schur_inverse: Float[np.ndarray, "r r"]
    logdet: float

    def has_matrix_of(self, problem: Problem, smoothness: Smoothness) -> bool:
        """Whether the node values of a problem have the same matrix as these."""
        return (
            self.problem.normal is problem.normal
            and self.problem.prior == problem.prior
            and self.smoothness == smoothness
        )

    @property
    def variance(self) -> float:
        """Variance of one reading of weight 1, by restricted maximum likelihood."""
        return (self.residual_square + self.penalty) / self.problem.free

    @cached_property
    def evidence(self) -> float:
        """Minus twice the restricted log-likelihood, up to a constant; smaller is better."""
        prior = self.problem.prior.logdet(self.smoothness)
        # Readings without any scatter are fitted exactly: no noise, and its log must not blow up.
        noise = float(np.log(max(self.variance, 1e-300)))
        return self.problem.free * noise + self.logdet - prior

    @cached_property
    def inverse(self) -> dict[tuple[int, int], Float[np.ndarray, "l s"]]:
        """Elements of the inverse between nodes that share a cell, ``[dl, ds][l, s]``.

        Relative to 1/noise². Entry ``(l, s)`` belongs to the pair of that node and node
        ``(l + dl, s + ds)``.
        """
        grid = self.problem.normal.grid
        steps = list(self.problem.normal.diagonals)
        if not grid.layout.periodic:
            return self.elements(steps)
        band = self.factor.columns.shape[1] - 1
        found = self.factor.inverse_diagonals(range(band + 1))
        stack = np.stack([found[offset] for offset in range(band + 1)])
        result = {}
        for step in steps:
            own, other = (
                grid.rank,
                grid.rank[grid.neighbour(np.arange(grid.slow), step[0])],
            )
            low, high = np.minimum(own, other), np.maximum(own, other)
            column = low[:, None] * grid.fast + np.arange(grid.fast)
            offset = ((high - low) * grid.fast)[:, None]
            result[step] = stack[offset, column] + self._border_share(*step)
        return result

    def elements(
        self, steps: Iterable[tuple[int, int]]
    ) -> dict[tuple[int, int], Float[np.ndarray, "l s"]]:
        """Return elements of the inverse as `inverse` does, of any pairs within the band.

        Not around a ring.
        """
        grid = self.problem.normal.grid
        band = self.factor.columns.shape[1] - 1
        offsets = {step: step[0] * grid.fast + step[1] for step in steps}
        inside = {step: offset for step, offset in offsets.items() if offset <= band}
        found = self.factor.inverse_diagonals(list(inside.values()))
        shape = (grid.slow, grid.fast)
        return {
            step: found[offset].reshape(shape) + self._border_share(*step)
            for step, offset in inside.items()
        }

    def _border_share(self, dl: int, ds: int) -> Float[np.ndarray, "l s"]:
        """Return what the uncertainty of the run effects adds to the inverse."""
        grid = self.problem.normal.grid
        if not len(self.effects):
            return np.zeros((grid.slow, grid.fast))
        gain = self.gain.reshape(grid.slow, grid.fast, -1)[grid.rank]
        moved = np.roll(gain, (-dl, -ds), axis=(0, 1))
        return np.asarray(np.einsum("lsr,rq,lsq->ls", gain, self.schur_inverse, moved))

    @cached_property
    def used(self) -> float:
        """Effective number of parameters: trace of inverse × information of the readings."""
        result = 0.0
        for step, coupling in self.problem.normal.diagonals.items():
            twice = 1.0 if step == (0, 0) else 2.0
            if step in self.inverse:
                result += twice * float((coupling * self.inverse[step]).sum())
        border = self.problem.border
        if border is not None:
            cross = self.gain.T @ _to_band(
                self.problem.normal.grid.rank, border.coupling
            )
            result += float((self.schur_inverse * (border.matrix - 2.0 * cross)).sum())
        return result


def solve(
    problem: Problem,
    smoothness: Smoothness,
    like: Posterior | None = None,
    bears: float = BEARS,
) -> Posterior | None:
    """Return the posterior, or None where the matrix is numerically singular.

    Args:
        problem: Sums about a current estimate.
        smoothness: Weights of the prior.
        like: Another solution; where its matrix is the same its factor serves again.
        bears: Precision of the prior relative to the readings above which a small table gets
            a factor that keeps its digits.
    """
    grid = problem.normal.grid
    factor: BandFactor | None
    if like is not None and like.has_matrix_of(problem, smoothness):
        factor = like.factor
    else:
        factor = _factor_of(problem, smoothness, bears)
    if factor is None or not np.isfinite(factor.logdet):
        return None
    step = _solved(problem, smoothness, factor, problem.vector, problem.values)
    count = len(problem.effects)
    gain = np.zeros((grid.size, count))
    schur_inverse: Float[np.ndarray, "r r"] = np.zeros((count, count))
    logdet = factor.logdet
    effect_step = np.zeros(count)
    if problem.border is not None and count:
        border = problem.border
        coupling = _to_band(grid.rank, border.coupling)
        gain = np.stack(
            [
                _solved(problem, smoothness, factor, column, np.zeros_like(column))
                for column in np.moveaxis(border.coupling, 2, 0)
            ],
            axis=1,
        )
        schur = border.matrix - coupling.T @ gain
        try:
            root = np.linalg.cholesky(schur)
        except np.linalg.LinAlgError:
            return None
        logdet += 2.0 * float(np.log(np.diag(root)).sum())
        schur_inverse = np.linalg.inv(schur)
        effect_step = schur_inverse @ (border.vector - coupling.T @ step)
        step = step - gain @ effect_step
    move = step.reshape(grid.slow, grid.fast)[grid.rank]
    values = problem.values + move
    square = problem.square - 2.0 * float((problem.vector * move).sum())
    square += float((move * problem.normal.apply(move)).sum())
    if problem.border is not None and count:
        border = problem.border
        square += -2.0 * float(border.vector @ effect_step)
        square += float(effect_step @ border.matrix @ effect_step)
        square += 2.0 * float(
            (move[:, :, None] * border.coupling).sum((0, 1)) @ effect_step
        )
    return Posterior(
        problem=problem,
        smoothness=smoothness,
        factor=factor,
        values=values,
        effects=problem.effects + effect_step,
        residual_square=max(square, 0.0),
        penalty=problem.prior.penalty(smoothness, values),
        gain=gain,
        schur_inverse=schur_inverse,
        logdet=logdet,
    )


def _factor_of(
    problem: Problem, smoothness: Smoothness, bears: float
) -> BandFactor | None:
    normal, prior = problem.normal, problem.prior
    stiffness = prior.slow.stiffness(smoothness.slow)
    if prior.fast is not None:
        stiffness += prior.fast.stiffness(smoothness.fast)
    stiff = bool(stiffness > bears * normal.density)
    if stiff and problem.small:
        return stiff_factor(normal, prior, smoothness)
    return factorise(assemble(normal, prior, smoothness), stiff)


def _solved(
    problem: Problem,
    smoothness: Smoothness,
    factor: BandFactor,
    vector: Float[np.ndarray, "l s"],
    values: Float[np.ndarray, "l s"],
) -> Float[np.ndarray, " n"]:
    """Return the step from a table to the solution, in the order of the band."""
    rank = problem.normal.grid.rank
    right = vector - problem.prior.apply(smoothness, values)
    step = factor.solve(_to_band(rank, right))
    if not factor.stiff:
        return step
    for _ in range(_TIMES):
        table = step.reshape(values.shape)[rank]
        left = vector - problem.normal.apply(table)
        # Of the sum: what the differences of both have in common is lost in neither.
        left -= problem.prior.apply(smoothness, values + table)
        more = factor.solve(_to_band(rank, left))
        step = step + more
        if float(np.abs(more).max()) <= _REFINED * float(np.abs(step).max()):
            break
    return step


def about(posterior: Posterior) -> Problem:
    """Return the sums of the same readings about the table that they gave."""
    problem, border = posterior.problem, posterior.problem.border
    move = posterior.values - problem.values
    vector = problem.vector - problem.normal.apply(move)
    if border is not None:
        change = posterior.effects - problem.effects
        vector -= border.coupling @ change
        pull = np.einsum("lsr,ls->r", border.coupling, move)
        border = dataclasses.replace(
            border, vector=border.vector - pull - border.matrix @ change
        )
    return dataclasses.replace(
        problem,
        vector=vector,
        square=posterior.residual_square,
        values=posterior.values,
        effects=posterior.effects,
        border=border,
    )


def _to_band(rank: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values over (slow, fast) as a vector in the order of the band."""
    result = np.empty_like(values)
    result[rank] = values
    return result.reshape(values.shape[0] * values.shape[1], *values.shape[2:])
