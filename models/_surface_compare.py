"""Where surfaces through the same tests differ, and by how much."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ._surface import AbstractSurface, BilinearGrid, grid_through
from ._surface_delaunay import DelaunaySurface


@final
class SurfaceDifference(eqx.Module):
    """Difference of two surfaces over the workspace of two adaptation axes."""

    position1: Float[np.ndarray, " i"]
    """Positions of adaptation axis 1 in mm."""
    position2: Float[np.ndarray, " j"]
    """Positions of adaptation axis 2 in mm."""
    difference: Float[np.ndarray, "b j i"]
    """Second surface − first surface in mm, per branch."""
    covered: Bool[np.ndarray, "j i"]
    """Whether the place lies among the tests for both surfaces."""

    @property
    def largest(self) -> float:
        """Largest size of the difference in mm."""
        return float(np.max(np.abs(self.difference)))

    @property
    def where(self) -> tuple[float, float]:
        """Place of the largest difference in mm: adaptation axis 1, then axis 2."""
        sizes = np.max(np.abs(self.difference), axis=0)
        j, i = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
        return float(self.position1[i]), float(self.position2[j])

    def share_above(self, size: float) -> float:
        """Return the share of the workspace where they differ by more than size mm."""
        return float(np.mean(np.max(np.abs(self.difference), axis=0) > size))

    def describe(self) -> str:
        """Return one sentence with units: by how much, and where."""
        x, y = self.where
        missed = 1.0 - float(np.mean(self.covered))
        outside = f"; the tests leave out {missed:.0%} of it" if missed > 0 else ""
        return (
            f"The surfaces differ by at most {1e3 * self.largest:.1f} µm in the "
            f"workspace, at ({x:.1f}, {y:.1f}) mm{outside}."
        )


def surface_difference(
    first: AbstractSurface,
    second: AbstractSurface,
    values: Float[Array | np.ndarray, "b p"],
    *,
    limits: tuple[tuple[float, float], tuple[float, float]] | None = None,
    count: tuple[int, int] = (101, 101),
) -> SurfaceDifference:
    """Return where in the workspace two surfaces differ, and by how much.

    Args:
        first: Surface over two adaptation axes.
        second: Another one through the same tests.
        values: Of the tests in mm, per branch (as `Crosstalk.values`).
        limits: Of the workspace in mm, per adaptation axis; None: those of the tests.
        count: Number of places along each axis.

    Raises:
        ValueError: If the surfaces do not go through the same tests of two axes.
    """
    tests = np.asarray(first.points)
    if tests.shape[1] != 2 or not np.array_equal(tests, np.asarray(second.points)):
        msg = (
            "Surfaces can be compared that go through the same tests of two adaptation "
            f"axes, got points of shape {tests.shape} and {second.points.shape}."
        )
        raise ValueError(msg)
    table = jnp.asarray(values, dtype=jnp.float64)
    (low1, high1), (low2, high2) = limits or zip(
        tests.min(axis=0), tests.max(axis=0), strict=True
    )
    x = np.linspace(low1, high1, count[0])
    y = np.linspace(low2, high2, count[1])
    places = jnp.asarray(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))

    def maps(surface: AbstractSurface) -> Float[np.ndarray, "b t"]:
        rows = [
            surface.evaluate(
                table, jnp.full(places.shape[0], row, dtype=jnp.int32), places
            )
            for row in range(table.shape[0])
        ]
        return np.asarray(jnp.stack(rows))

    covered = np.asarray(first.covers(places) & second.covers(places))
    return SurfaceDifference(
        position1=x,
        position2=y,
        difference=(maps(second) - maps(first)).reshape(-1, y.size, x.size),
        covered=covered.reshape(y.size, x.size),
    )


def surface_through(points: Float[np.ndarray, "p k"]) -> BilinearGrid | DelaunaySurface:
    """Return the surface that the controller is taken to use (S-37, S-38).

    A grid where the tests form one (always along one axis or none), else triangles.

    Args:
        points: Positions of the tests in mm along 0, 1 or 2 adaptation axes.

    Raises:
        ValueError: If there is no test, if two stand at the same place, or if tests of
            two axes form no grid and stand on one line.
    """
    grid = grid_through(points)
    return DelaunaySurface.through(points) if grid is None else grid
