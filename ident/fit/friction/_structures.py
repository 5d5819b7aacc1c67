"""The friction laws with named parameters: Coulomb + viscous, Stribeck."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, final

import jax
import numpy as np
from jaxtyping import Float, Int

from ....data.signals import quantile
from ....models import AbstractFriction, StribeckFriction
from ._linear_structure import AbstractLinearStructure
from ._structure import AbstractStructure, Reported

_GAUSS = 2.0
_RATIO = np.sqrt(2.0)
_SHAPES = (1.0, 2.0)
_SHAPE_RANGE = (0.3, 6.0)
_LARGEST = 700.0
"""Largest power whose exponential is not 0."""
_FIRST = np.zeros(1, np.int64)
_REST = 1e-300
"""mm/s that stand for rest, where a logarithm is asked for."""


@final
@dataclasses.dataclass(frozen=True)
class CoulombViscous(AbstractLinearStructure):
    """A constant level and a slope: 2 factors per direction."""

    @property
    def words(self) -> str:
        """See `AbstractStructure`."""
        return "Coulomb + viscous" + (" per direction" if self.directional else "")

    @property
    def in_words(self) -> bool:
        """See `AbstractStructure`."""
        return True

    @property
    def factors(self) -> tuple[str, ...]:
        """See `AbstractStructure`."""
        return ("coulomb", "viscous")

    @property
    def level_names(self) -> tuple[str, ...]:
        """See `AbstractStructure`."""
        return ("coulomb",)

    def pairs(
        self, speed: Float[np.ndarray, " t"]
    ) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "t 2"]]:
        """See `AbstractStructure`."""
        return _level_and_slope(speed)

    def bends(self) -> Float[np.ndarray, "b k"] | None:
        """See `AbstractStructure`."""
        return None

    def reported_way(
        self, factors: Float[np.ndarray, " k"], shape: Float[np.ndarray, " s"]
    ) -> Reported:
        """See `AbstractStructure`."""
        return Reported(self.factors, factors, np.eye(2))

    def law(
        self, factors: Float[np.ndarray, "w k"], shape: Float[np.ndarray, " s"]
    ) -> AbstractFriction:
        """See `AbstractStructure`."""
        coulomb, viscous = factors.T
        # With break-away at the Coulomb level the Stribeck velocity says nothing.
        return _stribeck(coulomb, coulomb, 1.0, 2.0, viscous)


@final
@dataclasses.dataclass(frozen=True)
class Stribeck(AbstractStructure):
    r"""Coulomb + viscous and a drop $d\,e^{-(|v|/v_s)^\delta}$ from break-away.

    Attributes:
        shape: The exponent δ, or None to fit it.
    """

    shape: float | None = _GAUSS

    @property
    def words(self) -> str:
        """See `AbstractStructure`."""
        return "Stribeck" + (" per direction" if self.directional else "")

    @property
    def in_words(self) -> bool:
        """See `AbstractStructure`."""
        return True

    @property
    def factors(self) -> tuple[str, ...]:
        """See `AbstractStructure`."""
        return ("coulomb", "viscous", "drop")

    @property
    def shapes(self) -> tuple[str, ...]:
        """See `AbstractStructure`."""
        free = ("stribeck_velocity", "stribeck_shape")
        return free if self.shape is None else free[:1]

    @property
    def level_names(self) -> tuple[str, ...]:
        """See `AbstractStructure`."""
        return ("coulomb",)

    def starts(
        self, speed: Float[np.ndarray, " t"]
    ) -> Sequence[Float[np.ndarray, " s"]]:
        """See `AbstractStructure`: a grid of v_s in steps of √2, for each usual shape."""
        low, high = self.bounds(speed)
        count = max(4, 1 + int((high[0] - low[0]) / np.log(_RATIO)))
        grid = np.linspace(low[0], high[0], count)[1:-1]
        shapes = _SHAPES if self.shape is None else ()
        if not shapes:
            return [np.array([place]) for place in grid]
        return [np.array([place, np.log(each)]) for each in shapes for place in grid]

    def bounds(
        self, speed: Float[np.ndarray, " t"]
    ) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
        """See `AbstractStructure`."""
        seen = speed[speed > 0]
        low = [np.log(quantile(seen, 0.001) / 2.0)]
        high = [np.log(2.0 * seen.max())]
        if self.shape is None:
            low.append(np.log(_SHAPE_RANGE[0]))
            high.append(np.log(_SHAPE_RANGE[1]))
        return np.asarray(low), np.asarray(high)

    def profile(
        self, speed: Float[np.ndarray, " t"], shape: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, "t k"]:
        """See `AbstractStructure`."""
        drop = self.shaped_values(speed[None], _FIRST, shape[None])[0]
        return np.stack([np.ones_like(speed), speed, drop], axis=1)

    def profile_slopes(
        self, speed: Float[np.ndarray, " t"], shape: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, "s t k"]:
        """See `AbstractStructure`."""
        result = np.zeros((len(shape), len(speed), 3))
        result[:, :, 2] = self.shaped_profiles(speed[None], _FIRST, shape[None])[1][
            :, 0
        ]
        return result

    @property
    def shaped(self) -> tuple[int, ...]:
        """See `AbstractStructure`: the drop."""
        return (2,)

    def pairs(
        self, speed: Float[np.ndarray, " t"]
    ) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "t 2"]]:
        """See `AbstractStructure`."""
        return _level_and_slope(speed)

    def shaped_profiles(
        self,
        speed: Float[np.ndarray, "r t"],
        of: Int[np.ndarray, " w"],
        shapes: Float[np.ndarray, "w s"],
    ) -> tuple[Float[np.ndarray, "w t"], Float[np.ndarray, "s w t"]]:
        """See `AbstractStructure`."""
        power, exponent, raised = self._powers(speed, of, shapes)
        values = np.exp(-power)
        slopes = np.empty((shapes.shape[1], *values.shape))
        common = np.multiply(power, values, out=power)
        np.multiply(common, exponent, out=slopes[0])
        if raised is not None and self.shape is None:
            np.multiply(common, -raised, out=slopes[1])
        return values, slopes

    def shaped_values(
        self,
        speed: Float[np.ndarray, "r t"],
        of: Int[np.ndarray, " w"],
        shapes: Float[np.ndarray, "w s"],
    ) -> Float[np.ndarray, "w t"]:
        """See `AbstractStructure`."""
        power = self._powers(speed, of, shapes)[0]
        return np.asarray(np.exp(np.negative(power, out=power), out=power))

    def _powers(
        self, speed: np.ndarray, of: np.ndarray, shapes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return (v / v_s) ** δ, at most so large, δ, and its logarithm where made."""
        free = self.shape is None
        exponent = np.exp(shapes[:, 1:]) if free else np.full((1, 1), self.shape)
        raised = None
        if self.shape == _GAUSS:
            power = speed[of] * np.exp(-shapes[:, :1])
            np.square(power, out=power)
        else:
            # At rest the power is 0: a logarithm far below all others stands for it.
            raised = np.log(np.maximum(speed, _REST))[of]
            raised -= shapes[:, :1]
            raised *= exponent
            power = np.exp(np.minimum(raised, np.log(_LARGEST)))
        np.minimum(power, _LARGEST, out=power)
        return power, exponent, raised

    def bends(self) -> Float[np.ndarray, "b k"] | None:
        """See `AbstractStructure`."""
        return None

    def reported_way(
        self, factors: Float[np.ndarray, " k"], shape: Float[np.ndarray, " s"]
    ) -> Reported:
        """See `AbstractStructure`: break-away is Coulomb level plus drop."""
        coulomb, viscous, drop = factors
        natural = np.exp(shape)
        values = np.concatenate([[coulomb, viscous, coulomb + drop], natural])
        jacobian = np.zeros((len(values), 3 + len(shape)))
        jacobian[0, 0] = jacobian[1, 1] = jacobian[2, 0] = jacobian[2, 2] = 1.0
        jacobian[3:, 3:] = np.diag(natural)
        names = ("coulomb", "viscous", "breakaway", *self.shapes)
        return Reported(names, values, jacobian)

    def law(
        self, factors: Float[np.ndarray, "w k"], shape: Float[np.ndarray, " s"]
    ) -> AbstractFriction:
        """See `AbstractStructure`."""
        exponent = np.exp(shape[1]) if self.shape is None else self.shape
        coulomb, viscous, drop = factors.T
        natural = float(np.exp(shape[0]))
        return _stribeck(coulomb, coulomb + drop, natural, float(exponent), viscous)


def _stribeck(
    coulomb: Float[np.ndarray, " w"],
    breakaway: Float[np.ndarray, " w"],
    velocity: float,
    exponent: float,
    viscous: Float[np.ndarray, " w"],
) -> StribeckFriction:
    """Return a Stribeck curve, its numbers as NumPy has them: one, or one per direction."""
    levels = (coulomb, breakaway, velocity, exponent, viscous)
    found: StribeckFriction = jax.tree.unflatten(
        _five_numbers(), [np.squeeze(each) for each in levels]
    )
    return found


@functools.cache
def _five_numbers() -> Any:
    """Return all of a Stribeck curve but its numbers.

    To put them in is a tenth of the work of making a curve of arrays of JAX.
    """
    return jax.tree.structure(StribeckFriction(*np.ones(5)))


def _level_and_slope(
    speed: Float[np.ndarray, " t"],
) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "t 2"]]:
    """Return the columns of Coulomb and viscous friction, which every speed meets."""
    cell = np.zeros(len(speed), np.int64)
    return cell, np.stack([np.ones_like(speed), speed], axis=1)
