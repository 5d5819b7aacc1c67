"""Smoothness and noise from the data: restricted maximum likelihood over the weights.

Four weights at most (second and fourth differences along each axis), searched in their
logarithms. Small tables are searched with exact evaluations only. For a large plane a
spectral surrogate gives the start; bent to the exact slope it gives every further step. A
step takes one factor and the elements of the inverse, which the deviations need anyway.
"""

import numpy as np
from jaxtyping import Bool, Float

from ._exact import search_exact
from ._logs import LEAST, active_weights, smoothness_of, stiffest
from ._posterior import Posterior, about, solve
from ._prior import Smoothness
from ._problem import Problem
from ._slopes import slopes
from ._spectrum import SHARE, Spectrum, spectral_start

_LIGHT = 1e-3
"""Weights relative to the density of the fit about which all others are looked for."""
_NEGLIGIBLE = 2.0
"""Expected gain at which the search ends."""
_STEPS, _RADIUS, _BACK = 10, 3.0, 0.3
"""Exact evaluations on a large plane, the largest step in a logarithm, and how much of a step
that led nowhere is tried next."""
_SOFT, _LESS = float(np.log(1e4)), 2.0
"""Logarithm that every factor bears, and how much is taken off one that it did not bear."""
_LIFT = 0.5
"""Curvature of weights that tell nothing."""


def choose_smoothness(problem: Problem) -> Posterior | None:
    """Return the weights with the best evidence; None where no weights give a fit.

    Args:
        problem: Sums about a current estimate.
    """
    density = problem.normal.density
    active = active_weights(problem)
    if not active.any():
        posterior = solve(problem, Smoothness((0.0, 0.0)))
        return posterior
    weight = _LIGHT * density
    fast = (weight, 0.0) if active[2] else (0.0, 0.0)
    light = solve(problem, Smoothness((weight, 0.0), fast))
    if light is None:
        return search_exact(problem, density, active) if problem.small else None
    # About a table near the readings the sums keep the digits that tell the weights.
    problem = about(light)
    if problem.small:
        return search_exact(problem, density, active)
    return _search_large(problem, light, density, active)


def _search_large(
    problem: Problem,
    light: Posterior,
    density: float,
    active: Bool[np.ndarray, " 4"],
) -> Posterior | None:
    """Spectral start, one step of the surrogate bent to the exact slope, quasi-Newton steps."""
    high = stiffest(problem.prior)
    surrogate, log, louder = spectral_start(light, active, high)
    # Fourth differences are there or not; second ones always, however weak.
    alive = active & ((log > LEAST + 1e-9) | np.array([True, False, True, False]))
    best: Posterior | None = None
    best_log, best_slope = log, np.zeros(int(alive.sum()))
    curvature: Float[np.ndarray, "k k"] | None = None
    step = best_slope
    for _ in range(_STEPS):
        posterior = solve(problem, smoothness_of(log, density))
        rise = None
        if posterior is not None and np.isfinite(posterior.evidence):
            worse = best is not None and posterior.evidence > best.evidence
            rise = None if worse else slopes(posterior)
        if posterior is None or rise is None or not np.isfinite(rise).all():
            if best is None:
                # Too stiff for a factor: as stiff as it bears.
                log = np.where(log > _SOFT, np.maximum(log - _LESS, _SOFT), log)
                continue
            step = _BACK * step
        else:
            slope = rise[alive]
            if best is None:
                there = surrogate.best_near(alive, log, louder, rise, _RADIUS, high)
                step = there[alive] - log[alive]
            else:
                if curvature is None:
                    curvature = _curvature(surrogate, log, alive)
                change = log[alive] - best_log[alive]
                curvature = _updated(curvature, change, slope - best_slope)
                # What stands at its end and wants to go on stays.
                ahead = np.where(slope < 0, high[alive] - log[alive], np.inf)
                free = ahead > 0
                step = np.zeros(len(slope))
                step[free] = -np.linalg.solve(
                    curvature[np.ix_(free, free)], slope[free]
                )
                step = np.clip(step, -_RADIUS, _RADIUS)
                step = np.minimum(step, high[alive] - log[alive])
            best, best_log, best_slope = posterior, log, slope
        # Expected gain well below one unit of log-likelihood: statistically the same weights.
        if -0.5 * float(best_slope @ step) < _NEGLIGIBLE:
            break
        log = best_log.copy()
        log[alive] = np.clip(log[alive] + step, LEAST[alive] + 2e-9, high[alive])
    return best


def _curvature(
    surrogate: Spectrum, log: Float[np.ndarray, " 4"], alive: Bool[np.ndarray, " 4"]
) -> Float[np.ndarray, "k k"]:
    """Return what the surrogate says of the curvature of the evidence, lifted off zero."""
    found = SHARE * surrogate.information(log)[np.ix_(alive, alive)]
    return np.asarray(found + _LIFT * np.eye(len(found)))


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
