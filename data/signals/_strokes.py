"""Motion of strokes: whether they are all alike, or begin at one place."""

import numpy as np
from jaxtyping import Float

_TIED = 0.1
"""Share of a travel within which accelerations stand at one place."""


def signs_at_one_place(
    push: Float[np.ndarray, " t"], place: Float[np.ndarray, " t"]
) -> int:
    """Return how many signs of an acceleration stand at one place each, 0 to 2.

    Both, where all strokes are alike: then nothing tells a push that changes with the place from
    an error that does. One, where strokes of different lengths begin at one place.

    Args:
        push: Acceleration in mm/s².
        place: Of any axis, in mm or °.
    """
    known = np.isfinite(push) & np.isfinite(place)
    limit, count = (_TIED * np.ptp(place[known])) ** 2, 0
    for sign in (1.0, -1.0):
        weight = np.square(np.maximum(sign * push[known], 0.0))
        weight /= max(float(weight.sum()), 1e-300)
        spread = weight @ np.square(place[known] - weight @ place[known])
        count += int(spread < limit)
    return count
