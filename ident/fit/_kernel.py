"""Sums over the readings of a plane as machine code: one pass, one record per cell.

XLA adds the thirteen moments of a reading one by one, each to an array of its own. Here they
lie side by side, 128 bytes per cell, so that a reading is added by two vector additions; its
cell is found, and the readings are looked over, in the same pass. A record holds, with ``w``
the weight of a reading, ``z`` its error and ``(u, v)`` its place in the cell,

====  =====  ======  ======  =======  =====  ======  =======
w     w·v    w·v²    w·z     w·z·v    1      unused  unused
w·u   w·u·v  w·u·v²  w·z·u   w·z·u·v  w·u²   w·u²·v  w·u²·v²
====  =====  ======  ======  =======  =====  ======  =======

so that the second row is u times the first one, but for its last three. A reading of weight 0
is not counted.

Importing this module compiles it, which takes seconds the first time; numba keeps the result
beside this file, or in the user's cache where it cannot write there. Import it only where
there are many readings. Products and sums are not fused, so that any processor gives the same
bits.
"""

from typing import Any, no_type_check

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from ._machine_code import machine_code

RECORD = 16
"""Numbers of a record."""
_CHUNK = 128
"""Readings that are located together, by vectors; they stay in the nearest cache."""

_Given = types.Array(types.float64, 1, "A", readonly=True)
_Numbers = types.Array(types.float64, 1, "C")
_Counts = types.Array(types.int64, 1, "C")
_Cells = types.Array(types.int32, 1, "C")
_Axis = types.Tuple(  # type: ignore[no-untyped-call]
    (types.int64, types.int64, _Numbers, _Numbers, _Cells)
)


@intrinsic
@no_type_check
def _add_record(
    typing: Any, table: Any, start: Any, terms: Any, count: Any, share: Any
) -> Any:
    """Add the first row of a record, ``count`` in its sixth place, and ``share`` times it."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        array = cgutils.create_struct_proxy(signature.args[0])(
            context, builder, value=given[0]
        )
        row = ir.VectorType(ir.DoubleType(), RECORD // 2)
        place = ir.IntType(32)
        first = shares = ir.Constant(row, ir.Undefined)
        for lane in range(RECORD // 2):
            term = builder.extract_value(given[2], lane)
            first = builder.insert_element(first, term, place(lane))
            shares = builder.insert_element(shares, given[4], place(lane))
        second = builder.fmul(first, shares)
        first = builder.insert_element(first, given[3], place(5))
        for offset, more in ((0, first), (RECORD // 2, second)):
            at = builder.add(given[1], ir.Constant(given[1].type, offset))
            pointer = builder.bitcast(builder.gep(array.data, [at]), row.as_pointer())
            # The table is aligned to whole records where it can be; it need not be.
            old = builder.load(pointer, align=8)
            builder.store(builder.fadd(old, more), pointer, align=8)
        return context.get_dummy_value()

    return types.void(table, start, terms, count, share), generate


@njit(error_model="numpy")
@no_type_check
def _place_even(position, count, numbers, cell, share, length):
    """Find cells among equidistant nodes, as `EquidistantNodes` does."""
    start, inverse, slack = numbers[0], numbers[1], numbers[2]
    last, cells = float(count - 1), np.int32(count - 2)
    for k in range(length):
        place = (position[k] - start) * inverse
        # What is no number goes to the first cell, and is found out in the end.
        place = place if place > 0.0 else 0.0
        place = place if place < last else last
        node = np.int32(place + slack)
        rest = place - node
        rest = rest if rest > slack else 0.0
        # The last node belongs to the last cell.
        back = np.int32(1) if node > cells else np.int32(0)
        cell[k] = node - back
        share[k] = rest + back


@njit(error_model="numpy")
@no_type_check
def _place_uneven(position, count, steps, nodes, numbers, first, cell, share, length):
    """Find cells among any nodes, as `Setpoints` does: from a bucket on, by halves."""
    last, cells = float(count - 1), np.int32(count - 2)
    start, inverse = numbers[0], numbers[1]
    buckets = float(len(first) - 1)
    for k in range(length):
        bucket = (position[k] - start) * inverse
        bucket = bucket if bucket > 0.0 else 0.0
        bucket = bucket if bucket < buckets else buckets
        cell[k] = first[np.int32(bucket)]
    step = np.int32(steps)
    while step > 0:
        # All of them at once: each alone would wait for its last look-up.
        for k in range(length):
            there = min(cell[k] + step, cells)
            cell[k] = there if nodes[there] <= position[k] else cell[k]
        step //= np.int32(2)
    for k in range(length):
        left = nodes[cell[k]]
        place = cell[k] + (position[k] - left) / (nodes[cell[k] + 1] - left)
        place = place if place > 0.0 else 0.0
        place = place if place < last else last
        node = np.int32(place)
        back = np.int32(1) if node > cells else np.int32(0)
        cell[k] = node - back
        share[k] = (place - node) + back


@njit(error_model="numpy")
@no_type_check
def _place(position, count, steps, numbers, nodes, first, cell, share, length):
    """Find the cells of some positions, and where in them they lie, from 0 to 1."""
    if steps < 0:
        _place_even(position, count, numbers, cell, share, length)
    else:
        _place_uneven(
            position, count, steps, nodes, numbers, first, cell, share, length
        )


@njit(error_model="numpy")
@no_type_check
def _look_over(position, low, high, strange, length):
    for k in range(length):
        low[k] = min(low[k], position[k])
        high[k] = max(high[k], position[k])
        strange[k] += position[k] * 0.0


@njit(error_model="numpy")
@no_type_check
def _count_untouched(corner, u, v, fast, lack):
    """Count a reading on the edge of its cell at the corners that it does not reach."""
    lack[corner] += 0 if u < 1.0 and v < 1.0 else 1
    lack[corner + 1] += 0 if u < 1.0 and v > 0.0 else 1
    lack[corner + fast] += 0 if u > 0.0 and v < 1.0 else 1
    lack[corner + fast + 1] += 0 if u > 0.0 and v > 0.0 else 1


@no_type_check
def _sum_plane(along, across, error, weight, centre, slow, fast, table, lack, found):
    """Add readings to the records of their cells.

    Args:
        along: Positions along the slow axis.
        across: Positions along the fast axis.
        error: Readings.
        weight: Their weights, 0 for what is left out; empty: all are 1.
        centre: What is taken off each reading.
        slow: Nodes along the slow axis, an `Axis`.
        fast: Nodes along the fast axis, an `Axis`.
        table: Records by cell, the fast index fastest.
        lack: By node, how many readings of the cells about it do not touch it.
        found: Least and largest position along the slow and along the fast axis, a number
            that is NaN where any of the readings is none, and Σ w·z².
    """
    # Unpacked once: every unpacking counts references, atomically.
    n, slow_steps, slow_numbers, slow_nodes, slow_first = slow
    m, fast_steps, fast_numbers, fast_nodes, fast_first = fast
    plain = len(weight) == 0
    l, s = np.empty(_CHUNK, np.int32), np.empty(_CHUNK, np.int32)
    u, v = np.empty(_CHUNK), np.empty(_CHUNK)
    x, y, z, w = np.empty(_CHUNK), np.empty(_CHUNK), np.empty(_CHUNK), np.ones(_CHUNK)
    at = np.empty(_CHUNK, np.int64)
    low, high = np.full(_CHUNK, np.inf), np.full(_CHUNK, -np.inf)
    left, right = np.full(_CHUNK, np.inf), np.full(_CHUNK, -np.inf)
    strange, square = np.zeros(_CHUNK), np.zeros(_CHUNK)
    for start in range(0, len(error), _CHUNK):
        length = min(_CHUNK, len(error) - start)
        # One array at a time, so that each loop runs on vectors.
        for k in range(length):
            x[k] = along[start + k]
        for k in range(length):
            y[k] = across[start + k]
        for k in range(length):
            z[k] = error[start + k] - centre
        if not plain:
            for k in range(length):
                w[k] = weight[start + k]
        _place(x, n, slow_steps, slow_numbers, slow_nodes, slow_first, l, u, length)
        _place(y, m, fast_steps, fast_numbers, fast_nodes, fast_first, s, v, length)
        _look_over(x, low, high, strange, length)
        _look_over(y, left, right, strange, length)
        for k in range(length):
            square[k] += w[k] * z[k] * z[k]
            strange[k] += w[k] * 0.0 + z[k] * 0.0
        for k in range(length):
            at[k] = RECORD * (np.int64(l[k]) * (m - 1) + np.int64(s[k]))
        edges = 0
        for k in range(length):
            edges += (u[k] <= 0.0) | (u[k] >= 1.0) | (v[k] <= 0.0) | (v[k] >= 1.0)
        if edges:
            for k in range(length):
                edge = (u[k] <= 0.0) | (u[k] >= 1.0) | (v[k] <= 0.0) | (v[k] >= 1.0)
                if edge and w[k] > 0.0:
                    corner = np.int64(l[k]) * m + np.int64(s[k])
                    _count_untouched(corner, u[k], v[k], m, lack)
        if plain:
            for k in range(length):
                vv, uv = v[k] * v[k], u[k] * v[k]
                first = (1.0, v[k], vv, z[k], z[k] * v[k], u[k], uv, u[k] * vv)
                _add_record(table, at[k], first, 1.0, u[k])
        else:
            for k in range(length):
                wz, wv, wu = w[k] * z[k], w[k] * v[k], w[k] * u[k]
                wvv = wv * v[k]
                first = (w[k], wv, wvv, wz, wz * v[k], wu, wu * v[k], u[k] * wvv)
                _add_record(table, at[k], first, 1.0 if w[k] > 0.0 else 0.0, u[k])
    found[0] = min(found[0], low.min())
    found[1] = max(found[1], high.max())
    found[2] = min(found[2], left.min())
    found[3] = max(found[3], right.max())
    found[4] += strange.sum()
    found[5] += square.sum()


@no_type_check
def _take_off(along, across, error, slow, fast, values, rest):
    """Give readings less the table; ``values`` by node, the fast index fastest."""
    n, slow_steps, slow_numbers, slow_nodes, slow_first = slow
    m, fast_steps, fast_numbers, fast_nodes, fast_first = fast
    l, s = np.empty(_CHUNK, np.int32), np.empty(_CHUNK, np.int32)
    u, v = np.empty(_CHUNK), np.empty(_CHUNK)
    x, y = np.empty(_CHUNK), np.empty(_CHUNK)
    for start in range(0, len(error), _CHUNK):
        length = min(_CHUNK, len(error) - start)
        for k in range(length):
            x[k] = along[start + k]
        for k in range(length):
            y[k] = across[start + k]
        _place(x, n, slow_steps, slow_numbers, slow_nodes, slow_first, l, u, length)
        _place(y, m, fast_steps, fast_numbers, fast_nodes, fast_first, s, v, length)
        for k in range(length):
            corner = np.int64(l[k]) * m + np.int64(s[k])
            low, high = values[corner], values[corner + m]
            low += v[k] * (values[corner + 1] - low)
            high += v[k] * (values[corner + m + 1] - high)
            rest[start + k] = error[start + k] - (low + u[k] * (high - low))


sum_plane = machine_code(
    _sum_plane,
    types.void(
        *(_Given, _Given, _Given, _Given, types.float64),
        *(_Axis, _Axis, _Numbers, _Counts, _Numbers),
    ),
)
take_off = machine_code(
    _take_off, types.void(_Given, _Given, _Given, _Axis, _Axis, _Numbers, _Numbers)
)
