"""The equation of a law for several choices of rows: solved at shapes, stepped, compared."""

from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from ._lanes import Lanes, Shares
from ._linear import solve_linear
from ._point import Columns, Point
from ._problem import Problem

_RIDGE = 1e-9
"""Of the trace, added where a step is solved for."""


class Equation:
    """Sums, solutions and steps of one kind of law, for several choices of rows.

    Attributes:
        problem: The equation.
        lanes: Rows that each fit uses.
        width: Number of linear factors.
        height: Number of shapes.
    """

    def __init__(
        self,
        problem: Problem,
        lanes: Lanes,
        *,
        plain: bool = False,
    ) -> None:
        """Prepare the sums, without a prior.

        Args:
            problem: The equation.
            lanes: Rows that each fit uses.
            plain: Least squares, though there may be instruments.
        """
        self.problem, self.lanes = problem, lanes
        self.still = problem.still()
        self.twin = self.still
        self.instruments = problem.has_instrument and not plain
        if self.instruments:
            self.twin = problem.still(instrument=True)
        self.places, self.moves = problem.places
        self.width = len(self.places) + len(self.moves)
        self.height = len(problem.structure.shapes)
        target = problem.target[:, None]
        self._right = np.concatenate([self.still, target], axis=1)
        self._own = lanes.sums(self.still, self._right)
        self._cross = self._own
        if self.instruments:
            self._cross = lanes.sums(self.twin, self._right)
        self._size = np.sqrt(
            np.einsum("sk,sk->k", self.still, self.still) / len(target)
        )
        self._weights: np.ndarray | None = None
        self._penalty: np.ndarray | None = None

    def smoothed(self, weights: Float[np.ndarray, " w"]) -> "Equation":
        """Return the equation with a smoothness prior, weights relative to 1/noise²."""
        other = object.__new__(Equation)
        other.__dict__.update(self.__dict__)
        other._weights, other._penalty = weights, self.problem.penalty()
        return other

    def sums(self, shares: Shares) -> Float[np.ndarray, "w k k1"]:
        """Return XᵀW [X, target] of a law without a shape."""
        return shares.sums(self._own, self.still, self._right)

    def take(self, which: Int[np.ndarray, " v"]) -> "Equation":
        """Return the equation for some of the fits."""
        if len(which) == len(self.lanes):
            return self
        other = object.__new__(Equation)
        other.__dict__.update(self.__dict__)
        other.lanes = self.lanes.take(which)
        other._own = self._own[which]
        other._cross = self._cross[which] if self.instruments else other._own
        if self._weights is not None:
            other._weights = self._weights[which]
        return other

    def weight(self, lane: int) -> float:
        """Return the weight of the smoothness prior of one fit."""
        return 0.0 if self._weights is None else float(self._weights[lane])

    def prior(self, lane: int) -> Float[np.ndarray, "k k"] | None:
        """Return the matrix of the smoothness prior of one fit, or None."""
        if self._penalty is None or self._weights is None:
            return None
        return np.asarray(self._weights[lane] * self._penalty)

    @cached_property
    def bounds(self) -> tuple[Float[np.ndarray, " h"], Float[np.ndarray, " h"]]:
        """Least and largest logarithms of the shape."""
        return self.problem.structure.bounds(self.problem.speed)

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
        same = known is not None and np.array_equal(known.shape, shape)
        if known is not None and same and shares.same(known.shares):
            return known
        moving = None
        if self.height:
            if known is not None and same:
                moving = known.moving
            else:
                moving = Columns(*self.problem.shaped(shape))
        own, size = self._assembled(shares, moving, moving, own=True)
        matrix = own
        if self.instruments:
            other = None
            if self.height:
                other = Columns(*self.problem.shaped(shape, instrument=True))
            matrix, _ = self._assembled(shares, other, moving, own=False)
        moment = matrix[:, :, -1]
        own, matrix = own[:, :, :-1], matrix[:, :, :-1]
        if self._penalty is not None and self._weights is not None:
            prior = self._weights[:, None, None] * self._penalty
            own = own + prior
            matrix = matrix + prior if self.instruments else own
        matrix = matrix if self.instruments else own
        linear = solve_linear(own, matrix, moment, size)
        residual = self.problem.target - linear.factors[:, self.places] @ self.still.T
        if moving is not None:
            for way, place in enumerate(self.moves):
                residual -= linear.factors[:, place, None] * moving.values[way]
        return Point(shares, shape.copy(), moving, linear, residual)

    def _assembled(
        self, shares: Shares, left: Columns | None, right: Columns | None, *, own: bool
    ) -> tuple[Float[np.ndarray, "w k k1"], Float[np.ndarray, "w k"]]:
        """Return leftᵀ W [right, target] in the order of the factors, and column sizes."""
        twin = self.still if own else self.twin
        still = shares.sums(self._own if own else self._cross, twin, self._right)
        count = len(self.lanes)
        size = np.broadcast_to(self._size, (count, len(self._size)))
        if left is None or right is None:
            return still, size
        places, moves = self.places, self.moves
        found = np.empty((count, self.width, self.width + 1))
        found[:, np.array(places)[:, None], [*places, self.width]] = still
        sizes = np.empty((count, self.width))
        sizes[:, places] = size
        for row, place in enumerate(moves):
            part = shares.full * left.values[row]
            found[:, place, [*places, self.width]] = part @ self._right
            for column, beside in enumerate(moves):
                found[:, place, beside] = np.einsum(
                    "ws,ws->w", part, right.values[column]
                )
            if own:
                found[:, places, place] = found[:, place, places]
            else:
                part = shares.full * right.values[row]
                found[:, places, place] = part @ twin
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
            columns = Columns(*self.problem.shaped(point.shape, instrument=True))
            twist = self.tangents(point, columns)
        count, high = len(self.lanes), self.height
        after = np.empty((count, self.width, high))
        before = np.empty((count, high, self.width))
        matrix, push = np.empty((count, high, high)), np.empty((count, high))
        for k in range(high):
            part = shares * tangents[k]
            after[:, self.places, k] = part @ self.twin
            bent = part if twist is tangents else shares * twist[k]
            before[:, k, self.places] = bent @ self.still
            for way, place in enumerate(self.moves):
                after[:, place, k] = np.einsum("ws,ws->w", part, columns.values[way])
                before[:, k, place] = np.einsum(
                    "ws,ws->w", bent, point.moving.values[way]
                )
            for other in range(high):
                matrix[:, k, other] = np.einsum("ws,ws->w", bent, tangents[other])
            push[:, k] = np.einsum("ws,ws->w", bent, point.residual)
        matrix = matrix - before @ (point.linear.inverse @ after)
        found = np.empty((count, high))
        for lane in range(count):
            scale = max(float(np.trace(np.abs(matrix[lane]))), 1e-300)
            ridged = matrix[lane] + _RIDGE * scale * np.eye(high)
            found[lane] = np.linalg.lstsq(ridged, push[lane], rcond=None)[0]
        return found

    def best_start(self, shares: Shares) -> Float[np.ndarray, "w h"]:
        """Return the best of the structure's starts for each fit, by least squares."""
        starts = np.stack(list(self.problem.structure.starts(self.problem.speed)))
        count = len(self.lanes)
        if len(starts) == 1:
            return np.repeat(starts, count, axis=0)
        values = self.problem.shaped(starts)[0]
        ways, many, rows = values.shape
        flat = np.ascontiguousarray(values.reshape(ways * many, rows).T)
        right = np.concatenate([self._right, flat], axis=1)
        size = len(self.places)
        full = shares.sums(self.lanes.sums(flat, right), flat, right)
        full = full.reshape(count, ways, many, -1)
        still = shares.sums(self._own, self.still, self._right)
        base = solve_linear(
            still[:, :, :-1],
            still[:, :, :-1],
            still[:, :, -1],
            np.broadcast_to(self._size, (count, size)),
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
        sizes = np.einsum("sk,sk->k", flat, flat).reshape(ways, many)
        for one in range(ways):
            pivot = square[:, :, one, one]
            seen = pivot > 1e-9 * sizes[one]
            share = np.where(seen, left[:, one] / np.where(seen, pivot, 1.0), 0.0)
            gain += share * left[:, one]
            for other in range(one + 1, ways):
                left[:, other] -= share * square[:, :, one, other]
                factor = np.where(
                    seen, square[:, :, one, other] / np.where(seen, pivot, 1.0), 0.0
                )
                square[:, :, other, other] -= factor * square[:, :, one, other]
        return np.asarray(starts[np.argmax(gain, axis=1)])
