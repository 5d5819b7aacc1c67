r"""The separable fit of a law: linear factors eliminated, shapes searched, rows weighed before.

A friction law is never quite the truth: what it leaves is in good part its own error, and a
loss that looked at it would weigh speeds against each other. So the weights of the rows stay
those of `weigh`.

Variable projection: at each trial shape the linear factors follow from least squares, so the
search runs over Stribeck velocity and exponent only. Source: G. Golub, V. Pereyra, Separable
nonlinear least squares, Inverse Problems 19(2), 2003. Where a noise-free motion stands beside
the measured one, rows are seen through its columns (two-stage least squares), which keeps the
fit consistent under noise in velocity and acceleration.
"""

from typing import final

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh
from scipy.optimize import leastsq

from ..core import FitError
from ._equation import Equation, Weights, in_line, ridged
from ._result import FrictionFit, Rows, lag_of, rooted

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


def _basis(columns: Float[np.ndarray, "s c"]) -> Float[np.ndarray, "s b"]:
    """Return an orthonormal basis of columns."""
    return np.asarray(columns @ rooted(columns.T @ columns)[0])


@final
class View:
    """How the rows of an equation are seen: weighted, and through a noise-free motion."""

    def __init__(
        self,
        equation: Equation,
        share: Float[np.ndarray, " s"],
        shape: Float[np.ndarray, " h"],
    ) -> None:
        self.share = share[:, None]
        self.root = np.sqrt(self.share)
        self._basis = None
        fine = equation.recording.noise_free
        if fine is not None:
            rows = Equation(fine, equation.structure).rows(shape)
            self._basis = _basis(self.root * rows[:, :-1])

    def seen(self, columns: Float[np.ndarray, "s c"]) -> Float[np.ndarray, "s c"]:
        """Return columns, times the roots of the weights, as they are seen."""
        weighted = self.root * columns
        if self._basis is None:
            return np.asarray(weighted)
        return np.asarray(self._basis @ (self._basis.T @ weighted))

    def rows(self, right: Float[np.ndarray, "s c"]) -> Rows:
        """Return weighted rows of columns and, as the last of them, the target."""
        columns = right[:, :-1]
        if self._basis is None:
            return Rows(self.share * columns, right)
        return Rows(self.root * self.seen(columns), right)


def fit_equation(
    equation: Equation,
    weights: Weights,
    near: Float[np.ndarray, " h"] | None = None,
    *,
    searched: int = 2,
) -> FrictionFit:
    """Fit factors and shape of an equation to all of its usable rows.

    Args:
        equation: The equation.
        weights: Of its rows.
        near: Logarithms of a shape to begin with.
        searched: How many of the non-linear parameters, from the first on; others stay.

    Raises:
        FitError: If hardly any row is left.
    """
    structure, share = equation.structure, weights.share
    count = int(equation.recording.usable.sum())
    linear, shapes = (
        len(equation.fixed_names) + len(structure.names),
        len(structure.shapes),
    )
    if count <= linear + shapes:
        msg = (
            f"{count} samples in motion are left after filtering, "
            f"expected more than the {linear + shapes} parameters."
        )
        raise FitError(msg)
    shape, converged = np.zeros(0), True
    if shapes:
        shape = weights.start(equation) if near is None else near[:shapes]
        view = View(equation, share, shape)
        shape, converged = _search(equation, view, searched, shape)
    rows = View(equation, share, shape).rows(equation.rows(shape))
    normal, moment = rows.sums[:linear, :linear], rows.sums[:linear, -1]
    prior = np.zeros_like(normal)
    if not structure.parametric:
        prior = _smoothness(equation, rows, share) * equation.penalty
    root, _ = rooted(normal + prior)
    factors = root @ (root.T @ moment)
    low, high = equation.bounds
    edge = _AT_BOUND * (high - low)
    return FrictionFit(
        equation=equation,
        state=factors,
        shape=shape,
        rows=rows.along(equation.tangent(factors)) if shapes else rows,
        share=share,
        prior=prior,
        converged=converged,
        at_bound=(shape <= low + edge) | (shape >= high - edge),
    )


def _search(
    equation: Equation, view: View, searched: int, begin: Float[np.ndarray, " h"]
) -> tuple[Float[np.ndarray, " h"], bool]:
    """Return the logarithms of the shape that leave the least, and whether the search ended.

    Searched are the first of them; the others stay where they begin.
    """
    basis = _basis(view.root * equation.unbent)
    held, bounds = begin[searched:], equation.bounds[:, :searched]
    middle, half = bounds.mean(axis=0), 0.5 * (bounds[1] - bounds[0])
    kept: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def apart(columns: np.ndarray) -> np.ndarray:
        """Return weighted rows without what columns that follow no shape explain of them."""
        seen = view.seen(columns)
        return np.asarray(seen - basis @ (basis.T @ seen))

    target = apart(equation.recording.target[:, None])[:, 0]

    def at(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what is left, and its derivative with factors following (Kaufman's part)."""
        if free.tobytes() not in kept:
            kept.clear()
            inside = np.tanh(free - _AWAY)
            own = equation.falling(np.append(middle + half * inside, held))
            own = own[:, :, : 1 + len(free)]
            own = apart(in_line(own)).reshape(own.shape)
            columns = own[:, :, 0]
            gram = columns.T @ columns
            factors = ridged(gram, columns.T @ target)
            slopes = np.tensordot(own[:, :, 1:], factors, (1, 0))
            slopes = slopes * (half * (1.0 - inside**2))
            every = np.stack([gram] * slopes.shape[1])
            slopes = columns @ ridged(every, slopes.T @ columns).T - slopes
            kept[free.tobytes()] = target - columns @ factors, slopes
        return kept[free.tobytes()]

    found = leastsq(
        lambda free: at(free)[0],
        _AWAY + np.arctanh(np.clip((begin[:searched] - middle) / half, -_INSIDE, _INSIDE)),
        Dfun=lambda free: at(free)[1],
        xtol=_LAST_STEP, ftol=_LAST_GAIN, factor=_FIRST_STEP, full_output=True,  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
    shape = np.append(middle + half * np.tanh(found[0] - _AWAY), held)
    return shape, found[-1] in (1, 2, 3, 4)


def _smoothness(
    equation: Equation, rows: Rows, share: Float[np.ndarray, " s"]
) -> float:
    """Return the weight of the smoothness prior that makes the rows most likely.

    Restricted likelihood of a linear model with Gaussian noise of unknown size; one
    eigenbasis of prior and rows together serves all weights. Residuals that resemble their
    neighbours carry less than their number says: they count as many as lie at the distance
    at which they stop doing so.

    Args:
        equation: Of a law with a prior.
        rows: Its rows.
        share: Weight of each row.
    """
    sums, (design, target) = rows.sums, np.split(rows.right, [-1], axis=1)
    size = np.sqrt(np.diag(sums))
    size = np.where(size > 0, size, size.max())
    area = np.outer(size, size)
    stiffness, vectors = eigh(
        equation.penalty / area, sums[:, :-1] / area + _NULL * np.eye(len(size))
    )
    along = vectors.T @ (sums[:, -1] / size)
    left = target[:, 0] - design @ (vectors @ along / size)
    lag = lag_of((np.sqrt(share) * left)[:, None], equation.recording.piece)
    flats = len(equation.fixed_names) + 2 * equation.structure.ways
    count = max(int((share > 0).sum()) // (1 + lag), len(size) + 2)
    raised = 1.0 + _WEIGHTS[:, None] * np.maximum(stiffness[flats:], 0.0)
    gone = (along[flats:] ** 2 * (1.0 - 1.0 / raised)).sum(axis=1)
    score = (count - flats) * np.log(np.maximum(share @ left**2 + gone, 1e-300))
    score += np.log(raised / _WEIGHTS[:, None]).sum(axis=1)
    return float(_WEIGHTS[np.argmin(score)])
