"""How sure a separable fit is: HAC covariance of factors and shapes."""

import numpy as np
from jaxtyping import Float

from .._loss import AbstractLoss
from ._covariance import larger_covariance, score_covariance
from ._equation import AbstractEquation
from ._linear import solve_linear
from ._point import Point


def uncertainty(
    equation: AbstractEquation,
    point: Point,
    lane: int,
    loss: AbstractLoss,
    share: Float[np.ndarray, " s"],
) -> tuple[Float[np.ndarray, "p p"], int, Float[np.ndarray, " p"]]:
    """Return the covariance of factors and shape, its lag, and the size of each column.

    Args:
        equation: The equation.
        point: Its solution.
        lane: Which of the fits.
        loss: That it ended with.
        share: Weights of the rows.
    """
    problem = equation.stack.problems[equation.of(lane)]
    many = len(problem.target)
    residual, share = point.residual[lane, :many], share[:many]
    full = twin = equation.columns(point, lane)
    if equation.instruments:
        twin = equation.columns(point, lane, instrument=True)
    used = equation.lanes.use[lane, :many] > 0
    slope = float(loss.slope(residual[used] / loss.scale).mean())
    slope = max(slope, 0.05)
    width = full.shape[1]
    large = None
    prior = equation.prior(lane)
    if prior is not None:
        large = np.zeros((width, width))
        large[: len(prior), : len(prior)] = prior
    some = full[used]
    other = some if twin is full else twin[used]
    even = other.T @ other
    own = some.T @ some if twin is not full else even
    matrix = slope * (other.T @ some) if twin is not full else slope * own
    own = slope * own
    if large is not None:
        own, matrix = own + large, matrix + large
    sizes = np.sqrt(np.einsum("tk,tk->k", some, some) / len(some))
    inverse = solve_linear(
        own[None],
        own[None] if twin is full else matrix[None],
        np.zeros((1, width)),
        sizes[None],
    ).inverse[0]
    leverage = slope * np.einsum("tk,tk->t", some @ inverse, other)
    psi = (share * residual)[used] / np.clip(1.0 - leverage, 0.1, 1.0)
    scores = np.zeros_like(twin)
    scores[used] = other * psi[:, None]
    inner, lag = score_covariance(scores, problem.piece)
    free = max(int(used.sum()) - width, 1)
    noise = max(float(psi @ psi) / free, problem.least_noise**2)
    even = noise * even
    if large is not None:
        prior = loss.scale**2 * large
        inner, even = inner + prior, even + prior
    return (
        larger_covariance(inverse @ inner @ inverse.T, inverse @ even @ inverse.T),
        lag,
        sizes,
    )


def roughly(
    equation: AbstractEquation, point: Point, lane: int, loss: AbstractLoss
) -> tuple[Float[np.ndarray, "p p"], int, Float[np.ndarray, " p"]]:
    """Return what `uncertainty` does, as if neighbouring samples had nothing in common.

    Shapes are taken for known.

    Args:
        equation: The equation.
        point: Its solution.
        lane: Which of the fits.
        loss: That it ended with.
    """
    width = equation.width + equation.height
    covariance, sizes = np.zeros((width, width)), np.ones(width)
    inner = slice(0, equation.width)
    covariance[inner, inner] = loss.scale**2 * point.linear.inverse[lane]
    sizes[inner] = point.linear.size[lane]
    return covariance, 0, sizes
