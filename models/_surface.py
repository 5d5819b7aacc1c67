"""Values between the tests of crosstalk compensation: what surfaces have in common."""

import abc
import math
from typing import TYPE_CHECKING, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ._nodes import Setpoints, float_array
from ._primitive import interpolate
from ._stencil import Stencil, linear_stencil


class AbstractSurface(eqx.Module):
    """Value over the positions of up to two adaptation axes, from values of tests."""

    # A field in one subclass, a property in others: equinox knows `AbstractVar` for it,
    # type checkers know the property.
    if TYPE_CHECKING:

        @property
        @abc.abstractmethod
        def points(self) -> Float[Array, "p k"]:
            """Positions of the p tests along the k adaptation axes in mm."""

    else:
        points: eqx.AbstractVar[Float[Array, "p k"]]

    @abc.abstractmethod
    def stencil(self, positions: Float[Array, "t k"]) -> Stencil:
        """Return the tests that each position touches, and their weights."""

    @abc.abstractmethod
    def evaluate(
        self,
        values: Float[Array, "b p"],
        branch: Int[Array, " t"],
        positions: Float[Array, "t k"],
    ) -> Float[Array, " t"]:
        """Return the value at each position, in the unit of the values.

        Args:
            values: Per branch and test.
            branch: Row of `values` that each sample uses.
            positions: Of the adaptation axes in mm.
        """

    @abc.abstractmethod
    def covers(self, positions: Float[Array, "t k"]) -> Bool[Array, " t"]:
        """Return whether each position lies among the tests, the border included."""


@final
class BilinearGrid(AbstractSurface):
    """Linear between tests along each axis, held outside: the tests form a grid.

    Without an adaptation axis it is one test, along one axis a polygon. The derivative
    with respect to a position is the right-hand one.
    """

    nodes: tuple[Setpoints, ...]
    """Test positions along each adaptation axis in mm."""
    order: tuple[int, ...] = eqx.field(static=True)
    """Number of the test at each node of the grid, last axis fastest."""

    def __check_init__(self) -> None:
        expected = math.prod(self._shape)
        if sorted(self.order) != list(range(expected)):
            msg = (
                f"order must name each of the {expected} tests once, "
                f"got {self.order!r}."
            )
            raise ValueError(msg)

    @property
    def points(self) -> Float[Array, "p k"]:
        """Positions of the tests along the adaptation axes in mm."""
        columns = jnp.meshgrid(*(axis.points for axis in self.nodes), indexing="ij")
        place = np.argsort(np.asarray(self.order))
        rows = [column.reshape(-1)[place] for column in columns]
        return jnp.stack(rows, axis=1) if rows else jnp.zeros((len(self.order), 0))

    @eqx.filter_jit
    def stencil(self, positions: Float[Array, "t k"]) -> Stencil:
        """Return the corners of the cell of each position, and their weights."""
        cell = linear_stencil(self._coordinates(positions), self._shape)
        test = jnp.asarray(self.order, dtype=jnp.int32)
        return Stencil(nodes=test[cell.nodes], weights=cell.weights, size=cell.size)

    @eqx.filter_jit
    def evaluate(
        self,
        values: Float[Array, "b p"],
        branch: Int[Array, " t"],
        positions: Float[Array, "t k"],
    ) -> Float[Array, " t"]:
        """Return the value at each position; arguments as in the base class."""
        table = values
        if self.order != tuple(range(len(self.order))):
            table = values[:, np.asarray(self.order)]
        coordinates = self._coordinates(positions)
        return interpolate(table.reshape(-1), coordinates, self._shape, branch)

    def covers(self, positions: Float[Array, "t k"]) -> Bool[Array, " t"]:
        """Return whether each position lies in the grid, the border included."""
        inside = jnp.ones(positions.shape[0], dtype=bool)
        for number, axis in enumerate(self.nodes):
            inside = inside & axis.covers(positions[:, number])
        return inside

    @property
    def _shape(self) -> tuple[int, ...]:
        return tuple(axis.count for axis in self.nodes) or (1,)

    def _coordinates(
        self, positions: Float[Array, "t k"]
    ) -> tuple[Float[Array, " t"], ...]:
        if not self.nodes:
            return (jnp.zeros(positions.shape[0]),)
        return tuple(
            axis.coordinate(positions[:, number])
            for number, axis in enumerate(self.nodes)
        )


def grid_through(points: Float[np.ndarray, "p k"]) -> BilinearGrid | None:
    """Return the grid that the tests form, or None if they form none.

    Args:
        points: Test positions in mm, in any order, along 0 to 2 axes.

    Raises:
        ValueError: If there is no test, or if two stand at the same place.
    """
    check_tests(points)
    axes, places = [], []
    for column in points.T:
        nodes, place = np.unique(column, return_inverse=True)
        axes.append(nodes)
        places.append(place)
    shape = tuple(axis.size for axis in axes)
    if math.prod(shape) != points.shape[0]:
        return None
    # As many tests as nodes and no two at the same place: each node has one.
    flat = np.ravel_multi_index(places, shape) if axes else np.zeros(1, dtype=int)
    order = tuple(int(number) for number in np.argsort(flat))
    return BilinearGrid(tuple(Setpoints(float_array(axis)) for axis in axes), order)


def check_tests(points: Float[np.ndarray, "p k"]) -> None:
    """Refuse test positions that no surface can go through.

    Raises:
        ValueError: If there is no test, or if two stand at the same place.
    """
    if points.shape[0] == 0:
        msg = "A crosstalk table needs at least one test, got none."
        raise ValueError(msg)
    for number, point in enumerate(points):
        equal = np.flatnonzero((points[:number] == point).all(axis=1))
        if equal.size:
            place = ", ".join(f"{value:g}" for value in point)
            msg = (
                f"tests {int(equal[0])} and {number} stand at the same place ({place}) "
                "mm: expected one test per place."
            )
            raise ValueError(msg)
