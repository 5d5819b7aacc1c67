"""Sums and residuals of friction laws as machine code, row by row and fit by fit.

Of the columns of a friction law a row meets few: those beside friction, the two factors that
its speed lies between, and what follows the shape. Adding up their products alone takes far
less than products of matrices do that are zero for the most part, and no array of all columns
is made. Each fit is summed up by itself, in the order of its rows: the same bits, whatever
stands beside it.

A row is, in the order of the factors: ``fixed`` columns, ``more`` columns, and per direction
``width`` factors of the law, of which the row meets ``cell`` and ``cell + 1`` with both
numbers of ``pair``, and ``third`` with ``drop``, all three times its ``sign``.

Importing this module compiles it, which takes seconds the first time; numba keeps the result
beside this file, or in the user's cache where it cannot write there. Products and sums are
not fused, so that any processor gives the same bits.
"""

from typing import Any, no_type_check

import numpy as np
from numba import njit, types

from .._machine_code import machine_code

_Table = types.Array(types.float64, 2, "C", readonly=True)
_Stack = types.Array(types.float64, 3, "C", readonly=True)
_Cells = types.Array(types.int64, 2, "C", readonly=True)
_Places = types.Array(types.int64, 1, "C", readonly=True)
_Rows = (_Stack, _Stack, _Table, _Cells, _Cells, _Stack, _Table)
"""fixed, more, sign, way, cell, pair, drop."""
_Law = (types.int64, types.int64)
"""width, third (−1: nothing follows a shape)."""
_Fits = (_Places, _Places, _Places, _Places)
"""Of each fit: its recording, where ``more`` and ``drop`` are, first row, end."""


_PIVOT = 1e-7
"""Share of a column that the others must leave of it, to be told apart without doubt."""


@njit(error_model="numpy")
@no_type_check
def _put(out, start, one, at, size, third, pair, drop):
    """Add what rows of one cell came to: products with the pair, and with the drop."""
    ap, aq, bp, bq, pp, pq, qq, py, qy = pair
    am, bm, pm, qm, mm, my = drop
    if start > 0:
        out[0, one] += ap
        out[0, one + 1] += aq
    if start > 1:
        out[1, one] += bp
        out[1, one + 1] += bq
    out[one, one] += pp
    out[one, one + 1] += pq
    out[one + 1, one + 1] += qq
    out[one, size] += py
    out[one + 1, size] += qy
    if third >= 0:
        if start > 0:
            out[0, at] += am
        if start > 1:
            out[1, at] += bm
        out[one, at] += pm
        out[one + 1, at] += qm
        out[at, at] += mm
        out[at, size] += my


@no_type_check
def _normal(
    fixed, more, sign, way, cell, pair, drop, width, third,
    of, beside, first, end, weight, target, aim, found,
):  # fmt: skip
    """Add up XᵀW [X, target] into a matrix per fit.

    The weights of its rows are where ``beside`` says, and what it is to meet is in the row
    ``aim`` of ``target``.
    """
    many, extra, size = fixed.shape[2], more.shape[2], found.shape[1]
    start = many + extra
    value = np.zeros(start + 2)
    for w in range(len(of)):
        r, b, t = of[w], beside[w], aim[w]
        out = found[w]
        out[:] = 0.0
        # Sums of the first two columns and of the cell that rows are in stay in registers.
        aa = ab = bb = ay = by = 0.0
        ap = aq = bp = bq = pp = pq = qq = py = qy = 0.0
        am = bm = pm = qm = mm = my = 0.0
        one = at = np.int64(-1)
        for s in range(first[w], end[w]):
            share = weight[b, s]
            if share == 0.0:
                continue
            base = start + way[r, s] * width
            if base + cell[r, s] != one:
                if one >= 0:
                    both = (ap, aq, bp, bq, pp, pq, qq, py, qy)
                    alone = (am, bm, pm, qm, mm, my)
                    _put(out, start, one, at, size, third, both, alone)
                ap = aq = bp = bq = pp = pq = qq = py = qy = 0.0
                am = bm = pm = qm = mm = my = 0.0
                one, at = base + cell[r, s], base + third
            for i in range(many):
                value[i] = fixed[r, s, i]
            for i in range(extra):
                value[many + i] = more[b, s, i]
            sense, y = sign[r, s], target[t, s]
            a, c = value[0], value[1]
            p, q = sense * pair[r, s, 0], sense * pair[r, s, 1]
            wa, wc, wp, wq = share * a, share * c, share * p, share * q
            aa += wa * a
            ab += wa * c
            bb += wc * c
            ay += wa * y
            by += wc * y
            ap += wa * p
            aq += wa * q
            bp += wc * p
            bq += wc * q
            pp += wp * p
            pq += wp * q
            qq += wq * q
            py += wp * y
            qy += wq * y
            m = 0.0
            if third >= 0:
                m = sense * drop[b, s]
                wm = share * m
                am += wa * m
                bm += wc * m
                pm += wp * m
                qm += wq * m
                mm += wm * m
                my += wm * y
            for i in range(2, start):
                x = share * value[i]
                for j in range(i + 1):
                    out[j, i] += x * value[j]
                out[i, one] += x * p
                out[i, one + 1] += x * q
                out[i, size] += x * y
                if third >= 0:
                    out[i, at] += x * m
        if one >= 0:
            both = (ap, aq, bp, bq, pp, pq, qq, py, qy)
            alone = (am, bm, pm, qm, mm, my)
            _put(out, start, one, at, size, third, both, alone)
        if start > 0:
            out[0, 0], out[0, size] = aa, ay
        if start > 1:
            out[0, 1], out[1, 1], out[1, size] = ab, bb, by
        for i in range(size):
            for j in range(i):
                out[i, j] = out[j, i]


@no_type_check
def _left(
    fixed, more, sign, way, cell, pair, drop, width, third,
    of, beside, first, end, factors, target, into, found,
):  # fmt: skip
    """Give target − fit, sample by sample, in the row ``into`` of what is found."""
    many, extra = fixed.shape[2], more.shape[2]
    start = many + extra
    for w in range(len(of)):
        r, b, to = of[w], beside[w], into[w]
        for s in range(first[w], end[w]):
            base = start + way[r, s] * width
            one = base + cell[r, s]
            law = pair[r, s, 0] * factors[w, one] + pair[r, s, 1] * factors[w, one + 1]
            if third >= 0:
                law += drop[b, s] * factors[w, base + third]
            fit = sign[r, s] * law
            for i in range(many):
                fit += fixed[r, s, i] * factors[w, i]
            for i in range(extra):
                fit += more[b, s, i] * factors[w, many + i]
            found[to, s] = target[r, s] - fit


@no_type_check
def _solve(own, moment, size, found, sure):
    """Solve own · x = moment by Cholesky, and tell where that holds.

    Columns are scaled to equal ``size`` before.
    """
    many = own.shape[1]
    root, scale = np.empty((many, many)), np.empty(many)
    for w in range(len(own)):
        for i in range(many):
            scale[i] = 1.0 / size[w, i] if size[w, i] > 0.0 else 1.0
        good = True
        for i in range(many):
            for j in range(i + 1):
                rest = own[w, i, j] * scale[i] * scale[j]
                whole = rest
                for k in range(j):
                    rest -= root[i, k] * root[j, k]
                if j < i:
                    root[i, j] = rest / root[j, j]
                elif rest > _PIVOT * whole:
                    root[i, i] = np.sqrt(rest)
                else:
                    good = False
                    break
            if not good:
                break
        sure[w] = good
        if good:
            for i in range(many):
                rest = moment[w, i] * scale[i]
                for k in range(i):
                    rest -= root[i, k] * found[w, k]
                found[w, i] = rest / root[i, i]
            for i in range(many - 1, -1, -1):
                rest = found[w, i]
                for k in range(i + 1, many):
                    rest -= root[k, i] * found[w, k]
                found[w, i] = rest / root[i, i]
            for i in range(many):
                found[w, i] *= scale[i]


@no_type_check
def _columns(
    fixed, more, sign, way, cell, pair, drop, width, third, of, beside, found
):  # fmt: skip
    """Write all columns of one fit, a row for each sample; ``more`` go last."""
    many, extra = fixed.shape[2], more.shape[2]
    first = found.shape[1] - extra
    for s in range(len(found)):
        found[s] = 0.0
        for i in range(many):
            found[s, i] = fixed[of, s, i]
        for i in range(extra):
            found[s, first + i] = more[beside, s, i]
        base, sense = many + way[of, s] * width, sign[of, s]
        one = base + cell[of, s]
        found[s, one] = sense * pair[of, s, 0]
        found[s, one + 1] = sense * pair[of, s, 1]
        if third >= 0:
            found[s, base + third] = sense * drop[beside, s]


def _signature(last: int) -> Any:
    """Return the types of arguments; what is found has so many axes."""
    found = types.Array(types.float64, last, "C")
    return types.void(*_Rows, *_Law, *_Fits, _Table, _Table, _Places, found)


normal = machine_code(_normal, _signature(3))
left = machine_code(_left, _signature(2))
solve = machine_code(
    _solve,
    types.void(
        types.Array(types.float64, 3, "A", readonly=True),
        types.Array(types.float64, 2, "A", readonly=True),
        _Table,
        types.Array(types.float64, 2, "C"),
        types.Array(types.boolean, 1, "C"),
    ),
)
_Matrix = types.Array(types.float64, 2, "C")
columns = machine_code(
    _columns, types.void(*_Rows, *_Law, types.int64, types.int64, _Matrix)
)
