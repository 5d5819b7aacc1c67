"""Sums and residuals of friction laws as machine code, row by row and fit by fit.

Of the columns of a friction law a row meets few: those beside friction, the two factors that
its speed lies between, and what follows the shape. Adding up their products alone takes far
less than products of matrices do that are zero for the most part, and no array of all columns
is made. Each fit is summed up by itself, in the order of its rows: the same bits, whatever
stands beside it.

A row is, in the order of the factors: ``fixed`` columns, ``more`` columns, and the factors of
the law, ``width`` of them per direction (``way``). Of these the row meets ``place`` and
``place + 1`` with both numbers of ``pair``, and ``third`` of its direction with ``drop``, all
of them signed.

Rows are taken as slices and places without a sign: an index that might be negative is looked
at again at every access, which takes as long as the sums.

Importing this module compiles it, which takes seconds the first time; numba keeps the result
beside this file, or in the user's cache where it cannot write there. Products and sums are
not fused, so that any processor gives the same bits.
"""

from typing import Any, no_type_check

import numpy as np
from numba import types

from .._machine_code import machine_code

_Table = types.Array(types.float64, 2, "C", readonly=True)
_Stack = types.Array(types.float64, 3, "C", readonly=True)
_Cells = types.Array(types.int64, 2, "C", readonly=True)
_Places = types.Array(types.int64, 1, "C", readonly=True)
_Rows = (_Stack, _Stack, _Cells, _Cells, _Stack, _Table)
"""fixed, more, way, place, pair, drop."""
_Law = (types.int64, types.int64)
"""width, third (−1: nothing follows a shape)."""
_Fits = (_Places, _Places, _Places, _Places)
"""Of each fit: its recording, where ``more`` and ``drop`` are, first row, end."""


_PIVOT = 1e-7
"""Share of a column that the others must leave of it, to be told apart without doubt."""


@no_type_check
def _normal(
    fixed, more, way, place, pair, drop, width, third,
    of, beside, first, end, weight, target, aim, found,
):  # fmt: skip
    """Add up XᵀW [X, target] into a matrix per fit.

    The weights of its rows are where ``beside`` says, and what it is to meet is in the row
    ``aim`` of ``target``.
    """
    many, extra, size = fixed.shape[2], more.shape[2], found.shape[1]
    start = many + extra
    nothing = np.zeros(fixed.shape[1])
    for w in range(len(of)):
        r, b, rows = of[w], beside[w], slice(first[w], end[w])
        own, further = fixed[r, rows], more[b, rows]
        places, both, ways = place[r, rows], pair[r, rows], way[r, rows]
        share, aims = weight[b, rows], target[aim[w], rows]
        moved = drop[b, rows] if third >= 0 else aims
        one, two = nothing, nothing
        if start > 0:
            one = own[:, 0] if many > 0 else further[:, 0]
        if start > 1:
            two = own[:, 1] if many > 1 else further[:, 1 - many]
        out = found[w]
        out[:] = 0.0
        aa = ab = bb = ay = by = 0.0
        begin, count = 0, len(aims)
        while begin < count:
            if share[begin] == 0.0:
                begin += 1
                continue
            # Rows that meet the same factors: their sums stay in registers.
            cell = places[begin]
            stop = begin + 1
            while stop < count and (places[stop] == cell or share[stop] == 0.0):
                stop += 1
            ap = aq = bp = bq = pp = pq = qq = py = qy = 0.0
            am = bm = pm = qm = mm = my = 0.0
            for k in range(begin, stop):
                s = np.uint64(k)
                a, b_, y = one[s], two[s], aims[s]
                p, q = both[s, 0], both[s, 1]
                wa, wb, wp, wq = share[s] * a, share[s] * b_, share[s] * p, share[s] * q
                aa += wa * a
                ab += wa * b_
                bb += wb * b_
                ay += wa * y
                by += wb * y
                ap += wa * p
                aq += wa * q
                bp += wb * p
                bq += wb * q
                pp += wp * p
                pq += wp * q
                qq += wq * q
                py += wp * y
                qy += wq * y
                if third >= 0:
                    m = moved[s]
                    wm = share[s] * m
                    am += wa * m
                    bm += wb * m
                    pm += wp * m
                    qm += wq * m
                    mm += wm * m
                    my += wm * y
            p, q = start + cell, start + cell + 1
            at = start + ways[begin] * width + third
            if start > 0:
                out[0, p] += ap
                out[0, q] += aq
            if start > 1:
                out[1, p] += bp
                out[1, q] += bq
            out[p, p] += pp
            out[p, q] += pq
            out[q, q] += qq
            out[p, size] += py
            out[q, size] += qy
            if third >= 0:
                if start > 0:
                    out[0, at] += am
                if start > 1:
                    out[1, at] += bm
                out[p, at] += pm
                out[q, at] += qm
                out[at, at] += mm
                out[at, size] += my
            for i in range(2, start):
                column = own[:, i] if i < many else further[:, i - many]
                xa = xb = xx = xp = xq = xm = xy = 0.0
                for k in range(begin, stop):
                    s = np.uint64(k)
                    x = share[s] * column[s]
                    xa += x * one[s]
                    xb += x * two[s]
                    xx += x * column[s]
                    xp += x * both[s, 0]
                    xq += x * both[s, 1]
                    xy += x * aims[s]
                    if third >= 0:
                        xm += x * moved[s]
                out[0, i] += xa
                out[1, i] += xb
                out[i, i] += xx
                out[i, p] += xp
                out[i, q] += xq
                out[i, size] += xy
                if third >= 0:
                    out[i, at] += xm
                for j in range(2, i):
                    other = own[:, j] if j < many else further[:, j - many]
                    for k in range(begin, stop):
                        s = np.uint64(k)
                        out[j, i] += share[s] * column[s] * other[s]
            begin = stop
        if start > 0:
            out[0, 0], out[0, size] = aa, ay
        if start > 1:
            out[0, 1], out[1, 1], out[1, size] = ab, bb, by
        for i in range(size):
            for j in range(i):
                out[i, j] = out[j, i]


@no_type_check
def _left(
    fixed, more, way, place, pair, drop, width, third,
    of, beside, first, end, factors, target, into, found,
):  # fmt: skip
    """Give target − fit, sample by sample, in the row ``into`` of what is found."""
    many, extra = fixed.shape[2], more.shape[2]
    for w in range(len(of)):
        r, b, rows = of[w], beside[w], slice(first[w], end[w])
        own, further, ways = fixed[r, rows], more[b, rows], way[r, rows]
        places, both, aims = place[r, rows], pair[r, rows], target[r, rows]
        still, law = factors[w, : many + extra], factors[w, many + extra :]
        fit = found[into[w], rows]
        # Column by column: one loop over all of them takes twice as long.
        for k in range(len(fit)):
            s, cell = np.uint64(k), np.uint64(places[k])
            fit[s] = both[s, 0] * law[cell] + both[s, 1] * law[cell + np.uint64(1)]
        if third >= 0:
            moved, there = drop[b, rows], law[third]
            back = law[width + third] if width < len(law) else there
            for k in range(len(fit)):
                s = np.uint64(k)
                fit[s] += moved[s] * (back if ways[s] > 0 else there)
        for i in range(many + extra):
            column = own[:, i] if i < many else further[:, i - many]
            factor = still[i]
            for k in range(len(fit)):
                s = np.uint64(k)
                fit[s] += column[s] * factor
        for k in range(len(fit)):
            s = np.uint64(k)
            fit[s] = aims[s] - fit[s]


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
    fixed, more, way, place, pair, drop, width, third, of, beside, found
):  # fmt: skip
    """Write all columns of one fit, a row for each sample; ``more`` go last."""
    many, extra = fixed.shape[2], more.shape[2]
    own, further, places, both = fixed[of], more[beside], place[of], pair[of]
    still, law = found[:, :many], found[:, many:]
    last = found[:, found.shape[1] - extra :]
    ways = way[of]
    found[:] = 0.0
    for k in range(len(found)):
        s, cell = np.uint64(k), np.uint64(places[k])
        for i in range(many):
            still[s, i] = own[s, i]
        for i in range(extra):
            last[s, i] = further[s, i]
        law[s, cell] = both[s, 0]
        law[s, cell + np.uint64(1)] = both[s, 1]
        if third >= 0:
            law[s, np.uint64(ways[s] * width + third)] = drop[beside, s]


@no_type_check
def _squares(fixed, place, pair, usable, found):
    """Add up the squares of the columns that follow no shape, over the rows of recordings."""
    many = fixed.shape[2]
    for r in range(len(fixed)):
        own, places, both, still = fixed[r], place[r], pair[r], found[r]
        law = still[many:]
        still[:] = 0.0
        for k in range(len(own)):
            s, cell = np.uint64(k), np.uint64(places[k])
            if not usable[r, s]:
                continue
            for i in range(many):
                still[i] += own[s, i] * own[s, i]
            law[cell] += both[s, 0] * both[s, 0]
            law[cell + np.uint64(1)] += both[s, 1] * both[s, 1]


@no_type_check
def _squares_of_drop(way, drop, of, found):
    """Add up the squares of what follows the shape, fit by fit and by direction."""
    for w in range(len(of)):
        ways, moved = way[of[w]], drop[w]
        front = back = 0.0
        for k in range(len(moved)):
            s = np.uint64(k)
            square = moved[s] * moved[s]
            front += square * (1 - ways[s])
            back += square * ways[s]
        found[w, 0] = front
        if found.shape[1] > 1:
            found[w, 1] = back


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
_Flags = types.Array(types.boolean, 2, "C", readonly=True)
squares = machine_code(_squares, types.void(_Stack, _Cells, _Stack, _Flags, _Matrix))
squares_of_drop = machine_code(
    _squares_of_drop, types.void(_Cells, _Table, _Places, _Matrix)
)
