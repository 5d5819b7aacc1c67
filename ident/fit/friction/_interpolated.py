"""Shapes of laws for many choices of rows, searched in sums about one that is nearly theirs.

Without one window of ten, a recording's law has nearly the shape that all rows give it. There
the column that follows the shape is interpolated between those of a few shapes: sums over the
rows are made once for all choices, and the search goes on in them, row for row to the tenth
digit. Source for the nodes: L. N. Trefethen, Approximation Theory and Approximation Practice,
chapter 2.
"""

import copy

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial import chebyshev

from ._equation import AbstractEquation
from ._lanes import Shares
from ._linear import solve_linear

_REACH = 0.1
"""Distance of a logarithm up to which columns are interpolated."""
_NODES = 8
"""Shapes between which they are: the error is below 1e-10 of the column."""
_STEPS = 12
_STILL = 1e-9
"""Step of a logarithm of the shape after which the next one would be lost in rounding."""
_INSIDE = 0.9
"""Share of the reach within which a shape must end."""


class Interpolated:
    """A law with one number of shape near that of each recording, in sums over its rows."""

    def __init__(
        self, equation: AbstractEquation, about: Float[np.ndarray, "r 1"]
    ) -> None:
        """Make the sums.

        Args:
            equation: The law, for several choices of rows.
            about: Logarithm of each recording's shape.
        """
        self._bounds, self._lanes = equation.bounds, equation.lanes
        self._centre = about[equation.lanes.of]
        stack = equation.stack
        angle = np.pi * (np.arange(_NODES) + 0.5) / _NODES
        shapes = (about + _REACH * np.cos(angle)).reshape(-1, 1)
        values = stack.shaped_values(shapes, np.repeat(np.arange(len(about)), _NODES))
        ways, _, rows = values.shape
        # Node by node, each with a column per direction.
        apart = values.reshape(ways, len(about), _NODES, rows).transpose(1, 3, 2, 0)
        still = equation.still_and_target(1)
        self._still = still.shape[2] - 1
        self._right = np.concatenate([still, apart.reshape(len(about), rows, -1)], 2)
        self._right[~stack.usable] = 0.0
        self._sums = self._lanes.sums(self._right, self._right)

    def take(self, which: Int[np.ndarray, " v"]) -> "Interpolated":
        """Return it for some of the choices of rows."""
        other = copy.copy(self)
        other._lanes = self._lanes.take(which)
        other._sums, other._centre = self._sums[which], self._centre[which]
        low, high = self._bounds
        other._bounds = low[which], high[which]
        return other

    def shapes(
        self, shares: Shares
    ) -> tuple[Float[np.ndarray, "w 1"], Bool[np.ndarray, " w"]]:
        """Return the best shape of each fit near its recording's, and whether it is there.

        Args:
            shares: Weights of the rows.
        """
        rest = self._rest(shares)
        count, (low, high) = len(rest), self._bounds
        place, before = np.zeros(count), np.full(count, 1e-3)
        slope, slope_before = _slope(rest, place), _slope(rest, before)
        rising = np.ones(count, bool)
        for _ in range(_STEPS):
            change, run = slope - slope_before, place - before
            moving = np.abs(run) > _STILL
            rising = np.where(moving, change * run > 0.0, rising)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.where(moving & rising, -slope * run / change, 0.0)
            before, slope_before = place, slope
            if not step.any():
                break
            place = np.clip(place + step, -_REACH, _REACH)
            slope = _slope(rest, place)
        found = self._centre + place[:, None]
        there = rising & (np.abs(place) < _INSIDE * _REACH)
        there &= np.abs(place - before) <= _STILL
        there &= ((found > low) & (found < high))[:, 0]
        return found, there

    def _rest(self, shares: Shares) -> Float[np.ndarray, "w q q"]:
        """Return XᵀWX of the target and of all nodes, still columns taken out."""
        sums, size = shares.sums(self._sums, self._right, self._right), self._still
        own = sums[:, :size, :size]
        scale = np.sqrt(np.einsum("wkk->wk", own))
        linear = solve_linear(own, own, sums[:, :size, size], scale)
        beside = sums[:, :size, size:]
        follow = np.swapaxes(beside, 1, 2) @ linear.inverse
        return np.asarray(sums[:, size:, size:] - follow @ beside)


def _slope(
    rest: Float[np.ndarray, "w q q"], place: Float[np.ndarray, " w"]
) -> Float[np.ndarray, " w"]:
    """Return the derivative of half the cost with respect to the shape, drops following."""
    count, ways = len(rest), (rest.shape[1] - 1) // _NODES
    value, bent = _shares_of_nodes(place / _REACH)
    blocks = rest[:, 1:, 1:].reshape(count, _NODES, ways * _NODES * ways)

    def along(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        half = (one[:, None] @ blocks).reshape(count, ways, _NODES, ways)
        half = half.transpose(0, 1, 3, 2)
        return np.asarray((half @ other[:, None, :, None])[..., 0])

    target = rest[:, 0, 1:].reshape(count, _NODES, ways)
    drop = np.linalg.solve(
        along(value, value) + _ridge(rest), (value[:, None] @ target)[:, 0, :, None]
    )[:, :, 0]
    push = (bent[:, None] @ target)[:, 0]
    bend = (along(bent, value) @ drop[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("wd,wd->w", drop, bend - push) / _REACH)


def _ridge(rest: Float[np.ndarray, "w q q"]) -> Float[np.ndarray, "w d d"]:
    """Return what keeps a direction without rows from stopping the others."""
    ways = (rest.shape[1] - 1) // _NODES
    size = np.einsum("wqq->w", rest[:, 1:, 1:])
    return np.asarray(1e-14 * np.maximum(size, 1e-300)[:, None, None] * np.eye(ways))


def _shares_of_nodes(
    place: Float[np.ndarray, " w"],
) -> tuple[Float[np.ndarray, "w m"], Float[np.ndarray, "w m"]]:
    """Return shares of Chebyshev's nodes in what lies between them, and their derivatives.

    Args:
        place: From −1 to 1.
    """
    order = np.arange(_NODES)
    angle = np.pi * (order + 0.5) / _NODES
    weight = chebyshev.chebvander(np.cos(angle), _NODES - 1)
    weight *= np.where(order > 0, 2.0, 1.0) / _NODES
    # A product for each place, its numbers in a row: the same bits in any company.
    here = np.ascontiguousarray(chebyshev.chebvander(place, _NODES - 1))
    bent = here[:, None, :-1] @ (chebyshev.chebder(np.eye(_NODES)) @ weight.T)
    return (here[:, None] @ weight.T)[:, 0], bent[:, 0]
