"""Weighted least squares over columns, with or without instruments and a prior."""

import dataclasses

import numpy as np
from jaxtyping import Float

_NULL = 1e-9
"""Share of the largest eigenvalue of the scaled normal matrix that counts as none."""


@dataclasses.dataclass(frozen=True)
class Linear:
    """Solution of one weighted least-squares problem.

    Attributes:
        factors: Of the columns.
        inverse: Of the normal matrix, where samples reach.
        null: Directions of the factors that no sample moves, as columns.
    """

    factors: Float[np.ndarray, " k"]
    inverse: Float[np.ndarray, "k k"]
    null: Float[np.ndarray, "k z"]


def solve_linear(
    design: np.ndarray,
    instrument: np.ndarray,
    target: np.ndarray,
    share: np.ndarray,
    penalty: np.ndarray | None,
) -> Linear:
    """Solve ZᵀW(Xβ − y) + Pβ = 0, least norm in directions that no sample moves."""
    size = np.sqrt(np.mean(design**2, axis=0))
    size = np.where(size > 0, size, 1.0)
    x = design / size
    weighted = x * share[:, None]
    own = matrix = weighted.T @ x
    if instrument is not design:
        weighted = instrument / size * share[:, None]
        matrix = weighted.T @ x
    if penalty is not None:
        scaled = penalty / size / size[:, None]
        own, matrix = own + scaled, matrix + scaled
    values, vectors = np.linalg.eigh(own)
    seen = values > _NULL * max(values[-1], np.finfo(float).tiny)
    basis = vectors[:, seen]
    inner = basis.T @ matrix @ basis
    inverse = basis @ np.linalg.solve(inner, basis.T)
    factors = inverse @ (weighted.T @ target) / size
    null = vectors[:, ~seen] / size[:, None]
    return Linear(factors, inverse / size / size[:, None], null)
