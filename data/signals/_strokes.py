"""Motion of strokes: whether they are all alike."""

import numpy as np
from jaxtyping import Float

_TIED = 0.1
"""Share of a travel within which accelerations stand at one place."""


def strokes_alike(
    push: Float[np.ndarray, " t"], place: Float[np.ndarray, " t"]
) -> bool:
    """Whether each sign of an acceleration stands at one place, as with strokes that are all alike.

    Then nothing tells a push that changes with the place from an error that does.

    Args:
        push: Acceleration in mm/s².
        place: Of any axis, in mm or °.
    """
    known = np.isfinite(push) & np.isfinite(place)
    spreads = []
    for sign in (1.0, -1.0):
        weight = np.square(np.maximum(sign * push[known], 0.0))
        weight /= max(float(weight.sum()), 1e-300)
        spreads.append(weight @ np.square(place[known] - weight @ place[known]))
    return bool(np.sqrt(max(spreads)) < _TIED * np.ptp(place[known]))
