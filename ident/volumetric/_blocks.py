"""Groups of unknowns of a volumetric fit: functions and angles of a machine, its set-up."""

import abc
import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import Any, final

import jax
import numpy as np
from jaxtyping import Bool, Float
from numpy.polynomial import legendre

from ...models import AbstractNodes, GeometricErrors, VolumetricGrid
from ...models._geometric import FUNCTIONS, SQUARENESS as ANGLES
from ..core import AbstractEffect, AbstractPrior, NoPrior, Readings, Smooth, chain
from ..core._effect import Design
from ..core._readings import padded

RUNS, ANGULAR, STRAIGHTNESS, POSITIONING, SQUARENESS, FRAME = range(6)
"""What may be moved between blocks leaves those that stand first."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Modes:
    """Shapes of the values of a block by which it is asked what readings show.

    Attributes:
        basis: Orthonormal columns over its values.
        labels: Name of each: offset, slope, curve, or the axes along which it varies.
        free: Those that no prior holds.
    """

    basis: Float[np.ndarray, "p m"]
    labels: tuple[str, ...]
    free: Bool[np.ndarray, " m"]

    @classmethod
    def single(cls, labels: Sequence[str]) -> "Modes":
        """Return each value of a block without prior as a shape of its own."""
        count = len(labels)
        return cls(np.eye(count), tuple(labels), np.ones(count, bool))


class AbstractBlock(AbstractEffect):
    """Unknowns that have a name in common."""

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """Name of the block."""

    @property
    @abc.abstractmethod
    def priority(self) -> int:
        """How late it gives way where something may be moved between blocks."""

    @property
    def by_tools(self) -> bool:
        """Whether only tools of different offsets show it."""
        return False

    @abc.abstractmethod
    def modes(self, most: Sequence[int]) -> Modes:
        """Return its shapes, up to a degree along X, Y and Z."""


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

    def rows(self, readings: Readings) -> Design:
        """Return the numbers of the model that readings touch, and their shares."""
        if self not in readings.designs:
            names = ("position", "along", "tool")
            given = padded({name: readings.inputs[name] for name in names})
            found = _stencil(self.model, given)
            nodes, shares = (np.asarray(each)[: len(readings)] for each in found)
            readings.designs[self] = nodes, shares
        return readings.designs[self]


# ------------------------------------------------------------------------ a machine


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Function(AbstractBlock):
    """One of the 18 functions: a smooth table over one axis.

    Attributes:
        touched: The machine.
        axis: Number of the axis that moves.
        row: Number of the function among the six of this axis.
    """

    touched: Touched
    axis: int
    row: int

    @property
    def name(self) -> str:
        """See `AbstractBlock`."""
        return FUNCTIONS[self.axis][self.row]

    @property
    def priority(self) -> int:
        """See `AbstractBlock`."""
        if self.row > 2:
            return ANGULAR
        return POSITIONING if self.row == self.axis else STRAIGHTNESS

    @property
    def by_tools(self) -> bool:
        """See `AbstractBlock`: true without an axis between it and the tool as a lever."""
        chain, own = self.touched.model.chain, "XYZ"[self.axis]
        later = set(chain[chain.index(own) + 1 :])
        return self.row > 2 and later <= {"XYZ"[self.row - 3]}

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return int(self.touched.model.nodes[self.axis].count)

    @property
    def prior(self) -> AbstractPrior:
        """See `AbstractEffect`."""
        return self._prior

    @cached_property
    def _prior(self) -> Smooth:
        along = chain(np.asarray(self.touched.model.nodes[self.axis].positions))
        return Smooth(along, None, 1, np.arange(self.size))

    def design(self, readings: Readings) -> Design:
        """See `AbstractEffect`."""
        nodes, shares = self.touched.rows(readings)
        first = 12 * self.axis + 2 * self.row
        own = nodes[:, first : first + 2]
        counts = [6 * each.count for each in self.touched.model.nodes[: self.axis]]
        return own - (sum(counts) + self.row * self.size), shares[:, first : first + 2]

    def modes(self, most: Sequence[int]) -> Modes:
        """See `AbstractBlock`."""
        basis = polynomials(self.touched.model.nodes[self.axis], most[self.axis])
        degree = np.arange(basis.shape[1])
        labels = tuple(("offset", "slope", "curve")[min(k, 2)] for k in degree.tolist())
        return Modes(basis, labels, degree < 2)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Squareness(AbstractBlock):
    """One of the three angles between axes.

    Attributes:
        touched: The machine.
        number: Number of the angle.
    """

    touched: Touched
    number: int

    @property
    def priority(self) -> int:
        """See `AbstractBlock`."""
        return SQUARENESS

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return 1

    @property
    def name(self) -> str:
        """See `AbstractBlock`."""
        return ANGLES[self.number]

    @property
    def prior(self) -> AbstractPrior:
        """See `AbstractEffect`."""
        return NoPrior(1)

    def design(self, readings: Readings) -> Design:
        """See `AbstractEffect`."""
        shares = self.touched.rows(readings)[1][:, 36 + self.number, None]
        return np.zeros(shares.shape, np.int64), shares

    def modes(self, most: Sequence[int]) -> Modes:
        """See `AbstractBlock`."""
        return Modes.single(["angle"])


# ------------------------------------------------------------- how the points were set up


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Frame(AbstractBlock):
    """Where the workpiece (or the instrument) stands: shift in mm and rotation in rad.

    Attributes:
        about: Position about which it is turned, in mm.
    """

    about: tuple[float, float, float]

    @property
    def name(self) -> str:
        """See `AbstractBlock`."""
        return "frame"

    @property
    def priority(self) -> int:
        """See `AbstractBlock`."""
        return FRAME

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return 6

    @property
    def prior(self) -> AbstractPrior:
        """See `AbstractEffect`."""
        return NoPrior(6)

    def design(self, readings: Readings) -> Design:
        """See `AbstractEffect`."""
        along = readings.inputs["along"]
        lever = readings.inputs["position"] - self.about + readings.inputs["tool"]
        shares = np.hstack([along, np.cross(lever, along)])
        return np.broadcast_to(np.arange(6), shares.shape), shares

    def modes(self, most: Sequence[int]) -> Modes:
        """See `AbstractBlock`."""
        return Modes.single(
            [*(f"shift {a}" for a in "XYZ"), *(f"turn {a}" for a in "ABC")]
        )


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Zeros(AbstractBlock):
    """The zero of each set-up beside the first: a shift of vectors, or of readings on a line.

    Attributes:
        runs: Number of set-ups.
        vectors: Whether vectors were measured.
    """

    runs: int
    vectors: bool

    @property
    def name(self) -> str:
        """See `AbstractBlock`."""
        return "zeros of the set-ups"

    @property
    def priority(self) -> int:
        """See `AbstractBlock`."""
        return RUNS

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return self.runs * (3 if self.vectors else 1)

    @property
    def prior(self) -> AbstractPrior:
        """See `AbstractEffect`."""
        return NoPrior(self.size)

    def design(self, readings: Readings) -> Design:
        """See `AbstractEffect`."""
        run = readings.inputs["run"][:, None]
        if not self.vectors:
            return run, np.ones(run.shape)
        return 3 * run + np.arange(3), readings.inputs["along"]

    def modes(self, most: Sequence[int]) -> Modes:
        """See `AbstractBlock`."""
        return Modes.single(["zero"] * self.size)
