"""Equations whose rows are samples: each meets few columns, and only these are summed up."""

from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from ._equation import AbstractEquation
from ._lanes import Shares
from ._linear import Linear, solve_linear
from ._point import Columns, Point


class PairEquation(AbstractEquation):
    """Sums row by row, in machine code."""

    @property
    def _rows(self) -> tuple[np.ndarray, ...]:
        """What a row meets beside what follows the shape, as the kernel takes it."""
        stack = self.stack
        return stack.beside, stack.way, stack.place, stack.pair

    def _law(self, moving: Columns | None) -> tuple[int, int]:
        """Return the factors of one direction, and which of them has a column that moves.

        −1 where none is given, which the kernel must not look for.
        """
        structure = self.stack.structure
        third = -1 if moving is None else structure.shaped[0]
        return len(structure.factors), third

    def _normal(
        self,
        of: Int[np.ndarray, " g"],
        beside: Int[np.ndarray, " g"],
        first: Int[np.ndarray, " g"],
        end: Int[np.ndarray, " g"],
        weight: Float[np.ndarray, "n s"],
        target: Float[np.ndarray, "_ s"],
        aim: Int[np.ndarray, " g"],
        moving: Columns | None = None,
        tangents: Float[np.ndarray, "n s h"] | None = None,
    ) -> Float[np.ndarray, "g q q1"]:
        """Return XᵀW [X, target] over ranges of rows.

        Args:
            of: Recording of each range.
            beside: Where its weights are, what follows the shape, and the tangents.
            first: Its first row.
            end: The one after its last.
            weight: Of the rows.
            target: What columns are to meet.
            aim: Where it is, for each range.
            moving: What follows the shape.
            tangents: Further columns, after those beside friction.
        """
        from . import _kernel

        more, drop = _given(moving, tangents, weight.shape)
        size = self.width + more.shape[2]
        found = np.empty((len(of), size, size + 1))
        columns, *rows = self._rows
        _kernel.normal(
            *(columns, more, *rows, drop, *self._law(moving)),
            *(of, beside, first, end, weight, target, aim, found),
        )
        return found

    @property
    def _all(
        self,
    ) -> tuple[
        Int[np.ndarray, " w"],
        Int[np.ndarray, " w"],
        Int[np.ndarray, " w"],
        Int[np.ndarray, " w"],
    ]:
        """Of each fit its recording, itself, and the ends of all rows, as ranges go."""
        each = np.arange(len(self.lanes))
        return self.lanes.of, each, 0 * each, np.full(len(each), self.stack.rows)

    def _sums(
        self, shares: Shares, moving: Columns | None
    ) -> Float[np.ndarray, "w k k1"]:
        """Return XᵀW [X, target] of each fit."""
        of = self.lanes.of
        return self._normal(*self._all, shares.full, self.stack.target, of, moving)

    def sums(self, shares: Shares) -> Float[np.ndarray, "w k k1"]:
        """See `AbstractEquation`."""
        return self._sums(shares, None)

    def _linear(
        self, shares: Shares, shape: Float[np.ndarray, "w h"], moving: Columns | None
    ) -> Linear:
        of = self.lanes.of
        size = self._size[of]
        if moving is not None:
            size[:, self.moves] = self._size_of_drop(moving)
        sums = self._sums(shares, moving)
        own = self._with_prior(sums[:, :, :-1])
        return solve_linear(own, own, sums[:, :, -1], size)

    @cached_property
    def _size(self) -> Float[np.ndarray, "r k"]:
        """RMS of the columns that follow no shape over all rows of each recording."""
        from . import _kernel

        stack = self.stack
        squares = np.empty((len(stack.problems), self.width))
        rows = stack.beside, stack.place, stack.pair, stack.usable
        _kernel.squares(*rows, squares)
        return np.asarray(np.sqrt(squares / stack.lengths[:, None]))

    def _size_of_drop(self, moving: Columns) -> Float[np.ndarray, "w d"]:
        """RMS of the columns that do, per direction."""
        from . import _kernel

        stack, of = self.stack, self.lanes.of
        squares = np.empty((len(of), len(self.moves)))
        drop = np.ascontiguousarray(moving.values[0])
        _kernel.squares_of_drop(stack.way, drop, of, squares)
        return np.asarray(np.sqrt(squares / stack.lengths[of, None]))

    def _factors(
        self, sums: Float[np.ndarray, "w q q1"], size: Float[np.ndarray, "w q"]
    ) -> Float[np.ndarray, "w q"]:
        """Return the solutions alone: of least norm where columns are not told apart."""
        from . import _kernel

        own, moment = self._with_prior(sums[:, :, :-1]), sums[:, :, -1]
        found, sure = np.empty_like(size), np.empty(len(size), bool)
        _kernel.solve(own, moment, size, found, sure)
        left = np.flatnonzero(~sure)
        if len(left):
            some = own[left]
            found[left] = solve_linear(some, some, moment[left], size[left]).factors
        return found

    def left(
        self, factors: Float[np.ndarray, "w k"], moving: Columns | None
    ) -> Float[np.ndarray, "w s"]:
        """See `AbstractEquation`."""
        found = np.empty((len(self.lanes), self.stack.rows))
        self._put_left(*self._all, factors, moving, found)
        return found

    def _put_left(
        self,
        of: Int[np.ndarray, " g"],
        beside: Int[np.ndarray, " g"],
        first: Int[np.ndarray, " g"],
        end: Int[np.ndarray, " g"],
        factors: Float[np.ndarray, "g q"],
        moving: Columns | None,
        found: Float[np.ndarray, "v s"],
        tangents: Float[np.ndarray, "n s h"] | None = None,
        into: Int[np.ndarray, " g"] | None = None,
    ) -> None:
        """Write target − fit of ranges of rows, each where ``beside`` or ``into`` says."""
        from . import _kernel

        shape = (len(found) if tangents is None else len(tangents), self.stack.rows)
        more, drop = _given(moving, tangents, shape)
        columns, *rows = self._rows
        into = beside if into is None else into
        factors = np.ascontiguousarray(factors)
        _kernel.left(
            *(columns, more, *rows, drop, *self._law(moving)),
            *(of, beside, first, end, factors, self.stack.target, into, found),
        )

    def columns(
        self, point: Point, lane: int, *, instrument: bool = False
    ) -> Float[np.ndarray, "t p"]:
        """See `AbstractEquation`."""
        from . import _kernel

        k, one = int(self.lanes.of[lane]), np.array([lane])
        moving = None if point.moving is None else point.moving.take(one)
        tangents = None
        if moving is not None:
            tangents = self._tangents(point.factors[one], moving, one)
        more, drop = _given(moving, tangents, (1, self.stack.rows))
        beside, *rows = self._rows
        many = len(self.stack.problems[k].target)
        found = np.empty((many, self.width + self.height))
        law = self._law(moving)
        _kernel.columns(beside, more, *rows, drop, *law, k, 0, found)
        return found

    def _shaped(self, shape: Float[np.ndarray, "w h"]) -> Columns:
        """Return the column that follows the shape, whatever the direction and its sign."""
        values, slopes = self.stack.profiles(shape, self.lanes.of)
        return Columns(values[None], slopes[:, None])

    def _tangents(
        self,
        factors: Float[np.ndarray, "n k"],
        moving: Columns,
        lanes: Int[np.ndarray, " n"] | None = None,
    ) -> Float[np.ndarray, "n s h"]:
        """Return the derivatives of the fit with respect to the logarithms of the shape.

        Args:
            factors: Fit by fit.
            moving: Columns that follow the shape.
            lanes: Which fits these are; by recording where left out.
        """
        stack = self.stack
        of = slice(None) if lanes is None else self.lanes.of[lanes]
        drop = factors[:, self.moves[:1]]
        if len(self.moves) > 1:
            drop = np.where(stack.way[of] > 0, factors[:, self.moves[1:]], drop)
        return np.ascontiguousarray(np.moveaxis(drop * moving.slopes[:, 0], 0, 2))

    def _pushes(
        self, point: Point
    ) -> tuple[
        Float[np.ndarray, "w k h"],
        Float[np.ndarray, "w h k"],
        Float[np.ndarray, "w h h"],
        Float[np.ndarray, "w h"],
    ]:
        assert point.moving is not None
        every = np.arange(len(self.lanes))
        tangents = self._tangents(point.factors, point.moving, every)
        weight, residual = point.shares.full, point.residual
        sums = self._normal(*self._all, weight, residual, every, point.moving, tangents)
        bent, factors = self._apart()
        # As they lie in memory for one fit: what is picked out of several lies otherwise,
        # and products would be rounded otherwise.
        matrix = np.ascontiguousarray(sums[:, bent[:, None], bent])
        after = np.ascontiguousarray(sums[:, factors[:, None], bent])
        return after, np.swapaxes(after, 1, 2), matrix, sums[:, bent, -1]

    def _apart(self) -> tuple[Int[np.ndarray, " h"], Int[np.ndarray, " k"]]:
        """Return where tangents stand among all columns, and where the factors do."""
        fixed = self.stack.beside.shape[2]
        places = np.arange(self.width + self.height)
        bent = places[fixed : fixed + self.height]
        return bent, np.delete(places, bent)

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
        stack, lanes = self.stack, self.lanes
        moving = tangents = None
        if self.height:
            values, slopes = stack.profiles(shape, None)
            moving = Columns(values[None], slopes[:, None])
            tangents = self._tangents(factors, moving)
        weight = np.zeros((len(stack.problems), stack.rows))
        weight[lanes.of[lanes.last]] = shares.full[lanes.last]
        of, first, end = lanes.stretches
        parts = self._normal(
            of, of, first, end, weight, stack.target, of, moving, tangents
        )
        width, begin = parts.shape[1], 0
        sums = np.empty((len(lanes), width * (width + 1)))
        size = np.empty((len(lanes), width))
        for k, own in lanes.own:
            many = len(lanes.edges[k]) - 1
            part = parts[begin : begin + many].reshape(many, -1)
            np.dot(lanes.member[own, :many], part, out=sums[own])
            whole = part.sum(axis=0).reshape(1, width, width + 1)
            size[own] = _sizes(whole, stack.lengths[k : k + 1])
            begin += many
        found = self._factors(sums.reshape(-1, width, width + 1), size)
        left = np.zeros((2, len(lanes.own), stack.rows))
        # The last fit of a recording is that of all rows.
        every = np.zeros(len(lanes), bool)
        every[lanes.last] = True
        into = np.cumsum(every) - every
        for some, row in ((~every, left[0]), (every, left[1])):
            of, place = lanes.of[some], into[some]
            first, end = np.ascontiguousarray(windows[some].T)
            self._put_left(
                of, of, first, end, found[some], moving, row, tangents, place
            )
        return left[0], left[1], found[:, self._apart()[0]]

    def still_and_target(self, step: int) -> Float[np.ndarray, "r s k1"]:
        """See `AbstractEquation`."""
        stack = self.stack
        fixed, width = stack.beside.shape[2], len(self.places)
        beside = stack.beside[:, ::step]
        found = np.zeros((*beside.shape[:2], width + 1))
        found[:, :, :fixed] = beside
        # Factors whose columns follow a shape, the last of each direction, are left out.
        skipped = len(stack.structure.shaped) * stack.way[:, ::step]
        at = fixed + stack.place[:, ::step] - skipped
        places = np.stack([at, at + 1], axis=2)
        np.put_along_axis(found, places, stack.pair[:, ::step], axis=2)
        found[:, :, width] = stack.target[:, ::step]
        return found


def _given(
    moving: Columns | None,
    tangents: Float[np.ndarray, "n s h"] | None,
    shape: tuple[int, int],
) -> tuple[Float[np.ndarray, "n s h"], Float[np.ndarray, "m s"]]:
    """Return further columns and what follows the shape as the kernel takes them."""
    more = np.zeros((*shape, 0)) if tangents is None else tangents
    drop = np.zeros((0, shape[1])) if moving is None else moving.values[0]
    return more, np.ascontiguousarray(drop)


def _sizes(
    sums: Float[np.ndarray, "n q q1"], rows: Int[np.ndarray, " n"]
) -> Float[np.ndarray, "n q"]:
    """Return the RMS of each column, given sums over all rows."""
    square = np.einsum("wkk->wk", sums[:, :, :-1])
    return np.asarray(np.sqrt(square / rows[:, None]))
