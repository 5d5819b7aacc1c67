"""Crosstalk compensation: an offset over the acceleration of another axis."""

import abc
from typing import TYPE_CHECKING, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ._filter import Past, SineSquaredFilter
from ._nodes import Setpoints, Values, float_array, is_known
from ._primitive import interpolate
from ._stencil import Stencil, linear_stencil
from ._surface import AbstractSurface

Samples = Float[Array | np.ndarray, " t"]
Places = Float[Array | np.ndarray, "t k"]


class AbstractCrosstalk(eqx.Module):
    """Maps the acceleration of a master axis to an offset of the slave axis.

    The offset is always smoothed over `cycles` cycles by a sin² filter (S-06).
    """

    # Always a field, but type checkers would not let fields without default follow it.
    if TYPE_CHECKING:

        @property
        @abc.abstractmethod
        def cycles(self) -> int:
            """Cycles of the sin² filter."""

    else:
        cycles: eqx.AbstractVar[int]

    @abc.abstractmethod
    def offset(
        self, acceleration: Samples, velocity: Samples, positions: Places | None = None
    ) -> Float[Array, " t"]:
        """Return what the controller adds to the slave axis in mm, before the filter.

        Args:
            acceleration: Of the master axis in mm/s².
            velocity: Of the master axis in mm/s.
            positions: Of the adaptation axes in mm; None where there are none.
        """

    @abc.abstractmethod
    def stencil(
        self, acceleration: Samples, velocity: Samples, positions: Places | None = None
    ) -> Stencil:
        """Return the entries that each sample touches, and their weights.

        A call of the stencil gives what `offset` gives, its sign left out.
        """

    def start(self) -> Past:
        """Return the state before the first cycle: nothing is added yet."""
        return SineSquaredFilter(self.cycles).start()

    @eqx.filter_jit
    def run(
        self,
        state: Past,
        acceleration: Samples,
        velocity: Samples,
        positions: Places | None = None,
    ) -> tuple[Float[Array, " t"], Past]:
        """Return the filtered offset per cycle in mm, and the state after."""
        offset = self.offset(acceleration, velocity, positions)
        return SineSquaredFilter(self.cycles).run(state, offset)


@final
class Crosstalk(AbstractCrosstalk):
    """Crosstalk compensation in modes 1, 2 and 3: by 0, 1 or 2 adaptation axes.

    Linear in the acceleration from 0 to the specified one and held from there on
    (S-36); the entries stand as they are, without a change of sign (S-42). Between
    tests the surface decides.

    The derivative with respect to the acceleration is at 0 that of positive ones, and 0
    from the specified acceleration on.
    """

    surface: AbstractSurface
    """Between the tests: one test, a polygon, a grid, triangles or a thin plate."""
    values: Float[Values, "4 p"] = eqx.field(converter=float_array)
    """Entries of the tests in mm: for acceleration in positive and in negative
    direction, then for deceleration in both (P-COMP-00087…90)."""
    acceleration: Float[Values, ""] = eqx.field(converter=float_array)
    """Specified acceleration in mm/s², positive (P-COMP-00066)."""
    deceleration: Float[Values, ""] = eqx.field(converter=float_array)
    """Specified deceleration in mm/s², negative (P-COMP-00067)."""
    velocity_dependent: bool = eqx.field(default=True, static=True)
    """Entries differ by direction; else those for positive direction act in both."""
    cycles: int = eqx.field(  # pyright: ignore[reportIncompatibleMethodOverride]
        default=0, static=True
    )
    """Cycles of the sin² filter on the values (P-COMP-00064)."""
    sign: float = eqx.field(default=1.0, static=True)
    """Offset per entry: +1 or −1 (S-42)."""
    by_speed: bool = eqx.field(default=False, static=True)
    """Acceleration is where |v| grows; else where a is not negative (S-34)."""
    own_deceleration: bool = eqx.field(default=True, static=True)
    """Without velocity_dependent decelerations have entries of their own (S-35)."""
    rest_direction: int = eqx.field(default=1, static=True)
    """Direction that counts where the velocity is 0: +1 or −1 (S-35)."""
    held_above: bool = eqx.field(default=True, static=True)
    """Above the specified acceleration the offset is held; else it grows on (S-36)."""
    held_outside: bool = eqx.field(default=True, static=True)
    """Outside the tests the nearest point is held; else nothing is added (S-38)."""

    def __check_init__(self) -> None:
        count = self.surface.points.shape[0]
        if self.values.shape != (4, count):
            msg = (
                f"values must have four rows and one entry per test, (4, {count}), "
                f"got shape {self.values.shape}."
            )
            raise ValueError(msg)
        if is_known(self.acceleration) and not self.acceleration > 0:
            msg = f"acceleration must be positive, got {self.acceleration!s} mm/s²."
            raise ValueError(msg)
        if is_known(self.deceleration) and not self.deceleration < 0:
            msg = f"deceleration must be negative, got {self.deceleration!s} mm/s²."
            raise ValueError(msg)

    @eqx.filter_jit
    def entry(
        self, acceleration: Samples, velocity: Samples, positions: Places | None = None
    ) -> Float[Array, " t"]:
        """Return the list's value in mm; arguments as in `offset`."""
        share, branch = self._branches(acceleration, velocity)
        places = self._places(positions, share.shape[0])
        value = self.surface.evaluate(self.values, branch, places)
        return self._reach(share, places) * value

    def offset(
        self, acceleration: Samples, velocity: Samples, positions: Places | None = None
    ) -> Float[Array, " t"]:
        """Return what the controller adds to the slave axis in mm, before the filter.

        Args:
            acceleration: Of the master axis in mm/s².
            velocity: Of the master axis in mm/s.
            positions: Of the adaptation axes in mm; None where there are none.
        """
        return self.sign * self.entry(acceleration, velocity, positions)

    @eqx.filter_jit
    def stencil(
        self, acceleration: Samples, velocity: Samples, positions: Places | None = None
    ) -> Stencil:
        """Return the tests that each sample touches: ``branch * tests + test``.

        The weights contain the share of the specified acceleration.
        """
        share, branch = self._branches(acceleration, velocity)
        places = self._places(positions, share.shape[0])
        tests = self.surface.stencil(places)
        return Stencil(
            nodes=tests.nodes + (branch * tests.size)[:, None],
            weights=tests.weights * self._reach(share, places)[:, None],
            size=4 * tests.size,
        )

    def covers(self, positions: Places) -> Bool[Array, " t"]:
        """Return whether each place of the adaptation axes lies among the tests."""
        return self.surface.covers(jnp.asarray(positions, dtype=jnp.float64))

    def _branches(
        self, acceleration: Samples, velocity: Samples
    ) -> tuple[Float[Array, " t"], Int[Array, " t"]]:
        """Return the share of the specified acceleration, and the row of `values`."""
        a = jnp.asarray(acceleration, dtype=jnp.float64)
        v = jnp.asarray(velocity, dtype=jnp.float64)
        slows = a * v < 0.0 if self.by_speed else a < 0.0
        specified = jnp.where(slows, self.deceleration, self.acceleration)
        # Not a division per sample: that of the two specified ones serves all.
        inverse = jnp.where(slows, 1.0 / self.deceleration, 1.0 / self.acceleration)
        # By the sign both are negative together, and the derivative at 0 is that of
        # positive ones.
        share = jnp.abs(a) * jnp.abs(inverse) if self.by_speed else a * inverse
        if self.held_above:
            reached = jnp.abs(a) >= jnp.abs(specified)
            share = jnp.where(reached, 1.0, share)
        if self.velocity_dependent:
            backward = v < 0.0 if self.rest_direction > 0 else v <= 0.0
            branch = 2 * slows.astype(jnp.int32) + backward.astype(jnp.int32)
        elif self.own_deceleration:
            branch = 2 * slows.astype(jnp.int32)
        else:
            branch = jnp.zeros(a.shape, dtype=jnp.int32)
        return share, branch

    def _places(self, positions: Places | None, count: int) -> Float[Array, "t k"]:
        axes = self.surface.points.shape[1]
        if positions is None:
            positions = np.zeros((count, 0))
        if positions.shape[1] != axes:
            msg = (
                f"The tests have {axes} adaptation axes, got positions of "
                f"{positions.shape[1]}."
            )
            raise ValueError(msg)
        return jnp.asarray(positions, dtype=jnp.float64)

    def _reach(
        self, share: Float[Array, " t"], places: Float[Array, "t k"]
    ) -> Float[Array, " t"]:
        if self.held_outside:
            return share
        return jnp.where(self.surface.covers(places), share, 0.0)


@final
class LegacyCrosstalk(AbstractCrosstalk):
    """Crosstalk compensation by the older list: a table over the acceleration (S-41).

    Linear between entries, held outside; neither direction nor adaptation axes. The
    derivative with respect to the acceleration is the right-hand one.
    """

    nodes: Setpoints
    """Accelerations of the entries in mm/s² (the older P-COMP-00066)."""
    values: Float[Values, " p"] = eqx.field(converter=float_array)
    """Entries in mm (the older P-COMP-00067)."""
    cycles: int = eqx.field(  # pyright: ignore[reportIncompatibleMethodOverride]
        default=0, static=True
    )
    """Cycles of the sin² filter on the values (P-COMP-00064)."""
    sign: float = eqx.field(default=1.0, static=True)
    """Offset per entry: +1 or −1 (S-42)."""

    def __check_init__(self) -> None:
        if self.values.shape != (self.nodes.count,):
            msg = (
                f"values must have one entry per acceleration, ({self.nodes.count},), "
                f"got shape {self.values.shape}."
            )
            raise ValueError(msg)

    @eqx.filter_jit
    def offset(
        self, acceleration: Samples, velocity: Samples, positions: Places | None = None
    ) -> Float[Array, " t"]:
        """Return what the controller adds to the slave axis in mm, before the filter.

        Args:
            acceleration: Of the master axis in mm/s².
            velocity: Without effect.
            positions: Without effect.
        """
        del velocity, positions
        a = jnp.asarray(acceleration, dtype=jnp.float64)
        place = (self.nodes.coordinate(a),)
        return self.sign * interpolate(self.values, place, (self.nodes.count,))

    @eqx.filter_jit
    def stencil(
        self, acceleration: Samples, velocity: Samples, positions: Places | None = None
    ) -> Stencil:
        """Return the 2 entries that each acceleration touches."""
        del velocity, positions
        a = jnp.asarray(acceleration, dtype=jnp.float64)
        return linear_stencil((self.nodes.coordinate(a),), (self.nodes.count,))
