"""Friction from any motion: current = (inertia · a + friction(v) + offset) / gain."""

import numpy as np

from ...core._errors import FitError
from ...core._threads import one_blas_thread
from ._assemble import assemble
from ._lowpass import default_factor
from ._problem import Known, Problem, make_problem
from ._result import FrictionFit
from ._samples import DriveSamples, check_samples
from ._solve import solve_stack
from ._stack import alone
from ._structure import AbstractStructure
from ._structures import Stribeck

METHOD = "inverse dynamic fit"


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
    return fit_problem(problem, loss, smoothness, METHOD)


def fit_problem(
    problem: Problem, loss: str, smoothness: float | None, method: str
) -> FrictionFit:
    """Fit one problem, with a simpler law where the data do not carry the asked one."""
    with one_blas_thread():
        (solved,) = solve_stack(alone(problem), loss, problem.all_rows, smoothness)
    return assemble(solved, method)
