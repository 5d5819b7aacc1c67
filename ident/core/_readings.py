"""What was measured, one row per reading."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

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

    @cached_property
    def matrices(self) -> dict[Any, Any]:
        """Rows of each stack that was asked for them, as a matrix."""
        return {}

    def __len__(self) -> int:
        return len(self.value)

    def take(self, rows: Rows) -> "Readings":
        """Return the readings of a slice, a mask or row numbers."""
        inputs = {name: array[rows] for name, array in self.inputs.items()}
        weight = None if self.weight is None else self.weight[rows]
        return Readings(self.value[rows], inputs, weight)


def filled(
    rows: Shaped[np.ndarray, "t *k"], least: int = 1024
) -> Shaped[np.ndarray, "n *k"]:
    """Return rows with the last one repeated up to the next power of two.

    Compiled functions then see few different lengths: nobody waits for a compilation per
    recording. The result has a least length; rows are one or more.
    """
    length = max(least, 1 << max(len(rows) - 1, 0).bit_length())
    fill = np.repeat(rows[-1:], length - len(rows), axis=0)
    return np.concatenate([rows, fill]) if len(fill) else rows


def padded(arrays: Mapping[str, np.ndarray], least: int = 64) -> dict[str, np.ndarray]:
    """Return arrays as `filled`, by their names."""
    return {name: filled(array, least) for name, array in arrays.items()}
