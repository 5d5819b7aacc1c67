"""What is to be explained: one column of a log, and what else is in it."""

import dataclasses
import functools
from typing import final

import numpy as np
from jaxtyping import Float

RESOLUTION = 1e-4
"""mm or °: the unit of the lists, and the smallest difference that is spoken of."""

FLOOR = RESOLUTION / 10
"""Noise in mm that is taken for granted: the arithmetic of two programs differs."""


@final
@dataclasses.dataclass(frozen=True)
class Target:
    """Measured values without what is known of them, and how well columns explain them.

    Attributes:
        values: In mm or °, shape ``(t,)``, each times the root of its weight.
        basis: Orthonormal columns that may be added freely (zero of a drive or of an
            instrument, clock), likewise weighted.
        step: Worth of the last digit of a value in mm; 0 where it is not counted.
        root: Of the weights; None: all count alike.
        band: Share by which what is added may be larger or smaller than a hypothesis says:
            machine and instrument drift.
    """

    values: Float[np.ndarray, " t"]
    basis: Float[np.ndarray, "t b"]
    step: float = 0.0
    root: Float[np.ndarray, " t"] | None = None
    band: float = 0.0

    @classmethod
    def of(
        cls,
        values: Float[np.ndarray, " t"],
        nuisance: Float[np.ndarray, "t b"] | None = None,
        step: float = 0.0,
        weight: Float[np.ndarray, " t"] | None = None,
    ) -> "Target":
        """Return a target; free columns may be anything, dependent ones too."""
        root = None if weight is None else np.sqrt(weight)
        if nuisance is None or not nuisance.shape[1]:
            weighed = values if root is None else root * values
            return cls(weighed, np.zeros((len(values), 0)), step, root)
        free = nuisance if root is None else root[:, None] * nuisance
        scaled = free / np.maximum(np.linalg.norm(free, axis=0), 1e-300)
        left, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
        basis = left[:, sizes > 1e-9 * sizes[0]]
        return cls(values, basis, step, root).but(values)

    def but(self, values: Float[np.ndarray, " t"]) -> "Target":
        """Return the target with other values, what is free taken out of them."""
        return dataclasses.replace(self, values=self.free_of(values))

    def at(self, rows: np.ndarray) -> "Target":
        """Return the target at some rows."""
        root = None if self.root is None else self.root[rows]
        part = Target.of(self.values[rows], self.basis[rows], self.step)
        return dataclasses.replace(part, root=root, band=self.band)

    def free_of(self, values: Float[np.ndarray, "*h t"]) -> Float[np.ndarray, "*h t"]:
        """Return what of columns cannot be had from the free ones, weighted."""
        if self.root is not None:
            values = self.root * values
        if not self.basis.shape[1]:
            return values
        return np.asarray(values - values @ self.basis @ self.basis.T)

    def residual(self, columns: Float[np.ndarray, "*h t"]) -> Float[np.ndarray, "*h t"]:
        """Return what columns leave of the values, in mm or °."""
        left = self.values - self.free_of(columns)
        return np.asarray(left if self.root is None else left / self.root)

    @functools.cached_property
    def power(self) -> float:
        """Sum of squares."""
        return float(self.values @ self.values)

    def fitted(
        self, columns: Float[np.ndarray, "h t"]
    ) -> tuple[
        Float[np.ndarray, " h"], Float[np.ndarray, " h"], Float[np.ndarray, " h"]
    ]:
        """Return the factors that fit columns best, what these leave, and their power.

        A column without any, or that the free ones make up, has factor 0 and power 0.
        """
        if self.root is not None:
            columns = self.root * columns
        power = np.einsum("ht,ht->h", columns, columns)
        if self.basis.shape[1]:
            power = power - np.square(columns @ self.basis).sum(axis=1)
        power = np.where(power > 1e-18 * columns.shape[1], power, 0.0)
        inner = columns @ self.values
        best = np.where(power > 0.0, inner, 0.0) / np.where(power > 0.0, power, 1.0)
        return best, self.power - best * inner, power

    def left_by(self, columns: Float[np.ndarray, "h t"]) -> Float[np.ndarray, " h"]:
        """Return the squares that columns leave, as they are or by factors in the band."""
        best, least, power = self.fitted(columns)
        factor = np.clip(best, 1.0 - self.band, 1.0 + self.band)
        return np.asarray(least + np.square(factor - best) * power)

    def criterion(
        self, squares: Float[np.ndarray, " h"], samples: float
    ) -> Float[np.ndarray, " h"]:
        """Return −2 log likelihood of sums of squares left over, noise estimated.

        Args:
            squares: Sums of squares in mm².
            samples: Number of independent rows.
        """
        floor = max(FLOOR**2, self.step**2 / 12.0)
        variance = np.maximum(squares, 0.0) / len(self.values) + floor
        return np.asarray(samples * np.log(variance))
