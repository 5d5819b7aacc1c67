"""The compiled loop of the sums, for many readings; numba compiles once per machine.

Cells of equidistant nodes are located with the bits of `axcomp.models.EquidistantNodes`.
"""

# mypy: disable-error-code="no-untyped-def,untyped-decorator"

from typing import Any, no_type_check

import numba
import numpy as np

from ._effect import READ


@numba.njit(inline="always")
@no_type_check
def _cell(position, axis):
    """Return cell and place in it; an axis is its start, 1/interval, slack and last node."""
    start, inverse, slack, last = axis
    place = (position - start) * inverse
    node = np.floor(place + slack)
    place = min(max(node if place - node <= slack else place, 0.0), last)
    cell = min(int(place), int(last) - 1)
    return cell, place - cell


@numba.njit(inline="always")
@no_type_check
def _weighed(residual, loss):
    """Return ψ of a residual, and what it adds to the tally; a loss is the fields of `Loss`."""
    scale, freedom, corner, limit, wild = loss
    size = abs(residual) * (1.0 / scale)
    if not size <= limit:
        return 0.0, (0.0, 0.0, 0.0, 0.0, 0.0)
    share = 1.0 / (1.0 + size * size * (1.0 / freedom))
    slope = (2.0 * share - 1.0) * share
    if size > corner:
        share, slope = corner / size, 0.0
    score, good = share * residual, 1.0 if size <= wild else 0.0
    return score, (1.0, slope, score * score, good * residual * residual, good)


def machine_code(function: Any) -> Any:
    """Return a function compiled at its first call; kept for the next process, if possible."""
    options: Any = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)
    except (RuntimeError, OSError):  # nowhere to write, or no space left
        return numba.njit(**options)(function)


@machine_code
@no_type_check
def add_plane(
    along, across, value, axes, theta, loss, full, record, right, tally, support,
    residual,
):  # fmt: skip
    """Add readings of an equidistant plane; a record has the products of a cell's corners."""
    fast = int(axes[1][3]) + 1
    count, slopes, scores, squares, good = 0.0, 0.0, 0.0, 0.0, 0.0
    for t in range(len(value)):
        slow, u = _cell(along[t], axes[0])
        column, v = _cell(across[t], axes[1])
        node = slow * fast + column
        corners = (node, node + 1, node + fast, node + fast + 1)
        shares = ((1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v)
        difference = value[t]
        for p in range(4):
            difference -= shares[p] * theta[corners[p]]
        residual[t] = difference
        score, add = _weighed(difference, loss)
        count, slopes, scores = count + add[0], slopes + add[1], scores + add[2]
        squares, good = squares + add[3], good + add[4]
        for p in range(4):
            right[corners[p]] += shares[p] * score
        if not (full and add[0]):
            continue
        diagonals, place = record[node], 0
        for p in range(4):
            support[corners[p]] += shares[p] > READ
            for q in range(p + 1):
                diagonals[place] += shares[p] * shares[q]
                place += 1
    # In memory, other stores between, each sum would wait for the one before.
    tally += np.array([count, slopes, scores, squares, good])
