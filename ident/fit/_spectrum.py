"""A spectral stand-in for the evidence of a large plane: where to begin, and how it bends."""

import dataclasses
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from ._logs import LEAST, LOW, spread_logs
from ._modes import Modes, modes_of
from ._posterior import Posterior

WORTH = 2.0
"""Gain in evidence below which the fourth differences are left out."""
_CLOSELY = {"maxiter": 200, "ftol": 1e-15, "gtol": 1e-7}
"""To the digits that the surrogate has."""
SHARE = 0.5
"""How much the evidence bends, relative to the surrogate: what was seen on rough and on smooth
planes alike."""
_NONE = 1e-30
"""Precision of a mode that no penalty holds."""


def spectral_start(
    light: Posterior, active: Bool[np.ndarray, " 4"], high: Float[np.ndarray, " 4"]
) -> "tuple[Spectrum, Float[np.ndarray, ' 4'], float]":
    """Return the surrogate, its best logs and how much louder the modes are.

    Fourth differences are there only where they are worth it.
    The modes of second differences bend nowhere at the ends of the table, those of fourth
    differences may: smooth errors need the latter, or their ends look rough.
    """
    bases = np.log((1e-2, 1.0, 1e2, 1e4))
    plain = active & np.array([True, False, True, False])
    rough = Spectrum.of(light, 2)
    rough_cost, rough_log, rough_louder = rough.descend(
        plain, [np.full(4, base) for base in bases], high
    )
    if not active[1::2].any():
        return rough, rough_log, rough_louder
    smooth = Spectrum.of(light, 4)
    starts = [np.where(plain, base, base + np.log(30.0)) for base in bases]
    starts.append(np.where(plain, rough_log, rough_log[[0, 0, 2, 2]] + np.log(1e2)))
    smooth_cost, smooth_log, smooth_louder = smooth.descend(active, starts, high)
    if smooth_cost < rough_cost - WORTH:
        return smooth, smooth_log, smooth_louder
    return rough, rough_log, rough_louder


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
        """Return the expected second derivative of the cost."""
        columns = self._weights(log)[:, None] * self._terms
        precision = np.maximum(columns.sum(axis=0), _NONE)
        scale = np.where(precision > _NONE, 1.0 / (precision * (1.0 + precision)), 0.0)
        columns = scale * columns
        return np.asarray(columns @ columns.T)

    def descend(
        self,
        mask: Bool[np.ndarray, " 4"],
        starts: list[Float[np.ndarray, " 4"]],
        high: Float[np.ndarray, " 4"],
    ) -> tuple[float, Float[np.ndarray, " 4"], float]:
        """Return the best cost and logs over the weights in ``mask``, and how much louder."""
        keep = np.append(mask, True)

        def cost(
            reduced: Float[np.ndarray, " k"],
        ) -> tuple[float, Float[np.ndarray, " k"]]:
            value, slope = self.cost(
                spread_logs(mask, reduced[:-1]), float(reduced[-1])
            )
            return value, slope[keep]

        bounds = [*zip(LEAST[mask], high[mask], strict=True), (-0.7, 2.0)]
        results = [
            minimize(
                cost, np.append(np.clip(log, LEAST + 0.5, high)[mask], 0.0), jac=True,
                bounds=bounds, method="L-BFGS-B", options={"maxiter": 60},
            )
            for log in starts
        ]  # fmt: skip
        best = min(results, key=lambda found: float(found.fun))
        # To the end, which is then one of the data and not of the way there.
        best = minimize(
            cost, best.x, jac=True, bounds=bounds, method="L-BFGS-B", options=_CLOSELY
        )
        return float(best.fun), spread_logs(mask, best.x[:-1]), float(best.x[-1])

    def best_near(
        self,
        mask: Bool[np.ndarray, " 4"],
        log: Float[np.ndarray, " 4"],
        louder: float,
        slope: Float[np.ndarray, " 4"],
        radius: float,
        high: Float[np.ndarray, " 4"],
    ) -> Float[np.ndarray, " 4"]:
        """Return the best logs of what bends as the evidence does and has a given slope.

        Args:
            mask: Which weights may move.
            log: Where the slope is known.
            louder: As `descend` returned it.
            slope: Of the evidence.
            radius: Largest step.
            high: Upper ends.
        """
        here, own = self.cost(log, louder)
        bend = (slope - SHARE * own[:-1])[mask]
        start = log[mask]

        def cost(
            reduced: Float[np.ndarray, " k"],
        ) -> tuple[float, Float[np.ndarray, " k"]]:
            moved = log.copy()
            moved[mask] = reduced
            value, rise = self.cost(moved, louder)
            pull = float(bend @ (reduced - start))
            return SHARE * (value - here) + pull, SHARE * rise[:-1][mask] + bend

        bounds = zip(
            np.maximum(LEAST[mask] + 2e-9, start - radius),
            np.minimum(high[mask], start + radius),
            strict=True,
        )
        best = minimize(
            cost, start, jac=True, bounds=list(bounds), method="L-BFGS-B",
            options=_CLOSELY,
        )  # fmt: skip
        result = log.copy()
        result[mask] = best.x
        return result
