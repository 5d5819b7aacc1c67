"""What every effect of a joint fit has (a name, inputs, columns), and the two smallest ones."""

import abc
import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar, final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from ...core import FitError, Smooth, TableEffect
from ._data import JointData

Ranges = Mapping[tuple[str, str], tuple[float, float]]
"""From where to where an input goes, by channel of `JointData` and name."""
ANYWHERE = np.nan, np.nan
"""Range of an input that makes a difference at any size."""


@dataclasses.dataclass(frozen=True)
class Block:
    """An effect over some rows: ``error = columns @ values``.

    Attributes:
        columns: Shape ``(t, p)``; zero in rows that lack an input.
        known: Rows that have all inputs.
        labels: What each value is, in words.
        prior: Smoothness prior of the values; None = no value knows another.
        table: The table as an effect of the estimator, where it is one.
    """

    columns: sp.csr_array
    known: Bool[np.ndarray, " t"]
    labels: tuple[str, ...]
    prior: Smooth | None = None
    table: TableEffect | None = None


@dataclasses.dataclass(frozen=True)
class AbstractEffect(abc.ABC):
    """One compensation as a function that is linear in its values; signs are of the *error*.

    Attributes:
        axis: Compensated axis.
    """

    axis: str

    compensation: ClassVar[str]
    """Kind of compensation: ``"leadscrew"``, ``"cross"``, ``"plane"`` and so on."""

    @cached_property
    def masters(self) -> tuple[str, ...]:
        """Axes on which it depends."""
        return (self.axis,)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Temperature sensors on which it depends, each once."""
        return ()

    @property
    def name(self) -> str:
        """What it is, in words: ``"plane of Z over X and Y"``."""
        return f"{self.compensation} of {self.axis}"

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Number of values."""

    @property
    @abc.abstractmethod
    def ranges(self) -> Ranges:
        """Its inputs, and from where to where each of them makes a difference."""

    def placed(self, data: JointData) -> "AbstractEffect":
        """Return the effect with everything fixed that was to be read off the data."""
        del data
        return self

    @abc.abstractmethod
    def block(self, data: JointData) -> Block:
        """Return the effect over the rows of these data.

        Raises:
            FitError: If an input was not recorded.
        """

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return values in the shape in which lists hold them."""
        return values


def few_columns(columns: Float[np.ndarray, "t p"], labels: tuple[str, ...]) -> Block:
    """Return a block of few columns, NaN in rows that lack an input."""
    known = np.asarray(np.isfinite(columns).all(axis=1))
    dense = np.where(known[:, None], columns, 0.0)
    return Block(sp.csr_array(dense), known, labels)


def sparse_rows(
    index: Int[np.ndarray, "t k"],
    weight: Float[np.ndarray, "t k"],
    known: Bool[np.ndarray, " t"],
    size: int,
) -> sp.csr_array:
    """Return the matrix with a fixed number of entries per row; zero where not known."""
    count, width = index.shape
    weight = np.where(known[:, None], weight, 0.0)
    parts = (weight.reshape(-1), index.reshape(-1).astype(np.int32))
    matrix = sp.csr_array((*parts, np.arange(count + 1) * width), shape=(count, size))
    matrix.sum_duplicates()
    return matrix


@final
@dataclasses.dataclass(frozen=True)
class BacklashEffect(AbstractEffect):
    r"""Backlash of an axis; its one value is the width in mm, signed as P-AXIS-00103.

    Error moving positive − error moving negative is minus the width:
    $e = -w\,(d - r)/2$ with the direction $d$ and the reference direction $r$, in which the
    axis is right (`axcomp.models.Backlash`).

    Attributes:
        reference: Direction without an error of its own, 1 or −1 (P-AXIS-00021 = 1 or 2).
    """

    reference: int = 1

    compensation = "backlash"
    size = 1

    def __post_init__(self) -> None:
        if self.reference not in (1, -1):
            msg = f"{self.name}: found reference {self.reference}, expected 1 or -1."
            raise FitError(msg)

    @property
    def ranges(self) -> Ranges:
        """See `AbstractEffect`."""
        return {("direction", self.axis): ANYWHERE}

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        way = data.column("direction", self.axis, self.name)
        return few_columns(-0.5 * (way[:, None] - self.reference), ("width",))


@final
@dataclasses.dataclass(frozen=True)
class DelayEffect(AbstractEffect):
    r"""Reference late behind the encoder of an axis in motion: $e = -(\tau + \rho\,(t-t_0))\,v$.

    No compensation carries it: it stands beside the others so that they are free of it.
    Values: the delay τ in s at the middle of the recording; with a clock, its rate ρ in s/s.

    Attributes:
        origin: Instant $t_0$ in s; None = middle of the data.
        rate: Whether the clocks run apart as well.
    """

    origin: float | None = None
    rate: bool = True

    compensation = "delay"

    @property
    def size(self) -> int:
        """See `AbstractEffect`."""
        return 2 if self.rate else 1

    @property
    def ranges(self) -> Ranges:
        """See `AbstractEffect`."""
        return {("velocity", self.axis): ANYWHERE}

    def placed(self, data: JointData) -> "DelayEffect":
        """See `AbstractEffect`."""
        if not self.rate or self.origin is not None:
            return self
        if data.time is None:
            msg = f"{self.name}: a rate needs the time of every reading, found none."
            raise FitError(msg)
        clock = data.time[np.isfinite(data.time)]
        middle = 0.5 * float(clock.min() + clock.max()) if len(clock) else 0.0
        return dataclasses.replace(self, origin=middle)

    def block(self, data: JointData) -> Block:
        """See `AbstractEffect`."""
        columns = -data.column("velocity", self.axis, self.name)[:, None]
        origin = self.placed(data).origin
        if self.rate and data.time is not None and origin is not None:
            columns = columns * np.column_stack(
                [np.ones(len(data)), data.time - origin]
            )
        return few_columns(columns, ("delay", "rate of the delay")[: self.size])
