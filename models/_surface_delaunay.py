"""Triangles between the tests of crosstalk compensation, each a plane."""

import itertools
from collections.abc import Callable, Sequence
from typing import TypeVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ._nodes import float_array
from ._stencil import Stencil
from ._surface import AbstractSurface, BilinearGrid, check_tests, grid_through

_INSIDE = 1e-12
"""Share by which rounding may put a position on a border outside of its triangle."""
_FLAT = 1e-9
"""A triangle is thrown away whose height is less than this share of its longest side."""

_BLOCK = 4
"""Triangles or edges compared per round: more take longer to compile."""

Triangle = tuple[int, int, int]
_T = TypeVar("_T")
_Three = tuple[_T, _T, _T]


@final
class DelaunaySurface(AbstractSurface):
    """Linear in each triangle between tests; outside, the value of the nearest point.

    The derivative with respect to a position is that of the triangle; on a border that
    of the first one in `triangles` which has it; outside only along the border.
    Differentiable in the test positions too: the triangles stay what they are.
    """

    points: Float[Array, "p 2"] = (  # pyright: ignore[reportIncompatibleMethodOverride]
        eqx.field(converter=float_array)
    )
    """Positions of the tests along both adaptation axes in mm."""
    triangles: tuple[Triangle, ...] = eqx.field(static=True)
    """Numbers of the tests at the corners of each triangle."""

    @classmethod
    def through(cls, points: Float[np.ndarray, "p 2"]) -> "DelaunaySurface":
        """Return the surface over the Delaunay triangles of the tests.

        Raises:
            ValueError: If there are less than three tests, if two stand at the same
                place or if all stand on one line.
        """
        check_tests(points)
        return cls(float_array(points), _triangles(points))

    @property
    def border(self) -> tuple[tuple[int, int], ...]:
        """Numbers of the tests at both ends of each edge that only one triangle has."""
        edges = [
            edge
            for corners in self.triangles
            for edge in itertools.combinations(sorted(corners), 2)
        ]
        return tuple(edge for edge in edges if edges.count(edge) == 1)

    @eqx.filter_jit
    def stencil(self, positions: Float[Array, "t 2"]) -> Stencil:
        """Return the 3 tests that each position touches; outside 2 and one of them."""
        nodes, weights, _ = self._locate(positions)
        return Stencil(
            nodes=jnp.stack(nodes, axis=1),
            weights=jnp.stack(weights, axis=1),
            size=self.points.shape[0],
        )

    @eqx.filter_jit
    def evaluate(
        self,
        values: Float[Array, "b p"],
        branch: Int[Array, " t"],
        positions: Float[Array, "t 2"],
    ) -> Float[Array, " t"]:
        """Return the value at each position; arguments as in the base class."""
        nodes, weights, _ = self._locate(positions)
        table = values.reshape(-1)
        row = branch.astype(jnp.int32) * values.shape[1]
        value = jnp.zeros(positions.shape[0])
        for node, weight in zip(nodes, weights, strict=True):
            value = value + weight * table[row + node]
        return value

    @eqx.filter_jit
    def covers(self, positions: Float[Array, "t 2"]) -> Bool[Array, " t"]:
        """Return whether each position lies in a triangle, the border included."""
        return self._locate(positions)[2]

    @eqx.filter_jit
    def nearest(self, positions: Float[Array, "t 2"]) -> Float[Array, "t 2"]:
        """Return the nearest covered position to each one, itself where covered."""
        nodes, weights, inside = self._locate(positions)
        columns = []
        for axis in (0, 1):
            border = jnp.zeros(positions.shape[0])
            for node, weight in zip(nodes, weights, strict=True):
                border = border + weight * self.points[:, axis][node]
            columns.append(jnp.where(inside, positions[:, axis], border))
        return jnp.stack(columns, axis=1)

    def _locate(
        self, positions: Float[Array, "t 2"]
    ) -> tuple[_Three[Int[Array, " t"]], _Three[Float[Array, " t"]], Bool[Array, " t"]]:
        """Return the tests that each position touches, their weights, whether inside.

        Which triangle or edge it is has no derivative: it is found first, and what
        follows is evaluated for that one alone. All by columns: XLA is slow to look up
        rows.
        """
        x, y = positions[:, 0], positions[:, 1]
        faces = _faces(self.points, self.triangles)
        edges = _edges(self.points, self.border)
        face, score = _best(_inside, faces, x, y)
        inside = score >= -_INSIDE
        edge, _ = _best(_nearness, edges, x, y)
        second, third = _weights([column[face] for column in faces], x, y)
        share = _share([column[edge] for column in edges], x, y)
        weights = (
            jnp.where(inside, 1.0 - second - third, 1.0 - share),
            jnp.where(inside, second, share),
            jnp.where(inside, third, 0.0),
        )
        corners = jnp.asarray(self.triangles, dtype=jnp.int32)
        vertices = jnp.asarray(self.border, dtype=jnp.int32)
        nodes = (
            jnp.where(inside, corners[:, 0][face], vertices[:, 0][edge]),
            jnp.where(inside, corners[:, 1][face], vertices[:, 1][edge]),
            jnp.where(inside, corners[:, 2][face], vertices[:, 0][edge]),
        )
        return nodes, weights, inside


def _faces(
    points: Float[Array, "p 2"], triangles: tuple[Triangle, ...]
) -> list[Float[Array, " f"]]:
    """Return per triangle its first corner and the slopes of the other two weights."""
    corners = points[np.asarray(triangles)]
    start = corners[:, 0]
    first, second = corners[:, 1] - start, corners[:, 2] - start
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    slopes = (second[:, 1], -second[:, 0], -first[:, 1], first[:, 0])
    return [start[:, 0], start[:, 1], *(slope / area for slope in slopes)]


def _edges(
    points: Float[Array, "p 2"], border: tuple[tuple[int, int], ...]
) -> list[Float[Array, " e"]]:
    """Return per edge its first end and the way to its other end."""
    ends = points[np.asarray(border)]
    vector = ends[:, 1] - ends[:, 0]
    return [ends[:, 0, 0], ends[:, 0, 1], vector[:, 0], vector[:, 1]]


def _weights(
    face: Sequence[Float[Array, "*t"]], x: Float[Array, " t"], y: Float[Array, " t"]
) -> tuple[Float[Array, " t"], Float[Array, " t"]]:
    """Return the weights of the second and the third corner of a triangle."""
    away1, away2 = x - face[0], y - face[1]
    return face[2] * away1 + face[3] * away2, face[4] * away1 + face[5] * away2


def _share(
    edge: Sequence[Float[Array, "*t"]], x: Float[Array, " t"], y: Float[Array, " t"]
) -> Float[Array, " t"]:
    """Return the share of an edge at which the point nearest to each place lies."""
    length = edge[2] ** 2 + edge[3] ** 2
    share = (x - edge[0]) * (edge[2] / length) + (y - edge[1]) * (edge[3] / length)
    # Not `clip`, whose derivative at an end would be a half.
    return jnp.where(share > 0.0, jnp.where(share < 1.0, share, 1.0), 0.0)


def _inside(
    face: Sequence[Float[Array, ""]], x: Float[Array, " t"], y: Float[Array, " t"]
) -> Float[Array, " t"]:
    """Return the least weight of a triangle, the same for all places inside of it."""
    second, third = _weights(face, x, y)
    least = jnp.minimum(jnp.minimum(second, third), 1.0 - second - third)
    return jnp.minimum(least, -_INSIDE)


def _nearness(
    edge: Sequence[Float[Array, ""]], x: Float[Array, " t"], y: Float[Array, " t"]
) -> Float[Array, " t"]:
    """Return the squared distance from an edge, negative, in mm²."""
    share = _share(edge, x, y)
    away1 = x - edge[0] - share * edge[2]
    away2 = y - edge[1] - share * edge[3]
    return -(away1**2 + away2**2)


def _best(
    score: Callable[..., Float[Array, " t"]],
    pieces: Sequence[Float[Array, " n"]],
    x: Float[Array, " t"],
    y: Float[Array, " t"],
) -> tuple[Int[Array, " t"], Float[Array, " t"]]:
    """Return the first of the pieces with the best score per place, and that score."""
    # A loop, and of two rounds at least: without one XLA would search again for each
    # number that is looked up by the result.
    rounds = max(2, -(-pieces[0].size // _BLOCK))
    missing = rounds * _BLOCK - pieces[0].size
    blocks = [
        jnp.pad(lax.stop_gradient(column), (0, missing), mode="edge").reshape(
            rounds, _BLOCK
        )
        for column in pieces
    ]
    place = (lax.stop_gradient(x), lax.stop_gradient(y))

    def search(number: Array, result: tuple[Array, Array]) -> tuple[Array, Array]:
        piece, best = result
        block = [column[number] for column in blocks]
        for offset in range(_BLOCK):
            new = score([column[offset] for column in block], *place)
            index = number.astype(jnp.int32) * _BLOCK + offset
            piece = jnp.where(new > best, index, piece)
            best = jnp.maximum(best, new)
        return piece, best

    nothing = jnp.zeros(x.shape, dtype=jnp.int32), jnp.full(x.shape, -jnp.inf)
    result: tuple[Array, Array] = lax.fori_loop(0, rounds, search, nothing)
    return result


def _triangles(points: Float[np.ndarray, "p 2"]) -> tuple[Triangle, ...]:
    # Takes a while to load, and few machines have such a surface.
    from scipy.spatial import Delaunay, QhullError

    try:
        simplices = Delaunay(points).simplices
    except (QhullError, ValueError):
        simplices = np.zeros((0, 3), dtype=int)
    corners = points[simplices]
    sides = corners - np.roll(corners, 1, axis=1)
    longest = np.max(np.sum(sides**2, axis=2), axis=1, initial=0.0)
    area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    proper = simplices[area > _FLAT * longest]
    if not proper.size:
        msg = (
            f"{points.shape[0]} tests on one line have no triangles: expected three "
            "tests or more that span a surface."
        )
        raise ValueError(msg)
    return tuple((int(a), int(b), int(c)) for a, b, c in proper)


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
