"""Friction laws that are linear in all their parameters: their columns have no shape."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ._structure import AbstractStructure


def no_shape() -> Float[np.ndarray, " s"]:
    """Return the logarithms of the shape of a law that has none."""
    return np.zeros(0)


@dataclasses.dataclass(frozen=True)
class AbstractLinearStructure(AbstractStructure):
    """One kind of friction law without non-linear parameters."""

    @property
    def shapes(self) -> tuple[str, ...]:
        """See `AbstractStructure`."""
        return ()

    def starts(
        self, speed: Float[np.ndarray, " t"]
    ) -> Sequence[Float[np.ndarray, " s"]]:
        """See `AbstractStructure`."""
        return (no_shape(),)

    def bounds(
        self, speed: Float[np.ndarray, " t"]
    ) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
        """See `AbstractStructure`."""
        return no_shape(), no_shape()

    def profile_slopes(
        self, speed: Float[np.ndarray, " t"], shape: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, "s t k"]:
        """See `AbstractStructure`."""
        return np.zeros((0, len(speed), len(self.factors)))

    @property
    def shaped(self) -> tuple[int, ...]:
        """See `AbstractStructure`."""
        return ()

    def profile(
        self, speed: Float[np.ndarray, " t"], shape: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, "t k"]:
        """See `AbstractStructure`."""
        return self.still_profile(speed)

    def shaped_profiles(
        self,
        speed: Float[np.ndarray, "r t"],
        of: Int[np.ndarray, " w"],
        shapes: Float[np.ndarray, "w s"],
    ) -> tuple[Float[np.ndarray, "w t"], Float[np.ndarray, "s w t"]]:
        """See `AbstractStructure`."""
        count, width = shapes.shape
        return np.zeros((count, speed.shape[1])), np.zeros(
            (width, count, speed.shape[1])
        )
