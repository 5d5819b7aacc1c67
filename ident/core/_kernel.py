"""The compiled loops of the sums: readings of a plane, and readings of any stack.

`Sums` gives the same from NumPy and SciPy for few readings; importing this module loads
numba, which compiles once per machine. Cells of equidistant nodes are located in the same
pass, with the same bits as `axcomp.models.EquidistantNodes` (a test holds them together).
"""

# mypy: disable-error-code="no-untyped-def,untyped-decorator"

from typing import no_type_check

import numba
import numpy as np


@numba.njit(inline="always")
@no_type_check
def _cell(position, start, inverse, slack, last):
    """Return cell and place in it among ``last + 1`` equidistant nodes."""
    place = (position - start) * inverse
    node = np.floor(place + slack)
    place = node if place - node <= slack else place
    place = min(max(place, 0.0), float(last))
    cell = min(int(place), last - 1)
    return cell, place - cell


@numba.njit(inline="always")
@no_type_check
def _influence(ratio, freedom, corner):
    """Return ψ(x)/x and ψ'(x) of a loss."""
    if abs(ratio) > corner:
        return corner / abs(ratio), 0.0
    share = 1.0 / (1.0 + ratio * ratio / freedom)
    return share, (2.0 * share - 1.0) * share


@numba.njit(inline="always")
@no_type_check
def _count(tally, weight, residual, psi, slope, good):
    tally[0] += 1.0
    tally[1] += slope
    tally[2] += weight * psi * psi
    tally[3] += weight * residual * residual if good else 0.0
    tally[4] += 1.0 if good else 0.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def add_plane(
    along,
    across,
    value,
    weight,
    axes,
    theta,
    loss,
    full,
    record,
    right,
    tally,
    support,
    residual,
):
    """Add readings of an equidistant plane; a record has the products of a cell's corners."""
    # Axes: start, 1/interval, slack and last node of the slow axis, then of the fast one.
    start1, inverse1, slack1, last1 = axes[0]
    start2, inverse2, slack2, last2 = axes[1]
    scale, freedom, corner, limit, wild = loss
    fast = int(last2) + 1
    for t in range(len(value)):
        slow, u = _cell(along[t], start1, inverse1, slack1, int(last1))
        column, v = _cell(across[t], start2, inverse2, slack2, int(last2))
        node = slow * fast + column
        a, b, c, d = (1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v
        low = a * theta[node] + b * theta[node + 1]
        rest = value[t] - (low + c * theta[node + fast] + d * theta[node + fast + 1])
        w = weight[t] if len(weight) else 1.0
        residual[t] = rest * np.sqrt(w)
        ratio = residual[t] / scale
        if not abs(ratio) <= limit:
            continue
        share, slope = _influence(ratio, freedom, corner)
        psi = share * rest
        _count(tally, w, rest, psi, slope, abs(ratio) <= wild)
        right[node] += w * a * psi
        right[node + 1] += w * b * psi
        right[node + fast] += w * c * psi
        right[node + fast + 1] += w * d * psi
        if not full:
            continue
        one = record[node]
        one[0] += w * a * a
        one[1] += w * b * a
        one[2] += w * b * b
        one[3] += w * c * a
        one[4] += w * c * b
        one[5] += w * c * c
        one[6] += w * d * a
        one[7] += w * d * b
        one[8] += w * d * c
        one[9] += w * d * d
        support[node] += a > 0.0
        support[node + 1] += b > 0.0
        support[node + fast] += c > 0.0
        support[node + fast + 1] += d > 0.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def add_rows(
    nodes, shares, own, value, weight, theta, loss, full, record, cross, border, right, tally,
    support, residual,
):  # fmt: skip
    """Add readings of any stack; the first ``own`` entries of a row belong to the band."""
    n, width = record.shape[0], nodes.shape[1]
    scale, freedom, corner, limit, wild = loss
    for t in range(len(value)):
        rest = value[t]
        for a in range(width):
            rest -= shares[t, a] * theta[nodes[t, a]]
        w = weight[t] if len(weight) else 1.0
        residual[t] = rest * np.sqrt(w)
        ratio = residual[t] / scale
        if not abs(ratio) <= limit:
            continue
        share, slope = _influence(ratio, freedom, corner)
        psi = share * rest
        _count(tally, w, rest, psi, slope, abs(ratio) <= wild)
        for a in range(width):
            right[nodes[t, a]] += w * shares[t, a] * psi
        if not full:
            continue
        place = 0
        for a in range(width):
            i, wa = nodes[t, a], w * shares[t, a]
            support[i] += shares[t, a] != 0.0
            for b in range(a + 1):
                j, product = nodes[t, b], wa * shares[t, b]
                if a < own:
                    record[nodes[t, 0], place] += product
                    place += 1
                elif b < own:
                    cross[i - n, j] += product
                else:
                    twice = 2.0 if i == j and a != b else 1.0
                    border[max(i, j) - n, min(i, j) - n] += twice * product
