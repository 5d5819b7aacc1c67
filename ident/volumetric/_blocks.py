"""Groups of unknowns of a volumetric fit: functions and angles of a machine, its set-up."""

import dataclasses
import functools
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial
from typing import Any, final

import jax
import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float
from numpy.polynomial import legendre

from ...models import AbstractNodes, GeometricErrors, VolumetricGrid
from ...models._geometric import FUNCTIONS, SQUARENESS as ANGLES
from ..core import (
    AbstractEffect,
    AbstractPrior,
    NoPrior,
    Readings,
    Smooth,
    chain,
    filled,
)
from ..core._effect import Design
from ..core._prior import Chain

RUNS, ANGULAR, STRAIGHTNESS, POSITIONING, SQUARENESS, FRAME = range(6)
"""What may be moved between blocks leaves those that stand first."""
_LEVER = 1e-5
"""Largest lever of an angle, relative to the longest of all, that is none."""
_TURNED_BEAM = 1e-3
"""Spread in rad of the directions of a set-up below which they are one: a centre that is off by
1 mm across them changes readings by less than 1 µm."""
_TURNED = np.array([*(k for k in range(36) if k % 12 > 5), 36, 37, 38])
"""Columns of angles in the stencil of a machine."""
FRAME_NAME, ZEROS_NAME = "frame", "zeros of the set-ups"
"""Names of the blocks that are no errors of the machine."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Block(AbstractEffect):
    """Unknowns that have a name in common, and the shapes by which readings are judged.

    Attributes:
        name: Name of the block.
        priority: How late it gives way where something may be moved between blocks.
        given: Prior of its values.
        rows: From readings to the rows of its design.
        basis: Shapes: orthonormal columns over its values.
        labels: Name of each: offset, slope, curve, or the axes along which it varies.
        free: Those that no prior holds.
        by_tools: Whether only tools of different offsets show it.
    """

    name: str
    priority: int
    given: AbstractPrior
    rows: Callable[[Readings], Design]
    basis: Float[np.ndarray, "p m"]
    labels: tuple[str, ...]
    free: Bool[np.ndarray, " m"]
    by_tools: bool = False

    @classmethod
    def single(
        cls,
        name: str,
        priority: int,
        labels: Sequence[str],
        rows: Callable[[Readings], Design],
    ) -> "Block":
        """Return a block without prior, each value of which is a shape of its own."""
        count = len(labels)
        free = np.ones(count, bool)
        return cls(
            name, priority, NoPrior(count), rows, np.eye(count), tuple(labels), free
        )

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return len(self.basis)

    @property
    def prior(self) -> AbstractPrior:
        """See `AbstractEffect`."""
        return self.given

    def design(self, readings: Readings) -> Design:
        """See `AbstractEffect`."""
        return self.rows(readings)


def polynomials(nodes: AbstractNodes, most: int) -> Float[np.ndarray, "p m"]:
    """Return orthonormal polynomials over nodes: constant, straight line, and so on."""
    places = np.asarray(nodes.positions)
    middle, half = (places[0] + places[-1]) / 2, max((places[-1] - places[0]) / 2, 1.0)
    degree = min(most, len(places) - 1)
    return np.asarray(
        np.linalg.qr(legendre.legvander((places - middle) / half, degree))[0]
    )


@jax.jit
def _stencil(
    model: GeometricErrors | VolumetricGrid, given: dict[str, Any]
) -> tuple[Any, Any]:
    if isinstance(model, GeometricErrors):
        found = model.stencil(given["position"], given["along"], given["tool"])
    else:
        found = model.stencil(given["position"])
    return found.nodes, found.weights


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Touched:
    """What readings touch of a model, asked for once by all of its blocks.

    Attributes:
        model: A machine or a grid, all values 0.
    """

    model: Any

    @functools.lru_cache(maxsize=2)  # noqa: B019 (all blocks ask for the same readings)
    def rows(self, readings: Readings) -> Design:
        """Return the numbers of the model that readings touch, and their shares."""
        names = ("position", "along", "tool")
        given = {name: filled(readings.inputs[name], 64) for name in names}
        found = _stencil(self.model, given)
        nodes, shares = (np.array(each)[: len(readings)] for each in found)
        if isinstance(self.model, GeometricErrors):
            shares[:, _TURNED] = _levers(shares[:, _TURNED], readings)
        return nodes, shares

    def part(self, first: int, columns: slice, readings: Readings) -> Design:
        """Return some columns, their numbers counted from a first one."""
        nodes, shares = self.rows(readings)
        return nodes[:, columns] - first, shares[:, columns]

    def along(self, axis: int, readings: Readings) -> Design:
        """Return the rows of a table of offsets of one axis."""
        nodes, shares = self.rows(readings)
        return nodes, shares * readings.inputs["along"][:, axis, None]


def _levers(
    shares: Float[np.ndarray, "t k"], readings: Readings
) -> Float[np.ndarray, "t k"]:
    """Return shares of angles without those that no reading has a lever for.

    Readings along a line through the reference show nothing of some angles but what rounding
    and the scatter of the line leave of their lever: noise must not be taken for it.
    """
    places = (readings.inputs[name] for name in ("position", "tool"))
    longest = max(1.0, *(float(np.abs(each).max(initial=0.0)) for each in places))
    known = np.abs(shares).max(axis=0, initial=0.0) > _LEVER * longest
    return np.where(known, shares, 0.0)


def machine_blocks(model: GeometricErrors, most: Sequence[int]) -> Iterator[Block]:
    """Yield the 18 functions of a machine, smooth tables over one axis each, and 3 angles.

    Args:
        model: All values 0.
        most: Degree of the shapes along X, Y and Z.
    """
    touched, first, column = Touched(model), 0, 0
    for axis, names in enumerate(FUNCTIONS):
        nodes = model.nodes[axis]
        line = chain(np.asarray(nodes.positions))
        prior = Smooth((line,), 1, np.arange(nodes.count))
        basis = polynomials(nodes, most[axis])
        degree = np.arange(basis.shape[1])
        labels = tuple(("offset", "slope", "curve")[min(k, 2)] for k in degree.tolist())
        later = set(model.chain[model.chain.index("XYZ"[axis]) + 1 :])
        for row, name in enumerate(names):
            priority = POSITIONING if row == axis else STRAIGHTNESS
            yield Block(
                name=name,
                priority=ANGULAR if row > 2 else priority,
                given=prior,
                rows=partial(touched.part, first, slice(column, column + 2)),
                basis=basis,
                labels=labels,
                free=degree < 2,
                # Without an axis between it and the tool as a lever.
                by_tools=row > 2 and later <= {"XYZ"[row - 3]},
            )
            first, column = first + nodes.count, column + 2
    for name in ANGLES:
        rows = partial(touched.part, first, slice(column, column + 1))
        yield Block.single(name, SQUARENESS, ["angle"], rows)
        first, column = first + 1, column + 1


def frame(about: tuple[float, float, float]) -> Block:
    """Return where the workpiece (or the instrument) stands: shift in mm, rotation in rad.

    Args:
        about: Position about which it is turned, in mm.
    """

    def rows(readings: Readings) -> Design:
        along = readings.inputs["along"]
        lever = readings.inputs["position"] - about + readings.inputs["tool"]
        turned = _levers(np.cross(lever, along), readings)
        shares = np.hstack([along, turned])
        return np.broadcast_to(np.arange(6), shares.shape), shares

    labels = [*(f"shift {a}" for a in "XYZ"), *(f"turn {a}" for a in "ABC")]
    return Block.single(FRAME_NAME, FRAME, labels, rows)


def zeros(readings: Readings, vectors: bool) -> Block:
    """Return what is unknown of each set-up: of vectors, or of readings along directions.

    Vectors have a zero each in X, Y and Z. Readings along a direction have one zero (the length
    of a ball bar), and the place of their centre in those ways in which the directions of the
    set-up differ: on a laser line in none, in a circle in two.
    """
    run, along = readings.inputs["run"], readings.inputs["along"]
    count = np.bincount(run)
    mean, spread = np.zeros((len(count), 3)), np.zeros((len(count), 3, 3))
    np.add.at(mean, run, along / count[run, None])
    apart = along - mean[run]
    np.add.at(spread, run, apart[:, :, None] * apart[:, None] / count[run, None, None])
    size, ways = np.linalg.eigh(spread)
    first = np.full((len(count), 1), not vectors)
    taken = np.hstack([first, vectors | (size > _TURNED_BEAM**2)])
    number = np.maximum(np.cumsum(taken).reshape(taken.shape) - 1, 0)

    def rows(readings: Readings) -> Design:
        run, along = readings.inputs["run"], readings.inputs["along"]
        centre = np.einsum("ti,tij->tj", along, ways[run])
        shares = np.hstack([np.ones((len(run), 1)), centre])
        return number[run], shares * taken[run]

    return Block.single(ZEROS_NAME, RUNS, ["zero"] * int(taken.sum()), rows)


# ---------------------------------------------------------------------------- a grid


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Lattice(AbstractPrior):
    """Prior of a table over three axes: second differences along each of them.

    Attributes:
        chains: Along the axes, the slowest first.
    """

    chains: tuple[Chain, ...]

    @cached_property
    def rows(self) -> tuple[sp.csr_array, ...]:
        """See `AbstractPrior`."""
        found = []
        for own, axis in enumerate(self.chains):
            parts = [sp.eye_array(each.size) for each in self.chains]
            parts[own] = axis.rows[0]
            found.append(sp.csr_array(functools.reduce(sp.kron, parts)))
        return tuple(found)

    @cached_property
    def _sizes(self) -> Float[np.ndarray, "k n"]:
        """Eigenvalues of each term at weight 1, of the shapes that they have in common."""
        each = [axis.eigenvalues(1.0) for axis in self.chains]
        return np.stack([own.ravel() for own in np.meshgrid(*each, indexing="ij")])

    def logdet(self, weights: Float[np.ndarray, " k"]) -> float:
        """See `AbstractPrior`."""
        total = weights @ self._sizes
        return float(np.log(total[total > 0.0]).sum())

    @property
    def straight(self) -> Float[np.ndarray, "n z"]:
        """See `AbstractPrior`."""
        return functools.reduce(np.kron, [axis.straight for axis in self.chains])

    @property
    def scanned(self) -> bool:
        """See `AbstractPrior`."""
        return True

    @property
    def bounds(self) -> Float[np.ndarray, "k 2"]:
        """See `AbstractPrior`."""
        return np.stack([axis.bounds[0] for axis in self.chains])


def grid_blocks(model: VolumetricGrid, most: Sequence[int]) -> Iterator[Block]:
    """Yield the tables of offsets of X, Y and Z; arguments as `machine_blocks`."""
    touched = Touched(model)
    prior = Lattice(
        tuple(chain(np.asarray(n.positions)) for n in reversed(model.nodes))
    )
    x, y, z = (
        polynomials(nodes, min(degree, 2))
        for nodes, degree in zip(model.nodes, most, strict=True)
    )
    shape = z.shape[1], y.shape[1], x.shape[1]
    degrees = np.indices(shape).reshape(3, -1).T[:, ::-1]
    labels = tuple(
        " and ".join(a for a, k in zip("XYZ", own, strict=True) if k) or "offset"
        for own in degrees
    )
    free = np.asarray((degrees < 2).all(axis=1))
    basis = np.kron(z, np.kron(y, x))
    for axis, name in enumerate("XYZ"):
        rows = partial(touched.along, axis)
        yield Block(name, FRAME, prior, rows, basis, labels, free)
