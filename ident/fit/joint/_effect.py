"""What every effect of a joint fit has: a name, inputs, and a block of columns."""

import abc
import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from ...core import Smooth, TableEffect
from ._data import JointData


@dataclasses.dataclass(frozen=True)
class Block:
    """An effect over some rows: ``error = columns @ values``.

    Attributes:
        columns: Shape ``(t, p)``; zero in rows that lack an input.
        known: Rows that have all inputs.
        labels: What each value is, in words.
        unit: Of each value.
        prior: Smoothness prior of the values; None = no value knows another.
        table: The table as an effect, where it is one.
    """

    columns: sp.csr_array
    known: Bool[np.ndarray, " t"]
    labels: tuple[str, ...]
    unit: tuple[str, ...]
    prior: Smooth | None = None
    table: TableEffect | None = None


@dataclasses.dataclass(frozen=True)
class AbstractEffect(abc.ABC):
    """One compensation as a function that is linear in its values; signs are of the *error*.

    Attributes:
        axis: Compensated axis.
    """

    axis: str

    @property
    @abc.abstractmethod
    def compensation(self) -> str:
        """Kind of compensation: ``"leadscrew"``, ``"cross"``, ``"plane"`` and so on."""

    # A field of the plane, a property of all others: an inherited property would be taken for
    # the default of the field.
    if TYPE_CHECKING:

        @property
        @abc.abstractmethod
        def masters(self) -> tuple[str, ...]:
            """Axes on which it depends."""

    @property
    @abc.abstractmethod
    def sensor_names(self) -> tuple[str, ...]:
        """Temperature sensors on which it depends, each once."""

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """What it is, in words: ``"plane of Z over X and Y"``."""

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of values."""

    @abc.abstractmethod
    def placed(self, data: JointData) -> "AbstractEffect":
        """Return the effect with everything fixed that was to be read off the data."""

    @abc.abstractmethod
    def block(self, data: JointData) -> Block:
        """Return the effect over the rows of these data.

        Raises:
            FitError: If an input was not recorded.
        """

    @abc.abstractmethod
    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return values in the shape in which lists hold them."""

    @property
    def sensor(self) -> str | None:
        """The temperature sensor, or the first of two; None without any."""
        return self.sensor_names[0] if self.sensor_names else None


@dataclasses.dataclass(frozen=True)
class AbstractOwnEffect(AbstractEffect):
    """An effect of an axis' own motion on itself: no other master, no temperature."""

    @property
    def masters(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return (self.axis,)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return ()

    @property
    def name(self) -> str:
        """See `AbstractEffect`."""
        return f"{self.compensation} of {self.axis}"


def sparse_rows(
    index: Int[np.ndarray, "t k"],
    weight: Float[np.ndarray, "t k"],
    known: Bool[np.ndarray, " t"],
    size: int,
) -> sp.csr_array:
    """Return the matrix with a fixed number of entries per row; zero where not known."""
    count, width = index.shape
    weight = np.where(known[:, None], weight, 0.0)
    pointers = np.arange(count + 1) * width
    matrix = sp.csr_array(
        (weight.reshape(-1), index.reshape(-1).astype(np.int32), pointers),
        shape=(count, size),
    )
    matrix.sum_duplicates()
    return matrix
