r"""What readings cannot identify, whatever they measured: by the information of their columns.

The information matrix $X^T X$ of columns that come in groups (one group per effect) shows two
kinds of it: directions without any information (`rooted`), and directions that one group
shares with another, which only their sum shows (`Correlations`: canonical correlations of the
groups beside a constant, since every group may hold one).

Source of the correlations: H. Hotelling, Relations between two sets of variates, Biometrika
28, 1936.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from functools import cached_property
from typing import final

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from ..core import rooted
from ..core._regression import SINGULAR

_ROUNDING = 1e-12
"""Information on a shape, relative to the largest of its group, that is rounding only."""
_MEMBER = 0.05
"""Part in a shared direction, relative to the largest, from which on a group is a member."""


def pivoted(
    matrix: Float[np.ndarray, "m n"],
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, " k"], Int[np.ndarray, " n"]]:
    """Return an orthonormal basis, sizes in descending order, and the columns' order."""
    factors = scipy.linalg.qr(matrix, mode="economic", pivoting=True)
    basis, upper, order = (np.asarray(factor) for factor in factors)
    return basis, np.abs(np.diag(upper)), order.astype(np.int64)


def pins_of(
    null: Float[np.ndarray, "n g"], diagonal: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Return precisions of unknowns that hold directions (columns), by information on each."""
    pins = np.zeros(len(null))
    if null.shape[1]:
        scale = np.where(diagonal > 0, np.sqrt(diagonal), 1.0)
        pinned = pivoted((null * scale[:, None]).T)[2][: null.shape[1]]
        typical = float(np.median(diagonal[diagonal > 0]))
        pins[pinned] = np.where(diagonal[pinned] > 0, diagonal[pinned], typical)
    return pins


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Shapes:
    """Groups of values, some shapes of each, and the information on these shapes.

    Attributes:
        basis: Shapes of each group, over its values.
        matrix: Information on all shapes, group after group.
        constant: Number of the group that is one constant.
    """

    basis: tuple[Float[np.ndarray, "_p _m"], ...]
    matrix: Float[np.ndarray, "m m"]
    constant: int

    @property
    def slices(self) -> list[slice]:
        """Columns of each group."""
        return _slices(self.basis)

    def limited(self, functionals: Sequence[Float[np.ndarray, "q _p"]]) -> "Shapes":
        """Return the shapes that functionals of each group's values map to zero."""
        kernels, scale = [], []
        for at, basis, rows in zip(self.slices, self.basis, functionals, strict=True):
            kernels.append(scipy.linalg.null_space(rows @ basis, rcond=SINGULAR))
            most = np.diag(self.matrix)[at].max(initial=0.0)
            scale += [most] * kernels[-1].shape[1]
        mixing = scipy.linalg.block_diag(*kernels)
        matrix = mixing.T @ self.matrix @ mixing
        valid = np.diag(matrix) > _ROUNDING * np.array(scale)
        pairs = zip(self.basis, kernels, strict=True)
        limited = tuple(basis @ kernel for basis, kernel in pairs)
        matrix = np.where(np.outer(valid, valid), matrix, 0.0)
        return Shapes(limited, matrix, self.constant)


def _slices(blocks: Sequence[np.ndarray]) -> list[slice]:
    ends = np.cumsum([0, *(block.shape[1] for block in blocks)]).tolist()
    return [slice(*pair) for pair in itertools.pairwise(ends)]


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Shared:
    """Directions that two or more groups share, or one with a constant.

    Attributes:
        members: Numbers of the groups.
        correlation: The largest of these directions, 0 to 1.
        count: Number of directions.
        sizes: Part of each value of each member in them, relative to its largest.
    """

    members: tuple[int, ...]
    correlation: float
    count: int
    sizes: tuple[Float[np.ndarray, " _p"], ...]


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Correlations:
    """Groups beside a constant, the shapes of each made a unit matrix by themselves.

    Attributes:
        shapes: Of the groups.
        white: Mixtures of the shapes of each group that do so.
        matrix: Information on all of them: what is off its blocks couples groups.
        constants: Groups that hold the constant, or all but: it is taken out of them.
    """

    shapes: Shapes
    white: tuple[Float[np.ndarray, "_m _r"], ...]
    matrix: Float[np.ndarray, "r r"]
    constants: tuple[Shared, ...]

    @classmethod
    def of(cls, shapes: Shapes, limit: float) -> "Correlations":
        """Return the correlations of groups.

        A shape with a smaller share left beside the constant than a limit is the constant.
        """
        slices, number = shapes.slices, shapes.constant
        along = shapes.matrix[:, slices[number]][:, 0]
        total = float(along[slices[number]][0])
        white: list[np.ndarray] = []
        constants = []
        for k, at in enumerate(slices):
            mixing = rooted(shapes.matrix[at, at])[0]
            shadow = mixing.T @ along[at] / np.sqrt(total)
            length = float(shadow @ shadow)
            if k != number and 1.0 - length < limit:
                held = shapes.basis[k] @ mixing @ shadow[:, None]
                correlation = float(np.sqrt(min(length, 1.0)))
                sizes = (_sizes(held), np.zeros(1))
                constants.append(Shared((k, number), correlation, 1, sizes))
            # What is left beside the constant: nothing of the constant itself.
            left, modes = np.linalg.eigh(np.eye(len(shadow)) - np.outer(shadow, shadow))
            good = left >= limit
            white.append(mixing @ modes[:, good] / np.sqrt(left[good]))
        overall = scipy.linalg.block_diag(*white)
        projected = shapes.matrix - np.outer(along, along) / total
        matrix = np.asarray(overall.T @ projected @ overall)
        return cls(shapes, tuple(white), matrix, tuple(constants))

    @cached_property
    def _slices(self) -> list[slice]:
        return _slices(self.white)

    @cached_property
    def _modes(self) -> tuple[Float[np.ndarray, " r"], Float[np.ndarray, "r r"]]:
        values, vectors = np.linalg.eigh(self.matrix)
        return np.asarray(values), np.asarray(vectors)

    def remaining(self) -> list[float]:
        """Return the information left of each group beside all others; a direction has 1 alone."""
        values, vectors = self._modes
        inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
        return [float(np.trace(np.linalg.inv(inverse[at, at]))) for at in self._slices]

    def hidden(self, number: int) -> Float[np.ndarray, " p"]:
        """Return the part of each value of a group, 0 to 1, that no reading shows at all."""
        basis, at = self.shapes.basis[number], self.shapes.slices[number]
        matrix = self.shapes.matrix[at, at]
        white, _ = rooted(matrix)
        length = np.maximum(np.linalg.norm(basis, axis=1), 1e-300)
        free = basis - basis @ white @ (white.T @ matrix)
        full = white.shape[1] == basis.shape[1]
        return np.zeros(len(basis)) if full else np.linalg.norm(free, axis=1) / length

    def pairs(self, limit: float) -> dict[tuple[int, int], Shared]:
        """Return what two groups share but for a share of information below a limit."""
        result = {}
        for second, first in itertools.product(range(len(self.white)), repeat=2):
            block = self.matrix[self._slices[first], self._slices[second]]
            if first >= second or not block.size:
                continue
            left, strength, right = np.linalg.svd(block, full_matrices=False)
            alike = 1.0 - np.square(np.minimum(strength, 1.0)) < limit
            if alike.any():
                mixed = {first: left[:, alike], second: right[alike].T}
                result[first, second] = self._shared(mixed, float(strength[0]))
        return result

    def several(self, limit: float, paired: Sequence[tuple[int, int]]) -> list[Shared]:
        """Return what three or more groups share and no two of them explain.

        Mixtures of all groups of less information than a limit count; pairs that share something
        themselves are looked at no more.
        """
        covered = set(itertools.chain.from_iterable(paired))
        values, vectors = self._modes
        result = []
        for weak in vectors[:, values < limit].T:
            strength = np.array([np.square(weak[at]).sum() for at in self._slices])
            members = np.flatnonzero(strength > _MEMBER * strength.max()).tolist()
            if len(members) > 2 and not covered & set(members):
                covered |= set(members)
                mixed = {k: weak[self._slices[k], None] for k in members}
                result.append(self._shared(mixed, 1.0))
        return result

    def _shared(
        self, mixed: dict[int, Float[np.ndarray, "_r a"]], correlation: float
    ) -> Shared:
        basis, white = self.shapes.basis, self.white
        values = [basis[k] @ white[k] @ mixture for k, mixture in mixed.items()]
        count = int(values[0].shape[1])
        return Shared(tuple(mixed), correlation, count, tuple(map(_sizes, values)))


def _sizes(values: Float[np.ndarray, "p a"]) -> Float[np.ndarray, " p"]:
    size = np.linalg.norm(values, axis=1)
    return np.asarray(size / max(float(size.max(initial=0.0)), 1e-300))
