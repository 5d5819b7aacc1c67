"""Information of readings about the unknowns of a stack; it adds up.

All that a fit needs of its readings are these sums about a current estimate: over pieces
of a file, over files, over workers. A group is left out by adding up the others.
"""

import dataclasses
import functools
import operator
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any, final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from ...models import EquidistantNodes, Plane
from ._loss import Loss
from ._prior import lower_band
from ._readings import FitError, Readings, Vector
from ._stack import Matrix, Stack

MANY = 100_000
"""From this many readings on, compiled loops pay for loading the compiler."""
_SHIFT, _SIZE = 45, (1 << 18) - 1
_FIRST, _BINS = (1023 - 60) << 7, 80 << 7
"""Residuals are counted by the leading bits of a float, the sign taken off: 128 bins per octave, 80
octaves."""
_CERTAIN = 1e6
"""Readings that leave no doubt of a value and enough digits to all others."""
_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)
"""Slack of a node, as in `axcomp.models.EquidistantNodes`."""

Axes = tuple[tuple[float, ...], ...]
"""Start, 1/interval, slack and last node of the slow and of the fast axis of a plane."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Sums:
    """Sums over readings about a current estimate θ; W is 1 for those that count, else 0.

    Attributes:
        stack: Effects.
        diagonals: $A^T W A$ of the band: ``[j, s]`` is element ``(j + offsets[s], j)``.
        cross: $A^T W A$ of the border with the band.
        border: $A^T W A$ of the border.
        right: $A^T ψ$ of the residuals.
        tally: Readings that count, Σψ', Σψ²; Σr² and number of those that are not wild.
        histogram: Number of residuals by size.
        support: Readings that touch each unknown; of a node, with a share that rounding of
            positions does not make.
    """

    stack: Stack
    diagonals: Float[np.ndarray, "n s"]
    cross: Float[np.ndarray, "m n"]
    border: Float[np.ndarray, "m m"]
    right: Float[np.ndarray, " u"]
    tally: Float[np.ndarray, " 5"]
    histogram: Int[np.ndarray, " b"]
    support: Int[np.ndarray, " u"]

    @classmethod
    def empty(cls, stack: Stack) -> "Sums":
        """Return sums over nothing."""
        n, m = stack.band, stack.size - stack.band
        return cls(
            stack,
            np.zeros((n, len(stack.offsets))),
            np.zeros((m, n)),
            np.zeros((m, m)),
            np.zeros(stack.size),
            np.zeros(5),
            np.zeros(_BINS, np.int64),
            np.zeros(stack.size, np.int64),
        )

    def __add__(self, other: "Sums") -> "Sums":
        names = [field.name for field in dataclasses.fields(self)[1:]]
        sums = (getattr(self, name) + getattr(other, name) for name in names)
        return Sums(self.stack, *sums)

    def with_matrix(self, other: "Sums") -> "Sums":
        """Return these sums with the matrix and the support of others."""
        right, tally, histogram = self.right, self.tally, self.histogram
        return dataclasses.replace(other, right=right, tally=tally, histogram=histogram)

    @property
    def diagonal(self) -> Vector:
        """Information on each unknown alone."""
        return np.concatenate([self.diagonals[:, 0], np.diag(self.border)])

    def apply(self, values: Float[np.ndarray, " u"]) -> Vector:
        """Return $A^T W A$ × values."""
        if not self.stack.band:
            return np.asarray(self.border @ values)
        band, rest = np.split(values, [self.stack.band])
        upper = self.band_matrix @ band + self.cross.T @ rest
        return np.concatenate([upper, self.cross @ band + self.border @ rest])

    @property
    def band_matrix(self) -> sp.dia_array:
        """$A^T W A$ of the band, both triangles."""
        n, offsets = self.stack.band, self.stack.offsets
        lower: Any = [self.diagonals[: n - k, s] for s, k in enumerate(offsets)]
        signed: Any = [*(-k for k in offsets), *offsets[1:]]
        return sp.diags_array([*lower, *lower[1:]], offsets=signed, shape=(n, n))

    def moved(self, step: Vector, gain: float = 1.0) -> "Sums":
        """Return the sums about θ + step; weights and mean ψ' (``gain``) of the loss stay."""
        change = gain * self.apply(step)
        tally = self.tally.copy()
        tally[2] += gain * float(step @ (change - 2.0 * self.right))
        return dataclasses.replace(self, right=self.right - change, tally=tally)

    def reduced(self, stack: Stack, band: sp.csr_array) -> "Sums":
        """Return the sums over fewer unknowns of the band, of which these are linear functions.

        Args:
            stack: Of the fewer unknowns.
            band: These unknowns of the band per unknown of the smaller one.
        """
        n = self.stack.band
        lower = lower_band(sp.csr_array(band.T @ self.band_matrix @ band))
        diagonals = np.zeros((stack.band, len(stack.offsets)))
        for slot, k in enumerate(stack.offsets):
            if k < lower.shape[1]:
                diagonals[:, slot] = lower[:, k]
        return dataclasses.replace(
            self,
            stack=stack,
            diagonals=diagonals,
            cross=np.asarray(self.cross @ band),
            right=np.concatenate([band.T @ self.right[:n], self.right[n:]]),
            support=np.zeros(stack.size, np.int64),
        )

    def zeroed(
        self, theta: Vector, rows: Float[np.ndarray, "q m"], gain: float
    ) -> tuple["Sums", Vector]:
        """Return sums with readings that say 0, by shares in the border, and the θ they are about.

        They hold what no other reading determines: neither counted nor judged, as they fit exactly.
        """
        n, step = self.stack.band, np.zeros_like(theta)
        step[n:] = -np.linalg.pinv(rows) @ (rows @ theta[n:])
        weight = _CERTAIN * float(np.diag(self.border).mean())
        border = self.border + weight * (rows.T @ rows)
        moved = dataclasses.replace(self.moved(step, gain), border=border)
        return moved, theta + step

    @property
    def sizes(self) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " k"]]:
        """Sizes of residuals, ascending, and how many there are of each."""
        # Of truth values NumPy finds the few that are set six times as fast.
        (bins,) = (self.histogram != 0).nonzero()
        bits = ((bins + _FIRST).astype(np.int64) << _SHIFT) + (1 << (_SHIFT - 1))
        return bits.view(np.float64), self.histogram[bins]


def _binned(residual: Float[np.ndarray, " t"]) -> Int[np.ndarray, " b"]:
    """Count residuals by size: the leading bits of a float are its logarithm, piecewise."""
    place = (residual.view(np.int64) >> _SHIFT) & _SIZE
    place -= _FIRST
    return np.bincount(np.clip(place, 0, _BINS - 1, out=place), minlength=_BINS)


def sums_of(
    stack: Stack,
    readings: Readings,
    theta: Vector,
    loss: Loss,
    former: Sums | None = None,
    design: Matrix | None = None,
) -> tuple[Sums, Float[np.ndarray, " t"]]:
    """Return the sums of readings about θ, and residuals.

    Args:
        stack: Effects.
        readings: Any number of them.
        theta: Current estimate.
        loss: How much each reading counts.
        former: Where matrix and support are taken from, which do not depend on θ but on
            which readings count; None: they are summed, too.
        design: Of the readings, where it is known.

    Raises:
        FitError: If readings are not finite.
    """
    axes = loop_axes(stack, readings)
    if axes is not None and design is None:
        sums, residual = _by_loop(stack, readings, theta, loss, former is None, axes)
        return sums if former is None else sums.with_matrix(former), residual
    matrix = stack.matrix(readings) if design is None else design
    residual = readings.value - matrix @ theta
    ratio = residual / loss.scale
    share, slope = loss.influence(ratio)
    active, good = share > 0.0, np.abs(ratio) <= loss.wild_from
    psi = share * residual
    tally = [
        np.count_nonzero(active),
        slope.sum(),
        psi @ psi,
        np.square(residual).sum(where=good),
        np.count_nonzero(good),
    ]
    right, sizes = matrix.T @ psi, _binned(residual)
    vectors = {"right": right, "tally": np.array(tally, float), "histogram": sizes}
    if former is not None:
        return dataclasses.replace(former, **vectors), residual
    least = np.hstack([np.full(each.size, each.least) for each in stack.effects])
    if isinstance(matrix, np.ndarray):
        read: Any = np.abs(matrix) > least
    else:
        felt = np.abs(matrix.data) > least[matrix.indices]
        read = sp.csr_array((felt, matrix.indices, matrix.indptr), matrix.shape)
    support = read.T @ active.astype(np.int64)
    products = _products(stack, matrix, active.astype(float))
    return Sums(stack, *products, **vectors, support=support), residual


def _products(
    stack: Stack, design: Matrix, weight: Float[np.ndarray, " t"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return $A^T W A$ of the band, of the border with it, and of the border."""
    n, offsets = stack.band, list(stack.offsets)
    diagonals = np.zeros((n, len(offsets)))
    if isinstance(design, np.ndarray):
        gram: Any = design.T @ (weight[:, None] * design)
    else:
        weighted = design if weight.all() else sp.diags_array(weight) @ design
        gram = sp.csr_array(design.T @ weighted)
    for slot, k in enumerate(offsets if n else ()):
        diagonals[: n - k, slot] = gram[:n, :n].diagonal(-k)
    cross, border = gram[n:, :n], gram[n:, n:]
    if not isinstance(gram, np.ndarray):
        cross, border = cross.toarray(), border.toarray()
    return diagonals, np.ascontiguousarray(cross), np.ascontiguousarray(border)


def _by_loop(
    stack: Stack, readings: Readings, theta: Vector, loss: Loss, full: bool, axes: Axes
) -> tuple[Sums, Float[np.ndarray, " t"]]:
    """Return the sums over a plane and its residuals, by the compiled loop on all cores."""
    from ._kernel import add_plane

    table, residual = stack.table, np.empty(len(readings))
    assert table is not None
    transposed = len(table.nodes[0]) > len(table.nodes[1])
    names = table.inputs if transposed else table.inputs[::-1]
    fast = min(len(nodes) for nodes in table.nodes)
    corners = (0, 1, fast, fast + 1)
    pairs = [(a, b) for a in range(4) for b in range(a + 1)]

    def summed(rows: slice) -> Sums:
        piece, sums = readings.take(rows), Sums.empty(stack)
        along, across = (np.asarray(piece.inputs[name], float) for name in names)
        record = np.zeros((stack.band, len(pairs)))
        add_plane(
            along, across, piece.value, axes, theta, dataclasses.astuple(loss),
            full, record, sums.right, sums.tally, sums.support, residual[rows],
        )  # fmt: skip
        for place, (a, b) in enumerate(pairs):
            low, high = corners[b], corners[a]
            slot = stack.offsets.index(high - low)
            sums.diagonals[low:, slot] += record[: stack.band - low, place]
        return dataclasses.replace(sums, histogram=_binned(residual[rows]))

    step = -(-len(readings) // min(os.cpu_count() or 1, len(readings) // MANY))
    pieces = [slice(k, k + step) for k in range(0, len(readings), step)]
    # The loop lets go of the interpreter.
    with ThreadPoolExecutor(len(pieces)) as pool:
        sums = functools.reduce(operator.add, pool.map(summed, pieces))
    if not np.isfinite(residual).all():
        msg = "readings are not finite, expected numbers."
        raise FitError(msg)
    return sums, residual


def loop_axes(stack: Stack, readings: Readings) -> Axes | None:
    """Return the axes of one equidistant plane of many readings, as the loop takes them.

    It locates their cells faster than it would read them. None: a matrix is faster.
    """
    table = stack.table
    if table is None or len(stack.effects) > 1 or len(readings) < MANY:
        return None
    if not isinstance(table.model, Plane):
        return None
    axes = []
    for axis in (table.model.nodes1, table.model.nodes2):
        if not isinstance(axis, EquidistantNodes) or axis.count < 2:
            return None
        start, interval = float(axis.start), float(axis.interval)
        slack = _ROUNDING * (abs(start / interval) + axis.count)
        axes.append((start, 1.0 / interval, slack, float(axis.count - 1)))
    if len(table.nodes[0]) <= len(table.nodes[1]):
        axes.reverse()
    return tuple(axes)
