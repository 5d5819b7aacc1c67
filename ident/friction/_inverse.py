"""Friction from any motion: current = (inertia · a + friction(v) + offset) / gain."""

import numpy as np
from jaxtyping import Float

from ..core import FitError, one_blas_thread
from ._determined import drop_reason, shape_reason
from ._equation import Equation, Known, default_factor
from ._result import FrictionFit, assemble
from ._samples import DriveSamples, check_samples
from ._separable import Solution, fit_equation
from ._structures import GAUSS, AbstractStructure, CoulombViscous, Stribeck

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
    low-pass and are thinned (`Lowpass`); where the samples carry instruments the normal
    equations are formed with them, which keeps the fit consistent under noise in velocity
    and acceleration. Standard deviations are HAC (`score_covariance`). A Stribeck drop or
    exponent that the data do not show is left out and named, and the rest fitted without it.

    Args:
        samples: The recording.
        structure: Kind of law; Stribeck with a free exponent where left out.
        known: Gain, and what of inertia and offset need not be fitted.
        loss: ``"trim"`` (least squares, wild samples out), ``"student"``, ``"huber"`` or
            ``"gauss"``.
        decimate: Samples per row; about 100 rows per second where not stated.
        smoothness: Weight of the prior of a table, relative to 1/noise²; by evidence where
            not stated.

    Raises:
        FitError: If the samples cannot be used at all; what merely cannot be told apart is
            named in the result.
    """
    equation = equation_of(samples, structure or Stribeck(), known, decimate)
    with one_blas_thread():
        return assemble(*fit_carried(equation, loss, smoothness), METHOD)


def equation_of(
    samples: DriveSamples,
    structure: AbstractStructure,
    known: Known | None,
    decimate: int | None,
) -> Equation:
    """Return the checked equation of a recording; arguments as of `fit_inverse`.

    Raises:
        FitError: If the samples cannot be used at all.
    """
    check_samples(samples)
    known = Known() if known is None else known
    if known.gain == 0 or not np.isfinite(known.gain):
        msg = f"gain: found {known.gain!r}, expected a number other than 0."
        raise FitError(msg)
    factor = default_factor(samples.cycle) if decimate is None else decimate
    if factor < 1:
        msg = f"decimate: found {factor}, expected 1 or more."
        raise FitError(msg)
    return Equation(samples, structure, known, factor)


def fit_carried(
    equation: Equation,
    loss: str,
    smoothness: float | None = None,
    *,
    begin: Float[np.ndarray, " s"] | None = None,
    near: Float[np.ndarray, " h"] | None = None,
) -> tuple[Equation, Solution, dict[str, str]]:
    """Return equation and solution of what the data carry of a law, and what they do not.

    Args:
        equation: Of the law that is asked for.
        loss: As for `fit_inverse`.
        smoothness: Likewise.
        begin: Weights of the rows to begin with.
        near: Logarithms of a shape to begin with.
    """
    solution = fit_equation(equation, loss, smoothness, begin, near)
    missing: dict[str, str] = {}
    structure = equation.structure
    reason = shape_reason(equation, solution)
    if reason is not None and drop_reason(equation, solution) is None:
        missing["stribeck_shape"] = reason
        simpler = Stribeck(structure.directional, exponent=GAUSS)
        equation = equation.with_structure(simpler)
        solution = fit_equation(equation, loss, begin=begin, near=solution.shape[:1])
    reason = drop_reason(equation, solution)
    if reason is not None:
        names = [name for name in structure.names if name.startswith("drop")]
        names = [name.replace("drop", "breakaway") for name in names]
        missing |= dict.fromkeys([*names, *structure.shapes], reason)
        equation = equation.with_structure(CoulombViscous(structure.directional))
        solution = fit_equation(equation, loss, begin=begin)
    return equation, solution, missing


def force_error(fit: FrictionFit, samples: DriveSamples) -> Float[np.ndarray, " s"]:
    """Return load − prediction for another recording, filtered alike, in load units.

    Args:
        fit: The law, with inertia and offset.
        samples: A recording, the one fitted or another; its rows in motion count.
    """
    equation = equation_of(samples, fit.structure, fit.known, fit.decimate)
    error = equation.target - equation.design(fit.shape) @ fit.state
    return np.asarray(error[equation.usable])
