r"""The separable fit of a law: linear factors eliminated, shapes searched, rows weighed before.

A friction law is never quite the truth: what it leaves is in good part its own error, and a
loss that looked at it would weigh speeds against each other. So the weights of the rows stay
those of `weigh`.

Variable projection: at each trial shape the linear factors follow from least squares, so the
search runs over Stribeck velocity and exponent only. Source: G. Golub, V. Pereyra, Separable
nonlinear least squares, Inverse Problems 19(2), 2003.
"""

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh
from scipy.optimize import leastsq

from ..core import FitError
from ._equation import Equation, in_line
from ._result import FrictionFit, lag_of
from ._weights import Rows, View, Weights, orthonormal, ridged, rooted

_LAST_GAIN, _LAST_STEP = 1e-7, 1e-4
"""Relative, of cost and shape at the end of a search: a hundredth of their deviations."""
_AWAY, _FIRST_STEP = 5.0, 0.1
"""MINPACK bounds its first step by a share of the unknowns: so they stay away from 0."""
_INSIDE = 0.999
"""Share of the way from the middle of the bounds to their edge where a search may begin."""
_AT_BOUND = 0.01
"""Distance to a bound, as a share of the range, that counts as none."""
_NULL = 1e-9
"""Share of the normal matrix added to it, that a smoothness prior can be compared with it."""
_WEIGHTS = np.geomspace(1e-2, 1e8, 31)
"""Of a smoothness prior, relative to 1/noise², that are tried."""


def fit_equation(
    equation: Equation, weights: Weights, near: Float[np.ndarray, " h"] | None = None
) -> FrictionFit:
    """Fit factors and shape of an equation to all of its usable rows.

    The search begins at the logarithms of a shape, where some are given.

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
    shape, converged = np.zeros(0), True
    if shapes:
        shape = weights.start(equation) if near is None else near[:shapes]
        shape, converged = _search(equation, View(equation, weights, shape), shape)
    view, columns = View(equation, weights, shape), equation.columns(shape)
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


def _search(
    equation: Equation, view: View, begin: Float[np.ndarray, " h"]
) -> tuple[Float[np.ndarray, " h"], bool]:
    """Return the logarithms of the shape that leave the least, and whether the search ended."""
    basis = orthonormal(view.root * equation.unbent)
    middle = equation.bounds.mean(axis=0)
    half = 0.5 * np.diff(equation.bounds, axis=0)[0]
    cache: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def projected(columns: np.ndarray) -> np.ndarray:
        """Return weighted rows without what columns that follow no shape explain of them."""
        weighted = view.weighted(columns)
        return np.asarray(weighted - basis @ (basis.T @ weighted))

    target = projected(equation.recording.target[:, None])[:, 0]

    def evaluated(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what is left, and its derivative with factors following (Kaufman's part)."""
        if free.tobytes() not in cache:
            cache.clear()
            place = np.tanh(free - _AWAY)
            falling = equation.falling(middle + half * place)
            falling = projected(in_line(falling)).reshape(falling.shape)
            columns = falling[:, :, 0]
            # Each direction has but one column: their inverse serves values and slopes.
            grams = np.stack([columns.T @ columns] * columns.shape[1])
            inverse = columns @ ridged(grams, np.eye(len(grams)))
            factors = target @ inverse
            slopes = np.tensordot(falling[:, :, 1:], factors, (1, 0))
            slopes = slopes * (half * (1.0 - place**2))
            slopes = columns @ (inverse.T @ slopes) - slopes
            cache[free.tobytes()] = target - columns @ factors, slopes
        return cache[free.tobytes()]

    optimum = leastsq(
        lambda free: evaluated(free)[0],
        _AWAY + np.arctanh(np.clip((begin - middle) / half, -_INSIDE, _INSIDE)),
        Dfun=lambda free: evaluated(free)[1],
        xtol=_LAST_STEP, ftol=_LAST_GAIN, factor=_FIRST_STEP, full_output=True,  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
    return middle + half * np.tanh(optimum[0] - _AWAY), optimum[-1] in (1, 2, 3, 4)


def _smoothed(
    equation: Equation, rows: Rows, share: Float[np.ndarray, " s"]
) -> tuple[float, Float[np.ndarray, " k"]]:
    """Return the weight of the smoothness prior that makes the rows most likely, and factors.

    Restricted likelihood of a linear model with Gaussian noise of unknown size; one
    eigenbasis of prior and rows together serves all weights. Residuals that resemble their
    neighbours carry less than their number says: they count as many as lie at the distance
    at which they stop doing so.
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
