"""Differences along one axis of a table, and their penalties as bands."""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

Weights = tuple[float, float]
"""Weights ``(a, b)`` of the second and of the fourth differences, relative to 1/noise²."""


def second_differences(
    gaps: Float[np.ndarray, " g"], mean: float, ring: bool
) -> tuple[sp.csr_array, Float[np.ndarray, " r"]]:
    """Rows mean²·f'' at inner nodes, and the share of the length that each row stands for."""
    points = len(gaps) if ring else len(gaps) + 1
    before = gaps if ring else gaps[:-1]
    after = np.roll(gaps, -1) if ring else gaps[1:]
    rows = len(before)
    if points < 3:
        return sp.csr_array((0, points)), np.zeros(0)
    scale = 2.0 * mean**2 / (before + after)
    index = np.arange(rows)
    columns = np.concatenate([index, (index + 1) % points, (index + 2) % points])
    data = np.concatenate(
        [scale / before, -scale * (1.0 / before + 1.0 / after), scale / after]
    )
    matrix = sp.coo_array((data, (np.tile(index, 3), columns)), shape=(rows, points))
    return sp.csr_array(matrix), (before + after) / (2.0 * mean)


def lower_band(matrix: sp.csr_array, ring: bool = False) -> Float[np.ndarray, "n w"]:
    """Return the lower band of a symmetric matrix, the indices of a ring folded."""
    entries = matrix.tocoo()
    n = len(matrix.indptr) - 1
    row, column = entries.coords
    if ring:
        index = np.arange(n)
        place = np.where(2 * index < n, 2 * index, 2 * (n - index) - 1)
        row, column = place[row], place[column]
    keep = row >= column
    offset = (row - column)[keep]
    columns = np.zeros((n, int(offset.max(initial=0)) + 1))
    np.add.at(columns, (column[keep], offset), entries.data[keep])
    return columns


def dense(columns: Float[np.ndarray, "_ w"], count: int) -> Float[np.ndarray, "n n"]:
    """Return a symmetric matrix from its lower band."""
    result = np.zeros((count, count))
    for offset in range(min(columns.shape[1], count) if len(columns) else 0):
        index = np.arange(count - offset)
        own = columns[: count - offset, offset]
        result[index + offset, index] = result[index, index + offset] = own
    return result


def mix(
    weights: Weights, bands: tuple[np.ndarray, np.ndarray]
) -> Float[np.ndarray, "n w"]:
    """Return the weighted sum of two lower bands, fresh memory; a zero weight costs no width."""
    second, fourth = bands
    if not weights[1]:
        return weights[0] * second
    result = weights[1] * fourth
    if second.shape[1] > fourth.shape[1]:
        result = np.pad(result, ((0, 0), (0, second.shape[1] - fourth.shape[1])))
    result[:, : second.shape[1]] += weights[0] * second
    return result
