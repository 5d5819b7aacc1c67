r"""The robust separable fit: linear factors eliminated, shapes searched, rows reweighted.

Variable projection: at each trial shape the linear factors follow from least squares, so the
search runs over Stribeck velocity and exponent only, from the best of a grid. Source: G. Golub,
V. Pereyra, Separable nonlinear least squares, Inverse Problems 19(2), 2003.

A friction law is never quite the truth: what it leaves is in good part its own error, and a
loss that bends away from least squares within a few scales would weigh speeds against each
other. So the usual loss, ``"trim"``, counts rows in full up to four scales and not at all from
eight on.
"""

import dataclasses
from collections.abc import Callable
from typing import final

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import leastsq

from ...data.signals import median
from ..core import FitError, Loss, choose_loss
from ._covariance import larger_covariance, score_covariance
from ._equation import Equation
from ._smoothing import choose_smoothness
from ._structures import KNOTS, KnotTable

LOSSES = ("trim", "student", "huber", "gauss")
_FULL, _NONE = 4.0, 8.0
"""Residuals in scales up to which a row counts in full, and from which on it does not."""
_FLOOR = 1e-9
"""Smallest scale of residuals relative to the load."""
_FREE_PASSES, _HUBER_PASSES = 8, 2
_CHANGE = 0.01
"""Change of a weight that is none, where only a beginning is sought."""
_PASSES, _FREEZE = 60, 20
"""Passes at most, and the one from which on the scale stays: nothing may go in circles."""
_SETTLED = 1e-3
"""Largest change of a row's residual in one pass, in scales, at the end."""
_NULL = 1e-9
"""Share of the largest eigenvalue of the scaled normal matrix that counts as none."""
_RIDGE = 1e-12
"""Added to the Gram matrix of columns that follow the shape, as a share of its trace."""
_START_ROWS = 256
"""Rows that tell where a search begins, at most."""
_TOLERANCE = 1e-8
"""Of cost and shape at the end of a search."""
_AWAY, _FIRST_STEP = 5.0, 0.1
"""MINPACK bounds its first step by a share of the unknowns: so they stay away from 0."""
_LARGEST_LEVERAGE = 0.9
_INSIDE = 0.999
"""Share of the way from the middle of the bounds to their edge where a search may begin."""
_AT_BOUND = 0.01
"""Distance to a bound, as a share of the range, that counts as none."""


@final
@dataclasses.dataclass(frozen=True)
class TrimLoss:
    """Least squares within four scales, nothing beyond eight, a straight line between.

    Its methods are those of `axcomp.ident.core.Loss`.

    Attributes:
        scale: Of the residuals.
    """

    scale: float

    def share(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """See `axcomp.ident.core.Loss`."""
        return np.asarray(np.clip((_NONE - np.abs(ratio)) / (_NONE - _FULL), 0.0, 1.0))

    def slope(self, ratio: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """See `axcomp.ident.core.Loss`."""
        size = np.abs(ratio)
        taper = np.where(size < _NONE, (_NONE - 2.0 * size) / (_NONE - _FULL), 0.0)
        return np.where(size <= _FULL, 1.0, taper)

    def wild(self, ratio: Float[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
        """See `axcomp.ident.core.Loss`."""
        return np.asarray(np.abs(ratio) >= _NONE)


@dataclasses.dataclass(frozen=True)
class Linear:
    """A solution of normal equations.

    Attributes:
        factors: Of the columns; of least norm where no row tells them.
        inverse: Of the normal matrix, in the directions that rows tell.
        null: Directions of the factors that no row tells, as columns.
    """

    factors: Float[np.ndarray, " k"]
    inverse: Float[np.ndarray, "k k"]
    null: Float[np.ndarray, "k z"]


@dataclasses.dataclass(frozen=True)
class Solution:
    """Where a fit ended.

    Attributes:
        factors: Linear factors, those beside friction first.
        shape: Logarithms of the non-linear parameters.
        covariance: Of factors and shape together, directions without information left out.
        null: Directions of the factors that no row tells, as columns.
        column_size: RMS of each column over the rows used, factors before tangents.
        residual: Load − fit per row, in load units.
        share: Weight that each row had, 0 to 1.
        scale: Robust standard deviation of the residuals.
        lag: Rows up to which the covariance looked.
        passes: How many were made.
        converged: Whether the last one changed nothing.
        at_bound: Which shapes ended at the edge of what the data could tell.
        smoothness: Weight of the prior relative to 1/noise²; 0 without one.
    """

    factors: Float[np.ndarray, " k"]
    shape: Float[np.ndarray, " h"]
    covariance: Float[np.ndarray, "p p"]
    null: Float[np.ndarray, "k z"]
    column_size: Float[np.ndarray, " p"]
    residual: Float[np.ndarray, " s"]
    share: Float[np.ndarray, " s"]
    scale: float
    lag: int
    passes: int
    converged: bool
    at_bound: Bool[np.ndarray, " h"]
    smoothness: float


def solve_normal(
    gram: Float[np.ndarray, "k k"],
    moment: Float[np.ndarray, " k"],
    mixed: Float[np.ndarray, "k k"] | None = None,
) -> Linear:
    """Return the factors β of M β = m, of least norm in directions without information.

    Args:
        gram: XᵀWX + P, which tells those directions.
        moment: m.
        mixed: M where it is another matrix (instruments).
    """
    size = np.sqrt(np.diag(gram))
    size = np.where(size > 0, size, 1.0)
    area = np.outer(size, size)
    values, vectors = np.linalg.eigh(gram / area)
    seen = values > _NULL * max(float(values[-1]), np.finfo(float).tiny)
    basis = vectors[:, seen]
    if mixed is None:
        inverse = (basis / values[seen]) @ basis.T
    else:
        inverse = basis @ np.linalg.solve(basis.T @ (mixed / area) @ basis, basis.T)
    inverse = inverse / area
    return Linear(inverse @ moment, inverse, vectors[:, ~seen] / size[:, None])


def fit_equation(
    equation: Equation,
    loss: str,
    smoothness: float | None = None,
    begin: Float[np.ndarray, " s"] | None = None,
    near: Float[np.ndarray, " h"] | None = None,
) -> Solution:
    """Fit factors and shapes of an equation to all of its usable rows.

    Args:
        equation: The equation.
        loss: One of `LOSSES`.
        smoothness: Weight of the prior of a table; by evidence where left out.
        begin: Weights to begin with, from `free_weights`.
        near: Logarithms of a shape to begin with.

    Raises:
        FitError: If hardly any row is left, or the loss is unknown.
    """
    share = free_weights(equation, loss) if begin is None else begin
    count = int(equation.usable.sum())
    parameters = len(equation.fixed_names) + len(equation.structure.names)
    parameters += len(equation.structure.shapes)
    if count <= parameters:
        msg = (
            f"{count} samples in motion are left after filtering, "
            f"expected more than the {parameters} parameters."
        )
        raise FitError(msg)
    weight = 0.0
    if equation.penalty is not None:
        weight = (
            choose_smoothness(equation, share) if smoothness is None else smoothness
        )
    kept, before, settled, step = None, None, False, 0
    shape = search_shape(equation, share, near)
    while True:
        shape = search_shape(equation, share, shape) if step else shape
        linear = solve(equation, share, shape, weight)
        residual = equation.target - equation.design(shape) @ linear.factors
        last = share
        share, found = reweigh(equation, residual, loss, kept)
        kept = found if step >= _FREEZE else None
        moved = np.inf if before is None else np.abs(residual - before)[share > 0].max()
        settled = np.array_equal(share, last) or moved <= _SETTLED * found.scale
        step += 1
        if settled or step == _PASSES:
            break
        before = residual
    covariance, lag, sizes = _uncertainty(
        equation, residual, share, found, shape, linear.factors, weight
    )
    low, high = equation.structure.bounds(equation.speed_range)
    edge = _AT_BOUND * (high - low)
    return Solution(
        factors=linear.factors,
        shape=shape,
        covariance=covariance,
        null=linear.null,
        column_size=sizes,
        residual=residual,
        share=share,
        scale=found.scale,
        lag=lag,
        passes=step,
        converged=bool(settled),
        at_bound=(shape <= low + edge) | (shape >= high - edge),
        smoothness=weight,
    )


def free_weights(equation: Equation, loss: str) -> Float[np.ndarray, " s"]:
    """Return weights of the rows under a table per direction that can bend anywhere.

    What is wild under a free table is wild under any law, whatever shape is tried.

    Raises:
        FitError: If the loss is unknown.
    """
    if loss not in LOSSES:
        words = ", ".join(repr(each) for each in LOSSES)
        msg = f"loss: found {loss!r}, expected one of {words}."
        raise FitError(msg)
    share = equation.usable * 1.0
    free = equation.with_structure(KnotTable(True, equation.knots(KNOTS)))
    design = free.design(np.zeros(0))
    if loss == "gauss" or share.sum() <= design.shape[1]:
        return share
    right = np.column_stack([design, free.target])
    every = (share[:, None] * design).T @ right
    for step in range(_FREE_PASSES):
        less = np.flatnonzero(share < equation.usable)
        lower = (1.0 - share[less, None]) * design[less]
        sums = every - lower.T @ right[less]
        linear = solve_normal(sums[:, :-1], sums[:, -1])
        residual = free.target - design @ linear.factors
        last = share
        share, _ = reweigh(free, residual, loss)
        if np.array_equal(share, equation.usable * 1.0):
            break  # nothing is wild under least squares
        if step < _HUBER_PASSES:
            # Where something is, a loss that no row can pull far comes first.
            share, _ = reweigh(free, residual, "huber")
        elif np.abs(share - last).max() <= _CHANGE:
            break
    return share


def reweigh(
    equation: Equation,
    residual: Float[np.ndarray, " s"],
    name: str,
    kept: Loss | TrimLoss | None = None,
) -> tuple[Float[np.ndarray, " s"], Loss | TrimLoss]:
    """Return how much each row counts by what is left of it, and the loss that says so.

    Args:
        equation: The equation.
        residual: Load − fit per row.
        name: Of the loss.
        kept: A loss whose scale stays as it is.
    """
    used = equation.usable
    count = int(used.sum())
    parameters = len(equation.fixed_names) + len(equation.structure.names)
    inflation = float(np.sqrt(count / max(count - parameters, 0.05 * count)))
    floor = max(_FLOOR * float(np.sqrt(np.mean(equation.load[used] ** 2))), 1e-300)
    loss: Loss | TrimLoss
    if kept is not None:
        loss = kept
    elif name == "trim":
        # 1.4826 makes the median of magnitudes the standard deviation of Gaussian noise.
        scale = 1.4826 * median(np.abs(residual[used])) * inflation
        loss = TrimLoss(max(scale, floor))
    else:
        loss = choose_loss(name, residual[used], inflation, floor)
    return np.where(used, loss.share(residual / loss.scale), 0.0), loss


def solve(
    equation: Equation,
    share: Float[np.ndarray, " s"],
    shape: Float[np.ndarray, " h"],
    smoothness: float = 0.0,
) -> Linear:
    """Return the linear factors at weights and shape, by instruments where there are some."""
    design = equation.design(shape)
    weighted = share[:, None] * design
    prior = prior_of(equation, smoothness)
    gram = weighted.T @ design + prior
    if not equation.has_instrument:
        return solve_normal(gram, weighted.T @ equation.target)
    twin = share[:, None] * equation.design(shape, instrument=True)
    return solve_normal(gram, twin.T @ equation.target, twin.T @ design + prior)


def prior_of(equation: Equation, smoothness: float) -> Float[np.ndarray, "k k"]:
    """Return the precision matrix of the smoothness prior relative to 1/noise²."""
    if equation.penalty is None:
        many = len(equation.fixed_names) + len(equation.structure.names)
        return np.zeros((many, many))
    return np.asarray(smoothness * (equation.penalty.T @ equation.penalty))


def search_shape(
    equation: Equation,
    share: Float[np.ndarray, " s"],
    near: Float[np.ndarray, " h"] | None = None,
) -> Float[np.ndarray, " h"]:
    """Return the logarithms of the shape that leave the least of the weighted rows.

    Args:
        equation: The equation.
        share: Weight of each row.
        near: Where to begin; the best of the structure's starts if left out.
    """
    structure = equation.structure
    if not structure.shapes:
        return np.zeros(0)
    projection = _Projection(equation, share)
    bounds = structure.bounds(equation.speed_range)
    begin = projection.best_start() if near is None else near
    found = _least(projection.residual, projection.jacobian, begin, bounds)
    if equation.has_instrument:
        moments = _Moments(equation, share)
        found = _least(moments.residual, moments.jacobian, found, bounds)
    return found


def _least(
    residual: Callable[[Float[np.ndarray, " h"]], Float[np.ndarray, " m"]],
    jacobian: Callable[[Float[np.ndarray, " h"]], Float[np.ndarray, "m h"]],
    begin: Float[np.ndarray, " h"],
    bounds: Float[np.ndarray, "2 h"],
) -> Float[np.ndarray, " h"]:
    """Return the shape of least squares within bounds, by Levenberg and Marquardt's method."""
    middle, half = bounds.mean(axis=0), 0.5 * (bounds[1] - bounds[0])

    def natural(free: np.ndarray) -> np.ndarray:
        return np.asarray(middle + half * np.tanh(free - _AWAY))

    found = leastsq(
        lambda free: residual(natural(free)),
        _AWAY + np.arctanh(np.clip((begin - middle) / half, -_INSIDE, _INSIDE)),
        Dfun=lambda free: jacobian(natural(free)) * (half * (1.0 - np.tanh(free - _AWAY) ** 2)),
        xtol=_TOLERANCE, ftol=_TOLERANCE, factor=_FIRST_STEP, full_output=True,  # pyright: ignore[reportArgumentType]
    )  # fmt: skip
    return natural(found[0])


class _Projection:
    """Rows without what the columns that follow no shape explain of them."""

    def __init__(self, equation: Equation, share: Float[np.ndarray, " s"]) -> None:
        self._equation = equation
        self._rows = np.flatnonzero(share > 0)
        self._root = np.sqrt(share[self._rows])[:, None]
        structure = equation.structure
        width, fixed = len(structure.factors), len(equation.fixed_names)
        self._moving = fixed + width * np.arange(1, structure.ways + 1) - 1
        _, start = structure.bounds(equation.speed_range)
        still = np.delete(equation.design(start), self._moving, axis=1)
        still = self._root * still[self._rows]
        size = np.linalg.norm(still, axis=0)
        still = still / np.where(size > 0, size, 1.0)
        values, vectors = np.linalg.eigh(still.T @ still)
        seen = values > _NULL * max(float(values[-1]), np.finfo(float).tiny)
        self._basis = still @ (vectors[:, seen] / np.sqrt(values[seen]))
        target = equation.target[self._rows, None] * self._root
        self._target = self._apart(target)[:, 0]
        self._last: tuple[bytes, tuple[np.ndarray, ...]] | None = None

    def _apart(self, columns: Float[np.ndarray, "s c"]) -> Float[np.ndarray, "s c"]:
        return np.asarray(columns - self._basis @ (self._basis.T @ columns))

    def best_start(self) -> Float[np.ndarray, " h"]:
        """Return the start that explains most, on some of the rows, filtered by nothing."""
        equation, step = self._equation, -(-len(self._rows) // _START_ROWS)
        structure = equation.structure
        rows = self._rows[::step]
        velocity = equation.samples.velocity[equation.lowpass.centres[rows]]
        signs = self._root[::step, 0] * structure.signs(velocity)
        basis = self._basis[::step] * np.sqrt(step)
        starts = structure.starts(equation.speed_range)
        speed = np.abs(velocity)
        columns = structure.last(speed, starts)[:, :, None] * signs.T
        columns = columns - basis @ (basis.T @ columns)
        moment = np.einsum("nsw,s->nw", columns, self._target[::step])
        gram = np.swapaxes(columns, 1, 2) @ columns
        inverse = np.linalg.pinv(gram, rcond=1e-9, hermitian=True)
        gain = np.einsum("nw,nwv,nv->n", moment, inverse, moment)
        return np.asarray(starts[np.argmax(gain)])

    def _at(self, shape: Float[np.ndarray, " h"]) -> tuple[np.ndarray, ...]:
        """Return the columns that follow the shape, (XᵀX)⁻¹, factors, and what is left."""
        key = shape.tobytes()
        if self._last is None or self._last[0] != key:
            columns = self._equation.last_columns(shape)[self._rows]
            columns = self._apart(self._root * columns)
            gram = columns.T @ columns
            ridge = _RIDGE * np.trace(gram) + np.finfo(float).tiny
            inverse = np.linalg.inv(gram + ridge * np.eye(len(gram)))
            factors = inverse @ (columns.T @ self._target)
            residual = self._target - columns @ factors
            self._last = key, (columns, inverse, factors, residual)
        return self._last[1]

    def residual(self, shape: Float[np.ndarray, " h"]) -> Float[np.ndarray, " s"]:
        """Return what is left of the weighted rows."""
        return self._at(shape)[3]

    def jacobian(self, shape: Float[np.ndarray, " h"]) -> Float[np.ndarray, "s h"]:
        """Return its derivative, the factors following (Kaufman's part of it)."""
        columns, inverse, factors, _ = self._at(shape)
        equation = self._equation
        full = np.zeros(len(equation.fixed_names) + len(equation.structure.names))
        full[self._moving] = factors
        tangents = self._root * equation.tangents(shape, full)[self._rows]
        tangents = self._apart(tangents)
        return np.asarray(columns @ (inverse @ (columns.T @ tangents)) - tangents)


class _Moments:
    """Tangents of the noise-free motion times residuals: none is left at the solution."""

    def __init__(self, equation: Equation, share: Float[np.ndarray, " s"]) -> None:
        self._equation, self._share = equation, share

    def _tangents(
        self, shape: Float[np.ndarray, " h"]
    ) -> tuple[Linear, Float[np.ndarray, "s h"]]:
        """Return the factors, and weighted tangents of the noise-free motion."""
        equation, share = self._equation, self._share
        linear = solve(equation, share, shape)
        tangents = equation.tangents(shape, linear.factors, instrument=True)
        return linear, share[:, None] * tangents

    def residual(self, shape: Float[np.ndarray, " h"]) -> Float[np.ndarray, " h"]:
        """Return the moments, in units of the sum of squares of the load."""
        equation = self._equation
        linear, tangents = self._tangents(shape)
        left = equation.target - equation.design(shape) @ linear.factors
        return np.asarray(tangents.T @ left / (equation.load @ equation.load))

    def jacobian(self, shape: Float[np.ndarray, " h"]) -> Float[np.ndarray, "h h"]:
        """Return their derivative, the factors following, without what residuals give."""
        equation, share = self._equation, self._share
        linear, tangents = self._tangents(shape)
        own = equation.tangents(shape, linear.factors)
        twin = share[:, None] * equation.design(shape, instrument=True)
        follow = equation.design(shape) @ (linear.inverse @ (twin.T @ own))
        return np.asarray(tangents.T @ (follow - own) / (equation.load @ equation.load))


def _uncertainty(
    equation: Equation,
    residual: Float[np.ndarray, " s"],
    share: Float[np.ndarray, " s"],
    loss: Loss | TrimLoss,
    shape: Float[np.ndarray, " h"],
    factors: Float[np.ndarray, " k"],
    smoothness: float,
) -> tuple[Float[np.ndarray, "p p"], int, Float[np.ndarray, " p"]]:
    """Return the covariance of factors and shape, its lag, and the RMS of the columns.

    Residuals are divided by 1 − leverage (HC3), which makes few rows at the edge count as
    few. Source: J. G. MacKinnon, H. White, J. Econometrics 29, 1985.
    """
    used = equation.usable[:, None]

    def columns(instrument: bool) -> np.ndarray:
        design = equation.design(shape, instrument=instrument)
        tangents = equation.tangents(shape, factors, instrument=instrument)
        return np.asarray(used * np.concatenate([design, tangents], axis=1))

    own = columns(False)
    other = columns(True) if equation.has_instrument else own
    count, width = int(used.sum()), own.shape[1]
    steep = max(float(loss.slope(residual[used[:, 0]] / loss.scale).mean()), 0.05)
    prior = np.zeros((width, width))
    prior[: len(factors), : len(factors)] = prior_of(equation, smoothness)
    normal = steep * (own.T @ own) + prior
    mixed = steep * (other.T @ own) + prior if equation.has_instrument else None
    inverse = solve_normal(normal, np.zeros(width), mixed).inverse
    push = share * residual
    leverage = steep * np.einsum("sk,sk->s", own @ inverse, other)
    push = push / np.clip(1.0 - leverage, 1.0 - _LARGEST_LEVERAGE, 1.0)
    inner, lag = score_covariance(other * push[:, None], equation.piece)
    noise = float(push @ push) / max(count - width, 1)
    even = other.T @ other
    known = loss.scale**2 * prior
    covariance = larger_covariance(
        inverse @ (inner + known) @ inverse.T,
        inverse @ (noise * even + known) @ inverse.T,
    )
    return covariance, lag, np.sqrt(np.diag(own.T @ own) / count)
