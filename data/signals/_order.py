"""Median and quantiles of one array: NumPy's numbers, of float64 to the bit, in less time.

NumPy's own serve any axis, weights and a dozen definitions; with some thousand samples
that takes several times as long as the look at the samples.
"""

import math

import numpy as np
from jaxtyping import Float


def median(values: Float[np.ndarray, " t"]) -> float:
    """Return what `np.median` does."""
    low, high = _neighbours(values, (values.size - 1) // 2)
    middle = low if values.size % 2 else (low + high) / 2.0
    return middle + 0.0  # a mean is never −0.0


def quantile(values: Float[np.ndarray, " t"], share: float) -> float:
    """Return what `np.quantile` does for one share, 0 … 1; of zeros perhaps the other."""
    place = share * (values.size - 1)
    low, high = _neighbours(values, math.floor(place))
    weight, step = place - math.floor(place), high - low
    # From the nearer side, as NumPy has it: the ends are met exactly.
    return high - step * (1.0 - weight) if weight >= 0.5 else low + step * weight


def _neighbours(values: Float[np.ndarray, " t"], at: int) -> tuple[float, float]:
    """Return the value at a place in ascending order and the next; NaN if any is NaN."""
    if not values.size:
        return math.nan, math.nan
    last = values.size - 1
    following = min(at + 1, last)
    parted = np.partition(values, (at, following, last))
    if math.isnan(parted.item(last)):  # NaN comes last
        return math.nan, math.nan
    return parted.item(at), parted.item(following)
