"""Equations whose rows are mixtures of samples, or have instruments: all columns as matrices."""

import numpy as np
from jaxtyping import Float, Int

from ._equation import AbstractEquation
from ._lanes import Lanes, Shares
from ._linear import Linear, solve_linear
from ._point import Columns, Point
from ._stack import Stack


class MatrixEquation(AbstractEquation):
    """Sums by products of matrices."""

    def __init__(self, stack: Stack, lanes: Lanes, *, plain: bool = False) -> None:
        """Prepare the sums, without a prior.

        Args:
            stack: The equations.
            lanes: Rows that each fit uses.
            plain: Least squares, though there may be instruments.
        """
        super().__init__(stack, lanes)
        self._still = self._twin = stack.still
        self.instruments = stack.one.has_instrument and not plain
        if self.instruments:
            self._twin = stack.still_instrument
        self._right = stack.right
        self._own = lanes.sums(self._still, self._right)
        self._cross = self._own
        if self.instruments:
            self._cross = lanes.sums(self._twin, self._right)

    def take(self, which: Int[np.ndarray, " v"]) -> AbstractEquation:
        """See `AbstractEquation`."""
        other = super().take(which)
        if isinstance(other, MatrixEquation) and other is not self:
            other._own = self._own[which]
            other._cross = self._cross[which] if self.instruments else other._own
        return other

    def sums(self, shares: Shares) -> Float[np.ndarray, "w k k1"]:
        """See `AbstractEquation`."""
        return shares.sums(self._own, self._still, self._right)

    def left(
        self, factors: Float[np.ndarray, "w k"], moving: Columns | None
    ) -> Float[np.ndarray, "w s"]:
        """See `AbstractEquation`."""
        fitted = self.lanes.along(factors[:, self.places], self._still)
        residual = self.stack.target[self.lanes.of] - fitted
        if moving is not None:
            for way, place in enumerate(self.moves):
                residual -= factors[:, place, None] * moving.values[way]
        return np.asarray(residual)

    def columns(
        self, point: Point, lane: int, *, instrument: bool = False
    ) -> Float[np.ndarray, "t p"]:
        """See `AbstractEquation`."""
        recording = int(self.lanes.of[lane])
        problem = self.stack.problems[recording]
        every = self.stack.still_instrument if instrument else self.stack.still
        many = len(problem.target)
        still = every[recording, :many]
        if point.moving is None:
            return still
        one = np.array([lane])
        if instrument:
            moving = Columns(*problem.shaped(point.shape[one], instrument=True))
        else:
            moving = point.moving.take(one)
        found = np.empty((many, self.width + self.height))
        found[:, self.places] = still
        for way, place in enumerate(self.moves):
            found[:, place] = moving.values[way, 0, :many]
        drops = point.factors[lane, self.moves]
        slopes = moving.slopes[:, :, 0, :many]
        found[:, self.width :] = np.einsum("d,hds->sh", drops, slopes)
        return found

    def held_out(
        self,
        shares: Shares,
        shape: Float[np.ndarray, "r h"],
        factors: Float[np.ndarray, "r k"],
        windows: Int[np.ndarray, "w 2"],
    ) -> tuple[
        Float[np.ndarray, "v s"], Float[np.ndarray, "v s"], Float[np.ndarray, "w h"]
    ]:
        """See `AbstractEquation`."""
        lanes, stack = self.lanes, self.stack
        columns, found = self._near(shares, shape, factors)
        held, whole = np.zeros((2, len(lanes.own), stack.rows))
        for row, every, (k, own) in zip(held, whole, lanes.own, strict=True):
            for lane in range(own.start, own.stop - 1):
                start, end = windows[lane]
                np.matmul(columns[k, start:end], found[lane], out=row[start:end])
            np.matmul(columns[k], found[own.stop - 1], out=every)
        target = stack.right[[k for k, _ in lanes.own], :, -1]
        return target - held, target - whole, found[:, self.width :]

    def _near(
        self,
        shares: Shares,
        shape: Float[np.ndarray, "r h"],
        factors: Float[np.ndarray, "r k"],
    ) -> tuple[Float[np.ndarray, "r s q"], Float[np.ndarray, "w q"]]:
        """Return columns that all fits of a recording share, and what each makes of them.

        The last ones are the tangents of the recording's law: their factors are steps in
        its shape.
        """
        if not self.height:
            none = np.zeros((len(self.lanes), 0))
            return self._still, self._linear(shares, none, None).factors
        values, slopes = self.stack.shaped(shape, np.arange(len(shape)))
        tangents = np.einsum("rd,hdrs->rsh", factors[:, self.moves], slopes)
        inner = [self._still, values.transpose(1, 2, 0)]
        right = np.concatenate([*inner, tangents, self._right[:, :, -1:]], axis=2)
        right[~self.stack.usable] = 0.0
        full = right[:, :, :-1]
        sums = shares.sums(self.lanes.sums(full, right), full, right)
        size = np.sqrt(np.einsum("rsk,rsk->rk", full, full) / full.shape[1])
        own, moment = sums[:, :, :-1], sums[:, :, -1]
        return full, solve_linear(own, own, moment, size[self.lanes.of]).factors

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
        own = self._with_prior(own[:, :, :-1])
        if self.instruments:
            matrix = self._with_prior(matrix[:, :, :-1])
        return solve_linear(own, matrix if self.instruments else own, moment, size)

    def _shaped(
        self, shape: Float[np.ndarray, "w h"], *, instrument: bool = False
    ) -> Columns:
        return Columns(*self.stack.shaped(shape, self.lanes.of, instrument=instrument))

    def _assembled(
        self, shares: Shares, left: Columns | None, right: Columns | None, *, own: bool
    ) -> tuple[Float[np.ndarray, "w k k1"], Float[np.ndarray, "w k"]]:
        """Return leftᵀ W [right, target] in the order of the factors, and column sizes."""
        twin = self._still if own else self._twin
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

    def _tangents(
        self, point: Point, moving: Columns | None = None
    ) -> Float[np.ndarray, "h w s"]:
        """Return the derivative of the fit with respect to the logarithms of the shape."""
        moving = point.moving if moving is None else moving
        assert moving is not None
        drops = point.factors[:, self.moves].T
        return np.asarray(np.einsum("dw,hdws->hws", drops, moving.slopes))

    def _pushes(
        self, point: Point
    ) -> tuple[
        Float[np.ndarray, "w k h"],
        Float[np.ndarray, "w h k"],
        Float[np.ndarray, "w h h"],
        Float[np.ndarray, "w h"],
    ]:
        """See `AbstractEquation`."""
        assert point.moving is not None
        shares = point.shares.full
        tangents = self._tangents(point)
        columns, twist = point.moving, tangents
        if self.instruments:
            columns = self._shaped(point.shape, instrument=True)
            twist = self._tangents(point, columns)
        count, high = len(self.lanes), self.height
        after = np.empty((count, self.width, high))
        before = np.empty((count, high, self.width))
        matrix, push = np.empty((count, high, high)), np.empty((count, high))
        for k in range(high):
            part = shares * tangents[k]
            after[:, self.places, k] = self.lanes.times(part, self._twin)
            bent = part if twist is tangents else shares * twist[k]
            before[:, k, self.places] = self.lanes.times(bent, self._still)
            for way, place in enumerate(self.moves):
                after[:, place, k] = np.einsum("ws,ws->w", part, columns.values[way])
                before[:, k, place] = np.einsum(
                    "ws,ws->w", bent, point.moving.values[way]
                )
            for other in range(high):
                matrix[:, k, other] = np.einsum("ws,ws->w", bent, tangents[other])
            push[:, k] = np.einsum("ws,ws->w", bent, point.residual)
        return after, before, matrix, push

    def still_and_target(self, step: int) -> Float[np.ndarray, "r s k1"]:
        """See `AbstractEquation`."""
        return self._right[:, ::step]
