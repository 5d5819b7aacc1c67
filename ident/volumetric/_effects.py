"""What a volumetric fit is asked for: the 21 errors of a machine, or a grid."""

import abc
import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import Any, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...models import EquidistantNodes, GeometricErrors, VolumetricGrid
from ...models._geometric import FUNCTIONS, SQUARENESS
from ._blocks import Block, frame, grid_blocks, machine_blocks

Triple = tuple[float, float, float]
SAME = 1e-3
"""Share of the range of an axis below which two positions count as one."""


@dataclasses.dataclass(frozen=True)
class AbstractVolumetric(abc.ABC):
    """An error over the positions of three axes; nodes X first, in mm.

    Attributes:
        start: First node along X, Y and Z.
        interval: Distance of nodes.
        points: Number of nodes.
    """

    start: Triple
    interval: Triple
    points: tuple[int, int, int]

    @cached_property
    @abc.abstractmethod
    def model(self) -> Any:
        """The model, all values 0."""

    @abc.abstractmethod
    def blocks(self, most: Sequence[int]) -> tuple[Block, ...]:
        """Return its unknowns, those that the frame of the readings adds last.

        Args:
            most: Degree along X, Y and Z of the shapes by which readings are judged.
        """

    @abc.abstractmethod
    def to_model(self, values: dict[str, Float[np.ndarray, " _n"]], sign: float) -> Any:
        """Return the model with values of its blocks by name; those without one are NaN."""

    @property
    def nodes(self) -> tuple[EquidistantNodes, EquidistantNodes, EquidistantNodes]:
        """Nodes along X, Y and Z."""
        rows = zip(self.start, self.interval, self.points, strict=True)
        x, y, z = (
            EquidistantNodes(jnp.asarray(float(first)), jnp.asarray(float(step)), count)
            for first, step, count in rows
        )
        return x, y, z

    @property
    def volume(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Lowest and highest position in mm."""
        low = np.array(self.start, float)
        return low, low + np.array(self.interval) * (np.array(self.points) - 1)

    def beyond(self, position: Float[np.ndarray, "t 3"]) -> Float[np.ndarray, "t 3"]:
        """Return by how many mm positions lie beyond the volume along X, Y and Z, where edges hold.

        A single node holds all along its axis, and less than `SAME` of a travel is nothing.
        """
        low, high = self.volume
        far = np.maximum(low - position, position - high)
        return np.where((far > SAME * (high - low)) & (high > low), far, 0.0)


@final
@dataclasses.dataclass(frozen=True)
class Geometry(AbstractVolumetric):
    """The 21 geometric errors of a machine with three linear axes.

    Attributes:
        chain: The axes in their order from the workpiece to the tool.
        reference: Position of X, Y and Z in mm about which angles act.
    """

    chain: str = "XYZ"
    reference: Triple = (0.0, 0.0, 0.0)

    @cached_property
    def model(self) -> GeometricErrors:
        """See `AbstractVolumetric`."""
        return GeometricErrors.of(self.nodes, {}, self.chain, self.reference)

    def blocks(self, most: Sequence[int]) -> tuple[Block, ...]:
        """See `AbstractVolumetric`."""
        return (*machine_blocks(self.model, most), frame(self.reference))

    def to_model(
        self, values: dict[str, Float[np.ndarray, " _n"]], sign: float
    ) -> GeometricErrors:
        """See `AbstractVolumetric`."""
        del sign  # entries are errors
        row = [
            values.get(name, np.full(nodes.count, np.nan))
            for nodes, names in zip(self.nodes, FUNCTIONS, strict=True)
            for name in names
        ]
        angles = [values[name] for name in SQUARENESS]
        return self.model.with_numbers(np.concatenate([*row, *angles]))


@final
@dataclasses.dataclass(frozen=True)
class Volumetric(AbstractVolumetric):
    """Errors of X, Y and Z on a regular grid over the volume; densely solved.

    With vectors, which leave X, Y and Z apart, 1 000 nodes take seconds; readings along oblique
    lines couple them: then 1 000 nodes may take a minute or two.
    """

    @cached_property
    def model(self) -> VolumetricGrid:
        """See `AbstractVolumetric`."""
        shape = (3, *reversed(self.points))
        return VolumetricGrid(self.nodes, jnp.zeros(shape))

    def blocks(self, most: Sequence[int]) -> tuple[Block, ...]:
        """See `AbstractVolumetric`."""
        return tuple(grid_blocks(self.model, most))

    def to_model(
        self, values: dict[str, Float[np.ndarray, " _n"]], sign: float
    ) -> VolumetricGrid:
        """See `AbstractVolumetric`: entries are offsets, against the errors."""
        shape = tuple(reversed(self.points))
        tables = np.stack([sign * values[axis].reshape(shape) for axis in "XYZ"])
        return VolumetricGrid(self.nodes, tables)
