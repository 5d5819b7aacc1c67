"""Readings that are the instrument's fault: those far from all others."""

import numpy as np
from jaxtyping import Bool, Float

_WILD = 6.0
"""Standard deviations from the median at which a reading is the instrument's fault."""
MOST_WILD = 0.1
"""Share of readings up to which those far from all others are wild: more have a cause."""


def wild_readings(
    error: Float[np.ndarray, " t"], least: float = 0.0
) -> Bool[np.ndarray, " t"]:
    """Tell which readings are the instrument's fault: those far from the median.

    Farther than six standard deviations, by the median of the distances.

    Args:
        error: One value per reading.
        least: Distance beyond that which is still none, in the unit of the error.
    """
    distance = np.abs(error - np.median(error))
    return np.asarray(distance > _WILD * 1.4826 * np.median(distance) + least)
