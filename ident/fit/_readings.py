"""Readings of one fit in memory: located once, summed as often as the loss needs it."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from ..core._loss import AbstractLoss
from ._grid import Grid, Located
from ._information import (
    Normal,
    evaluate,
    moment_sums,
    normal_from_moments,
    vector_from_moments,
)
from ._prior import TablePrior
from ._problem import Border, Problem

_RIDGE = 1e-9
"""Weight, relative to the mean information on a run effect, that holds it at zero."""


def _hold(matrix: Float[np.ndarray, "r r"]) -> float:
    return _RIDGE * float(np.trace(matrix)) / len(matrix)


@dataclasses.dataclass(frozen=True)
class Readings:
    """What was measured, located in the grid.

    Attributes:
        grid: Nodes.
        located: Cell of every reading.
        error: Reading.
        weight: Known weight.
        design: Columns of the run effects, shape (t, r); r = 0 without them.
    """

    grid: Grid
    located: Located
    error: Float[np.ndarray, " t"]
    weight: Float[np.ndarray, " t"]
    design: Float[np.ndarray, "t r"]
    _summed: list[tuple[np.ndarray, tuple[Normal, np.ndarray, np.ndarray]]] = (
        dataclasses.field(default_factory=list, init=False, repr=False, compare=False)
    )

    def residual(
        self, values: Float[np.ndarray, "l s"], effects: Float[np.ndarray, " r"]
    ) -> Float[np.ndarray, " t"]:
        """Return reading − table − run effects."""
        result = self.error - evaluate(self.grid, self.located, values)
        return np.asarray(result - self.design @ effects if len(effects) else result)

    def normal(
        self, active: Bool[np.ndarray, " t"]
    ) -> tuple[Normal, np.ndarray, np.ndarray]:
        """Return normal matrix, coupling to the run effects and their own matrix.

        The same readings as the last time give the same object: passes that no longer change
        what they believe sum and factorise nothing again.
        """
        if self._summed and np.array_equal(self._summed[0][0], active):
            return self._summed[0][1]
        sums = self._sum(active)
        self._summed[:] = [(active.copy(), sums)]
        return sums

    def _sum(
        self, active: Bool[np.ndarray, " t"]
    ) -> tuple[Normal, np.ndarray, np.ndarray]:
        weight = np.where(active, self.weight, 0.0)
        normal = normal_from_moments(
            self.grid, moment_sums(self.grid, self.located, weight, 2)
        )
        count = self.design.shape[1]
        coupling = np.zeros((self.grid.slow, self.grid.fast, count))
        for column in range(count):
            coupling[:, :, column] = self._vector(weight * self.design[:, column])
        matrix = self.design.T @ (weight[:, None] * self.design)
        if count:
            # A run of which no reading is believed has no effect to be told.
            matrix += _hold(matrix) * np.eye(count)
        return normal, coupling, matrix

    def _vector(self, weighted: Float[np.ndarray, " t"]) -> Float[np.ndarray, "l s"]:
        return vector_from_moments(
            self.grid, moment_sums(self.grid, self.located, weighted, 1)
        )

    def problem(
        self,
        prior: TablePrior,
        sums: tuple[Normal, np.ndarray, np.ndarray],
        values: Float[np.ndarray, "l s"],
        effects: Float[np.ndarray, " r"],
        pseudo: Float[np.ndarray, " t"],
        count: int,
    ) -> Problem:
        """Return the sums of pseudo-readings about the current estimate."""
        normal, coupling, matrix = sums
        weighted = self.weight * pseudo
        border = None
        if len(effects):
            hold = _hold(matrix) * effects
            border = Border(coupling, matrix, self.design.T @ weighted - hold)
        return Problem(
            normal=normal,
            prior=prior,
            vector=self._vector(weighted),
            square=float(weighted @ pseudo),
            count=count,
            values=values,
            effects=effects,
            border=border,
        )


def pseudo_readings(
    loss: AbstractLoss,
    residual: Float[np.ndarray, " t"],
    ratio: Float[np.ndarray, " t"],
    active: Bool[np.ndarray, " t"],
) -> Float[np.ndarray, " t"]:
    """Return ψ(residual) / mean ψ', and zero for readings that are left out."""
    slope = float(loss.slope(ratio).sum(where=active))
    # A mean slope near zero means that the scale is far too small: do not blow up.
    steepness = max(slope / max(int(active.sum()), 1), 0.1)
    pseudo = loss.share(ratio)
    pseudo *= residual
    pseudo /= steepness
    np.copyto(pseudo, 0.0, where=~active)
    return pseudo
