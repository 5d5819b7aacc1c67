"""Few smooth functions of a position, scaled as smooth errors are: large scale first."""

import numpy as np
from jaxtyping import Float

_DECAY = 1.5
"""A smooth error has less of fine structure: amplitudes fall as the 1.5th power."""


def waves(
    u: Float[np.ndarray, " t"], count: int, periodic: bool
) -> Float[np.ndarray, "t k"]:
    """Return functions of a position scaled to 0 … 1, the constant left out.

    A straight line and cosines, or sines and cosines of a turn.

    Args:
        u: Scaled position.
        count: How many functions.
        periodic: 0 and 1 are the same place.
    """
    result = np.empty((len(u), count))
    for k in range(count):
        if periodic:
            order = 1 + k // 2
            angle = 2.0 * np.pi * order * u
            wave = np.sin(angle) if k % 2 else np.cos(angle)
        elif k == 0:
            order, wave = 1, np.sqrt(3.0 / 2.0) * (2.0 * u - 1.0)
        else:
            order, wave = k, np.cos(np.pi * k * u)
        result[:, k] = np.sqrt(2.0) * wave / order**_DECAY
    return result


def products(
    first: Float[np.ndarray, "t i"], second: Float[np.ndarray, "t j"]
) -> Float[np.ndarray, "t k"]:
    """Return every product of a function of one position and one of another."""
    every = first[:, :, None] * second[:, None, :]
    return np.asarray(every.reshape(len(first), -1))
