"""Equations of a law for several choices of rows: solved at shapes, stepped, compared."""

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


class Equation:
    """Sums, solutions and steps of one kind of law, for several choices of rows.

    Attributes:
        stack: The equations.
        lanes: Rows that each fit uses.
        width: Number of linear factors.
        height: Number of shapes.
    """

    def __init__(self, stack: Stack, lanes: Lanes, *, plain: bool = False) -> None:
        """Prepare the sums, without a prior.

        Args:
            stack: The equations.
            lanes: Rows that each fit uses.
            plain: Least squares, though there may be instruments.
        """
        self.stack, self.lanes = stack, lanes
        self.still = self.twin = stack.still
        self.instruments = stack.one.has_instrument and not plain
        if self.instruments:
            self.twin = stack.still_instrument
        self.places, self.moves = stack.one.places
        self.width = len(self.places) + len(self.moves)
        self.height = len(stack.structure.shapes)
        self._right = stack.right
        self._own = lanes.sums(self.still, self._right)
        self._cross = self._own
        if self.instruments:
            self._cross = lanes.sums(self.twin, self._right)
        self._weights: np.ndarray | None = None

    def smoothed(self, weights: Float[np.ndarray, " w"]) -> "Equation":
        """Return the equation with a smoothness prior, weights relative to 1/noise²."""
        other = copy.copy(self)
        other._weights = weights
        return other

    def sums(self, shares: Shares) -> Float[np.ndarray, "w k k1"]:
        """Return XᵀW [X, target] of a law without a shape."""
        return shares.sums(self._own, self.still, self._right)

    def take(self, which: Int[np.ndarray, " v"]) -> "Equation":
        """Return the equation for some of the fits."""
        if len(which) == len(self.lanes):
            return self
        other = copy.copy(self)
        other.lanes = self.lanes.take(which)
        other._own = self._own[which]
        other._cross = self._cross[which] if self.instruments else other._own
        if self._weights is not None:
            other._weights = self._weights[which]
        return other

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
        fitted = self.lanes.along(linear.factors[:, self.places], self.still)
        residual = self.stack.target[self.lanes.of] - fitted
        if moving is not None:
            for way, place in enumerate(self.moves):
                residual -= linear.factors[:, place, None] * moving.values[way]
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
            for k, fits in self.lanes.own
            if stays[fits].all() and shares.same(known.shares, k)
        ]
        return np.concatenate([np.zeros(0, np.int64), *found])

    def _linear(
        self, shares: Shares, shape: Float[np.ndarray, "w h"], moving: Columns | None
    ) -> Linear:
        own, size = self._assembled(shares, moving, moving, own=True)
        matrix = own
        if self.instruments:
            other = None
            if self.height:
                other = self._shaped(shape, instrument=True)
            matrix, _ = self._assembled(shares, other, moving, own=False)
        moment = matrix[:, :, -1]
        own, matrix = own[:, :, :-1], matrix[:, :, :-1]
        penalty = self.stack.penalty
        if penalty is not None and self._weights is not None:
            prior = self._weights[:, None, None] * penalty[self.lanes.of]
            own = own + prior
            matrix = matrix + prior if self.instruments else own
        matrix = matrix if self.instruments else own
        return solve_linear(own, matrix, moment, size)

    def _shaped(
        self, shape: Float[np.ndarray, "w h"], *, instrument: bool = False
    ) -> Columns:
        return Columns(*self.stack.shaped(shape, self.lanes.of, instrument=instrument))

    def _assembled(
        self, shares: Shares, left: Columns | None, right: Columns | None, *, own: bool
    ) -> tuple[Float[np.ndarray, "w k k1"], Float[np.ndarray, "w k"]]:
        """Return leftᵀ W [right, target] in the order of the factors, and column sizes."""
        twin = self.still if own else self.twin
        still = shares.sums(self._own if own else self._cross, twin, self._right)
        count, size = len(self.lanes), self.stack.size[self.lanes.of]
        if left is None or right is None:
            return still, size
        places, moves = self.places, self.moves
        found = np.empty((count, self.width, self.width + 1))
        found[:, np.array(places)[:, None], [*places, self.width]] = still
        sizes = np.empty((count, self.width))
        sizes[:, places] = size
        for row, place in enumerate(moves):
            part = shares.full * left.values[row]
            found[:, place, [*places, self.width]] = self.lanes.times(part, self._right)
            for column, beside in enumerate(moves):
                found[:, place, beside] = np.einsum(
                    "ws,ws->w", part, right.values[column]
                )
            if own:
                found[:, places, place] = found[:, place, places]
            else:
                part = shares.full * right.values[row]
                found[:, places, place] = self.lanes.times(part, twin)
            square = np.einsum("ws,ws->w", right.values[row], right.values[row])
            sizes[:, place] = np.sqrt(square / right.values.shape[2])
        return found, sizes

    def tangents(
        self, point: Point, moving: Columns | None = None
    ) -> Float[np.ndarray, "h w s"]:
        """Return the derivative of the fit with respect to the logarithms of the shape."""
        moving = point.moving if moving is None else moving
        assert moving is not None
        drops = point.factors[:, self.moves].T
        return np.asarray(np.einsum("dw,hdws->hws", drops, moving.slopes))

    def step(self, point: Point) -> Float[np.ndarray, "w h"]:
        """Return the Gauss-Newton step in the shape, the factors following.

        What the linear columns can follow is no reason to move.
        """
        assert point.moving is not None
        shares = point.shares.full
        tangents = self.tangents(point)
        columns, twist = point.moving, tangents
        if self.instruments:
            columns = self._shaped(point.shape, instrument=True)
            twist = self.tangents(point, columns)
        count, high = len(self.lanes), self.height
        after = np.empty((count, self.width, high))
        before = np.empty((count, high, self.width))
        matrix, push = np.empty((count, high, high)), np.empty((count, high))
        for k in range(high):
            part = shares * tangents[k]
            after[:, self.places, k] = self.lanes.times(part, self.twin)
            bent = part if twist is tangents else shares * twist[k]
            before[:, k, self.places] = self.lanes.times(bent, self.still)
            for way, place in enumerate(self.moves):
                after[:, place, k] = np.einsum("ws,ws->w", part, columns.values[way])
                before[:, k, place] = np.einsum(
                    "ws,ws->w", bent, point.moving.values[way]
                )
            for other in range(high):
                matrix[:, k, other] = np.einsum("ws,ws->w", bent, tangents[other])
            push[:, k] = np.einsum("ws,ws->w", bent, point.residual)
        matrix = matrix - before @ (point.linear.inverse @ after)
        trace = np.abs(np.einsum("whh->wh", matrix)).sum(axis=1)
        ridge = _RIDGE * np.maximum(trace, 1e-300)
        inverse = np.linalg.pinv(matrix + ridge[:, None, None] * np.eye(high))
        return np.asarray((inverse @ push[..., None])[..., 0])

    def near(
        self,
        shares: Shares,
        shape: Float[np.ndarray, "r h"],
        factors: Float[np.ndarray, "r k"],
    ) -> tuple[Float[np.ndarray, "r s q"], Float[np.ndarray, "w q"]]:
        """Return columns that all fits of a recording share, and what each makes of them.

        The last ones are the tangents of the recording's law: their factors are steps in
        its shape. Sums are made once for all fits, and no row is looked at fit by fit.

        Args:
            shares: Weights of the rows.
            shape: Logarithms of each recording's law.
            factors: Its linear factors.
        """
        if not self.height:
            none = np.zeros((len(self.lanes), 0))
            return self.still, self._linear(shares, none, None).factors
        values, slopes = self.stack.shaped(shape, np.arange(len(shape)))
        tangents = np.einsum("rd,hdrs->rsh", factors[:, self.moves], slopes)
        inner = [self.still, values.transpose(1, 2, 0)]
        right = np.concatenate([*inner, tangents, self._right[:, :, -1:]], axis=2)
        right[~self.stack.usable] = 0.0
        full = right[:, :, :-1]
        sums = shares.sums(self.lanes.sums(full, right), full, right)
        size = np.sqrt(np.einsum("rsk,rsk->rk", full, full) / full.shape[1])
        own, moment = sums[:, :, :-1], sums[:, :, -1]
        return full, solve_linear(own, own, moment, size[self.lanes.of]).factors

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
        values = self.stack.shaped(every, of, step=step)[0]
        ways, _, rows = values.shape
        apart = values.reshape(ways, recordings, many, rows).transpose(1, 3, 0, 2)
        flat = apart.reshape(recordings, rows, ways * many)
        right = np.concatenate([self._right[:, ::step], flat], axis=2)
        right[~self.stack.usable[:, ::step]] = 0.0
        lanes = self.lanes.thinned(step)
        thin = lanes.shares(shares.full[:, ::step])
        sums = thin.sums(lanes.sums(right, right), right, right)
        size = len(self.places)
        still = sums[:, :size, : size + 1]
        full = sums[:, size + 1 :].reshape(count, ways, many, -1)
        base = solve_linear(
            still[:, :, :-1],
            still[:, :, :-1],
            still[:, :, -1],
            self.stack.size[lane_of],
        )
        # What the still columns leave of the others, and of the target.
        with_still = full[..., :size]
        follow = with_still @ base.inverse[:, None]
        left = full[..., size] - np.einsum("wdmk,wk->wdm", follow, still[:, :, -1])
        gain = np.zeros((count, many))
        square = np.empty((count, many, ways, ways))
        at = np.arange(many)
        for one in range(ways):
            for other in range(ways):
                both = full[:, one, at, size + 1 + other * many + at]
                square[:, :, one, other] = both - np.einsum(
                    "wmk,wmk->wm", follow[:, one], with_still[:, other]
                )
        sizes = np.einsum("rsk,rsk->rk", flat, flat)[lane_of]
        sizes = sizes.reshape(count, ways, many)
        for one in range(ways):
            pivot = square[:, :, one, one]
            seen = pivot > 1e-9 * sizes[:, one]
            share = np.where(seen, left[:, one] / np.where(seen, pivot, 1.0), 0.0)
            gain += share * left[:, one]
            for other in range(one + 1, ways):
                left[:, other] -= share * square[:, :, one, other]
                factor = np.where(
                    seen, square[:, :, one, other] / np.where(seen, pivot, 1.0), 0.0
                )
                square[:, :, other, other] -= factor * square[:, :, one, other]
        return np.asarray(starts[lane_of, np.argmax(gain, axis=1)])
