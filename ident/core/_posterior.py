"""The Gaussian of all unknowns for given weights of the prior, and how well they explain."""

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import Any, final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.linalg import cg

from ._factor import ArrowFactor
from ._readings import Vector
from ._stack import Stack, Term
from ._sums import Sums

FILL = 1e-9
"""Weight relative to the density that fills gaps where no smoothness was asked for."""
_EXACT, _STEPS = 1e-12, 60
"""Residual, in shares of the right-hand side, at which conjugate gradients end, and steps after
which they are given up."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Problem:
    """Sums about a current estimate, and all that does not depend on the weights.

    Attributes:
        sums: Over the readings that count.
        theta: Estimate that the sums are taken about.
        gain: Mean ψ' of the loss: pseudo-readings are θ's prediction + ψ/gain.
        density: Information per unknown of the effect that each weight belongs to.
        held: Precision that holds unknowns at zero.
        pinned: Number of unknowns that are held since nothing else determines them.
        times: Of so many readings one tells something of its own.
    """

    sums: Sums
    theta: Vector
    gain: float
    density: Vector
    held: Vector
    pinned: int = 0
    times: float = 1.0

    @classmethod
    def of(
        cls, sums: Sums, theta: Vector, gain: float = 1.0, pins: Vector | None = None
    ) -> "Problem":
        """Return the problem of some sums; pins hold unknowns that nothing else determines."""
        stack, diagonal = sums.stack, sums.diagonal
        density, held = [], np.zeros(stack.size)
        for number, (prior, here, _) in enumerate(stack.priors):
            block = diagonal[here]
            mean = float(block.sum()) / max(int(np.count_nonzero(block)), 1) or 1.0
            density += [mean] * len(prior.rows)
            held[here] = stack.effects[number].ridge * mean
        pinned = 0
        if pins is not None:
            held, pinned = held + pins, int((pins > 0.0).sum())
        return cls(sums, theta, gain, np.array(density), held, pinned)

    @property
    def stack(self) -> Stack:
        """The effects."""
        return self.sums.stack

    @property
    def count(self) -> float:
        """Readings that count, of those that tell something of their own."""
        return float(self.sums.tally[0]) / self.times

    @property
    def degrees(self) -> float:
        """Readings that count, less the unknowns that no prior holds."""
        return max(self.count - self.stack.free + self.pinned, 1e-9)

    @cached_property
    def bounds(self) -> Float[np.ndarray, "k 2"]:
        """Least and largest log of each weight."""
        ends = [prior.bounds for prior, _, _ in self.stack.priors]
        return np.asarray(np.concatenate(ends) + np.log(self.density)[:, None])

    @cached_property
    def right(self) -> Vector:
        """Right-hand side of the pseudo-readings."""
        return np.asarray(self.sums.right / self.gain)

    def at(
        self, weights: Vector, factor: ArrowFactor | None = None
    ) -> "Posterior | None":
        """Return the posterior for these weights; None where the matrix is singular.

        Args:
            weights: Of each term of the prior, relative to 1/noise².
            factor: Of the same matrix, where one is known.
        """
        sums, slope = self.sums, self.held * self.theta
        for weight, term in self.terms(weights):
            slope += weight * (term.gram @ self.theta)
        factor = self._factor(weights) if factor is None else factor
        if factor is None:
            return None
        step = factor.solve(self.right - slope)
        square = sums.tally[2] / self.gain**2 - 2.0 * float(step @ self.right)
        square += float(step @ sums.apply(step))
        return Posterior(self, weights, factor, self.theta + step, max(square, 0.0))

    def values_at(self, weights: Vector) -> Vector | None:
        """Return the unknowns alone; None where the matrix is singular.

        A plane full of readings takes a few conjugate gradients, a fraction of a factor; what
        does not converge soon (a stiff prior, gaps) is left to the factor.
        """
        stack = self.stack
        if stack.band == stack.size and len(stack.offsets) > 3:
            prior = self.prior(weights)
            matrix = self.sums.band_matrix + prior
            target = self.right - prior @ self.theta
            inverse = sp.diags_array(1.0 / np.maximum(matrix.diagonal(), 1e-300))
            step, failed = cg(matrix, target, rtol=_EXACT, maxiter=_STEPS, M=inverse)
            if not failed:
                return np.asarray(self.theta + step)
        post = self.at(weights)
        return None if post is None else post.values

    def prior(self, weights: Vector) -> sp.csr_array:
        """Return the precision of the prior for these weights."""
        total: Any = sp.csr_array(sp.diags_array(self.held))
        for weight, term in self.terms(weights):
            total = total + weight * term.gram
        return total

    def precision(self, weights: Vector) -> sp.csr_array:
        """Return information + prior precision, both triangles."""
        sums = self.sums
        rows: Any = [[sums.band_matrix, sums.cross.T], [sums.cross, sums.border]]
        return sp.csr_array(sp.block_array(rows) + self.prior(weights))

    def terms(self, weights: Vector) -> list[tuple[float, Term]]:
        """Return the terms of the prior that have a weight, each with it."""
        terms = zip(weights.tolist(), self.stack.terms, strict=True)
        return [(w, t) for w, t in terms if w > 0.0]

    def _factor(self, weights: Vector) -> ArrowFactor | None:
        stack, sums = self.stack, self.sums
        terms = self.terms(weights)
        n = stack.band
        reach = [max(stack.offsets)]
        reach += [max(t.distances, default=0) for _, t in terms if not t.border]
        width = min(max(reach), max(n - 1, 0))
        columns = np.zeros((n, width + 1))
        for slot, k in enumerate(stack.offsets if n else ()):
            if k <= width:
                columns[:, k] = sums.diagonals[:, slot]
        columns[:, 0] += self.held[:n]
        border = sums.border.copy()
        np.einsum("ii->i", border)[:] += self.held[n:]
        for weight, term in terms:
            if term.border:
                border[term.row - n, term.column - n] += weight * term.data
            else:
                places = term.column * width + term.row
                columns.reshape(-1)[places] += weight * term.data
        return ArrowFactor.of(columns, sums.cross, border)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Posterior:
    """The Gaussian of all unknowns for one set of weights; what is expensive is lazy.

    Attributes:
        problem: What was solved.
        weights: Of each term of the prior, relative to 1/noise².
        factor: Of information + prior precision.
        values: Mean of the unknowns.
        residual_square: Sum of squared residuals of the pseudo-readings.
    """

    problem: Problem
    weights: Vector
    factor: ArrowFactor
    values: Vector
    residual_square: float

    @cached_property
    def penalties(self) -> Vector:
        """Penalty of each term for weight 1, free of cancellation."""
        bends = (term.rows @ self.values for term in self.problem.stack.terms)
        return np.array([float(bend @ bend) for bend in bends])

    @cached_property
    def total(self) -> float:
        """Residual square plus penalty."""
        penalty = float(self.weights @ self.penalties)
        # Readings without any scatter are fitted exactly: the log must not blow up.
        return max(self.residual_square + penalty, 1e-300)

    @property
    def variance(self) -> float:
        """Of the noise of a pseudo-reading of weight 1, by restricted likelihood."""
        return self.total / self.problem.degrees

    @cached_property
    def _prior_slopes(self) -> Vector:
        """Slope of the determinant of the prior over the logarithm of each weight."""
        priors = self.problem.stack.priors
        slopes = [prior.slopes(self.weights[terms]) for prior, _, terms in priors]
        return np.concatenate(slopes)

    @cached_property
    def evidence(self) -> float:
        """Minus twice the restricted log-likelihood, up to a constant; smaller is better."""
        noise = self.problem.degrees * float(np.log(self.total))
        priors = self.problem.stack.priors
        prior = sum(prior.logdet(self.weights[terms]) for prior, _, terms in priors)
        return noise + self.factor.logdet - prior

    @cached_property
    def _selected(self) -> tuple[Float[np.ndarray, "n s"], Int[np.ndarray, " w"]]:
        """Diagonals of the inverse over the band that are asked for, and where each stands."""
        stack, width = self.problem.stack, self.factor.band.shape[1]
        used = {0, *(k for k in stack.offsets if k < width)}
        for _, term in self.problem.terms(self.weights):
            used |= set() if term.border else term.distances
        offsets = sorted(used)
        slots = np.zeros(offsets[-1] + 1, np.int64)
        slots[offsets] = np.arange(len(offsets))
        return self.factor.selected(offsets), slots

    @cached_property
    def traces(self) -> Vector:
        """Weight × trace of inverse × penalty matrix: unknowns that each term takes away."""
        stack = self.problem.stack
        result = np.zeros(len(self.weights))
        for k, term in enumerate(stack.terms):
            if self.weights[k] == 0.0:
                continue
            if term.border:
                places = term.row - stack.band, term.column - stack.band
                inverse = self.factor.border_inverse[places]
            else:
                selected, slots = self._selected
                inverse = selected[term.column, slots[term.row - term.column]]
            both = np.where(term.row == term.column, term.data, 2.0 * term.data)
            result[k] = self.weights[k] * float(both @ inverse)
        return result

    @property
    def carried(self) -> Vector:
        """Effective number of unknowns that each weight leaves to the readings."""
        return np.asarray(np.maximum(self._prior_slopes - self.traces, 0.0))

    @property
    def slopes(self) -> Vector:
        """Slope of the evidence over the logarithm of each weight."""
        fitted = self.problem.degrees * self.weights * self.penalties / self.total
        return np.asarray(fitted + self.traces - self._prior_slopes)

    @cached_property
    def used(self) -> float:
        """Effective number of parameters."""
        return float(len(self.values) - self.problem.pinned - self.traces.sum())

    @cached_property
    def inverse_diagonal(self) -> Vector:
        """Variance of every unknown per variance of one reading."""
        border = np.diag(self.factor.border_inverse)
        return np.concatenate([self._selected[0][:, 0], border])

    def covariance(self, offsets: Sequence[int]) -> sp.csr_array:
        """Return the covariance of unknowns within a cell of the first effect, noise 1.

        Elements at other distances from the diagonal are left out.
        """
        stack = self.problem.stack
        if stack.band:
            (selected, slots), size = self._selected, stack.band
            known = [k for k in offsets if k < self.factor.band.shape[1]]
            lower = {k: selected[: size - k, slots[k]] for k in known}
        else:
            inverse = self.factor.border_inverse[stack.here(0), stack.here(0)]
            lower = {k: np.diagonal(inverse, k) for k in offsets if k < len(inverse)}
        both = lower | {-k: diagonal for k, diagonal in lower.items()}
        places: Any = [*both]
        return sp.csr_array(sp.diags_array([*both.values()], offsets=places))
