"""Smoothness and noise from the data: restricted maximum likelihood over the weights.

Four weights at most (second and fourth differences along each axis), searched in their
logarithms. Small tables are searched with exact evaluations only. For a large plane a
spectral surrogate gives start and curvature, and a few exact Newton steps finish.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from ._logs import HIGH, LEAST, LOW, active_weights, smoothness_of, spread_logs
from ._posterior import Posterior, Problem, solve
from ._prior import Smoothness
from ._spectrum import spectral_start

_NEGLIGIBLE = 2.0
"""Expected gain at which the search ends."""
_DIFFERENCE = 0.02
"""Step in a logarithm for slopes."""
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
        return _search_exact(problem, density, active)
    return _search_large(problem, density, active)


def _search_exact(
    problem: Problem,
    density: float,
    active: Bool[np.ndarray, " 4"],
) -> Posterior | None:
    """Scan a few scales, then descend from the best."""
    best: Posterior | None = None

    def cost(reduced: Float[np.ndarray, " k"]) -> float:
        nonlocal best
        posterior = solve(problem, smoothness_of(spread_logs(active, reduced), density))
        if posterior is None or not np.isfinite(posterior.evidence):
            return 1e30
        if best is None or posterior.evidence < best.evidence:
            best = posterior
        return posterior.evidence

    second = active & np.array([True, False, True, False])
    starts = []
    # With and without fourth differences are two valleys: descend from the best of each.
    for lift, slope in ((LOW, 0.0), (np.log(10.0), 1.0), (0.0, 2.0)):
        scan = [
            np.clip(np.where(second, base, lift + slope * base), LEAST, HIGH)[active]
            for base in np.log((1e-2, 1.0, 1e2, 1e4, 1e6))
        ]
        starts.append(min(scan, key=cost))
    bounds = list(zip(LEAST[active], HIGH[active], strict=True))
    for log in starts:
        # A weight at its lower bound has no slope there: lift it a little so that it can grow.
        lifted = np.maximum(log, LEAST[active] + 1.0)
        # The evidence is smooth over a per cent of a weight, and exact to far better.
        minimize(
            cost, lifted, bounds=bounds, method="L-BFGS-B",
            options={"maxiter": 30, "ftol": 1e-8, "gtol": 1e-2, "eps": _DIFFERENCE},
        )  # fmt: skip
    return None if best is None else _without_idle(best)


def _without_idle(posterior: Posterior) -> Posterior:
    """Drop fourth differences that are not worth their place."""
    smoothness = posterior.smoothness
    if not (smoothness.slow[1] or smoothness.fast[1]):
        return posterior
    plain = Smoothness((smoothness.slow[0], 0.0), (smoothness.fast[0], 0.0))
    other = solve(posterior.problem, plain)
    if other is not None and other.evidence < posterior.evidence:
        return other
    return posterior


def _slope(
    problem: Problem,
    density: float,
    log: Float[np.ndarray, " 4"],
    alive: Bool[np.ndarray, " 4"],
    value: float,
) -> Float[np.ndarray, " k"]:
    """Return the slope of the evidence over the weights alive, by forward differences.

    The analytic slope needs traces of inverse × penalty, which cancel for smooth tables; the
    evidence itself stays exact.
    """
    result = []
    for k in np.flatnonzero(alive):
        moved = log.copy()
        moved[k] += _DIFFERENCE
        posterior = solve(problem, smoothness_of(moved, density))
        result.append(
            np.nan if posterior is None else (posterior.evidence - value) / _DIFFERENCE
        )
    return np.array(result)


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
            slope = _slope(problem, density, log, alive, posterior.evidence)
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
        log[alive] = np.clip(best_log[alive] + step, LEAST[alive] + 2e-9, HIGH[alive])
    return best


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
