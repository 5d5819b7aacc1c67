"""Smoothness and noise from the data: restricted maximum likelihood over the weights.

Four weights at most (second and fourth differences along each axis), searched in their
logarithms. Small tables are searched with exact evaluations only. For a large plane a
spectral surrogate gives start and curvature, and a few exact Newton steps finish.
"""

import numpy as np
from jaxtyping import Bool, Float

from ._exact import search_exact
from ._logs import HIGH, LEAST, active_weights, smoothness_of
from ._posterior import Posterior, Problem, solve
from ._prior import Smoothness
from ._spectrum import spectral_start

_NEGLIGIBLE = 2.0
"""Expected gain at which the search ends."""
_DIFFERENCE = 0.2
"""Step in a logarithm for slopes: wide, since what sums rounded in another order change of the
evidence is divided by it."""
_COARSE = 0.1
"""Step to which logarithms are rounded on a large plane."""
_STEPS, _RADIUS = 8, 3.0
"""Exact evaluations on a large plane, and the largest step in a logarithm."""
_SMALL = 5e6
"""Operations of one band Cholesky up to which exact evaluations are cheap."""


def choose_smoothness(problem: Problem) -> Posterior | None:
    """Return the weights with the best evidence; None where no weights give a fit.

    Args:
        problem: Sums about a current estimate.
    """
    grid = problem.normal.grid
    density = problem.normal.density
    active = active_weights(problem)
    if not active.any():
        posterior = solve(problem, Smoothness((0.0, 0.0)))
        return posterior
    full = grid.size * (4.0 * grid.fast) ** 2
    if full <= _SMALL:
        return search_exact(problem, density, active)
    return _search_large(problem, density, active)


def _slope(
    problem: Problem,
    density: float,
    log: Float[np.ndarray, " 4"],
    alive: Bool[np.ndarray, " 4"],
    value: float,
    curvature: Float[np.ndarray, "k k"],
) -> Float[np.ndarray, " k"]:
    """Return the slope of the evidence over the weights alive, by forward differences.

    What the curvature adds over the step is taken off. The analytic slope needs traces of
    inverse × penalty, which cancel for smooth tables; the evidence itself stays exact.
    """
    result = []
    for k in np.flatnonzero(alive):
        moved = log.copy()
        moved[k] += _DIFFERENCE
        posterior = solve(problem, smoothness_of(moved, density))
        result.append(
            np.nan if posterior is None else (posterior.evidence - value) / _DIFFERENCE
        )
    return np.array(result) - 0.5 * _DIFFERENCE * np.diag(curvature)


def _search_large(
    problem: Problem,
    density: float,
    active: Bool[np.ndarray, " 4"],
) -> Posterior | None:
    """Spectral start, then quasi-Newton steps with exact slopes."""
    found = spectral_start(problem, density, active)
    if found is None:
        return None
    surrogate, log = found
    alive = active & (log > LEAST + 1e-9)
    log = _coarse(log, alive)
    curvature = surrogate.information(log)[np.ix_(alive, alive)]
    best: Posterior | None = None
    best_log, best_slope = log, np.zeros(int(alive.sum()))
    step = best_slope
    for _ in range(_STEPS):
        posterior = solve(problem, smoothness_of(log, density))
        if posterior is None or not np.isfinite(posterior.evidence):
            if best is None:
                log = np.minimum(log, np.log(1e4))
                continue
            step = 0.3 * step
        elif best is not None and posterior.evidence > best.evidence:
            step = 0.3 * step
        else:
            slope = _slope(problem, density, log, alive, posterior.evidence, curvature)
            if best is not None:
                moved = log[alive] - best_log[alive]
                curvature = _updated(curvature, moved, slope - best_slope)
            best, best_log, best_slope = posterior, log, slope
            step = -np.linalg.solve(curvature, slope)
            step *= min(1.0, _RADIUS / max(float(np.abs(step).max()), 1e-12))
        # Expected gain well below one unit of log-likelihood: statistically the same weights.
        if -0.5 * float(best_slope @ step) < _NEGLIGIBLE:
            return best
        log = best_log.copy()
        log[alive] += step
        log = _coarse(log, alive)
        if np.array_equal(log, best_log):
            return best
    return best


def _coarse(
    log: Float[np.ndarray, " 4"], alive: Bool[np.ndarray, " 4"]
) -> Float[np.ndarray, " 4"]:
    """Return logarithms to a step that matters to nobody, within their ends.

    So sums rounded in another order are searched at the same places.
    """
    result = log.copy()
    steps = np.round(log[alive] / _COARSE) * _COARSE
    result[alive] = np.clip(steps, LEAST[alive] + 2e-9, HIGH[alive])
    return result


def _updated(
    curvature: Float[np.ndarray, "k k"],
    step: Float[np.ndarray, " k"],
    change: Float[np.ndarray, " k"],
) -> Float[np.ndarray, "k k"]:
    """Return the damped BFGS update of a positive definite curvature."""
    along = curvature @ step
    square = float(step @ along)
    if square <= 0:
        return curvature
    share = float(step @ change) / square
    # Powell's damping keeps the matrix positive definite.
    mix = 1.0 if share >= 0.2 else 0.8 / (1.0 - share)
    change = mix * change + (1.0 - mix) * along
    return np.asarray(
        curvature
        - np.outer(along, along) / square
        + np.outer(change, change) / float(step @ change)
    )
