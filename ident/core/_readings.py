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
    """

    value: Float[np.ndarray, " t"]
    inputs: Mapping[str, np.ndarray]

    @cached_property
    def designs(self) -> dict[Any, tuple[np.ndarray, np.ndarray]]:
        """Rows that an effect keeps, since others ask for the same."""
        return {}

    def __len__(self) -> int:
        return len(self.value)

    def take(self, rows: Rows) -> "Readings":
        """Return the readings of a slice, a mask or row numbers."""
        inputs = {name: array[rows] for name, array in self.inputs.items()}
        return Readings(self.value[rows], inputs)


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
