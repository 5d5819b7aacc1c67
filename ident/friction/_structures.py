"""Kinds of friction law that a fit may follow: Coulomb + viscous, Stribeck, and a table.

A structure turns velocities into columns of a linear equation. The columns carry the sign of
the motion, so the factor of a column is a current that opposes it. The laws themselves, and
the values of the columns, are those of `axcomp.models`.
"""

import abc
import dataclasses
from functools import cached_property
from typing import final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from ...data.signals import quantile
from ...models import (
    AbstractFriction,
    FrictionTable,
    Setpoints,
    StribeckFriction,
    stribeck_columns,
)
from ..core import node_shares
from ._samples import Trace

SUFFIXES = ("_positive", "_negative")
KNOTS = 20
"""Knots of a free table."""
GAUSS = 2.0
"""Exponent of the Stribeck curve that is assumed where the data do not tell it."""
_EXPONENTS = (0.7, 1.0, 2.0)
"""Exponents from which the search starts."""
_EXPONENT_RANGE = (0.3, 6.0)
_RATIO = np.sqrt(2.0)
"""Ratio of neighbouring Stribeck velocities from which the search starts."""
_LEVELS, _DENSEST = 400, 3.0
"""Speeds at which the distribution of a recording is taken; its largest density, of an even one."""

Shape = Float[np.ndarray, " h"]
"""Logarithms of the non-linear parameters of a law, such as its Stribeck velocity."""
Shapes = Float[np.ndarray, "n h"]
"""Several of them."""


@final
class DirectionalTable(AbstractFriction):
    """A friction table per direction: what an axis may show, and a list cannot say."""

    positive: FrictionTable
    negative: FrictionTable

    def level(
        self,
        speed: Float[Array | np.ndarray, " t"],
        direction: Float[Array | np.ndarray, " t"],
    ) -> Float[Array, " t"]:
        """Return how much current supports the motion, in drive units."""
        ahead = self.positive.level(speed, direction)
        back = self.negative.level(speed, direction)
        return jnp.where(jnp.asarray(direction) < 0, back, ahead)

    def numpy_level(self, speed: Trace, direction: Trace) -> Trace:
        """Return what `level` does, computed by NumPy."""
        ahead = self.positive.numpy_level(speed, direction)
        back = self.negative.numpy_level(speed, direction)
        return np.where(direction < 0, back, ahead)


@dataclasses.dataclass(frozen=True)
class AbstractStructure(abc.ABC):
    """One kind of friction law.

    Attributes:
        directional: Whether each direction has linear factors of its own. Non-linear
            parameters are shared.
    """

    directional: bool = False

    @property
    @abc.abstractmethod
    def factors(self) -> tuple[str, ...]:
        """Names of the linear factors of one direction."""

    def steady(self, speed: Trace) -> Float[np.ndarray, "t k"]:
        """Return the columns of one direction that follow no shape, over speeds in mm/s."""
        return np.stack([np.ones_like(speed), speed], axis=1)

    @abc.abstractmethod
    def law(self, factors: Float[np.ndarray, "w k"], shape: Shape) -> AbstractFriction:
        """Return the law for factors per direction (one row where both are alike)."""

    @property
    @abc.abstractmethod
    def label(self) -> str:
        """Name for reports where both directions are alike."""

    @property
    def words(self) -> str:
        """Name for reports."""
        return self.label + " per direction" * self.directional

    @property
    def parametric(self) -> bool:
        """Whether the parameters have a meaning of their own: Coulomb level, viscosity."""
        return self.bends is None

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the non-linear parameters, all positive; fits use their logarithms."""
        return ()

    @property
    def levels(self) -> Float[np.ndarray, " k"]:
        """What a constant added to the level of one direction adds to its factors."""
        return np.asarray([name == "coulomb" for name in self.factors], float)

    @property
    def reported(self) -> tuple[tuple[str, ...], Float[np.ndarray, "r k"]]:
        """Names of the parameters of one direction as users read them, by the factors."""
        return self.factors, np.eye(len(self.factors))

    @cached_property
    def bends(self) -> Float[np.ndarray, "b k"] | None:
        """What of the factors of one direction a smoothness prior keeps small, or None."""
        return None

    def bounds(self, speed: Trace) -> Float[np.ndarray, "2 h"]:
        """Return the least and the largest logarithms that speeds in mm/s can tell apart."""
        del speed
        return np.zeros((2, 0))

    def falling(self, speed: Trace, shapes: Shapes) -> Float[np.ndarray, "c n t"]:
        """Return the one column that follows the shape, if any, and its derivatives by each."""
        return np.zeros((0, len(shapes), len(speed)))

    @property
    def ways(self) -> int:
        """How many sets of factors there are."""
        return 2 if self.directional else 1

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all factors, direction by direction."""
        if not self.directional:
            return self.factors
        return tuple(name + suffix for suffix in SUFFIXES for name in self.factors)

    def signs(self, velocity: Trace) -> Float[np.ndarray, "w t"]:
        """Return the sign that the columns of each direction carry; 0 elsewhere."""
        if not self.directional:
            return np.asarray(np.sign(velocity)[None])
        return np.stack([(velocity > 0) * 1.0, (velocity < 0) * -1.0])

    def columns(self, velocity: Trace, shapes: Shapes) -> Float[np.ndarray, "n t k"]:
        """Return all columns at velocities in mm/s for each of some shapes; 0 at rest."""
        speed = np.abs(velocity)
        steady, last = self.steady(speed), self.falling(speed, shapes)[:1]
        repeated = np.broadcast_to(steady, (len(shapes), *steady.shape))
        profile = np.concatenate([repeated, np.moveaxis(last, 0, 2)], axis=2)
        signs = self.signs(velocity)
        return np.concatenate([sign[:, None] * profile for sign in signs], axis=2)

    def friction(
        self, velocity: Trace, factors: Float[np.ndarray, "n k"], shapes: Shapes
    ) -> Float[np.ndarray, "t n"]:
        """Return the friction of several laws at velocities in mm/s: `columns` @ factors."""
        speed = np.abs(velocity)
        steady, last = self.steady(speed), self.falling(speed, shapes)[:1]
        by_way = np.moveaxis(factors.reshape(len(factors), self.ways, -1), 0, 2)
        levels = steady @ by_way[:, : steady.shape[1]]
        for falling in last:
            levels += falling.T * by_way[:, -1:]
        return np.asarray((self.signs(velocity)[:, :, None] * levels).sum(axis=0))

    def bent(self, velocity: Trace, factors: Float[np.ndarray, " k"]) -> Trace:
        """Return how far a smooth curve lies from what the law draws in straight lines."""
        del factors
        return np.zeros(len(velocity))


@final
@dataclasses.dataclass(frozen=True)
class CoulombViscous(AbstractStructure):
    """A constant level and a slope: 2 factors per direction."""

    @property
    def label(self) -> str:
        return "Coulomb + viscous"

    @property
    def factors(self) -> tuple[str, ...]:
        return ("coulomb", "viscous")

    def law(self, factors: Float[np.ndarray, "w k"], shape: Shape) -> AbstractFriction:
        coulomb, viscous = factors[0] if len(factors) == 1 else factors.T
        return StribeckFriction(coulomb, coulomb, 1.0, GAUSS, viscous)


@final
@dataclasses.dataclass(frozen=True)
class Stribeck(AbstractStructure):
    r"""Coulomb + viscous and a drop $d\,e^{-(|v|/v_s)^\delta}$ from break-away.

    Attributes:
        exponent: The exponent δ, or None to fit it.
    """

    exponent: float | None = None

    @property
    def factors(self) -> tuple[str, ...]:
        return ("coulomb", "viscous", "drop")

    @property
    def label(self) -> str:
        fixed = "" if self.exponent is None else f" with exponent {self.exponent:g}"
        return "Stribeck" + fixed

    @property
    def shapes(self) -> tuple[str, ...]:
        free = ("stribeck_velocity", "stribeck_shape")
        return free if self.exponent is None else free[:1]

    @property
    def reported(self) -> tuple[tuple[str, ...], Float[np.ndarray, "r k"]]:
        """See `AbstractStructure`: break-away is Coulomb level plus drop."""
        sums = np.eye(3)
        sums[2, 0] = 1.0
        return ("coulomb", "viscous", "breakaway"), sums

    def starts(self, bounds: Float[np.ndarray, "2 h"]) -> Shapes:
        """Return logarithms of shapes to start from, given those of `bounds`."""
        low, high = bounds[:, 0]
        count = max(4, 1 + int((high - low) / np.log(_RATIO)))
        grid = np.linspace(low, high, count)[1:-1]
        if self.exponent is not None:
            return grid[:, None]
        return np.stack(np.meshgrid(grid, np.log(_EXPONENTS)), axis=-1).reshape(-1, 2)

    def bounds(self, speed: Trace) -> Float[np.ndarray, "2 h"]:
        """See `AbstractStructure`; a thousandth of the samples may be slower."""
        speeds = speed[speed > 0]
        velocity = np.array([0.5 * quantile(speeds, 0.001), 2.0 * speeds.max()])
        ranges = [velocity, np.array(_EXPONENT_RANGE)][: len(self.shapes)]
        return np.asarray(np.log(np.stack(ranges, axis=1)))

    def falling(self, speed: Trace, shapes: Shapes) -> Float[np.ndarray, "c n t"]:
        natural = np.exp(shapes)
        exponents = self.exponent or natural[:, 1:]
        return stribeck_columns(speed, natural[:, :1], exponents)[: 1 + shapes.shape[1]]

    def law(self, factors: Float[np.ndarray, "w k"], shape: Shape) -> AbstractFriction:
        coulomb, viscous, drop = factors[0] if len(factors) == 1 else factors.T
        velocity, *free = np.exp(shape)
        exponent = free[0] if self.exponent is None else self.exponent
        return StribeckFriction(coulomb, coulomb + drop, velocity, exponent, viscous)


@final
@dataclasses.dataclass(frozen=True)
class KnotTable(AbstractStructure):
    """A free table: values at knots, linear between, held outside, smooth by a prior.

    Attributes:
        knots: Speeds in mm/s, ascending, at least two.
        held: Whether the law is held below the second knot, whatever the first shows.
    """

    knots: tuple[float, ...] = ()
    held: bool = False

    @property
    def label(self) -> str:
        return f"table of {len(self.knots)} knots"

    @property
    def factors(self) -> tuple[str, ...]:
        return tuple(f"knot_{index}" for index in range(len(self.knots)))

    @property
    def levels(self) -> Float[np.ndarray, " k"]:
        return np.ones(len(self.knots))

    @cached_property
    def bends(self) -> Float[np.ndarray, "b k"] | None:
        """See `AbstractStructure`: how far each knot lies off the line of its neighbours.

        Coulomb + viscous friction, a straight line over speed, costs nothing.
        """
        widths = np.diff(self.knots)[:, None]
        bends = np.diff(np.diff(np.eye(len(self.knots)), axis=0) / widths, axis=0)
        share = widths[1:] * widths[:-1] / (widths[1:] + widths[:-1])
        return np.asarray(share * bends)

    def steady(self, speed: Trace) -> Float[np.ndarray, "t k"]:
        """See `AbstractStructure`: the weights of the model's table."""
        return node_shares(speed, np.asarray(self.knots))

    def bent(self, velocity: Trace, factors: Float[np.ndarray, " k"]) -> Trace:
        """See `AbstractStructure`: the smooth curve is a cubic spline through the knots."""
        values = factors.reshape(self.ways, -1)
        speed = np.clip(np.abs(velocity), self.knots[0], self.knots[-1])
        smooth = CubicSpline(self.knots, values, axis=1)(speed)
        deviation = smooth - values @ self.steady(speed).T
        return np.asarray((self.signs(velocity) * deviation).sum(axis=0))

    def law(self, factors: Float[np.ndarray, "w k"], shape: Shape) -> AbstractFriction:
        nodes = Setpoints(np.asarray(self.knots))
        tables = [FrictionTable(nodes, row) for row in factors]
        return tables[0] if len(tables) == 1 else DirectionalTable(*tables)


def default_knots(speed: Trace, count: int = KNOTS) -> tuple[float, ...]:
    """Return at most ``count`` knots in mm/s: half of them by time, half by even logarithms."""
    speeds = np.sort(speed[speed > 0])
    # The slowest few samples are mostly what a filter made of a standstill.
    level = np.linspace(np.log(speeds[len(speeds) // 200]), np.log(speeds[-1]), _LEVELS)
    share = np.searchsorted(speeds, np.exp(level)) / len(speeds)
    # Knots beside each other at a speed that is held for long would follow what is left of its
    # ripple: nowhere more than so many times as dense as by the logarithm.
    dense = np.minimum(np.diff(share), _DENSEST / (_LEVELS - 1))
    share = np.concatenate([[0.0], np.cumsum(dense)])
    mixed = share + (level - level[0]) / max(level[-1] - level[0], 1e-300)
    mixed = (mixed - mixed[0]) / (mixed[-1] - mixed[0])
    places = np.exp(np.interp(np.linspace(0.0, 1.0, count), mixed, level))
    return tuple(np.unique(places).tolist())
