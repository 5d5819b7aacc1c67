"""Friction from any motion: current = inertia · a + friction(v) + offset."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..core import one_blas_thread
from ._equation import Equation, record
from ._result import OTHER, FrictionFit, score_covariance
from ._samples import DriveSamples
from ._separable import fit_equation
from ._structures import GAUSS, AbstractStructure, CoulombViscous, Stribeck
from ._weights import View, Weights, ridged, weigh

_EXPONENTIAL = 1.0
"""Exponent of the other law that is common beside `GAUSS`."""
_DROP = 3.0
"""Standard deviations that a drop must show to be one."""
_TOO_FAST = 0.5
"""Stribeck velocity, as a share of the highest speed, that only a bend at speed can give."""
_VAGUE_LOG = 0.7
"""Standard deviation of the logarithm of a shape (a factor of two) that says nothing."""
_ASSUMED = "the data do not tell how sharply friction falls; 2 is assumed"


def fit_inverse(
    samples: DriveSamples,
    structure: AbstractStructure | None = None,
    *,
    inertia: float | None = None,
    loss: str = "trim",
    decimate: int | None = None,
) -> FrictionFit:
    """Fit inertia, friction law and offset to a recording of any motion.

    Current, acceleration and the friction computed from the velocity go through one
    low-pass and are thinned (`Lowpass`); where the samples carry instruments the rows are
    seen through them, which keeps the fit consistent under noise in velocity and
    acceleration. Standard deviations are HAC (`score_covariance`). A Stribeck drop or
    exponent that the data do not show is left out and named, and the rest fitted without it.

    Args:
        samples: The recording.
        structure: Kind of law; Stribeck with a free exponent where left out.
        inertia: In drive units per mm/s², where it is known.
        loss: ``"trim"`` (least squares, wild samples out), ``"student"``, ``"huber"`` or
            ``"gauss"``.
        decimate: Samples per row; about 100 rows per second where not stated.

    Raises:
        FitError: If the samples cannot be used at all; what merely cannot be told apart is
            named in the result.
    """
    recording = record(samples, inertia, decimate)
    with one_blas_thread():
        weights = weigh(recording, loss)
        return fit_carried(Equation(recording, structure or Stribeck()), weights)


def fit_carried(
    equation: Equation, weights: Weights, near: Float[np.ndarray, " h"] | None = None
) -> FrictionFit:
    """Return the fit of what the data carry of a law; arguments as of `fit_equation`."""
    directional, missing = equation.structure.directional, dict[str, str]()
    fit = fit_equation(equation, weights, near)
    if near is not None and _drop_reason(fit) is not None:
        # What a simpler law is best at may lie in another valley.
        exponential = equation.under(Stribeck(directional, _EXPONENTIAL))
        velocity = fit_equation(exponential, weights).shape
        starts = None, np.append(velocity, np.log(_EXPONENTIAL))
        others = [fit_equation(equation, weights, start) for start in starts]
        fit = min(fit, *others, key=lambda each: float(each.share @ each.error**2))
    free = "stribeck_shape" in fit.structure.shapes
    vague = free and np.sqrt(fit.state_covariance[-1, -1]) > _VAGUE_LOG
    if free and (vague or fit.at_bound[1]) and _drop_reason(fit) is None:
        missing["stribeck_shape"] = _ASSUMED
        gaussian = equation.under(Stribeck(directional, GAUSS))
        fit = fit_equation(gaussian, weights, fit.shape[:1])
        fit = dataclasses.replace(fit, assumed=True)
    reason = _drop_reason(fit)
    if reason is not None:
        names = [name for name in fit.structure.names if name.startswith("drop")]
        names = [name.replace("drop", "breakaway") for name in names]
        missing |= dict.fromkeys([*names, *equation.structure.shapes], reason)
        fit = fit_equation(equation.under(CoulombViscous(directional)), weights)
    return dataclasses.replace(fit, missing=missing) if missing else fit


def fit_competing(
    equation: Equation, weights: Weights, near: Float[np.ndarray, " h"] | None
) -> FrictionFit:
    """Return what `fit_carried` does, of a law that competes with others.

    An exponent is `GAUSS` unless the data ask for another one: where they do not, a free one
    follows the noise.
    """
    structure = equation.structure
    # Where one direction asks for an exponent, both do.
    if len(structure.shapes) > (1 if near is None else len(near)):
        gaussian = equation.under(Stribeck(structure.directional, GAUSS))
        fit = fit_equation(gaussian, weights, near)
        near = np.append(fit.shape, np.log(GAUSS))
        if not _not_gauss(fit, equation, weights, near) and _drop_reason(fit) is None:
            return dataclasses.replace(fit, assumed=True)
    return fit_carried(equation, weights, near)


def _not_gauss(
    fit: FrictionFit, free: Equation, weights: Weights, shape: Float[np.ndarray, " h"]
) -> bool:
    """Return whether the rows ask for another exponent than `GAUSS` (score test).

    Args:
        fit: With that exponent.
        free: Equation of the law with any exponent.
        weights: Of the rows.
        shape: Of the law with any exponent that is that of the fit.
    """
    columns = np.hstack([fit.rows.right, free.slopes(shape, fit.state)[:, -1:]])
    rows = View(free, weights, shape).rows(columns)
    # What each row adds to the next step of the exponent.
    influence = rows.left @ ridged(rows.sums[:, :-1], np.eye(columns.shape[1])[-1])
    scores = (influence * fit.error)[:, None]
    spread = score_covariance(scores, free.recording.piece)[0, 0]
    return bool(scores.sum() ** 2 > OTHER**2 * spread)


def _drop_reason(fit: FrictionFit) -> str | None:
    """Return why the data show no Stribeck drop, or None where they do."""
    structure, fixed = fit.structure, len(fit.equation.fixed_names)
    if not isinstance(structure, Stribeck):
        return None
    count, recording = len(fit.state), fit.equation.recording
    sd = np.sqrt(np.diag(fit.state_covariance))
    of_law = (values[fixed:count] for values in (fit.state, sd))
    factors, factors_sd = (values.reshape(structure.ways, -1) for values in of_law)
    velocity, speeds = float(np.exp(fit.shape[0])), recording.speed
    slowest, fastest = float(speeds.min()), float(speeds.max())
    unit = f"{recording.samples.unit}/s"
    if (factors[:, -1] <= 0).all():
        return (
            "friction does not fall from rest on: no Stribeck effect above "
            f"{slowest:.3g} {unit}, the slowest motion recorded"
        )
    if velocity > _TOO_FAST * fastest or (factors[:, 0] < 0).any():
        return (
            f"friction bends up to the highest speeds recorded ({fastest:.3g} {unit}): "
            "that is no drop from break-away, and says nothing of one"
        )
    if fit.at_bound[0] or sd[count] > _VAGUE_LOG:
        return (
            f"the recording has too little motion in the Stribeck range (slowest "
            f"{slowest:.3g} {unit}, found {velocity:.3g} {unit})"
        )
    if not (factors[:, -1] > _DROP * factors_sd[:, -1]).any():
        return "the drop from break-away to Coulomb friction is lost in the noise"
    return None
