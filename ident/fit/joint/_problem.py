"""Readings about a current estimate, and what one set of smoothness weights makes of them."""

import dataclasses
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ._arrow import Arrow, arrow_of
from ._sums import Sums
from ._weights import Weights


@dataclasses.dataclass(frozen=True)
class JointProblem:
    """A Gaussian problem as sums about a current estimate, so that nothing cancels.

    Attributes:
        sums: Information of the active readings.
        weights: Smoothness weights.
        pins: Added to the diagonal, about zero change.
        theta: Current values.
        vector: Σ x y with y = pseudo-reading − current estimate.
        square: Σ y².
        free: Readings beyond those that the prior leaves alone.
    """

    sums: Sums
    weights: Weights
    pins: Float[np.ndarray, " n"]
    theta: Float[np.ndarray, " n"]
    vector: Float[np.ndarray, " n"]
    square: float
    free: int


@dataclasses.dataclass(frozen=True)
class Solution:
    """Values for one set of weights; everything dear is lazy.

    Attributes:
        problem: What was solved.
        logs: Of the weights, relative to the densities.
        arrow: Factor.
        theta: Values.
        residual_square: Σ of squared residuals of the pseudo-readings.
        bends: Penalty of each weight 1.
    """

    problem: JointProblem
    logs: Float[np.ndarray, " k"]
    arrow: Arrow
    theta: Float[np.ndarray, " n"]
    residual_square: float
    bends: Float[np.ndarray, " k"]

    @cached_property
    def values(self) -> Float[np.ndarray, " k"]:
        """The weights themselves."""
        return np.asarray(self.problem.weights.values(self.logs))

    @property
    def penalty(self) -> float:
        """Penalty of the values."""
        return float(self.values @ self.bends)

    @property
    def variance(self) -> float:
        """Variance of one reading by restricted maximum likelihood."""
        return (self.residual_square + self.penalty) / self.problem.free

    @cached_property
    def evidence(self) -> float:
        """Minus twice the restricted log-likelihood, up to a constant; smaller is better."""
        noise = float(np.log(max(self.variance, 1e-300)))
        prior = self.problem.weights.logdet(self.logs)
        return self.problem.free * noise + self.arrow.logdet - prior

    @cached_property
    def bent(self) -> Float[np.ndarray, " k"]:
        """Weight × trace of inverse × penalty: unknowns that each weight takes away."""
        return np.asarray(self.values * self.arrow.traces(self.problem.weights))

    @property
    def used(self) -> float:
        """Effective number of parameters."""
        pinned = int((self.problem.pins > 0).sum())
        return float(self.problem.sums.design.size - pinned - self.bent.sum())

    @cached_property
    def carried(self) -> Float[np.ndarray, " k"]:
        """Effective number of parameters that each weight leaves to the readings."""
        slopes = self.problem.weights.logdet_slopes(self.logs)
        return np.asarray(np.maximum(slopes - self.bent, 0.0))

    @property
    def slopes(self) -> Float[np.ndarray, " k"]:
        """Slopes of the evidence over the logarithms."""
        pull = self.values * self.bends / max(self.variance, 1e-300)
        return np.asarray(pull - self.carried)


def solve_joint(
    problem: JointProblem, logs: Float[np.ndarray, " k"], arrow: Arrow | None = None
) -> Solution | None:
    """Return the solution, or None where the matrix is numerically singular.

    Args:
        problem: What to solve.
        logs: Of the smoothness weights.
        arrow: Factor for the same sums and weights, where it is known.
    """
    values = problem.weights.values(logs)
    if arrow is None:
        arrow = arrow_of(problem.sums, problem.weights, values, problem.pins)
    if arrow is None:
        return None
    right = problem.vector - problem.weights.apply(values, problem.theta)
    step = arrow.solve(right)
    square = problem.square - 2.0 * float(problem.vector @ step)
    square += float(step @ problem.sums.apply(step))
    theta = problem.theta + step
    bends = problem.weights.bends(theta)
    return Solution(problem, logs, arrow, theta, max(square, 0.0), bends)
