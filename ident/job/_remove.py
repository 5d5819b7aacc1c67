"""Take off what is the instrument's: an arbitrary zero, an arbitrary slope."""

from typing import Literal

import numpy as np
from jaxtyping import Float

_PASSES = 20
_TUNING = 1.345
"""Huber's constant: 95 % efficiency on clean data."""


def without_zero(
    error: Float[np.ndarray, " t"],
    positions: Float[np.ndarray, "t d"],
    kind: Literal["none", "offset", "line"],
) -> Float[np.ndarray, " t"]:
    """Return the error without its mean, or without the line (plane) through it.

    The mean and the line are fitted with Huber's loss, so that a wild reading does not
    tilt them.

    Args:
        error: In mm or °.
        positions: Of the masters.
        kind: ``none``, ``offset`` or ``line`` (over two masters, a plane).
    """
    if kind == "none":
        return error
    columns = [np.ones(len(error))]
    if kind == "line":
        # Centred, so that the columns stay apart from each other.
        columns += list((positions - positions.mean(axis=0)).T)
    design = np.stack(columns, axis=1)
    weight = np.ones(len(error))
    residual = error
    for _ in range(_PASSES):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(design * root[:, None], error * root)[0]
        residual = error - design @ solution
        size = np.abs(residual)
        scale = 1.4826 * float(np.median(size))
        if scale == 0.0:
            break
        new = np.minimum(1.0, _TUNING * scale / np.maximum(size, 1e-300))
        settled = float(np.max(np.abs(new - weight))) < 1e-6
        weight = new
        if settled:
            break
    return residual
