"""Scales of residuals, and how they resemble each other, as machine code.

What NumPy takes a look over all rows for, once for every step, is done here row by row.
Compiled like `_kernel`.
"""

from typing import no_type_check

import numpy as np
from numba import njit, types

from .._machine_code import machine_code

_Table = types.Array(types.float64, 2, "C", readonly=True)
_Given = types.Array(types.float64, 1, "A", readonly=True)
_Places = types.Array(types.int64, 1, "C", readonly=True)
_Matrix = types.Array(types.float64, 2, "C")
_Line = types.Array(types.float64, 1, "C")
_Found = types.Array(types.int64, 1, "C")


@njit(error_model="numpy")
@no_type_check
def _median(values, many):
    """Return the median of the first so many values, which change their places."""
    middle = many // 2
    low, high = 0, many
    while high - low > 1:
        half = (low + high - 1) // 2
        pivot, values[half] = values[half], values[high - 1]
        # Smaller ones to the front, without a branch that is guessed wrong half the time.
        place = low
        for k in range(low, high - 1):
            value = values[k]
            values[k], values[place] = values[place], value
            place += value < pivot
        values[high - 1], values[place] = values[place], pivot
        if place > middle:
            high = place
            continue
        # All that equal it stand together, or a run of equal ones would take for ever.
        low = place + 1
        if place < middle:
            for k in range(low, high):
                value = values[k]
                values[k], values[low] = values[low], value
                low += value == pivot
        if low > middle:
            break
    upper = values[middle]
    if many % 2:
        return upper
    lower = values[0]
    for k in range(1, middle):
        lower = max(lower, values[k])
    return 0.5 * (lower + upper)


@no_type_check
def _far(residual, use, least, factor, limit, scale, lane, row):
    """Find residuals that are large against their fit's scale; return how many.

    Scales are given where ``least`` is below 0. Which fits and rows, ``lane`` and ``row``
    say.
    """
    found = 0
    size = np.empty(residual.shape[1])
    for w in range(len(residual)):
        if least[w] >= 0.0:
            many = 0
            for s in range(residual.shape[1]):
                size[many] = abs(residual[w, s])
                many += use[w, s] > 0.0
            middle = _median(size, many) if many else 0.0
            scale[w] = max(middle * factor[w], least[w])
        bound = limit * scale[w]
        for s in range(residual.shape[1]):
            if abs(residual[w, s]) > bound and use[w, s] > 0.0:
                lane[found], row[found] = w, s
                found += 1
    return found


@no_type_check
def _scores(own, other, use, push, inverse, slope, found):
    """Write the scores of samples, made larger by their leverage; return Σ ψ²."""
    width = own.shape[1]
    reach = np.empty(width)
    total = 0.0
    for s in range(len(own)):
        if use[s] == 0.0:
            found[s] = 0.0
            continue
        reach[:] = 0.0
        for i in range(width):
            x = own[s, i]
            if x != 0.0:
                for j in range(width):
                    reach[j] += x * inverse[i, j]
        leverage = 0.0
        for j in range(width):
            leverage += reach[j] * other[s, j]
        psi = push[s] / min(max(1.0 - slope * leverage, 0.1), 1.0)
        total += psi * psi
        for j in range(width):
            found[s, j] = other[s, j] * psi
    return total


@no_type_check
def _resemblance(scores, piece, size, beside):
    """Write Σ s² of each column, and Σ s·s of neighbours in one piece."""
    size[:] = 0.0
    beside[:] = 0.0
    for s in range(len(scores)):
        same = s > 0 and piece[s] == piece[s - 1]
        for j in range(scores.shape[1]):
            size[j] += scores[s, j] * scores[s, j]
            if same:
                beside[j] += scores[s, j] * scores[s - 1, j]


@no_type_check
def _slide(scores, piece, lag, total):
    """Write the sum over all stretches of ``lag`` + 1 scores in a piece, at its ends too."""
    width = scores.shape[1]
    inner = np.empty(width)
    total[:] = 0.0
    first = 0
    while first < len(scores):
        end = first
        while end < len(scores) and piece[end] == piece[first]:
            end += 1
        inner[:] = 0.0
        for s in range(first, end + lag):
            for j in range(width):
                if s < end:
                    inner[j] += scores[s, j]
                if s - lag - 1 >= first:
                    inner[j] -= scores[s - lag - 1, j]
            for i in range(width):
                for j in range(width):
                    total[i, j] += inner[i] * inner[j]
        first = end


far = machine_code(
    _far,
    types.int64(
        *(_Table, _Table, _Line, _Line, types.float64, _Line, _Found, _Found),
    ),
)
scores = machine_code(
    _scores,
    types.float64(
        *(_Table, _Table, _Given, _Given, _Table, types.float64, _Matrix),
    ),
)
resemblance = machine_code(_resemblance, types.void(_Table, _Places, _Line, _Line))
slide = machine_code(_slide, types.void(_Table, _Places, types.int64, _Matrix))
