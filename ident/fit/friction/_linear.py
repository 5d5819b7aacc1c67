"""Weighted least squares over columns, with or without instruments and a prior, many at a time."""

import dataclasses

import numpy as np
from jaxtyping import Float

_NULL = 1e-9
"""Share of the largest eigenvalue of the scaled normal matrix that counts as none."""


@dataclasses.dataclass(frozen=True)
class Linear:
    """Solutions of several weighted least-squares problems.

    Attributes:
        factors: Of the columns.
        inverse: Of the normal matrices, where samples reach.
        null: Directions of the factors that no sample moves, as columns, per problem.
        size: RMS of each column.
    """

    factors: Float[np.ndarray, "w k"]
    inverse: Float[np.ndarray, "w k k"]
    null: tuple[Float[np.ndarray, "k _"], ...]
    size: Float[np.ndarray, "w k"]


def solve_linear(
    own: Float[np.ndarray, "w k k"],
    matrix: Float[np.ndarray, "w k k"],
    moment: Float[np.ndarray, "w k"],
    size: Float[np.ndarray, "w k"],
) -> Linear:
    """Solve Mβ = m, least norm in directions that no sample moves.

    Args:
        own: XᵀWX + P of the columns themselves, which tells those directions.
        matrix: M; ``own`` itself where there are no instruments.
        moment: m.
        size: RMS of each column, which makes factors of different units comparable.
    """
    size = np.where(size > 0, size, 1.0)
    area = size[:, :, None] * size[:, None, :]
    scaled = own / area
    other = scaled if matrix is own else matrix / area
    # Columns that no row of a fit touches stand apart: they must not spoil the others.
    diagonal = np.einsum("wkk->wk", scaled)
    empty = diagonal == 0.0
    beside, some = scaled, bool(empty.any())
    if some:
        apart = np.where(empty, diagonal.max(axis=1, keepdims=True), 0.0)
        beside = ((~empty)[:, :, None] & (~empty)[:, None]) * 1.0
        scaled = scaled * beside + apart[:, :, None] * np.eye(scaled.shape[1])
        other = scaled if matrix is own else other * beside + scaled * (1.0 - beside)
    try:
        inverse = np.linalg.inv(scaled)
        # No eigenvalue is smaller than 1 / |inverse|, and none larger than |matrix|.
        reach = np.square(scaled).sum(axis=(1, 2)) * np.square(inverse).sum(axis=(1, 2))
        with np.errstate(invalid="ignore"):
            sure = reach < 1.0 / _NULL**2
        if matrix is not own:
            inverse = np.linalg.inv(other)
    except np.linalg.LinAlgError:
        inverse, sure = np.zeros_like(scaled), np.zeros(len(scaled), bool)
    unit = np.eye(scaled.shape[1])
    null = [unit[:, :0]] * len(scaled)
    if some:
        inverse = inverse * beside
        null = [
            unit[:, each] / one[:, None] for each, one in zip(empty, size, strict=True)
        ]
    for lane in np.flatnonzero(~sure):
        alone = own[lane] / area[lane]
        values, vectors = np.linalg.eigh(alone)
        seen = values > _NULL * max(values[-1], np.finfo(float).tiny)
        basis = vectors[:, seen]
        inner = basis.T @ (matrix[lane] / area[lane]) @ basis
        inverse[lane] = basis @ np.linalg.solve(inner, basis.T)
        null[lane] = vectors[:, ~seen] / size[lane][:, None]
    inverse /= area
    factors = (inverse @ moment[..., None])[..., 0]
    return Linear(factors, inverse, tuple(null), size)
