"""The smoothness prior of a whole table.

Along two axes the penalties of both (`ChainPrior`) add up, so that the prior precision is a
Kronecker sum and its determinant follows from those of the axes.
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ._bands import Weights
from ._chain import LONG, ChainPrior


@dataclasses.dataclass(frozen=True)
class Smoothness:
    """Weights of the differences along the slow and along the fast axis."""

    slow: Weights
    fast: Weights = (0.0, 0.0)

    def names(self, slow_axis: int) -> dict[str, float]:
        """Return the weights under the names that results carry; axes count from 1."""
        fast_axis = 3 - slow_axis
        parts = {slow_axis: self.slow}
        if any(self.fast):
            parts[fast_axis] = self.fast
        return {
            f"order {order}, axis {axis}": float(weight)
            for axis in sorted(parts)
            for order, weight in zip((2, 4), parts[axis], strict=True)
        }

    @classmethod
    def named(cls, weights: Mapping[str, float], slow_axis: int) -> "Smoothness":
        """Return the weights from the names that results carry."""
        slow, fast = (
            tuple(weights.get(f"order {order}, axis {axis}", 0.0) for order in (2, 4))
            for axis in (slow_axis, 3 - slow_axis)
        )
        return cls((slow[0], slow[1]), (fast[0], fast[1]))


@dataclasses.dataclass(frozen=True)
class TablePrior:
    """Prior of a whole table: the Kronecker sum of its axes.

    Attributes:
        slow: Along the slow axis.
        fast: Along the fast axis; None where that counts branches, which share only the weights.
        branches: Length of the fast axis where there is no prior along it.
    """

    slow: ChainPrior
    fast: ChainPrior | None
    branches: int = 1

    @property
    def null(self) -> int:
        """Dimension of what the prior leaves alone."""
        return self.slow.null * (self.branches if self.fast is None else self.fast.null)

    def penalty(
        self, smoothness: Smoothness, values: Float[np.ndarray, "l s"]
    ) -> float:
        """Return the penalty of a table of node values over (slow, fast)."""
        result = self.slow.penalty(smoothness.slow, values)
        if self.fast is not None:
            result += self.fast.penalty(smoothness.fast, values.T)
        return result

    def apply(
        self, smoothness: Smoothness, values: Float[np.ndarray, "l s"]
    ) -> Float[np.ndarray, "l s"]:
        """Return precision × values."""
        result = np.zeros_like(values)
        axes = [(self.slow, smoothness.slow, values, result)]
        if self.fast is not None:
            axes.append((self.fast, smoothness.fast, values.T, result.T))
        for chain, weights, columns, out in axes:
            for weight, rows in zip(weights, (chain.second, chain.fourth), strict=True):
                if weight:
                    out += weight * (rows.T @ (rows @ columns))
        return result

    def logdet(self, smoothness: Smoothness) -> float:
        """Return the log of the product of the non-zero eigenvalues of the precision."""
        if self.fast is None:
            return self.branches * self.slow.logdet_shifted(smoothness.slow, 0.0)
        shifts = self.fast.eigenvalues(smoothness.fast)
        if self.slow.size <= LONG:
            # Of stiff chains a band factor of the shifted matrix has lost the small ones.
            both = self.slow.eigenvalues(smoothness.slow)[:, None] + shifts
            return float(np.log(both[both > 0]).sum())
        return sum(self.slow.logdet_shifted(smoothness.slow, shift) for shift in shifts)
