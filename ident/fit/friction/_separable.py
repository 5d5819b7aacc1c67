"""The separable fit: linear factors eliminated, shapes searched, samples weighed.

Variable projection: for each trial shape the linear factors follow from least squares, so the
search runs over Stribeck velocity and exponent only, from several starts. Fits of the same law
to one recording with and without some of its rows go side by side (`Lanes`). Source: G. Golub,
V. Pereyra, Separable nonlinear least squares, Inverse Problems 19(2), 2003.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .._errors import FitError
from .._loss import AbstractLoss
from ._equation import Equation
from ._lanes import Lanes, Shares, lanes_of
from ._loss import check_loss, weigh
from ._point import Point
from ._problem import Problem
from ._tables import KnotTable, default_knots
from ._uncertain import uncertainty

_PASSES = 60
_FREEZE = 20
"""Pass from which on the scale of the residuals is kept, so that nothing can go in circles."""
_STEP = 0.5
"""Longest step of a logarithm of the shape."""
_SETTLED = 1e-3
"""Largest change of any column's contribution in one pass, in scales, at the end."""
_FLOOR = 1e-9
"""Smallest scale of residuals relative to the load."""
_SCOUT_KNOTS = 12
_SCOUT_PASSES = 8
_HALVINGS = 12


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


def scout(problem: Problem, lanes: Lanes, loss: str) -> Shares:
    """Return weights of the samples under a law that can bend anywhere.

    What is wild under a free table is wild under any law, whatever shape is tried. Where
    nothing is wild in the whole recording, nothing is in a part of it.
    """
    whole = lanes_of(problem.usable)
    if not len(_scouted(problem, whole, loss).rows):
        return lanes.all_rows()
    return _scouted(problem, lanes, loss)


def _scouted(problem: Problem, lanes: Lanes, loss: str) -> Shares:
    key = (loss, problem.structure.directional, lanes.use.tobytes())
    if key not in problem.scouted:
        problem.scouted[key] = _scout(problem, lanes, loss)
    return problem.scouted[key]


def _scout(problem: Problem, lanes: Lanes, loss: str) -> Shares:
    shares = lanes.all_rows()
    knots = default_knots(problem.speed, _SCOUT_KNOTS)
    if len(set(knots)) < _SCOUT_KNOTS:
        return shares
    free = problem.with_structure(KnotTable(problem.structure.directional, knots))
    equation = Equation(free, lanes, plain=True)
    for step in range(_SCOUT_PASSES):
        residual = equation.solve(shares).residual
        kind = "huber" if step < _SCOUT_PASSES // 2 and loss != "gauss" else loss
        before = shares
        shares = _shares(problem, residual, kind, lanes, equation.width)[0]
        if kind == loss and shares.same(before):
            break  # and so it would stay
    return shares


def _shares(
    problem: Problem,
    residual: np.ndarray,
    name: str,
    lanes: Lanes,
    parameters: int,
    kept: Sequence[AbstractLoss] | None = None,
) -> tuple[Shares, list[AbstractLoss]]:
    count = lanes.count
    inflation = np.sqrt(count / np.maximum(count - parameters, 0.05 * count))
    floor = max(_FLOOR * float(np.sqrt(np.mean(problem.load**2))), 1e-300)
    return weigh(name, residual, lanes, inflation, floor, kept)


def separable(equation: Equation, loss: str, certain: Sequence[bool]) -> list[Solution]:
    """Fit factors and shapes of an equation, once for each choice of its rows.

    Args:
        equation: The equation.
        loss: Name of the loss.
        certain: For which fits the covariance is wanted; without it there are zeros, for
            laws that are only to predict.

    Raises:
        FitError: If hardly any sample is left.
    """
    check_loss(loss)
    problem, lanes = equation.problem, equation.lanes
    count = int(lanes.count.min())
    parameters = len(problem.fixed_names) + len(problem.structure.names)
    if count <= parameters + len(problem.structure.shapes):
        msg = (
            f"{count} samples in motion are left after filtering, "
            f"expected more than the {parameters} parameters."
        )
        raise FitError(msg)
    going = _start(equation, scout(problem, lanes, loss))
    found: dict[int, Solution] = {}
    for step in range(_PASSES):
        going.point = going.equation.solve(going.shares, going.shape, going.point)
        settled = going.weigh_again(problem, loss, parameters, step)
        last = step + 1 == _PASSES
        done = np.flatnonzero(settled | last)
        for lane in done:
            going.passes[lane] = step + 1
        if len(done):
            found |= _ended(going.take(done), settled[done], certain)
            if len(done) == len(settled):
                break
            going = going.take(np.flatnonzero(~settled))
        if problem.structure.shapes:
            going.next_shape()
    return [found[lane] for lane in range(len(lanes))]


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
        passes: That were made.
    """

    lane: Int[np.ndarray, " w"]
    equation: Equation
    shares: Shares
    shape: Float[np.ndarray, "w h"]
    point: Point | None
    before: Float[np.ndarray, "w s"] | None
    losses: list[AbstractLoss] | None
    passes: Int[np.ndarray, " w"]

    def take(self, which: Int[np.ndarray, " v"]) -> "_Going":
        """Return some of them."""
        if len(which) == len(self.lane):
            return self
        return _Going(
            self.lane[which],
            self.equation.take(which),
            self.shares.take(which),
            self.shape[which],
            None if self.point is None else self.point.take(which),
            None if self.before is None else self.before[which],
            None if self.losses is None else [self.losses[k] for k in which],
            self.passes[which],
        )

    def weigh_again(
        self, problem: Problem, loss: str, parameters: int, step: int
    ) -> Bool[np.ndarray, " w"]:
        """Weigh the rows by what is left of them; return which fits have settled."""
        assert self.point is not None
        residual = self.point.residual
        lanes = self.equation.lanes
        if loss != "gauss" or self.losses is None:
            kept = self.losses if step >= _FREEZE else None
            self.shares, self.losses = _shares(
                problem, residual, loss, lanes, parameters, kept
            )
        before, self.before = self.before, residual
        if before is None:
            return np.zeros(len(lanes), bool)
        if before is residual:
            return np.ones(len(lanes), bool)
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
        if equation.problem.has_instrument:
            self.shape = np.clip(self.shape + step, low, high)
            return
        now = self.point.cost
        left = np.arange(len(now))
        for _ in range(_HALVINGS):
            trial = np.clip(self.shape[left] + step[left], low, high)
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


def _start(equation: Equation, shares: Shares) -> _Going:
    count = len(equation.lanes)
    shape = equation.best_start(shares)
    none = np.zeros(count, np.int64)
    return _Going(np.arange(count), equation, shares, shape, None, None, None, none)


def _ended(
    going: _Going, settled: np.ndarray, certain: Sequence[bool]
) -> dict[int, Solution]:
    """Return the solutions under the last weights, by lane."""
    equation = going.equation
    point = equation.solve(going.shares, going.shape, going.point)
    assert going.losses is not None
    low, high = equation.bounds
    bound = (going.shape <= low + 1e-6) | (going.shape >= high - 1e-6)
    width = equation.width + equation.height
    unknown = np.zeros((width, width)), 0, np.ones(width)
    found = {}
    for place, lane in enumerate(going.lane.tolist()):
        share = going.shares.full[place]
        loss = going.losses[place]
        covariance, lag, sizes = unknown
        if certain[lane]:
            covariance, lag, sizes = uncertainty(equation, point, place, loss, share)
        found[lane] = Solution(
            point.factors[place],
            going.shape[place],
            covariance,
            point.null[place],
            sizes,
            point.residual[place],
            share,
            loss,
            lag,
            int(going.passes[place]),
            bool(settled[place]),
            bound[place],
            equation.weight(place),
        )
    return found
