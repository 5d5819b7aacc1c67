"""The thin plate: the smoothest surface through the tests of crosstalk compensation."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ._stencil import Stencil
from ._surface import AbstractSurface
from ._surface_delaunay import DelaunaySurface


@final
class ThinPlateSurface(AbstractSurface):
    r"""Thin plate spline through the tests; outside, the value of the nearest point.

    $\sum_i w_i\,r_i^2 \ln r_i$ plus a plane (Duchon, 1977). Unlike the linear surfaces
    it overshoots: values between tests may exceed those of all tests.
    """

    region: DelaunaySurface
    """Where the tests are: the hull that the surface is held at."""

    @classmethod
    def through(cls, points: Float[np.ndarray, "p 2"]) -> "ThinPlateSurface":
        """Return the surface through the tests.

        Raises:
            ValueError: If there are less than three tests, if two stand at the same
                place or if all stand on one line.
        """
        return cls(DelaunaySurface.through(points))

    @property
    def points(self) -> Float[Array, "p 2"]:
        """Positions of the tests along both adaptation axes in mm."""
        return self.region.points

    @eqx.filter_jit
    def stencil(self, positions: Float[Array, "t 2"]) -> Stencil:
        """Return the weights of all tests at each position."""
        count = self.points.shape[0]
        weights = jnp.stack(self._terms(positions), axis=1) @ self._solution()
        nodes = jnp.arange(count, dtype=jnp.int32)
        return Stencil(
            nodes=jnp.broadcast_to(nodes, weights.shape), weights=weights, size=count
        )

    @eqx.filter_jit
    def evaluate(
        self,
        values: Float[Array, "b p"],
        branch: Int[Array, " t"],
        positions: Float[Array, "t 2"],
    ) -> Float[Array, " t"]:
        """Return the value at each position; arguments as in the base class."""
        factors = self._solution() @ values.T
        value = jnp.zeros(positions.shape[0])
        for factor, term in zip(factors, self._terms(positions), strict=True):
            value = value + factor[branch] * term
        return value

    def covers(self, positions: Float[Array, "t 2"]) -> Bool[Array, " t"]:
        """Return whether each position lies in the hull of the tests."""
        return self.region.covers(positions)

    def _terms(self, positions: Float[Array, "t 2"]) -> list[Float[Array, " t"]]:
        """Return the kernel of each test and the three terms of the plane."""
        place = self._scaled(self.region.nearest(positions))
        kernels = [
            _kernel(jnp.sum((place - test[None]) ** 2, axis=1))
            for test in self._scaled(self.points)
        ]
        return [*kernels, jnp.ones(place.shape[0]), place[:, 0], place[:, 1]]

    def _solution(self) -> Float[Array, "n p"]:
        """Return what makes the factors of the terms from the values of the tests."""
        tests = self._scaled(self.points)
        count = tests.shape[0]
        squared = jnp.sum((tests[:, None] - tests[None, :]) ** 2, axis=2)
        plane = jnp.concatenate([jnp.ones((count, 1)), tests], axis=1)
        matrix = jnp.block(
            [[_kernel(squared), plane], [plane.T, jnp.zeros((3, 3), dtype=plane.dtype)]]
        )
        inverse: Float[Array, "n n"] = jnp.linalg.inv(matrix)
        return inverse[:, :count]

    def _scaled(self, positions: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
        """Return positions in units of the region's size, for a well-posed system.

        One unit for both axes: the plate stays the same.
        """
        lower = jnp.min(self.points, axis=0)
        size = jnp.max(jnp.max(self.points, axis=0) - lower)
        return (positions - lower[None]) * (1.0 / size)


def _kernel(squared: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Return r² ln r from r²: 0 at 0, and so its derivative."""
    positive = squared > 0.0
    safe = jnp.where(positive, squared, 1.0)
    return jnp.where(positive, 0.5 * safe * jnp.log(safe), 0.0)
