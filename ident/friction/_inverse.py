r"""Friction from any motion: current = inertia · a + friction(v) + offset.

A law is never quite the truth: what it leaves is in good part its own error, and a loss that
looked at it would weigh speeds against each other. So the weights of rows stay those of `weigh`.
Variable projection: at each trial shape the linear factors follow from least squares, so the
search runs over Stribeck velocity and exponent only. Source: G. Golub, V. Pereyra, Separable
nonlinear least squares, Inverse Problems 19(2), 2003.
"""

import dataclasses
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh
from scipy.optimize import least_squares

from ..core import FitError, rooted
from ._equation import Equation, in_line
from ._result import FrictionFit, lag_of
from ._structures import GAUSS, CoulombViscous, KnotTable, Shape, Stribeck
from ._weights import Rows, View, Weights, orthonormal

_DROP = 3.0
"""Standard deviations that a drop must show to be one."""
_TOO_FAST = 0.5
"""Stribeck velocity, as a share of the highest speed, that only a bend at speed can give."""
_VAGUE_LOG = 0.7
"""Standard deviation of the logarithm of a shape (a factor of two) that says nothing."""
_ASSUMED = "the data do not tell how sharply friction falls; 2 is assumed"
_LAST_GAIN, _LAST_STEP = 1e-7, 1e-4
"""Relative, of cost and shape at the end of a search: a hundredth of their deviations."""
_AT_BOUND = 0.01
"""Share of its range at which a shape stands at its edge."""
_NULL = 1e-9
"""Share of the normal matrix added to it, that a smoothness prior can be compared with it."""
_WEIGHTS = np.geomspace(1e-2, 1e8, 31)
"""Of a smoothness prior, relative to 1/noise², that are tried."""


def fit_carried(equation: Equation, weights: Weights) -> FrictionFit:
    """Return the fit of what the data carry of a law.

    An exponent is `GAUSS` unless the data ask for another one: where they do not, a free one
    follows the noise.
    """
    structure, missing = equation.structure, dict[str, str]()
    free = len(structure.shapes) > 1
    first = Stribeck(structure.directional, GAUSS) if free else structure
    fit = fit_equation(equation.under(first), weights)
    if isinstance(structure, KnotTable) and equation.recording.factor > 1:
        # Friction that falls towards rest is what turns leave of it: no law.
        rest, slowest = fit.factors.reshape(structure.ways, -1)[:, :2].T
        held = dataclasses.replace(structure, held=bool((rest < slowest).any()))
        return dataclasses.replace(fit, equation=equation.under(held))
    fit = gaussian = dataclasses.replace(fit, assumed=free)
    if free and (_drop_reason(fit) is not None or fit.asks_for_exponent):
        fit = fit_equation(equation, weights)
        vague = np.sqrt(fit.state_covariance[-1, -1]) > _VAGUE_LOG
        if (vague or fit.at_bound[1]) and _drop_reason(fit) is None:
            missing["stribeck_shape"] = _ASSUMED
            fit = gaussian
    reason = _drop_reason(fit)
    if reason is not None:
        names = [name for name in fit.structure.names if name.startswith("drop")]
        names = [name.replace("drop", "breakaway") for name in names]
        missing |= dict.fromkeys([*names, *structure.shapes], reason)
        plain = CoulombViscous(structure.directional)
        fit = fit_equation(equation.under(plain), weights)
    return dataclasses.replace(fit, missing=missing) if missing else fit


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


def fit_equation(equation: Equation, weights: Weights) -> FrictionFit:
    """Fit factors and shape of an equation to all of its usable rows.

    Raises:
        FitError: If hardly any row is left.
    """
    structure = equation.structure
    count, shapes = int(equation.recording.usable.sum()), len(structure.shapes)
    linear = len(equation.fixed_names) + len(structure.names)
    if count <= linear + shapes:
        msg = (
            f"{count} samples in motion are left after filtering, "
            f"expected more than the {linear + shapes} parameters."
        )
        raise FitError(msg)
    shape, converged = _search(equation, weights) if shapes else (np.zeros(0), True)
    view, columns = View(equation, weights.share, shape), equation.columns(shape)
    rows, prior = view.rows(columns), equation.penalty
    if structure.parametric:
        root, _ = rooted(rows.sums[:, :-1])
        factors = root @ (root.T @ rows.sums[:, -1])
    else:
        weight, factors = _smoothed(equation, rows, weights.share)
        prior = weight * prior
    if shapes:
        rows = view.rows(np.hstack([columns, equation.slopes(shape, factors)]))
    low, high = equation.bounds
    edge = _AT_BOUND * (high - low)
    return FrictionFit(
        equation=equation,
        state=factors,
        shape=shape,
        rows=rows,
        share=weights.share,
        prior=prior,
        converged=converged,
        at_bound=(shape <= low + edge) | (shape >= high - edge),
    )


def _search(equation: Equation, weights: Weights) -> tuple[Shape, bool]:
    """Return the logarithms of the shape that leave the least, and whether the search ended."""
    begin = weights.start(equation)
    view = View(equation, weights.share, begin)
    basis = orthonormal(view.root * equation.unbent)

    def projected(columns: np.ndarray) -> np.ndarray:
        """Return weighted rows without what columns that follow no shape explain of them."""
        weighted = view.weighted(columns)
        return np.asarray(weighted - basis @ (basis.T @ weighted))

    target = projected(equation.recording.target[:, None])[:, 0]

    @lru_cache(1)
    def evaluated(*shape: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what is left, and its derivative with factors following (Kaufman's part)."""
        falling = equation.falling(np.clip(shape, *equation.bounds))
        falling = projected(in_line(falling)).reshape(falling.shape)
        columns = falling[:, :, 0]
        root = rooted(columns.T @ columns)[0]
        inverse = columns @ (root @ root.T)
        factors = target @ inverse
        slopes = np.tensordot(falling[:, :, 1:], factors, (1, 0))
        return target - columns @ factors, columns @ (inverse.T @ slopes) - slopes

    # MINPACK takes half the time of what knows limits: nothing is gained beyond them.
    optimum = least_squares(
        lambda shape: evaluated(*shape)[0],
        begin,
        lambda shape: evaluated(*shape)[1],  # pyright: ignore[reportArgumentType]
        method="lm",
        xtol=_LAST_STEP,
        ftol=_LAST_GAIN,
    )
    return np.clip(optimum.x, *equation.bounds), optimum.success


def _smoothed(
    equation: Equation, rows: Rows, share: Float[np.ndarray, " s"]
) -> tuple[float, Float[np.ndarray, " k"]]:
    """Return the weight of the smoothness prior that makes the rows most likely, and factors.

    Restricted likelihood of a linear model with Gaussian noise of unknown size, in one
    eigenbasis of prior and rows for all weights. Residuals that resemble their neighbours
    count as many as lie at the distance at which they stop doing so.
    """
    sums = rows.sums
    size = np.sqrt(np.diag(sums))
    size = np.where(size > 0, size, size.max())
    scaling = np.outer(size, size)
    precision = sums[:, :-1] / scaling + _NULL * np.eye(len(size))
    stiffness, vectors = eigh(equation.penalty / scaling, precision)
    stiffness = np.maximum(stiffness, 0.0)
    moments = vectors.T @ (sums[:, -1] / size)
    residual = rows.target - rows.right @ (vectors @ moments / size)
    lag = lag_of((np.sqrt(share) * residual)[:, None], equation.recording.piece)
    free = len(equation.fixed_names) + 2 * equation.structure.ways
    count = max(int((share > 0).sum()) // (1 + lag), len(size) + 2)
    raised = 1.0 + _WEIGHTS[:, None] * stiffness[free:]
    explained = (moments[free:] ** 2 * (1.0 - 1.0 / raised)).sum(axis=1)
    score = (count - free) * np.log(np.maximum(share @ residual**2 + explained, 1e-300))
    score += np.log(raised / _WEIGHTS[:, None]).sum(axis=1)
    weight = float(_WEIGHTS[np.argmin(score)])
    return weight, vectors @ (moments / (1.0 + weight * stiffness)) / size
