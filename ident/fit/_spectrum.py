"""A spectral stand-in for the evidence of a large plane: where to begin, and how it bends."""

import dataclasses
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from ._logs import HIGH, LEAST, LOW, spread_logs
from ._modes import Modes, modes_of
from ._posterior import Posterior, Problem, solve
from ._prior import Smoothness

WORTH = 2.0
"""Gain in evidence below which the fourth differences are left out."""
_NONE = 1e-30
"""Precision of a mode that no penalty holds."""


def spectral_start(
    problem: Problem, density: float, active: Bool[np.ndarray, " 4"]
) -> "tuple[Spectrum, Float[np.ndarray, ' 4']] | None":
    """Return the surrogate and its best logs; fourth differences only where worth it.

    The modes of second differences bend nowhere at the ends of the table, those of fourth
    differences may: smooth errors need the latter, or their ends look rough.
    """
    weight = 1e-3 * density
    light = solve(problem, Smoothness((weight, 0.0), (weight, 0.0)))
    if light is None:
        return None
    bases = np.log((1e-2, 1.0, 1e2, 1e4))
    plain = active & np.array([True, False, True, False])
    rough = Spectrum.of(light, 2)
    rough_cost, rough_log = rough.descend(plain, [np.full(4, base) for base in bases])
    if not active[1::2].any():
        return rough, rough_log
    smooth = Spectrum.of(light, 4)
    starts = [np.where(plain, base, base + np.log(30.0)) for base in bases]
    starts.append(np.where(plain, rough_log, rough_log[[0, 0, 2, 2]] + np.log(1e2)))
    smooth_cost, smooth_log = smooth.descend(active, starts)
    if smooth_cost < rough_cost - WORTH:
        return smooth, smooth_log
    return rough, rough_log


@dataclasses.dataclass(frozen=True)
class Spectrum:
    """A light fit of a plane in the eigenbasis of second differences: uniform readings assumed.

    Attributes:
        slow: Modes along the slow axis; ``fast`` along the fast one.
        power: Squared coefficients of the light fit.
        variance: Of one coefficient: noise² / information.
    """

    slow: Modes
    fast: Modes
    power: Float[np.ndarray, "l s"]
    variance: float

    @classmethod
    def of(cls, light: Posterior, order: int) -> "Spectrum":
        """Build the surrogate from a light fit, in the modes of one order of differences."""
        problem = light.problem
        assert problem.prior.fast is not None
        slow = modes_of(problem.prior.slow, order)
        fast = modes_of(problem.prior.fast, order)
        power = np.square(slow.dual.T @ light.values @ fast.dual)
        spare = max(problem.count - problem.normal.grid.size, 0.1 * problem.count)
        return cls(
            slow, fast, power, light.residual_square / spare / problem.normal.density
        )

    @cached_property
    def _terms(self) -> Float[np.ndarray, "4 n"]:
        """Penalty of every mode by each of the four terms, for weight 1."""
        slow, fast = self.slow, self.fast
        products = (
            np.outer(slow.second, fast.size),
            np.outer(slow.fourth, fast.size),
            np.outer(slow.size, fast.second),
            np.outer(slow.size, fast.fourth),
        )
        return np.stack([product.reshape(-1) for product in products])

    @cached_property
    def _power(self) -> Float[np.ndarray, " n"]:
        return np.asarray(self.power.reshape(-1) / self.variance)

    @staticmethod
    def _weights(log: Float[np.ndarray, " 4"]) -> Float[np.ndarray, " 4"]:
        weights = np.asarray(np.exp(log))
        weights[1::2][log[1::2] <= LOW + 1e-9] = 0.0
        return weights

    def cost(
        self, log: Float[np.ndarray, " 4"], louder: float
    ) -> tuple[float, Float[np.ndarray, " 5"]]:
        """Return the surrogate of `Posterior.evidence` and its slope.

        ``louder`` is the log by which uneven density raises the noise of the modes.
        """
        weights = self._weights(log)
        precision = np.maximum(weights @ self._terms, _NONE)
        free = precision > _NONE
        # Relative to the variance of a coefficient.
        spread = (1.0 + 1.0 / precision) * np.exp(louder)
        share = self._power / spread
        excess = np.where(free, 1.0 - share, 0.0)
        cost = float((np.log(self.variance * spread) + share).sum(where=free))
        scale = -excess / (1.0 + precision) / precision
        return cost, np.append(weights * (self._terms @ scale), excess.sum())

    def information(self, log: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "4 4"]:
        """Return the expected second derivative of the cost, lifted off zero."""
        columns = self._weights(log)[:, None] * self._terms
        precision = np.maximum(columns.sum(axis=0), _NONE)
        scale = np.where(precision > _NONE, 1.0 / (precision * (1.0 + precision)), 0.0)
        columns = scale * columns
        return np.asarray(columns @ columns.T + np.eye(4))

    def descend(
        self, mask: Bool[np.ndarray, " 4"], starts: list[Float[np.ndarray, " 4"]]
    ) -> tuple[float, Float[np.ndarray, " 4"]]:
        """Return the best cost and logs over the weights in ``mask``."""
        keep = np.append(mask, True)

        def cost(
            reduced: Float[np.ndarray, " k"],
        ) -> tuple[float, Float[np.ndarray, " k"]]:
            value, slope = self.cost(
                spread_logs(mask, reduced[:-1]), float(reduced[-1])
            )
            return value, slope[keep]

        bounds = [*zip(LEAST[mask], HIGH[mask], strict=True), (-0.7, 2.0)]
        results = [
            minimize(
                cost, np.append(np.clip(log, LEAST + 0.5, HIGH)[mask], 0.0), jac=True,
                bounds=bounds, method="L-BFGS-B", options={"maxiter": 60},
            )
            for log in starts
        ]  # fmt: skip
        best = min(results, key=lambda found: float(found.fun))
        return float(best.fun), spread_logs(mask, best.x[:-1])
