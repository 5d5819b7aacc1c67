"""A law solved at given weights and shapes, for several choices of rows."""

import dataclasses
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from ._lanes import Shares
from ._linear import Linear


@dataclasses.dataclass(frozen=True, eq=False)
class Columns:
    """Columns that follow the shape, fit by fit.

    Attributes:
        values: Per direction with factors of its own.
        slopes: Derivatives with respect to the logarithms of the shape.
    """

    values: Float[np.ndarray, "d w s"]
    slopes: Float[np.ndarray, "h d w s"]

    def take(self, which: Int[np.ndarray, " v"]) -> "Columns":
        """Return those of some of the fits."""
        return Columns(self.values[:, which], self.slopes[:, :, which])


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """What was solved at given weights and shapes.

    Attributes:
        shares: The weights.
        shape: The logarithms.
        moving: Columns that follow the shape.
        linear: Factors, and the inverse of the normal matrices.
        residual: Target − fit per row, used or not.
    """

    shares: Shares
    shape: Float[np.ndarray, "w h"]
    moving: Columns | None
    linear: Linear
    residual: Float[np.ndarray, "w s"]

    @property
    def factors(self) -> Float[np.ndarray, "w k"]:
        """Linear factors, fixed columns first."""
        return self.linear.factors

    @property
    def null(self) -> tuple[Float[np.ndarray, "k _"], ...]:
        """Directions of the factors that no sample moves, as columns, per fit."""
        return self.linear.null

    @cached_property
    def cost(self) -> Float[np.ndarray, " w"]:
        """Weighted sum of squares."""
        weighted = self.shares.full * self.residual
        # A product for each fit: the same bits in any company.
        return np.asarray((weighted[:, None] @ self.residual[:, :, None])[:, 0, 0])

    def take(self, which: Int[np.ndarray, " v"]) -> "Point":
        """Return some of the fits."""
        linear = Linear(
            self.linear.factors[which],
            self.linear.inverse[which],
            tuple(self.linear.null[k] for k in which),
            self.linear.size[which],
        )
        return Point(
            self.shares.take(which),
            self.shape[which],
            None if self.moving is None else self.moving.take(which),
            linear,
            self.residual[which],
        )

    def put(self, which: Int[np.ndarray, " v"], other: "Point") -> "Point":
        """Return the point with some of the fits replaced; the weights are the same."""
        if not len(which):
            return self
        linear = Linear(
            self.linear.factors.copy(),
            self.linear.inverse.copy(),
            tuple(
                other.null[list(which).index(k)] if k in which else null
                for k, null in enumerate(self.null)
            ),
            self.linear.size.copy(),
        )
        linear.factors[which] = other.linear.factors
        linear.inverse[which] = other.linear.inverse
        linear.size[which] = other.linear.size
        shape, residual = self.shape.copy(), self.residual.copy()
        shape[which], residual[which] = other.shape, other.residual
        moving = self.moving
        if moving is not None and other.moving is not None:
            moving = Columns(moving.values.copy(), moving.slopes.copy())
            moving.values[:, which] = other.moving.values
            moving.slopes[:, :, which] = other.moving.slopes
        return Point(self.shares, shape, moving, linear, residual)
