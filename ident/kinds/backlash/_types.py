"""What comes out of a backlash fit, and whether the width changes along the axis."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from numpy.polynomial import legendre
from scipy.stats import f as f_distribution

from ....models import Backlash
from ...core import DriftNoise, FitError, Regression

SURE = 3.0
"""Deviations from which on a backlash shows."""
_CHANCE = 0.01
_MATTERS = 0.1
"""Change relative to the width that is worth a table."""


@dataclasses.dataclass(frozen=True)
class Dependence:
    """How the backlash changes along the axis.

    Attributes:
        probability: Of data like these if it did not change at all.
        variation: Root mean square of the change over the measured positions, in mm or °.
        slope: Change over the measured positions, first to last, in mm or °.
        slope_deviation: Standard deviation of that.
        significant: Whether it changes by more than chance and by enough to matter.
    """

    probability: float
    variation: float
    slope: float
    slope_deviation: float
    significant: bool


@dataclasses.dataclass(frozen=True)
class Reversal:
    """One reversal cut out of a trace.

    Attributes:
        turn: Row of the turning point.
        position: Of the turning point in mm or °.
        direction: Of the motion after it, ±1.
        width: Backlash that this reversal shows by itself, in mm or °.
        standard_deviation: Of the width, from the scatter within the window.
        wild: Set aside because it contradicts the others.
    """

    turn: int
    position: float
    direction: int
    width: float
    standard_deviation: float
    wild: bool


@dataclasses.dataclass(frozen=True)
class BacklashFit:
    """The backlash of an axis.

    The width has the sign of P-AXIS-00103: error moving positive − error moving negative is
    minus the width.

    Attributes:
        width: In mm or °.
        standard_deviation: Of the width.
        noise: How the readings (reversals) scatter.
        independent: Independent readings (reversals) that would leave the same uncertainty.
        support: Readings (reversals) used per direction of motion, positive first.
        residual: Reading − fit in mm or ° (readings, or reversals).
        wild: Readings (reversals) that the loss rejected outright.
        dependence: How it changes along the axis; None where the positions are too few.
        drift: Change of the readings within a run, and the width with that taken off, where
            it shows and counts as backlash; None elsewhere.
        delay: By how much the reference is late behind the encoder in s, and the deviation of
            that, from the speeds of the reversals; None where it was not fitted.
        delay_gain: Backlash per second of delay in mm/s or °/s, where all reversals run at one
            speed, so that nothing tells them apart.
        reversals: Each reversal of a trace; empty for bidirectional readings.
        take_up: Travel after a reversal in which nine tenths come, in mm or °; None where it
            was not seen.
    """

    width: float
    standard_deviation: float
    noise: DriftNoise
    independent: float
    support: tuple[int, int]
    residual: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    dependence: Dependence | None = None
    drift: tuple[float, float] | None = None
    delay: tuple[float, float] | None = None
    delay_gain: float | None = None
    reversals: tuple[Reversal, ...] = ()
    take_up: float | None = None

    @property
    def significant(self) -> bool:
        """Whether there is a backlash by more than chance."""
        return abs(self.width) > SURE * self.standard_deviation

    @property
    def kind(self) -> str:
        """Where the play is, in words."""
        if not self.significant:
            return "no backlash shows"
        if self.width > 0:
            return "positive: play between drive and slide"
        return "negative: play between slide and measuring system"

    def compensation(self, reference: int = 1, cycles: int = 0) -> Backlash:
        """Return the model that takes this backlash away.

        Args:
            reference: Direction in which the axis is right without it (P-AXIS-00021 = 1 or
                2): that of homing and of the tables. The other choice shifts all positions by
                the width.
            cycles: Over which a reversal is spread.
        """
        return Backlash(jnp.asarray(self.width), 1 if reference > 0 else -1, cycles)


def refuse_undetermined(found: Regression, things: str) -> None:
    """Refuse a width, the first coefficient, that the kept readings do not determine.

    Raises:
        FitError: Saying how many were left out.
    """
    if found.undetermined[0]:
        msg = (
            f"the {things} that agree with each other do not determine the backlash: "
            f"{int(found.wild.sum())} wild ones are left out."
        )
        raise FitError(msg)


def polynomials(
    position: Float[np.ndarray, " t"], order: int
) -> Float[np.ndarray, "t k"]:
    """Return Legendre polynomials 0 … order over the measured range."""
    low, high = float(position.min()), float(position.max())
    place = 2.0 * (position - low) / max(high - low, 1e-300) - 1.0
    return np.asarray(legendre.legvander(place, order))


def dependence_of(found: Regression, order: int, readings: int) -> Dependence | None:
    """Return the test of the polynomials from order 1 on.

    Args:
        found: Regression whose first columns are those polynomials times the width.
        order: Highest order.
        readings: Independent ones at most (places, reversals).
    """
    part = slice(1, 1 + order)
    values, covariance = found.coefficients[part], found.covariance[part, part]
    if found.undetermined[: 1 + order].any():
        return None
    if not covariance.any():
        # Readings without any scatter fit exactly: what they show is what there is.
        statistic = np.inf if values.any() else 0.0
    else:
        statistic = float(values @ np.linalg.pinv(covariance, hermitian=True) @ values)
        statistic /= order
    sure = min(float(found.independent[part].min()), float(readings))
    free = max(sure - order - 1.0, 1.0)
    probability = float(f_distribution.sf(statistic, order, free))
    orders = np.arange(1, order + 1)
    variation = float(np.sqrt((values**2 / (2 * orders + 1)).sum()))
    ends = np.where(orders % 2 == 1, 2.0, 0.0)
    width = abs(float(found.coefficients[0]))
    return Dependence(
        probability,
        variation,
        float(ends @ values),
        float(np.sqrt(max(ends @ covariance @ ends, 0.0))),
        probability < _CHANCE and variation > _MATTERS * width,
    )
