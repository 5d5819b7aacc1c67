"""Equations of a law for several choices of rows: solved at shapes, stepped, compared."""

import abc
import copy

import numpy as np
from jaxtyping import Float, Int

from ._lanes import Lanes, Shares
from ._linear import Linear, solve_linear
from ._point import Columns, Point
from ._stack import Stack

_START_ROWS = 512
"""Rows that tell where a search begins, at most."""
_RIDGE = 1e-9
"""Of the trace, added where a step is solved for."""


class AbstractEquation(abc.ABC):
    """Sums, solutions and steps of one kind of law, for several choices of rows.

    Attributes:
        stack: The equations.
        lanes: Rows that each fit uses.
        places: Of the linear factors whose columns follow no shape.
        moves: Of those whose columns do, one per direction.
        width: Number of linear factors.
        height: Number of shapes.
        instruments: Whether a noise-free motion stands beside the measured one.
    """

    def __init__(self, stack: Stack, lanes: Lanes) -> None:
        """Prepare an equation without a prior.

        Args:
            stack: The equations.
            lanes: Rows that each fit uses.
        """
        self.stack, self.lanes = stack, lanes
        self.places, self.moves = stack.one.places
        self.width = len(self.places) + len(self.moves)
        self.height = len(stack.structure.shapes)
        self.instruments = False
        self._weights: np.ndarray | None = None

    def smoothed(self, weights: Float[np.ndarray, " w"]) -> "AbstractEquation":
        """Return the equation with a smoothness prior, weights relative to 1/noise²."""
        other = copy.copy(self)
        other._weights = weights
        return other

    def take(self, which: Int[np.ndarray, " v"]) -> "AbstractEquation":
        """Return the equation for some of the fits."""
        if len(which) == len(self.lanes):
            return self
        other = copy.copy(self)
        other.lanes = self.lanes.take(which)
        if self._weights is not None:
            other._weights = self._weights[which]
        return other

    @abc.abstractmethod
    def sums(self, shares: Shares) -> Float[np.ndarray, "w k k1"]:
        """Return XᵀW [X, target] of a law without a shape."""

    @abc.abstractmethod
    def left(
        self, factors: Float[np.ndarray, "w k"], moving: Columns | None
    ) -> Float[np.ndarray, "w s"]:
        """Return target − fit."""

    @abc.abstractmethod
    def columns(
        self, point: Point, lane: int, *, instrument: bool = False
    ) -> Float[np.ndarray, "t p"]:
        """Return all columns of one fit in the order of its factors, then its tangents.

        Args:
            point: Where it was solved.
            lane: Which of the fits.
            instrument: Of the noise-free motion.
        """

    @abc.abstractmethod
    def held_out(
        self,
        shares: Shares,
        shape: Float[np.ndarray, "r h"],
        factors: Float[np.ndarray, "r k"],
        windows: Int[np.ndarray, "w 2"],
    ) -> tuple[
        Float[np.ndarray, "v s"], Float[np.ndarray, "v s"], Float[np.ndarray, "w h"]
    ]:
        """Return what laws leave of each row, solved without its window, and of all rows.

        Laws with a shape take a joint step from those given. Sums are made once for all
        fits of a recording, and no row is looked at fit by fit.

        Args:
            shares: Weights of the rows; fits of a recording must give a row the same one.
            shape: Logarithms of each recording's law.
            factors: Its linear factors.
            windows: First row and end of the window that each fit does without; the last
                fit of each recording is that of all rows.

        Returns:
            Both for each recording with any fits, and the steps in the shape of each fit.
        """

    @abc.abstractmethod
    def _linear(
        self, shares: Shares, shape: Float[np.ndarray, "w h"], moving: Columns | None
    ) -> Linear:
        """Return the linear factors at weights and shapes."""

    @abc.abstractmethod
    def _shaped(self, shape: Float[np.ndarray, "w h"]) -> Columns:
        """Return the columns that follow the shape."""

    @abc.abstractmethod
    def _pushes(
        self, point: Point
    ) -> tuple[
        Float[np.ndarray, "w k h"],
        Float[np.ndarray, "w h k"],
        Float[np.ndarray, "w h h"],
        Float[np.ndarray, "w h"],
    ]:
        """Return sums over tangents T: XᵀWT, TᵀWX, TᵀWT and TᵀW times what is left."""

    @abc.abstractmethod
    def still_and_target(self, step: int) -> Float[np.ndarray, "r s k1"]:
        """Return columns that follow no shape and the target, of every so-manieth row."""

    def of(self, lane: int) -> int:
        """Return the recording that a fit is of."""
        return int(self.lanes.of[lane])

    def weight(self, lane: int) -> float:
        """Return the weight of the smoothness prior of one fit."""
        return 0.0 if self._weights is None else float(self._weights[lane])

    def prior(self, lane: int) -> Float[np.ndarray, "k k"] | None:
        """Return the matrix of the smoothness prior of one fit, or None."""
        penalty = self.stack.penalty
        if penalty is None or self._weights is None:
            return None
        return np.asarray(self._weights[lane] * penalty[self.of(lane)])

    def _with_prior(
        self, own: Float[np.ndarray, "w k k"]
    ) -> Float[np.ndarray, "w k k"]:
        """Return normal matrices with the smoothness prior added, where there is one."""
        penalty = self.stack.penalty
        if penalty is None or self._weights is None:
            return own
        return np.asarray(own + self._weights[:, None, None] * penalty[self.lanes.of])

    @property
    def bounds(self) -> tuple[Float[np.ndarray, "w h"], Float[np.ndarray, "w h"]]:
        """Least and largest logarithms of the shape, fit by fit."""
        low, high = self.stack.bounds
        return low[self.lanes.of], high[self.lanes.of]

    def solve(
        self,
        shares: Shares,
        shape: Float[np.ndarray, "w h"] | None = None,
        known: Point | None = None,
    ) -> Point:
        """Return the solution at weights and shapes.

        Args:
            shares: Weights of the rows.
            shape: Logarithms; none where the law has none.
            known: What was solved before: where nothing has changed it is the answer.
        """
        count = len(self.lanes)
        shape = np.zeros((count, 0)) if shape is None else shape
        kept = np.zeros(0, np.int64)
        if known is not None:
            kept = self._unchanged(shares, shape, known)
            if len(kept) == count:
                return known
        moving = None
        if self.height:
            if known is not None and np.array_equal(known.shape, shape):
                moving = known.moving
            else:
                moving = self._shaped(shape)
        linear = self._linear(shares, shape, moving)
        residual = self.left(linear.factors, moving)
        point = Point(shares, shape.copy(), moving, linear, residual)
        if known is not None and len(kept):
            # To the bit as if these recordings stood alone: sums may be rounded elsewhere
            # since some of their fits have ended.
            point = point.put(kept, known.take(kept))
        return point

    def _unchanged(
        self, shares: Shares, shape: Float[np.ndarray, "w h"], known: Point
    ) -> Int[np.ndarray, " v"]:
        """Return fits of recordings in which nothing has changed since."""
        stays = (shape == known.shape).all(axis=1)
        found = [
            np.arange(fits.start, fits.stop)
            for _, fits in self.lanes.own
            if stays[fits].all() and shares.same(known.shares, fits)
        ]
        return np.concatenate([np.zeros(0, np.int64), *found])

    def step(self, point: Point) -> Float[np.ndarray, "w h"]:
        """Return the Gauss-Newton step in the shape, the factors following.

        What the linear columns can follow is no reason to move.
        """
        after, before, matrix, push = self._pushes(point)
        matrix = matrix - before @ (point.linear.inverse @ after)
        trace = np.abs(np.einsum("whh->wh", matrix)).sum(axis=1)
        ridge = _RIDGE * np.maximum(trace, 1e-300)
        inverse = np.linalg.pinv(matrix + ridge[:, None, None] * np.eye(self.height))
        return np.asarray((inverse @ push[..., None])[..., 0])

    def best_start(self, shares: Shares) -> Float[np.ndarray, "w h"]:
        """Return the best of the structure's starts for each fit, by least squares."""
        starts, lane_of = self.stack.starts, self.lanes.of
        recordings, many, _ = starts.shape
        count = len(self.lanes)
        if many == 1:
            return np.asarray(starts[lane_of, 0])
        of = np.repeat(np.arange(recordings), many)
        # By powers of two: the same for recordings that stand side by side and alone.
        step = max(1, (1 << self.stack.rows.bit_length()) // _START_ROWS)
        every = starts.reshape(len(of), -1)
        values = self.stack.shaped_values(every, of, step)
        ways, _, rows = values.shape
        apart = values.reshape(ways, recordings, many, rows).transpose(1, 3, 0, 2)
        flat = apart.reshape(recordings, rows, ways * many)
        right = np.concatenate([self.still_and_target(step), flat], axis=2)
        right[~self.stack.usable[:, ::step]] = 0.0
        lanes = self.lanes.thinned(step)
        thin = Shares(lanes, shares.full[:, ::step])
        sums = thin.sums(lanes.sums(right, right), right, right)
        size = len(self.places)
        still = sums[:, :size, : size + 1]
        full = sums[:, size + 1 :].reshape(count, ways, many, -1)
        normal = still[:, :, :-1]
        square = np.einsum("wkk->wk", normal)
        base = solve_linear(normal, normal, still[:, :, -1], np.sqrt(square))
        # What the still columns leave of the others, and of the target.
        with_still = full[..., :size]
        follow = with_still @ base.inverse[:, None]
        left = full[..., size] - np.einsum("wdmk,wk->wdm", follow, still[:, :, -1])
        gain = np.zeros((count, many))
        inner = np.empty((count, many, ways, ways))
        at = np.arange(many)
        for one in range(ways):
            for other in range(ways):
                both = full[:, one, at, size + 1 + other * many + at]
                inner[:, :, one, other] = both - np.einsum(
                    "wmk,wmk->wm", follow[:, one], with_still[:, other]
                )
        sizes = np.einsum("rsk,rsk->rk", flat, flat)[lane_of]
        sizes = sizes.reshape(count, ways, many)
        for one in range(ways):
            pivot = inner[:, :, one, one]
            seen = pivot > 1e-9 * sizes[:, one]
            share = np.where(seen, left[:, one] / np.where(seen, pivot, 1.0), 0.0)
            gain += share * left[:, one]
            for other in range(one + 1, ways):
                left[:, other] -= share * inner[:, :, one, other]
                factor = np.where(
                    seen, inner[:, :, one, other] / np.where(seen, pivot, 1.0), 0.0
                )
                inner[:, :, other, other] -= factor * inner[:, :, one, other]
        return np.asarray(starts[lane_of, np.argmax(gain, axis=1)])
