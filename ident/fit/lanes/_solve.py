"""The Gaussian posteriors of many small tables at once, dense."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ._stack import Stack, dot, times


@dataclasses.dataclass(frozen=True)
class Problems:
    """Sums about a current estimate, lane by lane (`.._posterior.Problem`).

    Attributes:
        stack: The fits.
        normal: Σ w x xᵀ over nodes and run effects.
        vector: Σ w x y, with y the pseudo-reading minus the current estimate.
        square: Σ w y².
        count: Number of active readings.
        unknowns: Current node values over (branch, node), then run effects.
    """

    stack: Stack
    normal: Float[np.ndarray, "k m m"]
    vector: Float[np.ndarray, "k m"]
    square: Float[np.ndarray, " k"]
    count: Float[np.ndarray, " k"]
    unknowns: Float[np.ndarray, "k m"]

    def take(self, lanes: Int[np.ndarray, " k"]) -> "Problems":
        """Return some of the lanes."""
        return Problems(
            self.stack.take(lanes),
            *(
                getattr(self, field.name)[lanes]
                for field in dataclasses.fields(self)[1:]
            ),
        )

    @property
    def free(self) -> Float[np.ndarray, " k"]:
        """Readings beyond those that the prior's null space and the run effects use up."""
        return self.count - self.stack.null - self.stack.effects


@dataclasses.dataclass
class Factors:
    """Inverses of normal matrix plus prior, kept while neither changes.

    Attributes:
        pull: Penalty matrix of one chain.
        root: Inverse of the Cholesky factor.
        inverse: Inverse of the matrix.
        used: Effective number of parameters.
        sound: Whether the matrix is positive definite.
    """

    pull: Float[np.ndarray, "k n n"]
    root: Float[np.ndarray, "k m m"]
    inverse: Float[np.ndarray, "k m m"]
    used: Float[np.ndarray, " k"]
    sound: Bool[np.ndarray, " k"]

    def take(self, lanes: Int[np.ndarray, " k"]) -> "Factors":
        """Return some of the lanes."""
        return Factors(
            *(getattr(self, field.name)[lanes] for field in dataclasses.fields(self))
        )

    def put(self, lanes: Int[np.ndarray, " k"], other: "Factors") -> None:
        """Replace some of the lanes."""
        for field in dataclasses.fields(self):
            getattr(self, field.name)[lanes] = getattr(other, field.name)


@dataclasses.dataclass(frozen=True)
class Solutions:
    """Posterior means, lane by lane.

    Attributes:
        unknowns: Node values over (branch, node), then run effects.
        residual_square: Σ w (y − fit)².
        variance: Of one reading of weight 1, by restricted maximum likelihood.
    """

    unknowns: Float[np.ndarray, "k m"]
    residual_square: Float[np.ndarray, " k"]
    variance: Float[np.ndarray, " k"]


def factors_of(
    stack: Stack, normal: Float[np.ndarray, "k m m"], weights: Float[np.ndarray, "k 2"]
) -> Factors:
    """Return the factors of normal matrix plus prior for weights of both differences."""
    pull = stack.pull(weights)
    matrix = with_prior(stack, normal, pull)
    lower, sound = cholesky(matrix)
    root = np.linalg.inv(lower)
    inverse = np.matmul(root.transpose(0, 2, 1), root)
    used = (inverse * normal).reshape(len(normal), -1).sum(axis=1)
    return Factors(pull, root, inverse, np.asarray(used), sound)


def with_prior(
    stack: Stack,
    normal: Float[np.ndarray, "k m m"],
    pull: Float[np.ndarray, "k n n"],
) -> Float[np.ndarray, "k m m"]:
    """Return a matrix with the prior's pull on every branch, fresh memory."""
    result = normal.copy()
    for branch in range(stack.branches):
        own = slice(branch * stack.nodes, (branch + 1) * stack.nodes)
        result[:, own, own] += pull
    return result


def cholesky(
    matrix: Float[np.ndarray, "*k m m"],
) -> tuple[Float[np.ndarray, "*k m m"], Bool[np.ndarray, "*k"]]:
    """Return the lower factors and which exist; the identity stands for those that do not."""
    try:
        lower = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        pass
    else:
        return lower, np.ones(matrix.shape[:-2], bool)
    lower = np.broadcast_to(np.eye(matrix.shape[-1]), matrix.shape).copy()
    sound = np.zeros(matrix.shape[:-2], bool)
    for index in np.ndindex(*matrix.shape[:-2]):
        try:
            lower[index] = np.linalg.cholesky(matrix[index])
        except np.linalg.LinAlgError:
            continue
        sound[index] = True
    return lower, sound


def solve_lanes(
    problems: Problems, weights: Float[np.ndarray, "k 2"], factors: Factors
) -> Solutions:
    """Return the posteriors; a lane whose factor is not sound returns garbage."""
    stack = problems.stack
    right = problems.vector.copy()
    here = stack.tables(problems.unknowns)
    right[:, : stack.size] -= np.matmul(here, factors.pull).reshape(len(right), -1)
    root = factors.root
    step = times(root.transpose(0, 2, 1), times(root, right))
    square = problems.square - 2.0 * dot(problems.vector, step)
    square += dot(step, times(problems.normal, step))
    unknowns = problems.unknowns + step
    there = stack.tables(unknowns)
    square = np.maximum(square, 0.0)
    penalty = bending(stack, there, weights)
    return Solutions(unknowns, square, (square + penalty) / problems.free)


def bending(
    stack: Stack,
    tables: Float[np.ndarray, "k s n"],
    weights: Float[np.ndarray, "k 2"],
) -> Float[np.ndarray, " k"]:
    """Return the penalty of node values, free of cancellation."""
    result = np.zeros(len(tables))
    for part, weight in zip(
        (stack.bends.second, stack.bends.fourth), weights.T, strict=True
    ):
        rows = np.matmul(tables, part.transpose(0, 2, 1)).reshape(len(tables), -1)
        result = result + weight * dot(rows, rows)
    return result
