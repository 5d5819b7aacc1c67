"""How much each row of an equation counts, how rows are seen, and the sums of them.

Rows are weighed once, under a table that can bend anywhere: what is wild under it is wild under
any law. Where a noise-free motion stands beside the measured one, rows are seen through its
columns (two-stage least squares).
"""

import dataclasses
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float

from ..core import estimate_columns, least_scale, rooted
from ._equation import Equation, Recording, in_line
from ._structures import KnotTable, Shape, Stribeck

_WILD = 4.0
"""Error in scales beyond which a row says nothing of the law."""
_RIDGE = 1e-12
"""Added to scaled normal matrices that are inverted as they stand."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """Weighted rows of an equation.

    Attributes:
        left: Columns as they are seen, times the weight of each row.
        right: Columns.
        target: What they explain.
    """

    left: Float[np.ndarray, "s k"]
    right: Float[np.ndarray, "s k"]
    target: Float[np.ndarray, " s"]

    def sums_of(self, rows: slice) -> Float[np.ndarray, "k k1"]:
        """Return the sums XᵀW [X, target] of some rows."""
        columns, target = self.left[rows].T, self.target[rows]
        return np.column_stack([columns @ self.right[rows], columns @ target])

    @cached_property
    def sums(self) -> Float[np.ndarray, "k k1"]:
        """The sums of all rows."""
        return self.sums_of(slice(None))


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Weights:
    """What the rows say before any law is asked.

    Attributes:
        share: How much each row counts, 0 to 1.
        limit: Largest error that says anything of a law.
        free: Equation of the free table.
    """

    share: Float[np.ndarray, " s"]
    limit: float
    free: Equation

    @cached_property
    def free_sums(self) -> Float[np.ndarray, "k k1"]:
        """Sums of all rows of the free table."""
        columns, target = self.free.unbent, self.free.recording.target
        return Rows(self.share[:, None] * columns, columns, target).sums

    def start(self, equation: Equation) -> Shape:
        """Return the start of a law's shape that leaves the least, as the free table sees it."""
        structure, free = equation.structure, self.free
        assert isinstance(structure, Stribeck)
        knots, fixed = np.asarray(free.recording.knots), len(free.fixed_names)
        velocity = np.concatenate([knots, -knots])
        # Factors of the free table, which has no offset, for each factor of the law.
        starts = structure.starts(equation.bounds)
        columns = structure.columns(velocity, starts)
        if "offset" in equation.fixed_names:
            columns = np.concatenate([columns, np.ones_like(columns[:, :, :1])], axis=2)
        laws = np.zeros((len(starts), len(self.free_sums), fixed + columns.shape[2]))
        laws[:, :fixed, :fixed] = np.eye(fixed)
        laws[:, fixed:, fixed:] = np.sign(velocity)[:, None] * columns
        sums = np.swapaxes(laws, 1, 2) @ self.free_sums
        factors = ridged(sums[:, :, :-1] @ laws, sums[:, :, -1])
        gains = np.einsum("nk,nk->n", sums[:, :, -1], factors)
        return np.asarray(starts[np.argmax(gains)])


@final
class View:
    """How the rows of an equation are seen: weighted, and through a noise-free motion."""

    def __init__(
        self, equation: Equation, share: Float[np.ndarray, " s"], shape: Shape
    ) -> None:
        self.equation = equation
        self.share, self._basis = share[:, None], None
        self.root = np.sqrt(self.share)
        free = equation.recording.noise_free
        if free is not None:
            fine = Equation(free, equation.structure)
            slopes = in_line(fine.falling(shape)[:, :, 1:])
            columns = np.hstack([fine.columns(shape), slopes])
            self._basis = orthonormal(self.root * columns)

    def weighted(self, columns: Float[np.ndarray, "s c"]) -> Float[np.ndarray, "s c"]:
        """Return columns times the roots of the weights, as the noise-free motion sees them."""
        weighted = self.root * columns
        if self._basis is None:
            return np.asarray(weighted)
        return np.asarray(self._basis @ (self._basis.T @ weighted))

    def rows(self, columns: Float[np.ndarray, "s k"]) -> Rows:
        """Return weighted rows of columns."""
        target = self.equation.recording.target
        if self._basis is None:
            return Rows(self.share * columns, columns, target)
        return Rows(self.root * self.weighted(columns), columns, target)


def weigh(recording: Recording, loss: str) -> Weights:
    """Return the weights of the rows under a table per direction that can bend anywhere.

    Args:
        recording: The recording.
        loss: ``"trim"``, ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If the loss is unknown.
    """
    free = Equation(recording, KnotTable(True, recording.knots))
    used = recording.usable
    rows, target = free.unbent[used], recording.target[used]
    count, size = rows.shape
    limit, share = np.inf, used * 1.0
    if loss != "gauss" and count > 2 * size:
        length = np.sqrt(np.maximum(np.einsum("sk,sk->k", rows, rows), 1e-300))
        design = rows / length
        fit = estimate_columns(design, target, loss, least_scale(target))
        ratio = (target - design @ fit.centre) / fit.loss.scale
        share[used], limit = fit.loss.share(ratio), _WILD * fit.loss.scale
    return Weights(share, limit, free)


def ridged(
    matrix: Float[np.ndarray, "*w k k"], right: Float[np.ndarray, "*w k"]
) -> Float[np.ndarray, "*w k"]:
    """Return the solutions of normal equations; 0 where columns have no rows."""
    size = np.sqrt(np.maximum(matrix.diagonal(0, -2, -1), 0.0))
    size[size == 0.0] = 1.0
    scaled = matrix / (size[..., :, None] * size[..., None, :])
    np.einsum("...kk->...k", scaled)[...] += _RIDGE
    return np.asarray(np.linalg.solve(scaled, (right / size)[..., None])[..., 0] / size)


def orthonormal(columns: Float[np.ndarray, "s c"]) -> Float[np.ndarray, "s b"]:
    """Return an orthonormal basis of columns."""
    return np.asarray(columns @ rooted(columns.T @ columns)[0])
