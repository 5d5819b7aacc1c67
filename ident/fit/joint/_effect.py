"""What every effect on the readings of several axes has: a name, inputs, columns."""

import abc
import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from .... import models
from ..._recording import JointData
from ...core import FitError, Smooth, TableEffect

Inputs = tuple[tuple[str, str], ...]
"""Channel of `JointData` and name of each input."""
Ranges = Mapping[tuple[str, str], tuple[float, float]]
"""From where to where an input goes, by channel of `JointData` and name."""
Number = float | int
Rows = tuple[Int[np.ndarray, "t k"], Float[np.ndarray, "t k"]]
"""Values that each reading touches, and their shares."""


@dataclasses.dataclass(frozen=True)
class Block:
    """An effect over some rows: ``error = columns @ values``.

    Attributes:
        columns: Shape ``(t, p)``; zero in rows that lack an input.
        known: Rows that have all inputs.
    """

    columns: sp.csr_array
    known: Bool[np.ndarray, " t"]


@dataclasses.dataclass(frozen=True)
class AbstractEffect(abc.ABC):
    """One compensation as a function that is linear in its values; signs are of the *error*.

    Attributes:
        axis: Compensated axis.
    """

    axis: str

    compensation: ClassVar[str]
    """As in a job file: ``"leadscrew"``, ``"cross"``, ``"plane"`` and so on."""
    no_keys: ClassVar[tuple[str, ...]] = ()
    """Fields that are no keys of a fit in a job file."""

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

    @cached_property
    def table_effect(self) -> TableEffect | None:
        """The table as an effect of the estimator, where it is one."""
        return None

    @cached_property
    def prior(self) -> Smooth | None:
        """Smoothness prior of the values; None = no value knows another."""
        return None

    @cached_property
    @abc.abstractmethod
    def labels(self) -> tuple[str, ...]:
        """What each value is, in words."""

    @property
    def size(self) -> int:
        """Number of values."""
        return len(self.labels)

    @property
    @abc.abstractmethod
    def inputs(self) -> Inputs:
        """What it depends on."""

    @property
    def timed(self) -> bool:
        """Whether it needs the time of every reading."""
        return False

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the readings that it needs, such as ``"X.position"``."""
        found = [
            f"temperature.{name}" if channel == "temperature" else f"{name}.{channel}"
            for channel, name in self.inputs
        ]
        return (*found, "time") if self.timed else tuple(found)

    @property
    def grid(self) -> tuple[Float[np.ndarray, " _n"], ...]:
        """Nodes along each master of a table; empty for what is none."""
        return ()

    @property
    def ranges(self) -> Ranges:
        """From where to where its inputs make a difference; one left out does at any size."""
        return {}

    def placed(self, data: JointData) -> "AbstractEffect":
        """Return the effect with everything fixed that was to be read off the data."""
        del data
        return self

    def block(self, data: JointData) -> Block:
        """Return the effect over the rows of these data.

        Raises:
            FitError: If an input was not recorded.
        """
        columns = self.columns_of(data)
        known = np.asarray(np.isfinite(columns).all(axis=0))
        nodes, shares = self.rows([np.where(known, own, 0.0) for own in columns])
        shares = np.where(known[:, None], shares, 0.0)
        parts = (shares.reshape(-1), nodes.reshape(-1).astype(np.int32))
        pointers = np.arange(len(known) + 1) * shares.shape[1]
        matrix = sp.csr_array((*parts, pointers), shape=(len(known), self.size))
        matrix.sum_duplicates()
        if self.table_effect is None:  # a band wants all corners of each cell
            matrix.eliminate_zeros()
        return Block(matrix, known)

    def columns_of(self, data: JointData) -> list[Float[np.ndarray, " t"]]:
        """Return its inputs over the rows of these data, NaN where one is not known."""
        return [data.column(*each, self.name) for each in self.inputs]

    @abc.abstractmethod
    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        """Return the values that each row touches, and their shares, for known inputs."""

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return values in the shape in which lists hold them."""
        return values

    @abc.abstractmethod
    def to_model(self, table: Any, sign: float) -> Any:
        """Return the controller's model of values in the shape of the list.

        Args:
            table: As the error has them.
            sign: −1 for values (the controller takes the error off), +1 for deviations.
        """

    def offsets(
        self, model: Any, *places: Float[np.ndarray, " _n"]
    ) -> Float[np.ndarray, "..."]:
        """Return what a model of the controller adds in mm or °, shaped like the list.

        Args:
            model: Of this compensation.
            places: Along each master; left out: at the nodes.

        Raises:
            FitError: If the effect is no table and no backlash.
        """
        del model, places
        msg = f"active: found {self.compensation}, expected a table or backlash"
        raise FitError(msg)


def every(shares: Float[np.ndarray, "t p"]) -> Rows:
    """Return rows that touch all values."""
    return np.broadcast_to(np.arange(shares.shape[1]), shares.shape), shares


@final
@dataclasses.dataclass(frozen=True)
class Backlash(AbstractEffect):
    r"""Backlash of an axis; its one value is the width in mm or °, signed as P-AXIS-00103.

    Error moving positive − error moving negative is minus the width:
    $e = -w\,(d - r)/2$ with the direction $d$ and the reference direction $r$, in which the
    axis is right (`axcomp.models.Backlash`).

    Attributes:
        reference: Direction without an error of its own, 1 or −1 (P-AXIS-00021 = 1 or 2).
    """

    reference: int = 1

    compensation = "backlash"
    no_keys = ("reference",)

    def __post_init__(self) -> None:
        if self.reference not in (1, -1):
            msg = f"{self.name}: found reference {self.reference}, expected 1 or -1."
            raise FitError(msg)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return ("width",)

    @property
    def inputs(self) -> Inputs:
        """See `AbstractEffect`."""
        return (("direction", self.axis),)

    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        """See `AbstractEffect`."""
        return every(-0.5 * (columns[0][:, None] - self.reference))

    def to_model(self, table: Any, sign: float) -> Any:
        """See `AbstractEffect`; the width is taken off as it stands."""
        del sign
        return models.Backlash(table[0], self.reference)

    def offsets(
        self, model: Any, *places: Float[np.ndarray, " _n"]
    ) -> Float[np.ndarray, "..."]:
        """See `AbstractEffect`; the width is taken off as it stands."""
        del places
        return -np.atleast_1d(np.asarray(model.width))


@final
@dataclasses.dataclass(frozen=True)
class Delay(AbstractEffect):
    r"""Reference late behind the encoder of an axis in motion: $e = -(\tau + \rho\,(t-t_0))\,v$.

    No compensation carries it: it stands beside the others so that they are free of it.
    Values: the delay τ in s at the middle of the recording, and its rate ρ in s/s: the clocks
    may run apart.

    Attributes:
        origin: Instant $t_0$ in s; None = middle of the data.
    """

    origin: float | None = None

    compensation = "delay"

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """See `AbstractEffect`."""
        return ("delay", "rate of the delay")

    @property
    def inputs(self) -> Inputs:
        """See `AbstractEffect`."""
        return (("velocity", self.axis),)

    @property
    def timed(self) -> bool:
        """See `AbstractEffect`."""
        return True

    def placed(self, data: JointData) -> "Delay":
        """See `AbstractEffect`."""
        if self.origin is not None:
            return self
        clock = data.clock_for(f"{self.name}: a rate")
        clock = clock[np.isfinite(clock)]
        middle = 0.5 * float(clock.min() + clock.max()) if len(clock) else 0.0
        return dataclasses.replace(self, origin=middle)

    def columns_of(self, data: JointData) -> list[Float[np.ndarray, " t"]]:
        """See `AbstractEffect`; how late each reading is beside its velocity."""
        late = data.clock_for(f"{self.name}: a rate") - (
            self.placed(data).origin or 0.0
        )
        return [*super().columns_of(data), late]

    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        """See `AbstractEffect`."""
        speed, late = columns
        return every(-np.column_stack([speed, speed * late]))

    def to_model(self, table: Any, sign: float) -> Any:
        """See `AbstractEffect`; there is none."""
        raise NotImplementedError
