"""What was measured, one row per reading."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

Rows = Any
"""A slice, a mask of shape ``(t,)`` or row numbers."""


@dataclasses.dataclass(frozen=True)
class Readings:
    """Measured values with the inputs that they were taken at, all of shape ``(t,)``.

    Attributes:
        value: Readings in mm or °.
        inputs: What the effects depend on, by name: positions, directions, temperatures,
            runs. Each effect says which names it needs.
        weight: Known relative weights (1/variance ratio) > 0, None for equal ones.
    """

    value: Float[np.ndarray, " t"]
    inputs: Mapping[str, np.ndarray]
    weight: Float[np.ndarray, " t"] | None = None

    @cached_property
    def designs(self) -> dict[Any, tuple[np.ndarray, np.ndarray]]:
        """Rows of each effect that was asked for them."""
        return {}

    def __len__(self) -> int:
        return len(self.value)

    def take(self, rows: Rows) -> "Readings":
        """Return the readings of a slice, a mask or row numbers."""
        inputs = {name: array[rows] for name, array in self.inputs.items()}
        weight = None if self.weight is None else self.weight[rows]
        return Readings(self.value[rows], inputs, weight)


def padded(arrays: Mapping[str, np.ndarray], least: int = 64) -> dict[str, np.ndarray]:
    """Return arrays filled up to the next power of two by their last row.

    Compiled functions then see few different lengths: nobody waits for a compilation per
    recording.
    """
    count = len(next(iter(arrays.values())))
    room = max(least, 1 << max(count - 1, 0).bit_length())
    if room == count:
        return dict(arrays)
    return {
        name: np.concatenate([array, np.repeat(array[-1:], room - count, axis=0)])
        for name, array in arrays.items()
    }
