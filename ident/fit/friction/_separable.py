"""The separable fit: linear factors eliminated, shapes searched, samples weighed.

Variable projection: for each trial shape the linear factors follow from least squares, so the
search runs over Stribeck velocity and exponent only, from several starts. Fits of the same law
to one recording with and without some of its rows go side by side (`Lanes`). Source: G. Golub,
V. Pereyra, Separable nonlinear least squares, Inverse Problems 19(2), 2003.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core._errors import FitError
from ...core._loss import AbstractLoss
from ._equation import AbstractEquation
from ._interpolated import Interpolated
from ._lanes import Shares
from ._loss import check_loss
from ._point import Point
from ._scout import reweigh, scout
from ._uncertain import roughly, uncertainty

_PASSES = 60
_FREEZE = 20
"""Pass from which on the scale of the residuals is kept, so that nothing can go in circles."""
_STILL = 1e-3
"""Change of a logarithm of the shape that no prediction shows."""
_STEP = 0.5
"""Longest step of a logarithm of the shape."""
_SETTLED = 1e-3
"""Largest change of any column's contribution in one pass, in scales, at the end."""
_HALVINGS = 12
_VALLEY = 0.7
"""Distance of a logarithm of the shape from the best start: two steps of the starts."""


@dataclasses.dataclass(frozen=True)
class Solution:
    """Where the separable fit ended.

    Attributes:
        factors: Linear factors, fixed columns first.
        shape: Logarithms of the non-linear parameters.
        covariance: Of factors and shape together, null directions left out.
        null: Directions of the factors that no sample moves, as columns.
        column_size: RMS of each column over the samples used (factors, then tangents).
        residual: Load − fit per filtered sample, in load units.
        share: Weight that each of them had.
        loss: With its scale.
        lag: Up to which the covariance looked.
        passes: How many were made.
        converged: Whether the last one changed nothing.
        at_bound: Which shapes ended at the edge of what the data could tell.
        weight: Of the smoothness prior.
    """

    factors: Float[np.ndarray, " k"]
    shape: Float[np.ndarray, " s"]
    covariance: Float[np.ndarray, "p p"]
    null: Float[np.ndarray, "k z"]
    column_size: Float[np.ndarray, " p"]
    residual: Float[np.ndarray, " t"]
    share: Float[np.ndarray, " t"]
    loss: AbstractLoss
    lag: int
    passes: int
    converged: bool
    at_bound: Bool[np.ndarray, " s"]
    weight: float


def separable(
    equation: AbstractEquation,
    loss: str,
    certain: bool,
    about: Float[np.ndarray, "r h"] | None = None,
) -> list[Solution]:
    """Fit factors and shapes of an equation, once for each choice of its rows.

    Args:
        equation: The equation.
        loss: Name of the loss.
        certain: Whether covariances must hold; if not, they are those of independent noise,
            for laws that are only to predict.
        about: Logarithms near which each recording's shapes may be; anywhere where left
            out. What is found does not depend on them, but for the time it takes.

    Raises:
        FitError: If hardly any sample is left.
    """
    check_loss(loss)
    lanes = equation.lanes
    count, parameters = int(lanes.count.min()), equation.width
    if count <= parameters + equation.height:
        msg = (
            f"{count} samples in motion are left after filtering, "
            f"expected more than the {parameters} parameters."
        )
        raise FitError(msg)
    shares = scout(equation.stack, lanes, loss)
    begin = _start(equation, shares, equation.best_start(shares))
    found: dict[int, Solution] = {}
    if about is not None and equation.height == 1 and not equation.instruments:
        found = _fitted_near(begin, about, loss, certain)
    left = [lane for lane in range(len(lanes)) if lane not in found]
    found |= _fitted(begin.take(np.array(left, np.int64)), loss, certain)
    return [found[lane] for lane in range(len(lanes))]


def _fitted(going: "_Going", loss: str, certain: bool) -> dict[int, Solution]:
    """Search factors, weights and shapes until nothing changes; return them by lane."""
    found: dict[int, Solution] = {}
    for step in range(_PASSES):
        if not len(going.lane):
            break
        going.point = going.equation.solve(going.shares, going.shape, going.point)
        settled = going.weigh_again(loss, step)
        done = settled | (step + 1 == _PASSES)
        ended = going.take(np.flatnonzero(done))
        found |= _ended(ended, settled[done], step + 1, certain)
        going = going.take(np.flatnonzero(~done))
        if going.equation.height and len(going.lane):
            going.next_shape()
    return found


def _fitted_near(
    begin: "_Going", about: Float[np.ndarray, "r 1"], loss: str, certain: bool
) -> dict[int, Solution]:
    """Return the fits whose shapes lie near those of their recordings, by lane.

    Shapes are the best ones under the weights at every pass: only these are left to settle.
    """
    sums = Interpolated(begin.equation, about)
    shape, there = sums.shapes(begin.shares)
    # Another valley, maybe a lower one, is searched from its own start.
    there &= (np.abs(shape - begin.shape) < _VALLEY)[:, 0]
    going = dataclasses.replace(begin)
    found: dict[int, Solution] = {}
    for step in range(_PASSES):
        going.shape = shape
        which = np.flatnonzero(there)
        if not len(which):
            break
        going, sums = going.take(which), sums.take(which)
        going.point = going.equation.solve(going.shares, going.shape, going.point)
        weights = going.shares
        settled = going.weigh_again(loss, step)
        settled |= (going.shares.full == weights.full).all(axis=1)
        ended = going.take(np.flatnonzero(settled))
        found |= _ended(ended, settled[settled], step + 1, certain)
        which = np.flatnonzero(~settled)
        going, sums = going.take(which), sums.take(which)
        shape, there = sums.shapes(going.shares)
    return found


def search(
    equation: AbstractEquation, shares: Shares, shape: Float[np.ndarray, "w h"]
) -> Point:
    """Return the solutions under given weights, shapes searched from where they may be.

    Args:
        equation: The equation.
        shares: Weights of the rows.
        shape: Logarithms to start from, fit by fit.
    """
    going, found = _start(equation, shares, shape), shape.copy()
    for _ in range(_PASSES if equation.height else 0):
        before = going.shape.copy()
        going.next_shape()
        found[going.lane] = going.shape
        moved = np.abs(going.shape - before).max(axis=1) > _STILL
        if not moved.any():
            break
        going = going.take(np.flatnonzero(moved))
    return equation.solve(shares, found)


@dataclasses.dataclass
class _Going:
    """Fits that have not settled yet.

    Attributes:
        lane: Which they are.
        equation: Of these.
        shares: Weights of the rows.
        shape: Logarithms.
        point: What was solved last, or None.
        before: Residuals of the pass before, or None.
        losses: With their scales, or None.
    """

    lane: Int[np.ndarray, " w"]
    equation: AbstractEquation
    shares: Shares
    shape: Float[np.ndarray, "w h"]
    point: Point | None
    before: Float[np.ndarray, "w s"] | None
    losses: list[AbstractLoss] | None

    def take(self, which: Int[np.ndarray, " v"]) -> "_Going":
        """Return some of them."""
        if len(which) == len(self.lane):
            return self
        point, before = self.point, self.before
        last = point is not None and before is point.residual
        if point is not None:
            point = point.take(which)
        if before is not None:
            # What the last pass left, for the most part: not taken twice.
            before = point.residual if last and point is not None else before[which]
        return _Going(
            self.lane[which],
            self.equation.take(which),
            self.shares.take(which),
            self.shape[which],
            point,
            before,
            None if self.losses is None else [self.losses[k] for k in which],
        )

    def weigh_again(self, loss: str, step: int) -> Bool[np.ndarray, " w"]:
        """Weigh the rows by what is left of them; return which fits have settled."""
        assert self.point is not None
        residual = self.point.residual
        if loss != "gauss" or self.losses is None:
            kept = self.losses if step >= _FREEZE else None
            self.shares, self.losses = reweigh(self.equation, residual, loss, kept=kept)
        before, self.before = self.before, residual
        if before is None:
            return np.zeros(len(residual), bool)
        if before is residual:
            return np.ones(len(residual), bool)
        moved = np.abs(residual - before) * (self.shares.full > 0)
        scale = np.array([each.scale for each in self.losses])
        return np.asarray(moved.max(axis=1) <= _SETTLED * scale)

    def next_shape(self) -> None:
        """Take one Gauss-Newton step in the shape, factors following, kept within bounds."""
        equation = self.equation
        self.point = equation.solve(self.shares, self.shape, self.point)
        step = equation.step(self.point)
        longest = np.maximum(np.abs(step).max(axis=1), 1e-300)
        step = step * np.minimum(1.0, _STEP / longest)[:, None]
        low, high = equation.bounds
        if equation.stack.one.has_instrument:
            self.shape = np.clip(self.shape + step, low, high)
            return
        now = self.point.cost
        left = np.arange(len(now))
        for _ in range(_HALVINGS):
            trial = np.clip(self.shape[left] + step[left], low[left], high[left])
            there = equation.take(left).solve(self.shares.take(left), trial)
            good = there.cost <= now[left] * (1 + 1e-12)
            self.shape[left[good]] = trial[good]
            if good.all() and len(good) == len(now):
                self.point = there
            else:
                self.point = self.point.put(
                    left[good], there.take(np.flatnonzero(good))
                )
            left = left[~good]
            if not len(left):
                return
            step = 0.5 * step


def _start(
    equation: AbstractEquation, shares: Shares, shape: Float[np.ndarray, "w h"]
) -> _Going:
    every = np.arange(len(equation.lanes))
    return _Going(every, equation, shares, shape, None, None, None)


def _ended(
    going: _Going, settled: np.ndarray, passes: int, certain: bool
) -> dict[int, Solution]:
    """Return the solutions under the last weights, by lane."""
    if not len(going.lane):
        return {}
    equation = going.equation
    point = equation.solve(going.shares, going.shape, going.point)
    assert going.losses is not None
    low, high = equation.bounds
    bound = (going.shape <= low + 1e-6) | (going.shape >= high - 1e-6)
    losses, full = going.losses, going.shares.full
    sure = (uncertainty if certain else roughly)(equation, point, losses)
    found = {}
    for place, lane in enumerate(going.lane.tolist()):
        many = len(equation.stack.problems[equation.of(place)].target)
        found[lane] = Solution(
            point.factors[place],
            going.shape[place],
            sure.covariance[place],
            point.null[place],
            sure.sizes[place],
            point.residual[place, :many],
            full[place, :many],
            losses[place],
            int(sure.lag[place]),
            passes,
            bool(settled[place]),
            bound[place],
            equation.weight(place),
        )
    return found
