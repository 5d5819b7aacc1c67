"""Friction from any motion: current = (inertia · a + friction(v) + offset) / gain."""

import numpy as np

from .._errors import FitError
from .._threads import one_blas_thread
from ._assemble import assemble
from ._determined import drop_reason, shape_reason
from ._lowpass import default_factor
from ._problem import Known, Problem, make_problem
from ._result import FrictionFit
from ._samples import DriveSamples, check_samples
from ._separable import Solution, separable
from ._smoothing import choose_weight
from ._structure import AbstractStructure
from ._structures import CoulombViscous, Stribeck


def fit_inverse(
    samples: DriveSamples,
    structure: AbstractStructure | None = None,
    *,
    known: Known | None = None,
    loss: str = "trim",
    decimate: int | None = None,
    smoothness: float | None = None,
) -> FrictionFit:
    """Fit inertia, friction law and offset to a recording of any motion.

    Current, acceleration and the friction computed from the velocity go through one
    low-pass and are thinned (see `Decimation`); where the samples carry instruments the
    normal equations are formed with them, which keeps the fit consistent under noise in
    velocity and acceleration. Standard deviations are HAC (see `_covariance`). A Stribeck
    drop or exponent that the data do not show is left out and named, and the rest fitted
    without it.

    Args:
        samples: The recording.
        structure: Kind of law; Stribeck with exponent 2 where left out.
        known: Gain, and what of inertia and offset need not be fitted.
        loss: ``"trim"`` (least squares, wild samples out), ``"student"``, ``"huber"`` or
            ``"gauss"``.
        decimate: Samples per sample kept; about 100 per second are left where not stated.
        smoothness: Weight of the prior of a table, relative to 1/noise²; by evidence where
            not stated.

    Raises:
        FitError: If the samples cannot be used at all; what merely cannot be told apart is
            named in the result.
    """
    check_samples(samples)
    structure = Stribeck() if structure is None else structure
    known = Known() if known is None else known
    if known.gain == 0 or not np.isfinite(known.gain):
        msg = f"gain: found {known.gain!r}, expected a number other than 0."
        raise FitError(msg)
    if decimate is None:
        decimate = default_factor(samples.cycle)
    if decimate < 1:
        msg = f"decimate: found {decimate}, expected 1 or more."
        raise FitError(msg)
    problem = make_problem(samples, structure, known, decimate)
    return fit_problem(problem, loss, smoothness, "inverse dynamic fit")


def fit_problem(
    problem: Problem, loss: str, smoothness: float | None, method: str
) -> FrictionFit:
    """Fit one problem, with a simpler law where the data do not carry the asked one."""
    with one_blas_thread():
        return _fit(problem, loss, smoothness, method)


def _fit(
    problem: Problem, loss: str, smoothness: float | None, method: str
) -> FrictionFit:
    problem, solution, missing = _solved(problem, loss, smoothness, certain=True)
    return assemble(problem, solution, missing, method)


def solve_problem(problem: Problem, loss: str) -> tuple[Problem, Solution]:
    """Return what `fit_problem` finds before it is put into words, for predictions only.

    Returns:
        The problem, of a simpler law where the data do not carry the asked one, and its
        solution; the covariance is there where the choice of that law needs it.
    """
    with one_blas_thread():
        problem, solution, _ = _solved(problem, loss, None, certain=False)
    return problem, solution


def _solved(
    problem: Problem, loss: str, smoothness: float | None, *, certain: bool
) -> tuple[Problem, Solution, dict[str, str]]:
    asked = problem.structure
    missing: dict[str, str] = {}
    # Whether a drop from break-away is one is judged by its standard deviation.
    judged = certain or bool(asked.shapes)
    solution = _solution(problem, loss, smoothness, judged)
    reason = shape_reason(problem, solution)
    if reason is not None and drop_reason(problem, solution) is None:
        missing["stribeck_shape"] = reason
        problem = problem.with_structure(Stribeck(asked.directional, 2.0))
        solution = _solution(problem, loss, smoothness, judged)
    reason = drop_reason(problem, solution)
    if reason is not None:
        ways = ("_positive", "_negative") if asked.directional else ("",)
        names = [f"breakaway{way}" for way in ways] + list(asked.shapes)
        missing |= dict.fromkeys(names, reason)
        problem = problem.with_structure(CoulombViscous(asked.directional))
        solution = _solution(problem, loss, smoothness, certain)
    return problem, solution, missing


def _solution(
    problem: Problem, loss: str, smoothness: float | None, certain: bool
) -> Solution:
    if problem.structure.penalty() is None:
        return separable(problem, loss, certain=certain)
    weight = choose_weight(problem, loss) if smoothness is None else smoothness
    return separable(problem, loss, weight, certain=certain)
