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

import dataclasses
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import eigh
from scipy.optimize import leastsq

from ...data.signals import median
from ..core import FitError
from ._equation import Equation, Weights, in_line, ridged

_NULL = 1e-9
"""Share of the largest eigenvalue of the scaled normal matrix that counts as none."""
_LAST_GAIN, _LAST_STEP = 1e-7, 1e-4
"""Relative, of cost and shape at the end of a search: a hundredth of their deviations."""
_AWAY, _FIRST_STEP = 5.0, 0.1
"""MINPACK bounds its first step by a share of the unknowns: so they stay away from 0."""
_INSIDE = 0.999
"""Share of the way from the middle of the bounds to their edge where a search may begin."""
_AT_BOUND = 0.01
"""Distance to a bound, as a share of the range, that counts as none."""
_LARGEST_LEVERAGE = 0.9
_WEIGHTS = np.geomspace(1e-2, 1e8, 31)
"""Of a smoothness prior, relative to 1/noise², that are tried."""
_LARGEST_LAG = 0.1
"""Longest lag as a share of the rows."""
_STRONGEST = 0.97
"""Autocorrelation that a first-order model is taken to have at most."""


def _rooted(
    matrix: Float[np.ndarray, "k k"],
) -> tuple[Float[np.ndarray, "k r"], Float[np.ndarray, "k z"]]:
    """Return R with R Rᵀ the inverse in directions that rows tell, and the other directions."""
    size = np.sqrt(np.diag(matrix))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    seen = values > _NULL * max(float(values[-1]), np.finfo(float).tiny)
    root = vectors[:, seen] / np.sqrt(values[seen]) / size[:, None]
    return root, vectors[:, ~seen] / size[:, None]


def _basis(columns: Float[np.ndarray, "s c"]) -> Float[np.ndarray, "s b"]:
    """Return an orthonormal basis of columns."""
    return np.asarray(columns @ _rooted(columns.T @ columns)[0])


@final
class View:
    """How the rows of an equation are seen: weighted, and through a noise-free motion."""

    def __init__(
        self,
        equation: Equation,
        share: Float[np.ndarray, " s"],
        shape: Float[np.ndarray, " h"],
    ) -> None:
        self.root = np.sqrt(share)[:, None]
        self._basis = None
        fine = equation.noise_free
        if fine is not None:
            design, slopes = fine.columns(shape)
            self._basis = _basis(self.root * np.hstack([design, in_line(slopes)]))

    def seen(self, rows: Float[np.ndarray, "s c"]) -> Float[np.ndarray, "s c"]:
        """Return weighted rows as they are seen."""
        return rows if self._basis is None else self._basis @ (self._basis.T @ rows)

    def rows(self, *columns: np.ndarray) -> "Rows":
        """Return weighted rows of columns and, as the last of them, the target."""
        weighted = self.root * np.column_stack(columns)
        return Rows(self.seen(weighted[:, :-1]), weighted)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """Weighted rows of an equation.

    Attributes:
        left: Columns as they are seen.
        right: Columns and target.
    """

    left: Float[np.ndarray, "s k"]
    right: Float[np.ndarray, "s k1"]

    @cached_property
    def sums(self) -> Float[np.ndarray, "k k1"]:
        """The sums XᵀW [X, target]."""
        return np.asarray(self.left.T @ self.right)


@dataclasses.dataclass(frozen=True)
class Solution:
    """Where a fit ended.

    Attributes:
        factors: Linear factors, those beside friction first.
        shape: Logarithms of the non-linear parameters.
        columns: Derivatives of the load per row by factors and shape.
        rows: The same, weighted.
        prior: Precision of the factors by smoothness, relative to 1/noise².
        null: Directions of the factors that no row tells, as columns.
        residual: Load − fit per row, in load units.
        share: Weight that each row had, 0 to 1.
        piece: Stretch of even time steps of each row.
        scale: Robust standard deviation of the residuals.
        converged: Whether the search for the shape ended.
        at_bound: Which shapes ended at the edge of what the data could tell.
        given: The covariance, where it is not that of the rows.
    """

    factors: Float[np.ndarray, " k"]
    shape: Float[np.ndarray, " h"]
    columns: Float[np.ndarray, "s p"]
    rows: Rows
    prior: Float[np.ndarray, "k k"]
    null: Float[np.ndarray, "k z"]
    residual: Float[np.ndarray, " s"]
    share: Float[np.ndarray, " s"]
    piece: Int[np.ndarray, " s"]
    scale: float
    converged: bool
    at_bound: Bool[np.ndarray, " h"]
    given: Float[np.ndarray, "p p"] | None = None

    @cached_property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Of factors and shape together, directions without information left out.

        Neighbouring rows resemble each other (`score_covariance`). Residuals are divided by
        1 − leverage (HC3), which makes few rows at the edge count as few. Source:
        J. G. MacKinnon, H. White, J. Econometrics 29, 1985. A robust variance is itself
        uncertain, and errs more often downwards: where it claims to know more than
        independent noise would allow, it is not believed.
        """
        if self.given is not None:
            return self.given
        columns, left = self.rows.left, np.sqrt(self.share) * self.residual
        prior = np.pad(self.prior, (0, len(self.shape)))
        even = columns.T @ columns
        root, _ = _rooted(even + prior)
        inverse = root @ root.T
        leverage = np.square(columns @ root).sum(axis=1)
        push = left / np.clip(1.0 - leverage, 1.0 - _LARGEST_LEVERAGE, 1.0)
        count = int(np.count_nonzero(left))
        noise = float(push @ push) / max(count - len(inverse), 1)
        known = self.scale**2 * prior
        inner = score_covariance(columns * push[:, None], self.piece)[0]
        robust = inverse @ (inner + known) @ inverse
        plain = inverse @ (noise * even + known) @ inverse
        have, least = np.diag(robust), np.diag(plain)
        factor = np.sqrt(np.maximum(least / np.where(have > 0, have, np.inf), 1.0))
        return np.asarray(robust * np.outer(factor, factor))


def fit_equation(
    equation: Equation,
    weights: Weights,
    near: Float[np.ndarray, " h"] | None = None,
    *,
    held: bool = False,
) -> Solution:
    """Fit factors and shape of an equation to all of its usable rows.

    Args:
        equation: The equation.
        weights: Of its rows.
        near: Logarithms of a shape to begin with.
        held: The shape stays there, and the factors alone are fitted.

    Raises:
        FitError: If hardly any row is left.
    """
    structure, share = equation.structure, weights.share
    count = int(equation.usable.sum())
    fixed, shapes = len(equation.fixed_names), len(structure.shapes)
    parameters = fixed + len(structure.names) + shapes
    if count <= parameters:
        msg = (
            f"{count} samples in motion are left after filtering, "
            f"expected more than the {parameters} parameters."
        )
        raise FitError(msg)
    shape, converged = np.zeros(0), True
    if shapes:
        shape = weights.start(equation) if near is None else near[:shapes]
        if not held:
            shape, converged = _search(equation, View(equation, share, shape), shape)
    view, (design, slopes) = View(equation, share, shape), equation.columns(shape)
    rows = view.rows(design, equation.target)
    normal = rows.sums
    prior = np.zeros_like(normal[:, :-1])
    if not structure.parametric:
        prior = _smoothness(equation, design, share, normal) * equation.penalty
    root, null = _rooted(normal[:, :-1] + prior)
    factors = root @ (root.T @ normal[:, -1])
    residual = equation.target - design @ factors
    typical = median(np.abs(residual[equation.usable]))
    # 1.4826 makes the median of magnitudes the standard deviation of Gaussian noise.
    scale = 1.4826 * typical * float(np.sqrt(count / (count - parameters)))
    columns = design
    if shapes:
        columns = np.hstack([design, equation.tangents(slopes, factors)])
        rows = view.rows(columns, equation.target)
    low, high = structure.bounds(equation.speed_range)
    edge = _AT_BOUND * (high - low)
    return Solution(
        factors=factors,
        shape=shape,
        columns=columns,
        rows=rows,
        prior=prior,
        null=null,
        residual=residual,
        share=share,
        piece=equation.piece,
        scale=scale,
        converged=converged,
        at_bound=(shape <= low + edge) | (shape >= high - edge),
    )


def _search(
    equation: Equation, view: View, begin: Float[np.ndarray, " h"]
) -> tuple[Float[np.ndarray, " h"], bool]:
    """Return the logarithms of the shape that leave the least, and whether the search ended."""
    steady = np.hstack([equation.beside, in_line(equation.steady)])
    basis = _basis(view.root * steady)
    bounds = equation.structure.bounds(equation.speed_range)
    middle, half = bounds.mean(axis=0), 0.5 * (bounds[1] - bounds[0])
    kept: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def apart(columns: Float[np.ndarray, "s c"]) -> Float[np.ndarray, "s c"]:
        """Return weighted rows without what columns that follow no shape explain of them."""
        seen = view.seen(view.root * columns)
        return np.asarray(seen - basis @ (basis.T @ seen))

    target = apart(equation.target[:, None])[:, 0]

    def at(free: Float[np.ndarray, " h"]) -> tuple[np.ndarray, np.ndarray]:
        """Return what is left, and its derivative with factors following (Kaufman's part)."""
        if free.tobytes() not in kept:
            kept.clear()
            inside = np.tanh(free - _AWAY)
            own = equation.falling(middle + half * inside)
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
        _AWAY + np.arctanh(np.clip((begin - middle) / half, -_INSIDE, _INSIDE)),
        Dfun=lambda free: at(free)[1],
        xtol=_LAST_STEP, ftol=_LAST_GAIN, factor=_FIRST_STEP, full_output=True,  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
    return middle + half * np.tanh(found[0] - _AWAY), found[-1] in (1, 2, 3, 4)


def _smoothness(
    equation: Equation,
    design: Float[np.ndarray, "s k"],
    share: Float[np.ndarray, " s"],
    sums: Float[np.ndarray, "k k1"],
) -> float:
    """Return the weight of the smoothness prior that makes the rows most likely.

    Restricted likelihood of a linear model with Gaussian noise of unknown size; one
    eigenbasis of prior and rows together serves all weights. Residuals that resemble their
    neighbours carry less than their number says: they count as many as lie at the distance
    at which they stop doing so.

    Args:
        equation: Of a law with a prior.
        design: Its columns.
        share: Weight of each row.
        sums: XᵀW [X, target].
    """
    size = np.sqrt(np.diag(sums))
    size = np.where(size > 0, size, size.max())
    area = np.outer(size, size)
    stiffness, vectors = eigh(
        equation.penalty / area, sums[:, :-1] / area + _NULL * np.eye(len(size))
    )
    along = vectors.T @ (sums[:, -1] / size)
    left = equation.target - design @ (vectors @ along / size)
    lag = lag_of((np.sqrt(share) * left)[:, None], equation.piece)
    flats = len(equation.fixed_names) + 2 * equation.structure.ways
    count = max(int((share > 0).sum()) // (1 + lag), len(size) + 2)
    raised = 1.0 + _WEIGHTS[:, None] * np.maximum(stiffness[flats:], 0.0)
    gone = (along[flats:] ** 2 * (1.0 - 1.0 / raised)).sum(axis=1)
    score = (count - flats) * np.log(np.maximum(share @ left**2 + gone, 1e-300))
    score += np.log(raised / _WEIGHTS[:, None]).sum(axis=1)
    return float(_WEIGHTS[np.argmin(score)])


def lag_of(scores: Float[np.ndarray, "t k"], piece: Int[np.ndarray, " t"]) -> int:
    """Return over how many rows scores resemble each other (Andrews' rule, Bartlett weights).

    Source: D. W. K. Andrews, Heteroskedasticity and autocorrelation consistent covariance
    matrix estimation, Econometrica 59(3), 1991.

    Args:
        scores: Per row, in order; rows left out have zeros.
        piece: Stretch of even time steps; no lag reaches from one to the next.
    """
    same = piece[1:] == piece[:-1]
    size = np.square(scores).sum(axis=0)
    beside = (scores[1:] * scores[:-1] * same[:, None]).sum(axis=0)
    used = size > 0
    rho = np.clip(beside / np.where(used, size, 1.0), 0.0, _STRONGEST)
    far = used / (1 - rho) ** 4
    alpha = (4 * rho**2 / ((1 - rho) ** 2 * (1 + rho) ** 2) * far).sum()
    alpha /= max(float(far.sum()), 1.0)
    best = 1.1447 * (alpha * len(scores)) ** (1 / 3)
    return int(min(best, _LARGEST_LAG * len(scores)))


def score_covariance(
    scores: Float[np.ndarray, "t k"], piece: Int[np.ndarray, " t"]
) -> tuple[Float[np.ndarray, "k k"], int]:
    """Return the covariance of the sum of scores, and the lag up to which it looks.

    Arguments as of `lag_of`.
    """
    lag = lag_of(scores, piece)
    # Bartlett's weights are what sums over a sliding window give. Pieces are set apart by
    # as many empty rows as the window is long.
    edges = np.flatnonzero(np.diff(piece)) + 1
    gap = np.zeros((lag + 1, scores.shape[1]))
    parts = [each for part in np.split(scores, edges) for each in (part, gap)]
    total = np.cumsum(np.concatenate([gap, *parts]), axis=0)
    window = total[lag + 1 :] - total[: -lag - 1]
    return window.T @ window / (lag + 1), lag
