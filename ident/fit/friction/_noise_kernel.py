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


_SAMPLE = 64
"""Values that tell about where the median of many is."""


@njit(error_model="numpy")
@no_type_check
def _ranked(values, many, first, second):
    """Return the mean of two neighbours in order, by rank; values change their places."""
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
        if place > second:
            high = place
            continue
        # All that equal it stand together, or a run of equal ones would take for ever.
        low = place + 1
        if place < second:
            for k in range(low, high):
                value = values[k]
                values[k], values[low] = values[low], value
                low += value == pivot
        if low > second:
            break
    upper = values[second]
    if first == second:
        return upper
    lower = values[0]
    for k in range(1, second):
        lower = max(lower, values[k])
    return 0.5 * (lower + upper)


@njit(error_model="numpy")
@no_type_check
def _median(values, many, sample, near):
    """Return the median of the first so many values, which may change their places."""
    first, second = (many - 1) // 2, many // 2
    if many < 4 * _SAMPLE:
        return _ranked(values, many, first, second)
    step = many // _SAMPLE
    for k in range(_SAMPLE):
        value, place = values[k * step], k
        while place > 0 and sample[place - 1] > value:
            sample[place] = sample[place - 1]
            place -= 1
        sample[place] = value
    # About a third lies between these, and the median with it but once in a thousand times.
    low, high = sample[_SAMPLE // 3], sample[_SAMPLE - _SAMPLE // 3]
    below = inside = 0
    for k in range(many):
        s = np.uint64(k)
        value = values[s]
        near[np.uint64(inside)] = value
        inside += (value >= low) & (value <= high)
        below += value < low
    if first < below or second >= below + inside:
        return _ranked(values, many, first, second)
    return _ranked(near, inside, first - below, second - below)


@no_type_check
def _far(residual, use, least, factor, limit, scale, lane, row):
    """Find residuals that are large against their fit's scale; return how many.

    Scales are given where ``least`` is below 0. Which fits and rows, ``lane`` and ``row``
    say.
    """
    found = 0
    size, near = np.empty((2, residual.shape[1] + 1))
    sample = np.empty(_SAMPLE)
    for w in range(len(residual)):
        left, used = residual[w], use[w]
        if least[w] >= 0.0:
            many = 0
            for k in range(len(left)):
                s = np.uint64(k)
                size[np.uint64(many)] = abs(left[s])
                many += used[s] > 0.0
            middle = _median(size, many, sample, near) if many else 0.0
            scale[w] = max(middle * factor[w], least[w])
        bound = limit * scale[w]
        for k in range(len(left)):
            s = np.uint64(k)
            if abs(left[s]) > bound and used[s] > 0.0:
                lane[found], row[found] = w, k
                found += 1
    return found


@no_type_check
def _scores(own, other, use, push, inverse, slope, found):
    """Write the scores of samples, made larger by their leverage; return Σ ψ²."""
    width = own.shape[1]
    met = np.empty(width + 1, np.uint64)
    total = 0.0
    for k in range(len(own)):
        s = np.uint64(k)
        if use[s] == 0.0:
            found[s] = 0.0
            continue
        # Of its columns a sample meets few.
        many = 0
        for j in range(width):
            met[np.uint64(many)] = j
            many += (own[s, j] != 0.0) | (other[s, j] != 0.0)
        leverage = 0.0
        for a in range(many):
            j = met[a]
            reach = 0.0
            for b in range(many):
                reach += own[s, met[b]] * inverse[met[b], j]
            leverage += reach * other[s, j]
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
        own = scores[first:end]
        inner[:] = 0.0
        for s in range(len(own) + lag):
            if s < len(own):
                for j in range(width):
                    inner[j] += own[s, j]
            if s > lag:
                for j in range(width):
                    inner[j] -= own[s - lag - 1, j]
            for i in range(width):
                one = inner[i]
                for j in range(width):
                    total[i, j] += one * inner[j]
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
