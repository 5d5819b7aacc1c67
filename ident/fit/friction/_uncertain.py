"""How sure a separable fit is: HAC covariance of factors and shapes."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ...core._loss import AbstractLoss
from ._covariance import larger_covariance, score_covariances
from ._equation import AbstractEquation
from ._linear import solve_linear
from ._point import Point


@dataclasses.dataclass(frozen=True)
class Certainty:
    """How sure fits are.

    Attributes:
        covariance: Of the factors and the shape of each.
        lag: Samples over which its residuals were taken to resemble each other.
        sizes: RMS of each of its columns, factors before tangents.
    """

    covariance: Float[np.ndarray, "w p p"]
    lag: Int[np.ndarray, " w"]
    sizes: Float[np.ndarray, "w p"]


def uncertainty(
    equation: AbstractEquation, point: Point, losses: Sequence[AbstractLoss]
) -> Certainty:
    """Return how sure fits are, each for itself: only what is small is done side by side.

    Args:
        equation: The equation.
        point: Its solution under the weights that the fits ended with.
        losses: Theirs.
    """
    stack, lanes = equation.stack, equation.lanes
    problems = [stack.problems[equation.of(lane)] for lane in range(len(lanes))]
    slope = _slopes(point, equation, losses)
    own, other = _rows(equation, point)
    square = np.stack([each.T @ each for each in own])
    even, mixed = square, square
    if equation.instruments:
        even = np.stack([each.T @ each for each in other])
        mixed = np.stack([a.T @ b for a, b in zip(other, own, strict=True)])
    count, width = lanes.count, square.shape[1]
    prior = _priors(equation, width)
    steep = slope[:, None, None]
    normal = steep * square + prior
    matrix = steep * mixed + prior if equation.instruments else normal
    sizes = np.sqrt(np.einsum("wkk->wk", square) / count[:, None])
    zeros = np.zeros((len(lanes), width))
    inverse = solve_linear(normal, matrix, zeros, sizes).inverse
    inner, squares, lag = _scored(equation, point, own, other, inverse, slope)
    free = np.maximum(count - width, 1)
    least = np.array([each.least_noise for each in problems])
    noise = np.maximum(squares / free, least**2)[:, None, None]
    scale = np.array([each.scale for each in losses])[:, None, None]
    turned = np.swapaxes(inverse, 1, 2)
    covariance = larger_covariance(
        inverse @ (inner + scale**2 * prior) @ turned,
        inverse @ (noise * even + scale**2 * prior) @ turned,
    )
    return Certainty(covariance, lag, sizes)


def _slopes(
    point: Point, equation: AbstractEquation, losses: Sequence[AbstractLoss]
) -> Float[np.ndarray, " w"]:
    """Return the mean slope of each fit's loss over the rows that it uses."""
    found = [
        float(loss.slope(residual[use > 0] / loss.scale).mean())
        for loss, residual, use in zip(
            losses, point.residual, equation.lanes.use, strict=True
        )
    ]
    return np.maximum(found, 0.05)


def _rows(
    equation: AbstractEquation, point: Point
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the columns of each fit's rows, zero where unused, and those multiplied with."""

    def used(lane: int, instrument: bool) -> np.ndarray:
        found = equation.columns(point, lane, instrument=instrument)
        return np.asarray(found * equation.lanes.use[lane, : len(found), None])

    every = range(len(equation.lanes))
    own = [used(lane, False) for lane in every]
    return own, [used(lane, True) for lane in every] if equation.instruments else own


def _priors(equation: AbstractEquation, width: int) -> Float[np.ndarray, "w p p"]:
    """Return the smoothness prior of each fit over its factors and its shape."""
    found = np.zeros((len(equation.lanes), width, width))
    for lane, into in enumerate(found):
        prior = equation.prior(lane)
        if prior is not None:
            into[: len(prior), : len(prior)] = prior
    return found


def _scored(
    equation: AbstractEquation,
    point: Point,
    own: list[np.ndarray],
    other: list[np.ndarray],
    inverse: Float[np.ndarray, "w p p"],
    slope: Float[np.ndarray, " w"],
) -> tuple[Float[np.ndarray, "w p p"], Float[np.ndarray, " w"], Int[np.ndarray, " w"]]:
    """Return the covariance of each fit's sum of scores, their squares, and the lag."""
    from . import _noise_kernel

    stack, use = equation.stack, equation.lanes.use
    push = point.shares.full * point.residual
    scores = [np.empty(each.shape) for each in own]
    squares, pieces = np.empty(len(own)), []
    for lane, into in enumerate(scores):
        many = len(into)
        squares[lane] = _noise_kernel.scores(
            *(own[lane], other[lane], use[lane, :many], push[lane, :many]),
            *(inverse[lane], slope[lane], into),
        )
        pieces.append(stack.problems[equation.of(lane)].piece)
    inner, lag = score_covariances(scores, pieces)
    return inner, squares, lag


def roughly(
    equation: AbstractEquation, point: Point, losses: Sequence[AbstractLoss]
) -> Certainty:
    """Return what `uncertainty` does, as if neighbouring samples had nothing in common.

    Shapes are taken for known.

    Args:
        equation: The equation.
        point: Its solution.
        losses: Those that the fits ended with.
    """
    count, width = len(losses), equation.width + equation.height
    covariance, sizes = np.zeros((count, width, width)), np.ones((count, width))
    scale = np.array([each.scale for each in losses])[:, None, None]
    inner = slice(0, equation.width)
    covariance[:, inner, inner] = scale**2 * point.linear.inverse
    sizes[:, inner] = point.linear.size
    return Certainty(covariance, np.zeros(count, np.int64), sizes)
