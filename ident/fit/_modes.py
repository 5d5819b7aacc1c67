"""Modes of bending along one axis: the basis in which smoothness and readings separate."""

import dataclasses
import functools

import numpy as np
import scipy.linalg
from jaxtyping import Float

from ._chain import ChainPrior


@dataclasses.dataclass(frozen=True)
class Modes:
    """Modes normalised against the information of evenly spread readings.

    Attributes:
        vectors: One mode per column, shape (n, n).
        dual: Mass × vectors; its transpose takes node values to the modes.
        second: Penalty of second differences of every mode; ``fourth`` likewise.
        size: Sum of squares of every mode.
    """

    vectors: Float[np.ndarray, "n n"]
    dual: Float[np.ndarray, "n n"]
    second: Float[np.ndarray, " n"]
    fourth: Float[np.ndarray, " n"]
    size: Float[np.ndarray, " n"]


@functools.lru_cache(maxsize=32)
def modes_of(chain: ChainPrior, order: int) -> Modes:
    """Return the modes of second or of fourth differences along a chain."""
    n = chain.size
    diagonal = np.full(n, 2.0 / 3.0)
    diagonal[[0, -1]] = 1.0 / 3.0
    beside = np.full(n - 1, 1.0 / 6.0)
    mass = np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1)
    # The density counts what stands on the diagonal.
    mass /= mass.diagonal().mean()
    grams = [gram.toarray() for gram in chain.grams]
    _, vectors = scipy.linalg.eigh(grams[0] if order == 2 else grams[1], mass)
    # Within what fourth differences leave alone, second differences tell the modes apart.
    free = min(4, n)
    inner = vectors[:, :free].T @ grams[0] @ vectors[:, :free]
    vectors[:, :free] = vectors[:, :free] @ np.linalg.eigh(inner)[1]
    bends = []
    for gram in grams:
        values = np.maximum((vectors * (gram @ vectors)).sum(axis=0), 0.0)
        values[: chain.null] = 0.0
        bends.append(values)
    size = np.square(vectors).sum(axis=0)
    return Modes(vectors, mass @ vectors, bends[0], bends[1], size)
