"""The separable fit: linear factors eliminated, shapes searched, samples weighed.

Variable projection: for each trial shape the linear factors follow from least squares, so the
search runs over Stribeck velocity and exponent only, from several starts. Source: G. Golub,
V. Pereyra, Separable nonlinear least squares, Inverse Problems 19(2), 2003.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from .._errors import FitError
from .._loss import AbstractLoss
from ._covariance import larger_covariance, score_covariance
from ._linear import Linear, solve_linear
from ._loss import friction_loss
from ._problem import Problem
from ._tables import KnotTable, default_knots

_PASSES = 60
_FREEZE = 20
"""Pass from which on the scale of the residuals is kept, so that nothing can go in circles."""
_STEP = 0.5
"""Longest step of a logarithm of the shape."""
_SETTLED = 1e-3
"""Largest change of any column's contribution in one pass, in scales, at the end."""
_FLOOR = 1e-9
"""Smallest scale of residuals relative to the load."""
_SCOUT_KNOTS = 12


@dataclasses.dataclass(frozen=True)
class Solution:
    """Where the separable fit ended.

    Attributes:
        factors: Linear factors, fixed columns first.
        shape: Logarithms of the non-linear parameters.
        covariance: Of factors and shape together, null directions left out.
        null: Directions of the factors that no sample moves, as columns.
        column_size: RMS of each column over the samples used (factors, then tangents).
        residual: Load − fit per filtered sample, in load units.
        share: Weight that each of them had.
        loss: With its scale.
        lag: Up to which the covariance looked.
        passes: How many were made.
        converged: Whether the last one changed nothing.
        at_bound: Which shapes ended at the edge of what the data could tell.
        weight: Of the smoothness prior.
    """

    factors: Float[np.ndarray, " k"]
    shape: Float[np.ndarray, " s"]
    covariance: Float[np.ndarray, "p p"]
    null: Float[np.ndarray, "k z"]
    column_size: Float[np.ndarray, " p"]
    residual: Float[np.ndarray, " t"]
    share: Float[np.ndarray, " t"]
    loss: AbstractLoss
    lag: int
    passes: int
    converged: bool
    at_bound: Bool[np.ndarray, " s"]
    weight: float


def scout(problem: Problem, loss: str) -> Float[np.ndarray, " t"]:
    """Return weights of the samples under a law that can bend anywhere.

    What is wild under a free table is wild under any law, whatever shape is tried.
    """
    rows = b"" if problem.only is None else np.packbits(problem.only).tobytes()
    key = (loss, problem.structure.directional, rows)
    if key not in problem.scouted:
        problem.scouted[key] = _scout(problem, loss)
    return problem.scouted[key].copy()


def _scout(problem: Problem, loss: str) -> Float[np.ndarray, " t"]:
    knots = default_knots(problem.speed, _SCOUT_KNOTS)
    if len(set(knots)) < _SCOUT_KNOTS:
        return problem.usable.astype(float)
    free = problem.with_structure(KnotTable(problem.structure.directional, knots))
    design = free.design(np.zeros(0))
    share = problem.usable.astype(float)
    for step in range(8):
        solved = solve_linear(design, design, free.target, share, None)
        residual = free.target - design @ solved.factors
        kind = "huber" if step < 4 and loss != "gauss" else loss
        share = _shares(problem, residual, kind, design.shape[1])[0]
    return share


def _shares(
    problem: Problem,
    residual: np.ndarray,
    name: str,
    parameters: int,
    kept: AbstractLoss | None = None,
) -> tuple[np.ndarray, AbstractLoss]:
    usable = problem.usable
    count = int(usable.sum())
    inflation = np.sqrt(count / max(count - parameters, 0.05 * count))
    floor = max(_FLOOR * float(np.sqrt(np.mean(problem.load**2))), 1e-300)
    loss = kept or friction_loss(name, residual[usable], float(inflation), floor)
    return np.where(usable, loss.share(residual / loss.scale), 0.0), loss


def separable(
    problem: Problem, loss: str, weight: float = 0.0, *, certain: bool = True
) -> Solution:
    """Fit factors and shapes of a problem.

    Args:
        problem: The equation.
        loss: Name of the loss.
        weight: Of the smoothness prior, relative to 1/noise².
        certain: Whether the covariance is wanted; without it there are zeros, for laws
            that are only to predict.

    Raises:
        FitError: If hardly any sample is left.
    """
    count = int(problem.usable.sum())
    parameters = len(problem.fixed_names) + len(problem.structure.names)
    if count <= parameters + len(problem.structure.shapes):
        msg = (
            f"{count} samples in motion are left after filtering, "
            f"expected more than the {parameters} parameters."
        )
        raise FitError(msg)
    penalty = problem.penalty()
    if penalty is not None:
        penalty = weight * penalty
    share = scout(problem, loss)
    shape = _best_start(problem, share, penalty)
    low, high = problem.structure.bounds(problem.speed)
    chosen: AbstractLoss | None = None
    converged = False
    before: np.ndarray | None = None
    step = 0
    for step in range(_PASSES):
        _, _, _, residual = _at(problem, shape, share, penalty)
        fit = problem.target - residual
        kept = chosen if step >= _FREEZE else None
        if loss != "gauss" or chosen is None:
            share, chosen = _shares(problem, residual, loss, parameters, kept)
        moved = np.inf if before is None else np.abs(fit - before)[share > 0].max()
        if moved <= _SETTLED * chosen.scale:
            converged = True
            break
        before = fit
        if len(shape):
            shape = _next_shape(problem, shape, share, penalty)
    assert chosen is not None
    _, _, solved, residual = _at(problem, shape, share, penalty)
    width = len(solved.factors) + len(shape)
    covariance, lag, sizes = np.zeros((width, width)), 0, np.ones(width)
    if certain:
        covariance, lag, sizes = _uncertainty(
            problem, shape, solved, residual, share, chosen, penalty
        )
    return Solution(
        solved.factors,
        shape,
        covariance,
        solved.null,
        sizes,
        residual,
        share,
        chosen,
        lag,
        step + 1,
        converged,
        (shape <= low + 1e-6) | (shape >= high - 1e-6),
        weight,
    )


def _at(
    problem: Problem,
    shape: np.ndarray,
    share: np.ndarray,
    penalty: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, Linear, np.ndarray]:
    """Return design, tangents, linear solution and residual at a shape."""
    design = problem.design(shape)
    twin = problem.design(shape, instrument=True) if problem.has_instrument else design
    solved = solve_linear(design, twin, problem.target, share, penalty)
    tangents = problem.tangents(shape, solved.factors)
    return design, tangents, solved, problem.target - design @ solved.factors


def _cost(
    problem: Problem, shape: np.ndarray, share: np.ndarray, penalty: np.ndarray | None
) -> float:
    design = problem.design(shape)
    solved = solve_linear(design, design, problem.target, share, penalty)
    residual = problem.target - design @ solved.factors
    return float(share @ residual**2)


def _best_start(
    problem: Problem, share: np.ndarray, penalty: np.ndarray | None
) -> np.ndarray:
    starts = list(problem.structure.starts(problem.speed))
    if len(starts) == 1:
        return starts[0]
    costs = [_cost(problem, start, share, penalty) for start in starts]
    return np.asarray(starts[int(np.argmin(costs))])


def _next_shape(
    problem: Problem, shape: np.ndarray, share: np.ndarray, penalty: np.ndarray | None
) -> np.ndarray:
    """Take one Gauss-Newton step in the shape, linear factors following, kept within bounds."""
    low, high = problem.structure.bounds(problem.speed)
    design, tangents, solved, residual = _at(problem, shape, share, penalty)
    twin, twist = design, tangents
    if problem.has_instrument:
        twin = problem.design(shape, instrument=True)
        twist = problem.tangents(shape, solved.factors, instrument=True)
    # What the linear columns can follow is no reason to move.
    off = solved.inverse @ (twin * share[:, None]).T @ tangents
    free = tangents - design @ off
    matrix = (twist * share[:, None]).T @ free
    push = (twist * share[:, None]).T @ residual
    scale = max(float(np.trace(np.abs(matrix))), 1e-300)
    step = np.linalg.lstsq(
        matrix + 1e-9 * scale * np.eye(len(shape)), push, rcond=None
    )[0]
    step = step * min(1.0, _STEP / max(float(np.abs(step).max()), 1e-300))
    if problem.has_instrument:
        return np.asarray(np.clip(shape + step, low, high))
    now = float(share @ residual**2)
    for _ in range(12):
        trial = np.clip(shape + step, low, high)
        if _cost(problem, trial, share, penalty) <= now * (1 + 1e-12):
            return np.asarray(trial)
        step = 0.5 * step
    return shape


def _uncertainty(
    problem: Problem,
    shape: np.ndarray,
    solved: Linear,
    residual: np.ndarray,
    share: np.ndarray,
    loss: AbstractLoss,
    penalty: np.ndarray | None,
) -> tuple[np.ndarray, int, np.ndarray]:
    """Return the covariance of factors and shape, its lag, and the size of each column."""
    design = problem.design(shape)
    full = np.concatenate([design, problem.tangents(shape, solved.factors)], axis=1)
    twin = full
    if problem.has_instrument:
        twin = np.concatenate(
            [
                problem.design(shape, instrument=True),
                problem.tangents(shape, solved.factors, instrument=True),
            ],
            axis=1,
        )
    used = problem.usable
    slope = float(loss.slope(residual[used] / loss.scale).mean())
    weight = np.where(used, max(slope, 0.05), 0.0)
    width = full.shape[1]
    large = None
    if penalty is not None:
        large = np.zeros((width, width))
        large[: len(penalty), : len(penalty)] = penalty
    inverse = solve_linear(full, twin, problem.target, weight, large).inverse
    leverage = np.einsum("tk,kl,tl->t", full, inverse, twin) * weight
    psi = share * residual / np.clip(1.0 - leverage, 0.1, 1.0)
    scores = twin * psi[:, None]
    inner, lag = score_covariance(scores, problem.piece)
    free = max(int(used.sum()) - width, 1)
    noise = max(float(psi[used] @ psi[used]) / free, problem.least_noise**2)
    even = noise * (twin[used].T @ twin[used])
    if large is not None:
        prior = loss.scale**2 * large
        inner, even = inner + prior, even + prior
    sizes = np.sqrt(np.mean(full[used] ** 2, axis=0))
    return (
        larger_covariance(inverse @ inner @ inverse.T, inverse @ even @ inverse.T),
        lag,
        sizes,
    )
