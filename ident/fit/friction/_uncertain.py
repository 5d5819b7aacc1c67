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
    from . import _noise_kernel

    problem = equation.stack.problems[equation.of(lane)]
    many = len(problem.target)
    residual, share = point.residual[lane, :many], share[:many]
    use = equation.lanes.use[lane, :many]
    used = use > 0
    full = twin = equation.columns(point, lane)
    if equation.instruments:
        twin = equation.columns(point, lane, instrument=True)
    own = full * use[:, None]
    other = twin * use[:, None] if equation.instruments else own
    slope = float(loss.slope(residual[used] / loss.scale).mean())
    slope = max(slope, 0.05)
    square = even = own.T @ own
    matrix = normal = slope * square
    if equation.instruments:
        even, matrix = other.T @ other, slope * (other.T @ own)
    width, prior = own.shape[1], equation.prior(lane)
    large = np.zeros((width, width))
    if prior is not None:
        large[: len(prior), : len(prior)] = prior
        matrix = matrix + large
        normal = normal + large if equation.instruments else matrix
    count = int(used.sum())
    sizes = np.sqrt(np.einsum("kk->k", square) / count)
    inverse = solve_linear(
        normal[None],
        normal[None] if matrix is normal else matrix[None],
        np.zeros((1, width)),
        sizes[None],
    ).inverse[0]
    scores = np.empty(own.shape)
    square = _noise_kernel.scores(
        own, other, use, share * residual, inverse, slope, scores
    )
    inner, lag = score_covariance(scores, problem.piece)
    noise = max(square / max(count - width, 1), problem.least_noise**2)
    even = noise * even
    if prior is not None:
        inner, even = inner + loss.scale**2 * large, even + loss.scale**2 * large
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
