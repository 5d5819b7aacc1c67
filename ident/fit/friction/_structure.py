"""What a friction law is made of: columns that enter linearly, and their shape.

A structure turns velocities into columns; the fit finds their factors (variable projection).
Columns carry the sign of the motion, so a factor is a current that opposes it.
"""

import abc
import dataclasses
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from ....models import AbstractFriction

WAYS = ("_positive", "_negative")


@dataclasses.dataclass(frozen=True)
class Reported:
    """Parameters as users read them, and how they follow from the factors of the columns.

    Attributes:
        names: One word each, ``_positive`` and ``_negative`` where per direction.
        values: In drive units over mm/s.
        jacobian: Derivative with respect to factors, then logarithms of the shape.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " r"]
    jacobian: Float[np.ndarray, "r k"]


@dataclasses.dataclass(frozen=True)
class AbstractStructure(abc.ABC):
    """One kind of friction law.

    Attributes:
        directional: Whether each direction has factors of its own. The shape is shared.
    """

    directional: bool = False

    @property
    @abc.abstractmethod
    def words(self) -> str:
        """Name for reports."""

    @property
    @abc.abstractmethod
    def in_words(self) -> bool:
        """Whether its parameters have a meaning of their own, and not only a place."""

    @property
    @abc.abstractmethod
    def factors(self) -> tuple[str, ...]:
        """Names of the linear factors of one direction."""

    @property
    @abc.abstractmethod
    def shapes(self) -> tuple[str, ...]:
        """Names of the non-linear parameters, all positive."""

    @abc.abstractmethod
    def starts(
        self, speed: Float[np.ndarray, " t"]
    ) -> Sequence[Float[np.ndarray, " s"]]:
        """Return logarithms of shapes to start from, given the speeds in mm/s."""

    @abc.abstractmethod
    def bounds(
        self, speed: Float[np.ndarray, " t"]
    ) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
        """Return the least and the largest logarithms that the data could tell apart."""

    @abc.abstractmethod
    def profile(
        self, speed: Float[np.ndarray, " t"], shape: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, "t k"]:
        """Return the columns of one direction over the speed, without a sign."""

    @abc.abstractmethod
    def profile_slopes(
        self, speed: Float[np.ndarray, " t"], shape: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, "s t k"]:
        """Return the derivatives of the columns with respect to the logarithms."""

    @property
    @abc.abstractmethod
    def shaped(self) -> tuple[int, ...]:
        """Places of the factors of one direction whose columns follow the shape."""

    @abc.abstractmethod
    def pairs(
        self, speed: Float[np.ndarray, " t"]
    ) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "t 2"]]:
        """Return which of the factors of one direction that follow no shape each speed meets.

        They are two neighbours: place of the first, and the columns of both.
        """

    def still_profile(self, speed: Float[np.ndarray, " t"]) -> Float[np.ndarray, "t k"]:
        """Return the columns of one direction that do not follow the shape."""
        cell, both = self.pairs(speed)
        found = np.zeros((len(speed), len(self.factors) - len(self.shaped)))
        rows = np.arange(len(speed))
        found[rows, cell], found[rows, cell + 1] = both.T
        return found

    @abc.abstractmethod
    def shaped_profiles(
        self,
        speed: Float[np.ndarray, "r t"],
        of: Int[np.ndarray, " w"],
        shapes: Float[np.ndarray, "w s"],
    ) -> tuple[Float[np.ndarray, "w t"], Float[np.ndarray, "s w t"]]:
        """Return the one column that does, for several shapes, and its derivatives.

        Args:
            speed: Of some recordings, in mm/s.
            of: Recording that each shape is for.
            shapes: Logarithms.
        """

    def shaped_values(
        self,
        speed: Float[np.ndarray, "r t"],
        of: Int[np.ndarray, " w"],
        shapes: Float[np.ndarray, "w s"],
    ) -> Float[np.ndarray, "w t"]:
        """Return what `shaped_profiles` does without the derivatives."""
        return self.shaped_profiles(speed, of, shapes)[0]

    @abc.abstractmethod
    def bends(self) -> Float[np.ndarray, "b k"] | None:
        """Return what of the factors of one direction the smoothness prior keeps small.

        Two less than there are factors: a straight line costs nothing.
        """

    def penalty(self) -> Float[np.ndarray, "k k"] | None:
        """Return the matrix of the smoothness prior on the factors of one direction."""
        bends = self.bends()
        return None if bends is None else np.asarray(bends.T @ bends)

    @abc.abstractmethod
    def reported_way(
        self, factors: Float[np.ndarray, " k"], shape: Float[np.ndarray, " s"]
    ) -> Reported:
        """Return the parameters of one direction as users read them."""

    @abc.abstractmethod
    def law(
        self, factors: Float[np.ndarray, "w k"], shape: Float[np.ndarray, " s"]
    ) -> AbstractFriction:
        """Return the law for factors per direction (one row where both are alike).

        Its numbers may be as NumPy has them, of which JAX takes no derivative.
        """

    @cached_property
    def alike(self) -> "AbstractStructure":
        """The same kind of law for both directions together."""
        return (
            dataclasses.replace(self, directional=False) if self.directional else self
        )

    @property
    def ways(self) -> int:
        """How many sets of factors there are."""
        return 2 if self.directional else 1

    @property
    def kind(self) -> tuple[object, ...]:
        """What laws have in common whose columns are the same but for places of knots."""
        return type(self), self.directional, self.names, self.shapes

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all factors in the order of `columns`."""
        if not self.directional:
            return self.factors
        return tuple(name + way for way in WAYS for name in self.factors)

    def columns(
        self, velocity: Float[np.ndarray, " t"], shape: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, "t k"]:
        """Return all columns at velocities in mm/s; at rest they are 0."""
        profile = self.profile(np.abs(velocity), shape)
        return self.signed(self.signs(velocity), profile)

    def column_slopes(
        self, velocity: Float[np.ndarray, " t"], shape: Float[np.ndarray, " s"]
    ) -> list[Float[np.ndarray, "t k"]]:
        """Return their derivatives with respect to the logarithms of the shape."""
        slopes = self.profile_slopes(np.abs(velocity), shape)
        return [self.signed(self.signs(velocity), slope) for slope in slopes]

    @property
    def shaped_places(self) -> tuple[int, ...]:
        """Places of these among all factors, by direction."""
        width = len(self.factors)
        return tuple(
            way * width + place for way in range(self.ways) for place in self.shaped
        )

    def still_columns(
        self, velocity: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, "t k"]:
        """Return the columns that do not follow the shape, in order."""
        return self.signed(self.signs(velocity), self.still_profile(np.abs(velocity)))

    def signs(self, velocity: Float[np.ndarray, " t"]) -> Float[np.ndarray, "w t"]:
        """Return what the columns of each direction carry as sign; 0 elsewhere."""
        if not self.directional:
            return np.asarray(np.sign(velocity)[None])
        return np.stack([(velocity > 0) * 1.0, (velocity < 0) * -1.0])

    def signed(
        self, signs: Float[np.ndarray, "w t"], profile: Float[np.ndarray, "t k"]
    ) -> Float[np.ndarray, "t m"]:
        """Return columns over velocity, given those of one direction over the speed."""
        found = np.empty((len(profile), self.ways * profile.shape[1]))
        self.put_signed(signs, profile, found)
        return found

    def put_signed(
        self,
        signs: Float[np.ndarray, "w t"],
        profile: Float[np.ndarray, "t k"],
        into: Float[np.ndarray, "t m"],
    ) -> None:
        """Write what `signed` returns."""
        width = profile.shape[1]
        for way, sign in enumerate(signs):
            own = into[:, way * width : (way + 1) * width]
            np.multiply(sign[:, None], profile, out=own)

    def levels(self) -> Float[np.ndarray, " k"]:
        """Return what a constant added to the level of one direction adds to its factors."""
        return np.asarray([name in self.level_names for name in self.factors], float)

    @property
    @abc.abstractmethod
    def level_names(self) -> tuple[str, ...]:
        """The factors that a constant in the level of friction adds to."""

    def reported(
        self, factors: Float[np.ndarray, " k"], shape: Float[np.ndarray, " s"]
    ) -> Reported:
        """Return all parameters as users read them."""
        if not self.directional:
            return self.reported_way(factors, shape)
        rows = factors.reshape(self.ways, -1)
        width = rows.shape[1]
        names: list[str] = []
        values: list[np.ndarray] = []
        total = len(factors) + len(shape)
        blocks = []
        shared = set(self.shapes)
        for way, row in enumerate(rows):
            one = self.reported_way(row, shape)
            own = [name for name in one.names if name not in shared or way == 0]
            keep = [one.names.index(name) for name in own]
            names += [name if name in shared else name + WAYS[way] for name in own]
            values.append(one.values[keep])
            block = np.zeros((len(keep), total))
            block[:, way * width : (way + 1) * width] = one.jacobian[keep][:, :width]
            block[:, len(factors) :] = one.jacobian[keep][:, width:]
            blocks.append(block)
        return Reported(tuple(names), np.concatenate(values), np.concatenate(blocks))
