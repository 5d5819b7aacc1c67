"""What was measured, one row per reading, and why a fit of it is refused."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from ...data.errors import AxcompError

NOT_DETERMINED = (
    "the readings do not determine the table: too few different places in it."
)
"""What a factor that does not exist means to the user."""
NOT_LEFT_OUT = (
    "without some of its readings the rest does not determine the table, so that nothing"
    " could be proven: take fewer nodes, or read more places, or each of them again."
)
"""The same, where readings were held out."""

Vector = Float[np.ndarray, " _n"]


class FitError(AxcompError, ValueError):
    """The readings cannot determine what was asked for; the message says what is missing."""


@dataclasses.dataclass(frozen=True, eq=False)
class Readings:
    """Measured values with the inputs that they were taken at, all of shape ``(t,)``.

    Attributes:
        value: Readings in mm or °.
        inputs: What the effects depend on, by name: positions, directions, temperatures,
            runs. Each effect says which names it needs.
    """

    value: Float[np.ndarray, " t"]
    inputs: Mapping[str, np.ndarray]

    def __len__(self) -> int:
        return len(self.value)

    def take(self, rows: Any) -> "Readings":
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
