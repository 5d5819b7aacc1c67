"""The smoothness of a small table by exact evaluations of the evidence.

Two valleys are descended into, and the bottom of the deeper one is then found to far below
what matters to anybody: sums that were rounded in another order, since a file came in
pieces or workers shared it, end in the same place.
"""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from ._logs import LEAST, LOW, spread_logs, stiffest, weights_of
from ._posterior import BEARS, Posterior, solve
from ._problem import Problem

_DIFFERENCE = 0.02
"""Step in a logarithm for the slopes of the descent."""
_GAIN = 1e-2
"""Gain in evidence of one step at which the descent ends."""
_WIDTH = 0.2
"""Step in a logarithm for slopes and curvatures at the bottom: wide enough to stand out of
the rounding of the evidence."""
_STEPS, _RADIUS, _SETTLED = 30, 2.0, 1e-3
"""Newton steps at most, the largest one, and the last one."""
_NEAR, _POLISHED, _TOUCHES = 0.05, 1e-9, 6
"""First step of the polish at most, the one at which it ends, and how many at most."""
_HALVES = 4
_ROUNDING, _NOTHING = 1e-11, 1e-5
"""Of the evidence, relative to its size; and how much of it is nothing to anybody."""
_WORTH = 0.1
"""Gain in evidence below which the simpler of two priors is taken."""
_ROUGHLY = 1e9
"""`BEARS` of the way down, where the evidence may be out by what is nothing to anybody."""
_HOPELESS = 1e30

Log = Float[np.ndarray, " 4"]
"""Logarithms of the four weights; −∞ for one that is not there."""


def search_exact(
    problem: Problem, density: float, active: Bool[np.ndarray, " 4"]
) -> Posterior | None:
    """Return the weights with the best evidence; None where no weights give a fit.

    Args:
        problem: Sums about a current estimate.
        density: Of the readings.
        active: Which of the four weights have any difference to act on.
    """
    evidence = _Evidence(problem, density, stiffest(problem.prior))
    roughly = dataclasses.replace(evidence, bears=_ROUGHLY)
    log = _deepest(roughly, active)
    if evidence(log) >= _HOPELESS:
        return None
    log = _bottom(roughly, _simplest(evidence, log))
    simple = _simplest(evidence, log)
    if not np.array_equal(simple, log):
        log = _bottom(roughly, simple)
    return evidence.posterior(_polished(evidence, log))


@dataclasses.dataclass(frozen=True)
class _Evidence:
    """Minus twice the restricted log-likelihood over the four logarithms; smaller is better.

    Attributes:
        problem: Sums about a current estimate.
        density: Of the readings.
        high: Upper ends of the logarithms.
        bears: As for `solve`.
    """

    problem: Problem
    density: float
    high: Log
    bears: float = BEARS

    def posterior(self, log: Log) -> Posterior | None:
        """Return the posterior for these weights, None where there is none."""
        return solve(self.problem, weights_of(log, self.density), bears=self.bears)

    def __call__(self, log: Log) -> float:
        posterior = self.posterior(log)
        if posterior is None or not np.isfinite(posterior.evidence):
            return _HOPELESS
        return posterior.evidence

    def free(self, log: Log) -> Bool[np.ndarray, " 4"]:
        """Return which weights are there and lie between their ends."""
        return np.asarray((log > LEAST) & (log < self.high))


def _deepest(evidence: _Evidence, active: Bool[np.ndarray, " 4"]) -> Log:
    """Scan a few scales, descend from the best of each valley, return the deepest place."""
    least, high = LEAST[active], evidence.high[active]
    best, lowest = spread_logs(active, high), np.inf

    def cost(reduced: Float[np.ndarray, " k"]) -> float:
        nonlocal best, lowest
        log = spread_logs(active, reduced)
        log[1::2][log[1::2] <= LOW + 1e-9] = -np.inf
        value = evidence(log)
        if value < lowest:
            best, lowest = log, value
        return value

    second = active & np.array([True, False, True, False])
    starts = []
    # With and without fourth differences are two valleys: descend from the best of each.
    for lift, slope in ((LOW, 0.0), (np.log(10.0), 1.0), (0.0, 2.0)):
        scan = [
            np.clip(np.where(second, base, lift + slope * base)[active], least, high)
            for base in np.log((1e-2, 1.0, 1e2, 1e4, 1e6))
        ]
        starts.append(min(scan, key=cost))
    bounds = list(zip(least, high, strict=True))
    for log in starts:
        # A weight at its lower bound has no slope there: lift it a little so that it can grow.
        lifted = np.minimum(np.maximum(log, least + 1.0), high)
        # Relative to the evidence, as the routine has it.
        gain = _GAIN / max(abs(lowest), 1.0)
        minimize(
            cost, lifted, bounds=bounds, method="L-BFGS-B",
            options={"maxiter": 30, "ftol": gain, "gtol": 1e-2, "eps": _DIFFERENCE},
        )  # fmt: skip
    return best


def _bottom(evidence: _Evidence, log: Log) -> Log:
    """Return the bottom of a valley, by safeguarded Newton steps from near by."""
    value = evidence(log)
    for _ in range(_STEPS):
        free = np.flatnonzero(evidence.free(log))
        if not len(free):
            break
        slope, curvature = _derivatives(evidence, log, free, value)
        if not np.isfinite(curvature).all():
            break
        step = -_inverse(curvature) @ slope
        step *= min(1.0, _RADIUS / max(float(np.abs(step).max()), 1e-300))
        moved = log
        for _ in range(_HALVES):
            moved = log.copy()
            moved[free] = np.clip(log[free] + step, LEAST[free], evidence.high[free])
            reached = evidence(moved)
            if reached <= value + max(_ROUNDING * abs(value), _NOTHING):
                break
            step = 0.5 * step
        else:
            break
        settled = float(np.abs(moved[free] - log[free]).max()) <= _SETTLED
        log, value = moved, reached
        if settled:
            break
    return log


def _polished(evidence: _Evidence, log: Log) -> Log:
    """Return the bottom from next to it, to the digits that the evidence has.

    Steps with the same curvature shrink by a factor; the last ones are far below what
    rounding elsewhere does to a table.
    """
    free = np.flatnonzero(evidence.free(log))
    if not len(free):
        return log
    slope, curvature = _derivatives(evidence, log, free, evidence(log))
    if not np.isfinite(curvature).all():
        return log
    inverse, size = _inverse(curvature), 2.0 * _NEAR
    for _ in range(_TOUCHES):
        step = -inverse @ slope
        if not float(np.abs(step).max()) <= 0.5 * size:
            break
        size = float(np.abs(step).max())
        log = log.copy()
        log[free] = np.clip(log[free] + step, LEAST[free], evidence.high[free])
        if size <= _POLISHED:
            break
        ahead, behind = _beside(evidence, log, free)
        slope = (ahead - behind) / (2.0 * _WIDTH)
    return log


def _inverse(curvature: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """Return the inverse of a curvature with every bend taken for a valley."""
    bends, ways = np.linalg.eigh(curvature)
    # Uphill bends are gone down, too; where nothing bends no weight matters.
    return np.asarray((ways / np.maximum(np.abs(bends), 1e-9)) @ ways.T)


def _beside(
    evidence: _Evidence, log: Log, free: np.ndarray
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return the evidence a step ahead and a step behind along each free weight."""
    steps = _WIDTH * np.eye(4)[free]
    ahead = np.array([evidence(log + step) for step in steps])
    behind = np.array([evidence(log - step) for step in steps])
    return ahead, behind


def _derivatives(
    evidence: _Evidence, log: Log, free: np.ndarray, value: float
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k k"]]:
    """Return slope and curvature over the free weights, by central differences.

    The analytic slope needs traces of inverse × penalty, which cancel for smooth tables;
    the evidence itself stays exact.
    """
    ahead, behind = _beside(evidence, log, free)
    if max(*ahead, *behind) >= _HOPELESS:
        return ahead, np.full((len(free), len(free)), np.inf)
    steps = _WIDTH * np.eye(4)[free]
    slope = (ahead - behind) / (2.0 * _WIDTH)
    own = (ahead + behind - 2.0 * value) / _WIDTH**2
    curvature = np.diag(own)
    for i, k in itertools.combinations(range(len(free)), 2):
        both = evidence(log + steps[i] + steps[k]) + evidence(log - steps[i] - steps[k])
        mixed = (both - 2.0 * value) / _WIDTH**2 - own[i] - own[k]
        curvature[i, k] = curvature[k, i] = 0.5 * mixed
    return slope, curvature


def _simplest(evidence: _Evidence, log: Log) -> Log:
    """Return the prior that needs least among those that explain the readings as well.

    Fourth differences that are not worth their place go; a direction in which the table
    might as well be straight is straight.
    """
    most = evidence(log) + _WORTH
    fourth = [k for k in (1, 3) if log[k] > -np.inf]
    for gone in ([1, 3], [1], [3]):
        if not set(gone) <= set(fourth):
            continue
        plain = log.copy()
        plain[gone] = -np.inf
        if evidence(plain) <= most:
            log = plain
            break
    for k in np.flatnonzero(evidence.free(log)):
        straight = log.copy()
        straight[k] = evidence.high[k]
        if evidence(straight) <= most:
            log = straight
    return log
