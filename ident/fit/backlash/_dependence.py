"""Whether the backlash changes along the axis."""

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre
from scipy.stats import f as f_distribution

from ...core._regression import Regression
from ._types import Dependence

HIGHEST = 3
"""Order of the polynomial along the axis."""
_CHANCE = 0.01
_MATTERS = 0.1
"""Change relative to the width that is worth a table."""


def polynomials(
    position: Float[np.ndarray, " t"], order: int
) -> Float[np.ndarray, "t k"]:
    """Return Legendre polynomials 0 … order over the measured range."""
    low, high = float(position.min()), float(position.max())
    place = 2.0 * (position - low) / max(high - low, 1e-300) - 1.0
    return np.asarray(legendre.legvander(place, order))


def dependence_of(
    found: Regression, first: int, order: int, readings: int
) -> Dependence | None:
    """Return the test of the polynomials from order 1 on.

    Args:
        found: Regression whose columns ``first … first + order`` are those polynomials times
            the width.
        first: Column of order 0.
        order: Highest order.
        readings: Independent ones at most (places, reversals).
    """
    if order < 1:
        return None
    part = slice(first + 1, first + 1 + order)
    values, covariance = found.coefficients[part], found.covariance[part, part]
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
    width = abs(float(found.coefficients[first]))
    return Dependence(
        probability,
        variation,
        float(ends @ values),
        float(np.sqrt(max(ends @ covariance @ ends, 0.0))),
        probability < _CHANCE and variation > _MATTERS * width,
    )


def dependence_warning(dependence: Dependence) -> str:
    """Return what a changing backlash asks for."""
    return (
        f"The backlash changes along the axis by {1e3 * dependence.variation:.1f} µm rms "
        f"({1e3 * dependence.slope:+.1f} µm from one end to the other): one number cannot "
        "take it away, a bilateral leadscrew table is the better answer."
    )
