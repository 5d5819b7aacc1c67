"""The friction law that can bend anywhere: values at knots, smooth by a prior."""

import dataclasses
from typing import final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ....models import AbstractFriction, FrictionTable, Setpoints
from ._linear_structure import AbstractLinearStructure
from ._structure import Reported


@final
class DirectionalTable(AbstractFriction):
    """A table per direction: what an axis may show, and a list cannot say."""

    positive: FrictionTable
    negative: FrictionTable

    def level(
        self,
        speed: Float[Array | np.ndarray, " t"],
        direction: Float[Array | np.ndarray, " t"],
    ) -> Float[Array, " t"]:
        """Return how much current supports the motion, in drive units."""
        back = jnp.asarray(direction) < 0
        ahead = self.positive.level(speed, direction)
        return jnp.where(back, self.negative.level(speed, direction), ahead)


@final
@dataclasses.dataclass(frozen=True)
class KnotTable(AbstractLinearStructure):
    """A free table: values at knots, linear between, held outside, smooth by a prior.

    Attributes:
        knots: Speeds in mm/s, ascending, at least two.
    """

    knots: tuple[float, ...] = ()

    @property
    def words(self) -> str:
        """See `AbstractStructure`."""
        per = " per direction" if self.directional else ""
        return f"table of {len(self.knots)} knots{per}"

    @property
    def in_words(self) -> bool:
        """See `AbstractStructure`."""
        return False

    @property
    def factors(self) -> tuple[str, ...]:
        """See `AbstractStructure`."""
        return tuple(f"knot_{index}" for index in range(len(self.knots)))

    @property
    def level_names(self) -> tuple[str, ...]:
        """See `AbstractStructure`."""
        return self.factors

    def pairs(
        self, speed: Float[np.ndarray, " t"]
    ) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "t 2"]]:
        """See `AbstractStructure`."""
        place = np.interp(speed, self.knots, np.arange(len(self.knots)))
        cell = np.minimum(place.astype(np.int64), len(self.knots) - 2)
        share = place - cell
        return cell, np.stack([1.0 - share, share], axis=1)

    def bends(self) -> Float[np.ndarray, "b k"] | None:
        """See `AbstractStructure`: how far each knot lies off the line of its neighbours.

        Coulomb + viscous friction, a straight line over speed, costs nothing.
        """
        count = len(self.knots)
        if count < 3:
            return None
        knots = np.asarray(self.knots)
        share = (knots[1:-1] - knots[:-2]) / (knots[2:] - knots[:-2])
        off = np.zeros((count - 2, count))
        rows = np.arange(count - 2)
        off[rows, rows], off[rows, rows + 2] = share - 1.0, -share
        off[rows, rows + 1] = 1.0
        return off

    def reported_way(
        self, factors: Float[np.ndarray, " k"], shape: Float[np.ndarray, " s"]
    ) -> Reported:
        """See `AbstractStructure`."""
        return Reported(self.factors, factors, np.eye(len(factors)))

    def law(
        self, factors: Float[np.ndarray, "w k"], shape: Float[np.ndarray, " s"]
    ) -> AbstractFriction:
        """See `AbstractStructure`."""
        nodes = Setpoints(jnp.asarray(self.knots))
        tables = [FrictionTable(nodes, jnp.asarray(row)) for row in factors]
        return tables[0] if len(tables) == 1 else DirectionalTable(*tables)


def default_knots(speed: Float[np.ndarray, " t"], count: int) -> tuple[float, ...]:
    """Return knots in mm/s where the samples are: evenly by share and by logarithm.

    Half of the weight goes to where the axis spends its time, half to even steps of the
    logarithm, so that the bend near rest is not missed.
    """
    return spread_of(speed).knots(count)


@dataclasses.dataclass(frozen=True, eq=False)
class Spread:
    """How the speeds of a recording are spread.

    Attributes:
        level: Logarithms of speed in mm/s, ascending.
        share: Of the knots that should lie below each, 0 to 1.
    """

    level: Float[np.ndarray, " n"]
    share: Float[np.ndarray, " n"]

    def knots(self, count: int) -> tuple[float, ...]:
        """Return so many knots in mm/s."""
        evenly = np.linspace(0, 1, count)
        return tuple(np.exp(np.interp(evenly, self.share, self.level)).tolist())


def spread_of(speed: Float[np.ndarray, " t"]) -> Spread:
    """Return how speeds in mm/s are spread, for `default_knots` of several numbers."""
    seen = np.sort(speed[speed > 0])
    # The slowest few samples are mostly what a filter made of a standstill.
    low, high = np.log(seen[len(seen) // 200]), np.log(seen[-1])
    level = np.linspace(low, high, 400)
    share = np.searchsorted(seen, np.exp(level)) / len(seen)
    mixed = 0.5 * share + 0.5 * (level - low) / (high - low)
    return Spread(level, (mixed - mixed[0]) / (mixed[-1] - mixed[0]))
