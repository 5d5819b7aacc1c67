"""Smoothness of all tables of an axis together: restricted maximum likelihood."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from .._evidence import _updated
from .._logs import LOW
from ._problem import JointProblem, Solution, solve_joint

NEGLIGIBLE = 2.0
"""Expected gain at which the search ends."""
_STEPS, _RADIUS = 25, 3.0
"""Evaluations at most, and the largest step in a logarithm."""


def choose_weights(
    problem: JointProblem, start: Float[np.ndarray, " k"]
) -> Solution | None:
    """Return the solution with the best evidence; None where no weights give one.

    Quasi-Newton in the logarithms with exact slopes. The curvature begins as the number of
    parameters that each weight leaves to the readings; that makes the first step about the
    fixed point of Fellner and Schall.

    Source: S. N. Wood, M. Fasiolo, A generalized Fellner–Schall method for smoothing
    parameter optimization, Biometrics 73(4), 2017.

    Args:
        problem: Sums about a current estimate.
        start: Logarithms of the weights to begin with.
    """
    low, high = problem.weights.low, problem.weights.high
    # Fourth differences that are off stay off: they were weighed beforehand.
    kinds = np.array([part.kind % 2 for part in problem.weights.parts], bool)
    log = np.clip(start, low, high)
    idle = kinds & (log <= LOW + 1e-9)
    best: Solution | None = None
    slope = np.zeros(len(log))
    curvature = np.eye(len(log))
    step = slope
    for _ in range(_STEPS):
        found = solve_joint(problem, log)
        worse = best is not None and (
            found is None
            or not np.isfinite(found.evidence)
            or found.evidence > best.evidence + 1e-6
        )
        if found is None and best is None:
            # Less smoothness beside the readings keeps the digits that they need.
            log = np.minimum(log, np.log(1e4))
            if np.array_equal(log, np.clip(start, low, high)):
                return None
            start = log
            continue
        if worse or found is None:
            step = 0.3 * step
        else:
            fresh = found.slopes
            fresh[idle] = 0.0
            if best is None:
                curvature = np.diag(np.maximum(0.7 * found.carried, 0.3))
            else:
                curvature = _updated(curvature, log - best.logs, fresh - slope)
            best, slope = found, fresh
            step = _step(curvature, slope, log, low, high)
        assert best is not None
        if -0.5 * float(slope @ step) < NEGLIGIBLE:
            return best
        log = np.clip(best.logs + step, low, high)
    return best


def scanned_starts(problem: JointProblem) -> list[Float[np.ndarray, " k"]]:
    """Return where to begin in each valley: one scale for all tables, by trial.

    With and without fourth differences are two valleys; with them, their weight may keep
    its ratio to that of the second ones or grow as its square.
    """
    fourth = np.array([part.kind % 2 for part in problem.weights.parts], bool)
    low, high = problem.weights.low, problem.weights.high
    start = problem.weights.start(1.0)
    result = []
    for lift, slope in ((LOW, 0.0), (float(np.log(10.0)), 1.0), (0.0, 2.0)):
        tried: list[tuple[float, Float[np.ndarray, " k"]]] = []
        for base in np.log((1e-2, 1.0, 1e2, 1e4, 1e6)):
            log = np.clip(np.where(fourth, lift + slope * base, base), low, high)
            log = np.where(problem.weights.walks, start, log)
            found = solve_joint(problem, log)
            if found is not None and np.isfinite(found.evidence):
                tried.append((found.evidence, log))
        if tried:
            result.append(min(tried, key=lambda each: each[0])[1])
        if not fourth.any():
            break
    return result


def best_of(
    problem: JointProblem, starts: Sequence[Float[np.ndarray, " k"]]
) -> Solution | None:
    """Return the best solution over several starts, fourth differences dropped if idle."""
    found = [choose_weights(problem, start) for start in starts]
    good = [each for each in found if each is not None]
    if not good:
        return None
    best = min(good, key=lambda each: each.evidence)
    for number in range(len(problem.weights.tables)):
        parts = problem.weights.parts
        mine = [k for k, p in enumerate(parts) if p.table == number and p.kind % 2]
        if not mine or (best.logs[mine] <= LOW + 1e-9).all():
            continue
        plain = best.logs.copy()
        plain[mine] = LOW
        other = choose_weights(problem, plain)
        if other is not None and other.evidence < best.evidence:
            best = other
    return best


def _step(
    curvature: Float[np.ndarray, "k k"],
    slope: Float[np.ndarray, " k"],
    log: Float[np.ndarray, " k"],
    low: Float[np.ndarray, " k"],
    high: Float[np.ndarray, " k"],
) -> Float[np.ndarray, " k"]:
    """Return a Newton step that leaves weights at their ends where they are."""
    held = ((log <= low + 1e-9) & (slope > 0)) | ((log >= high - 1e-9) & (slope < 0))
    free = np.flatnonzero(~held)
    step = np.zeros(len(log))
    if len(free):
        step[free] = -np.linalg.solve(curvature[np.ix_(free, free)], slope[free])
        step *= min(1.0, _RADIUS / max(float(np.abs(step).max()), 1e-12))
        wanted = np.clip(log + step, low, high) - log
        step = wanted
    return step
