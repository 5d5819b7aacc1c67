r"""Priors of the unknowns of an effect: smooth tables, independent values, none at all.

A prior has one weight per term; its precision is $\sum_k w_k D_k^T D_k$, relative to
1/noise². The rows $D_k$ are second and fourth differences of node values along the axes of
a table; a straight line along an axis is left free (on a ring: a constant).
"""

import abc
import dataclasses
import functools
from functools import cached_property
from typing import final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from ._chain import CAPS, LEAST, LONG, Chain

_STEP = 1e-3
"""Step in a log weight for slopes of the determinant, which costs little beside a factor."""

Vector = Float[np.ndarray, " _n"]


class AbstractPrior(abc.ABC):
    """A Gaussian prior of the unknowns of one effect, with one weight per term."""

    @cached_property
    @abc.abstractmethod
    def rows(self) -> tuple[sp.csr_array, ...]:
        """Rows $D_k$ of each term over the unknowns of the effect."""

    @property
    @abc.abstractmethod
    def straight(self) -> Float[np.ndarray, "n z"]:
        """What no term holds, one column per dimension."""

    @abc.abstractmethod
    def logdet(self, weights: Vector) -> float:
        """Return the log of the product of the non-zero eigenvalues of the precision."""

    def slopes(self, weights: Vector) -> Vector:
        """Return the slope of `logdet` over the logarithm of each weight; 0 for a weight of 0."""
        result = np.zeros(len(weights))
        for k in np.flatnonzero(weights):
            step = np.zeros(len(weights))
            step[k] = _STEP
            ends = [self.logdet(weights * np.exp(sign * step)) for sign in (1.0, -1.0)]
            result[k] = (ends[0] - ends[1]) / (2.0 * _STEP)
        return result

    @cached_property
    def free(self) -> int:
        """Dimension of what no term holds."""
        return int(self.straight.shape[1])

    @property
    def bounds(self) -> Float[np.ndarray, "k 2"]:
        """Least and largest log weight of each term, relative to the density."""
        return np.tile([[LEAST, np.log(CAPS[0])]], (len(self.rows), 1))

    @property
    def optional(self) -> Bool[np.ndarray, " k"]:
        """Terms that may be left out: fourth differences."""
        return np.zeros(len(self.rows), bool)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the weights as results carry them."""
        return tuple(f"term {k + 1}" for k in range(len(self.rows)))


@final
@dataclasses.dataclass(frozen=True)
class NoPrior(AbstractPrior):
    """No prior at all: each value rests on its own readings."""

    size: int

    @cached_property
    def rows(self) -> tuple[sp.csr_array, ...]:
        return ()

    @property
    def straight(self) -> Float[np.ndarray, "n z"]:
        return np.eye(self.size)

    def logdet(self, weights: Vector) -> float:
        return 0.0


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Independent(AbstractPrior):
    """Values of one variance about zero, as precision rows of full rank.

    Attributes:
        matrix: Rows whose square is the precision at weight 1; the unit matrix for
            independent values, first differences for a random walk that starts at zero.
        constant: Log-determinant of the precision at weight 1.
    """

    matrix: sp.csr_array
    constant: float = 0.0

    @cached_property
    def rows(self) -> tuple[sp.csr_array, ...]:
        return (self.matrix,)

    @property
    def straight(self) -> Float[np.ndarray, "n z"]:
        return np.zeros((int(np.asarray(self.matrix.shape)[1]), 0))

    def logdet(self, weights: Vector) -> float:
        count = float(np.asarray(self.matrix.shape)[1])
        return count * float(np.log(weights[0])) + self.constant


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Smooth(AbstractPrior):
    """Prior of a table: differences along its axes, whose precisions add up.

    Values are ordered with the last axis fastest; ``order`` says which value stands at each
    place of that grid.

    Attributes:
        slow: Along the first axis.
        fast: Along the second one; None for a table of one axis.
        branches: Tables side by side (directions of motion), each smooth by itself.
        order: Unknown at each place of the (branch, slow, fast) grid, flattened.
        axes: Numbers of both axes in the names of the weights, from 1.
    """

    slow: Chain
    fast: Chain | None
    branches: int
    order: Int[np.ndarray, " n"]
    axes: tuple[int, int] = (1, 2)

    @cached_property
    def rows(self) -> tuple[sp.csr_array, ...]:
        width = 1 if self.fast is None else self.fast.size
        left, right = sp.eye_array(self.branches), sp.eye_array(width)
        blocks = [sp.kron(left, sp.kron(rows, right)) for rows in self.slow.rows]
        if self.fast is not None:
            along = sp.eye_array(self.slow.size)
            blocks += [sp.kron(along, rows) for rows in self.fast.rows]
        return tuple(_placed(sp.coo_array(block), self.order) for block in blocks)

    def logdet(self, weights: Vector) -> float:
        if self.fast is None:
            return self.branches * self.slow.logdet(weights)
        across = _eigenvalues(self.fast, *weights[2:].tolist())
        if self.slow.size <= LONG:
            grid = _eigenvalues(self.slow, *weights[:2].tolist())[:, None] + across
            return float(np.log(grid[grid > 0.0]).sum())
        return sum(self.slow.logdet(weights[:2], value) for value in across)

    @property
    def bounds(self) -> Float[np.ndarray, "k 2"]:
        axes = [self.slow] if self.fast is None else [self.slow, self.fast]
        return np.concatenate([axis.bounds for axis in axes])

    @property
    def optional(self) -> Bool[np.ndarray, " k"]:
        return np.resize([False, True], 2 if self.fast is None else 4)

    @property
    def names(self) -> tuple[str, ...]:
        axes = self.axes[:1] if self.fast is None else self.axes
        return tuple(f"order {n}, axis {axis}" for axis in axes for n in (2, 4))

    @property
    def straight(self) -> Float[np.ndarray, "n z"]:
        if self.fast is None:
            grid = np.kron(np.eye(self.branches), self.slow.straight)
        else:
            grid = np.kron(self.slow.straight, self.fast.straight)
        result = np.zeros(grid.shape)
        result[self.order] = grid
        return result


@functools.lru_cache(maxsize=64)
def _eigenvalues(axis: Chain, second: float, fourth: float) -> Vector:
    return axis.eigenvalues(np.array([second, fourth]))


def _placed(rows: sp.coo_array, order: Int[np.ndarray, " n"]) -> sp.csr_array:
    """Return rows over a grid as rows over the unknowns that stand there."""
    row, column = rows.coords
    shape = (int(np.asarray(rows.shape)[0]), len(order))
    return sp.csr_array(sp.coo_array((rows.data, (row, order[column])), shape=shape))
