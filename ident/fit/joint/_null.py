"""What neither the readings nor the smoothness hold, found before any fit."""

import dataclasses

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from ._sums import Information

SINGULAR = 1e-9
"""Eigenvalue of scaled information below which nothing is known."""


@dataclasses.dataclass(frozen=True)
class Pinned:
    """Directions without any information.

    Attributes:
        null: One per column, shape ``(n, g)``.
        pins: What is added to the diagonal to hold them, shape ``(n,)``.
        free: Number of directions that the prior leaves alone and the readings tell.
    """

    null: Float[np.ndarray, "n g"]
    pins: Float[np.ndarray, " n"]
    free: int


def pinned(sums: Information) -> Pinned:
    """Return the directions that nothing holds, and pins on single unknowns that do."""
    design = sums.design
    parts = [component.straight for component in design.components]
    widths = [part.shape[1] for part in parts]
    basis = np.zeros((design.size, sum(widths)))
    first = 0
    for component, part in zip(design.components, parts, strict=True):
        basis[component.places, first : first + part.shape[1]] = part
        first += part.shape[1]
    found = null_space(sums.over(basis))
    null = basis @ found
    pins = np.zeros(design.size)
    scale = np.sqrt(sums.diagonal)
    scale = np.where(scale > 0, scale, 1.0)
    if null.shape[1]:
        rows = _spanning(null * scale[:, None])
        reached = sums.diagonal[rows] > 0
        typical = float(np.median(sums.diagonal[sums.diagonal > 0]))
        pins[rows] = np.where(reached, sums.diagonal[rows], typical)
    return Pinned(null, pins, basis.shape[1] - null.shape[1])


def null_space(
    matrix: Float[np.ndarray, "m m"], limit: float = SINGULAR
) -> Float[np.ndarray, "m g"]:
    """Return the null space of an information matrix, judged with a unit diagonal."""
    diagonal = np.diag(matrix)
    scale = np.where(diagonal > 0, np.sqrt(np.maximum(diagonal, 0.0)), 1.0)
    eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return np.asarray(vectors[:, eigenvalues < limit] / scale[:, None])


def _spanning(null: Float[np.ndarray, "n g"]) -> Int[np.ndarray, " g"]:
    """Return the unknowns that, held, hold all null directions."""
    return pivoted(null.T)[2][: null.shape[1]]


def pivoted(
    matrix: Float[np.ndarray, "m n"],
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, " k"], Int[np.ndarray, " n"]]:
    """Return an orthonormal basis, sizes in descending order, and the columns' order."""
    found = scipy.linalg.qr(matrix, mode="economic", pivoting=True)
    basis, upper, order = (np.asarray(part) for part in found)
    return basis, np.abs(np.diag(upper)), order.astype(np.int64)
