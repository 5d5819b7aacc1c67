"""What is to be explained: one column of a log, and what else is in it."""

import dataclasses
import functools
from typing import final

import numpy as np
from jaxtyping import Float

RESOLUTION = 1e-4
"""mm or °: the unit of the lists, and the smallest difference that is spoken of."""

_FLOOR = RESOLUTION / 10
"""Noise in mm that is taken for granted: the arithmetic of two programs differs."""


@final
@dataclasses.dataclass(frozen=True)
class Target:
    """A column of a log without what is known of it.

    Attributes:
        values: In mm or °, shape ``(t,)``.
        basis: Orthonormal columns that may be added freely (zero of the drive, clock).
        step: Worth of its last digit in mm; 0 where it is not counted.
    """

    values: Float[np.ndarray, " t"]
    basis: Float[np.ndarray, "t b"]
    step: float = 0.0

    @classmethod
    def of(
        cls,
        values: Float[np.ndarray, " t"],
        nuisance: Float[np.ndarray, "t b"] | None = None,
        step: float = 0.0,
    ) -> "Target":
        """Return a target; free columns may be anything, dependent ones too."""
        if nuisance is None or not nuisance.shape[1]:
            return cls(values, np.zeros((len(values), 0)), step)
        scaled = nuisance / np.maximum(np.linalg.norm(nuisance, axis=0), 1e-300)
        left, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
        basis = left[:, sizes > 1e-9 * sizes[0]]
        return cls(values, basis, step).but(values)

    def but(self, values: Float[np.ndarray, " t"]) -> "Target":
        """Return the target with other values, what is free taken out of them."""
        return dataclasses.replace(self, values=self.free_of(values))

    def at(self, rows: np.ndarray) -> "Target":
        """Return the target at some rows."""
        return Target.of(self.values[rows], self.basis[rows], self.step)

    def free_of(self, values: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return what of a column cannot be had from the free ones."""
        if not self.basis.shape[1]:
            return values
        return np.asarray(values - self.basis @ (self.basis.T @ values))

    @functools.cached_property
    def power(self) -> float:
        """Sum of squares."""
        return float(self.values @ self.values)

    def products(self, column: Float[np.ndarray, " t"]) -> tuple[float, float]:
        """Return the column's product with the target, and with itself."""
        if not self.basis.shape[1]:
            return float(self.values @ column), float(column @ column)
        inner = self.basis.T @ column
        return float(self.values @ column), float(column @ column - inner @ inner)

    def criterion(self, squares: float, samples: float) -> float:
        """Return −2 log likelihood of a sum of squares left over, noise estimated.

        Args:
            squares: Sum of squares in mm².
            samples: Number of independent rows.
        """
        floor = max(_FLOOR**2, self.step**2 / 12.0)
        return samples * float(np.log(max(squares, 0.0) / len(self.values) + floor))
