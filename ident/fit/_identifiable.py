r"""What readings cannot identify, whatever they measured: by the information of their columns.

The information matrix $X^T X$ of columns that come in groups (one group per effect) knows two
kinds of it: directions without any information (`null_space`), and directions that one group
shares with another, which only their sum shows (`Correlations`: canonical correlations of the
groups, a constant taken off first since every group may hold one). Numbers only: what a group
is, and what to say of it, is the caller's.

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

SINGULAR = 1e-9
"""Eigenvalue of scaled information below which nothing is known."""
_ROUNDING = 1e-12
"""Information, relative to what is typical, that is rounding only."""
_MEMBER = 0.05
"""Part in a shared direction, relative to the largest, from which on a group is a member."""


def null_space(
    matrix: Float[np.ndarray, "m m"], limit: float = SINGULAR
) -> Float[np.ndarray, "m g"]:
    """Return the null space of an information matrix, judged with a unit diagonal."""
    diagonal = np.diag(matrix)
    scale = np.where(diagonal > 0, np.sqrt(np.maximum(diagonal, 0.0)), 1.0)
    eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return np.asarray(vectors[:, eigenvalues < limit] / scale[:, None])


def pivoted(
    matrix: Float[np.ndarray, "m n"],
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, " k"], Int[np.ndarray, " n"]]:
    """Return an orthonormal basis, sizes in descending order, and the columns' order."""
    found = scipy.linalg.qr(matrix, mode="economic", pivoting=True)
    basis, upper, order = (np.asarray(part) for part in found)
    return basis, np.abs(np.diag(upper)), order.astype(np.int64)


def whitener(
    matrix: Float[np.ndarray, "m m"], typical: float = 0.0
) -> Float[np.ndarray, "m r"]:
    """Return columns that make information a unit matrix, what has none left out.

    Args:
        matrix: Information.
        typical: Beside which nothing but rounding is none.
    """
    diagonal = np.diag(matrix)
    some = diagonal > max(_ROUNDING * typical, 0.0)
    scale = np.where(some, np.sqrt(np.maximum(diagonal, 0.0)), 1.0)
    matrix = np.where(np.outer(some, some), matrix, 0.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    good = values > SINGULAR
    return np.asarray(vectors[:, good] / scale[:, None] / np.sqrt(values[good]))


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Shared:
    """Directions that two or more groups share.

    Attributes:
        members: Numbers of the groups.
        correlation: The largest of these directions, 0 to 1.
        mixtures: Of the columns of each member, one column per direction.
    """

    members: tuple[int, ...]
    correlation: float
    mixtures: tuple[Float[np.ndarray, "_m a"], ...]

    @property
    def count(self) -> int:
        """Number of directions."""
        return int(self.mixtures[0].shape[1])


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Correlations:
    """Groups of columns beside a constant, each made a unit matrix by itself.

    Attributes:
        alone: Mixtures of the columns of each group that do so, with the constant.
        white: Those beside the constant.
        matrix: Information on all of them: what is off its blocks couples groups.
        constants: Groups that hold the constant, or all but: it is taken out of them.
    """

    alone: tuple[Float[np.ndarray, "_m _a"], ...]
    white: tuple[Float[np.ndarray, "_m _r"], ...]
    matrix: Float[np.ndarray, "r r"]
    constants: tuple[Shared, ...]

    @classmethod
    def of(
        cls,
        matrix: Float[np.ndarray, "m m"],
        slices: Sequence[slice],
        constant: int,
        limit: float,
        typical: Sequence[float] = (),
    ) -> "Correlations":
        """Return the correlations of groups.

        Args:
            matrix: Information on all columns.
            slices: Columns of each group.
            constant: Number of the group that is one constant column; projected out.
            limit: Share left beside the constant below which a direction is the constant.
            typical: Information per column of each group, beside which rounding is none.
        """
        along = matrix[:, slices[constant]][:, 0]
        total = float(along[slices[constant]][0])
        alone: list[np.ndarray] = []
        white: list[np.ndarray] = []
        constants = []
        for k, own in enumerate(slices):
            each = whitener(matrix[own, own], typical[k] if typical else 0.0)
            alone.append(each)
            shadow = each.T @ along[own] / np.sqrt(total)
            length = float(shadow @ shadow)
            if k == constant:
                each = each[:, :0]
            elif 1.0 - length < limit:
                unit = (shadow / np.sqrt(length))[:, None]
                # The constant itself stays what it is.
                mixtures = (each @ unit, np.zeros((1, 1)))
                whole = float(np.sqrt(min(length, 1.0)))
                constants.append(Shared((k, constant), whole, mixtures))
                each = each @ scipy.linalg.null_space(unit.T)
            elif length > 0.0:
                stretch = (1.0 / np.sqrt(1.0 - length) - 1.0) / length
                each = each + each @ (stretch * np.outer(shadow, shadow))
            white.append(each)
        overall = scipy.linalg.block_diag(*white)
        rest = matrix - np.outer(along, along) / total
        return cls(
            tuple(alone), tuple(white), overall.T @ rest @ overall, tuple(constants)
        )

    @cached_property
    def _slices(self) -> tuple[slice, ...]:
        ends = np.cumsum([0, *(each.shape[1] for each in self.white)]).tolist()
        return tuple(slice(*pair) for pair in itertools.pairwise(ends))

    @cached_property
    def _modes(self) -> tuple[Float[np.ndarray, " r"], Float[np.ndarray, "r r"]]:
        values, vectors = np.linalg.eigh(self.matrix)
        return np.asarray(values), np.asarray(vectors)

    def left(self) -> list[float]:
        """Return the information left of each group beside all others.

        Summed over its directions, each of which has 1 alone.
        """
        values, vectors = self._modes
        inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T
        return [
            float(np.trace(np.linalg.inv(inverse[own, own]))) for own in self._slices
        ]

    def pairs(self, limit: float) -> list[Shared]:
        """Return what two groups share but for a share of information below a limit."""
        return [
            found
            for second in range(len(self.white))
            for first in range(second)
            if (found := self.pair(first, second, limit)) is not None
        ]

    def pair(self, first: int, second: int, limit: float) -> Shared | None:
        """Return what these two groups share; None where that is nothing."""
        block = self.matrix[self._slices[first], self._slices[second]]
        if not block.size:
            return None
        left, strength, right = np.linalg.svd(block, full_matrices=False)
        alike = 1.0 - np.square(np.minimum(strength, 1.0)) < limit
        if not alike.any():
            return None
        sides = left[:, alike], right[alike].T
        mixtures = tuple(
            self.white[k] @ side for k, side in zip((first, second), sides, strict=True)
        )
        return Shared((first, second), float(strength[0]), mixtures)

    @property
    def weakest(self) -> float:
        """Least information on any mixture of the groups; 1 where they are independent."""
        return float(self._modes[0][0]) if len(self.matrix) else 1.0

    def several(self, limit: float, known: Sequence[Shared]) -> list[Shared]:
        """Return what three or more groups share and no two of them explain.

        Args:
            limit: Information below which a mixture of all groups is shared.
            known: Pairs, whose members are looked at no more.
        """
        seen = {k for pair in known for k in pair.members}
        values, vectors = self._modes
        result = []
        for weak in vectors[:, values < limit].T:
            strength = np.array([np.square(weak[own]).sum() for own in self._slices])
            members = np.flatnonzero(strength > _MEMBER * strength.max()).tolist()
            if len(members) < 3 or seen & set(members):
                continue
            seen |= set(members)
            mixtures = tuple(
                self.white[k] @ weak[self._slices[k], None] for k in members
            )
            result.append(Shared(tuple(members), 1.0, mixtures))
        return result
