"""What every effect on the readings of several axes has: a name, inputs, columns, and words."""

import abc
import contextlib
import dataclasses
import enum
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from ..._recording import JointData
from ...core import FitError, Independent, Smooth, TableEffect

Inputs = tuple[tuple[str, str], ...]
"""Channel of `JointData` and name of each input."""
Ranges = Mapping[tuple[str, str], tuple[float, float]]
"""From where to where an input goes, by channel of `JointData` and name."""
Number = float | int
Rows = tuple[Int[np.ndarray, "t k"], Float[np.ndarray, "t k"]]
"""Values that each reading touches, and their shares."""


class Rank(enum.IntEnum):
    """How simple a component is: the larger, the later it gives way to others."""

    WANDER = enum.auto()
    RUNS = enum.auto()
    DELAY = enum.auto()
    PLANE = enum.auto()
    CROSSTALK = enum.auto()
    COEFFICIENT = enum.auto()
    OFFSET = enum.auto()
    BILATERAL = enum.auto()
    CROSS = enum.auto()
    LEADSCREW = enum.auto()
    BACKLASH = enum.auto()
    DATUM = enum.auto()


TABLES = frozenset((Rank.PLANE, Rank.BILATERAL, Rank.CROSS, Rank.LEADSCREW))


@dataclasses.dataclass(frozen=True, eq=False)
class Component:
    """A part of the unknowns that has a meaning of its own.

    Attributes:
        name: In words.
        rank: How simple it is.
        places: Column of each of its values.
        effect: That it belongs to; None: datum, runs or wander.
        prior: Prior of its values, None without.
        table: The table as an effect of the estimator, where its columns form a band.
        reference: Sum of its values that a rule puts to zero; None: their mean over the readings.
        level: What fixes its constant, in words.
        rule: What fixes what it shares with a simpler one, in words.
        shared: What it may share with another one, where that is always the same.
    """

    name: str
    rank: Rank
    places: Int[np.ndarray, " p"]
    effect: "AbstractEffect | None" = None
    prior: Smooth | Independent | None = None
    table: TableEffect | None = None
    reference: Float[np.ndarray, "1 p"] | None = None
    level: str = "every table has mean zero over the readings"
    rule: str = ""
    shared: str = ""

    @property
    def owner(self) -> str:
        """What it is called beside others: its effect."""
        return self.name if self.effect is None else self.effect.name

    @property
    def masters(self) -> tuple[str, ...]:
        """Axes on which it depends."""
        return () if self.effect is None else self.effect.masters


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
    rank: ClassVar[Rank]
    """How simple it is beside others."""
    remedy: ClassVar[str] = "move {masters} over the whole table."
    """What to measure where no reading shows it; with fields of `worded`."""
    remedies: ClassVar[Mapping[Rank | None, str]] = {}
    """The same where it cannot be told from a component of this rank (None: any), and why; the
    first one counts."""
    one_unit: ClassVar[bool] = True
    """Whether its values are of one unit."""

    def expect(self, valid: object, found: str, expected: str) -> None:
        """Raise `FitError` with what was found and what was expected, unless it is valid."""
        if not valid:
            msg = f"{self.name}: found {found}, expected {expected}"
            raise FitError(msg)

    @cached_property
    def masters(self) -> tuple[str, ...]:
        """Axes on which it depends."""
        return (self.axis,)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Temperature sensors on which it depends, each once."""
        sensors = (name for channel, name in self.inputs if channel == "temperature")
        return tuple(dict.fromkeys(sensors))

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
        """Whether it needs the time of every reading, as a lag does."""
        return any(lag != 0.0 for lag in self.lags.values())

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the readings that it needs, such as ``"X.position"``."""
        roles = [
            f"temperature.{name}" if channel == "temperature" else f"{name}.{channel}"
            for channel, name in self.inputs
        ]
        return (*roles, "time") if self.timed else tuple(roles)

    @property
    def grid(self) -> tuple[Float[np.ndarray, " _n"], ...]:
        """Nodes along each master of a table; empty for what is none."""
        return () if self.table_effect is None else self.table_effect.nodes

    @property
    def ranges(self) -> Ranges:
        """From where to where its inputs make a difference; one left out does at any size."""
        lines = zip(self.masters, self.grid, strict=False)  # what is no table has none
        return {
            ("position", master): (float(nodes[0]), float(nodes[-1]))
            for master, nodes in lines
        }

    @property
    def lags(self) -> Mapping[str, Number | str]:
        """Time constant in s by which it follows each of its sensors, or ``"fit"``."""
        return {}

    def lagging(self, lags: Mapping[str, float]) -> "AbstractEffect":
        """Return the effect with these time constants in s, by sensor; others are not its own."""
        del lags
        return self

    def worded(self, words: str, axes: Sequence[str] = ()) -> str:
        """Return words with its axis, first and all masters, sensors, and given axes."""
        return words.format(
            axis=self.axis,
            master=in_a_row(self.masters[:1]),
            masters=in_a_row(self.masters),
            sensors=in_a_row(self.sensor_names),
            axes=in_a_row(axes),
        )

    def components(self, places: Int[np.ndarray, " p"]) -> list[Component]:
        """Return its parts that have a meaning of their own, for values at these columns."""
        rule = f"the {self.name} has none of it"
        return [Component(self.name, self.rank, places, self, self.prior, rule=rule)]

    def placed(self, data: JointData) -> "AbstractEffect":
        """Return the effect with everything fixed that was to be read off the data."""
        del data
        return self

    def block(self, data: JointData) -> tuple[sp.csr_array, Bool[np.ndarray, " t"]]:
        """Return the columns of its values over the rows of these data, and the rows it knows.

        ``error = columns @ values``; shape ``(t, p)``, zero in rows that lack an input.

        Raises:
            FitError: If an input was not recorded.
        """
        columns = self.columns_of(data)
        finite = np.asarray(np.isfinite(columns).all(axis=0))
        nodes, shares = self.rows([np.where(finite, column, 0.0) for column in columns])
        shares = np.where(finite[:, None], shares, 0.0)
        parts = (shares.reshape(-1), nodes.reshape(-1).astype(np.int32))
        pointers = np.arange(len(finite) + 1) * shares.shape[1]
        matrix = sp.csr_array((*parts, pointers), shape=(len(finite), self.size))
        matrix.sum_duplicates()
        matrix.eliminate_zeros()
        return matrix, finite

    def curve(
        self, values: Float[np.ndarray, " p"], data: JointData
    ) -> Float[np.ndarray, " t"]:
        """Return what it adds to each row in mm or °; NaN where an input is missing."""
        columns, known = self.block(data)
        return np.where(known, columns @ values, np.nan)

    def columns_of(self, data: JointData) -> list[Float[np.ndarray, " t"]]:
        """Return its inputs over the rows of these data, NaN where one is not known."""
        return [data.column(*channel, self.name) for channel in self.inputs]

    @abc.abstractmethod
    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        """Return the values that each row touches, and their shares, for known inputs."""

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return values in the shape in which lists hold them."""
        return values

    def to_model(self, table: Any, sign: float) -> Any:
        """Return the controller's model of values in the shape of the list, None without one.

        The sign is −1 for values (the controller takes the error off), +1 for deviations.
        """
        del table, sign
        return None

    def offsets(
        self, model: Any, *places: Float[np.ndarray, " _n"]
    ) -> Float[np.ndarray, "..."]:
        """Return what a model of the controller adds in mm or °, shaped like the list.

        At places along each master, or else at the nodes.

        Raises:
            FitError: If the effect is no table and no backlash.
        """
        del model, places
        msg = f"active: found {self.compensation}, expected a table or backlash"
        raise FitError(msg)


def is_number(value: object) -> bool:
    """Return whether a value is one finite number."""
    return not isinstance(value, str) and numbers_of(value).ndim == 0


def numbers_of(given: object) -> Float[np.ndarray, "..."]:
    """Return an array of finite numbers; empty where they are none."""
    with contextlib.suppress(TypeError, ValueError):
        numbers = np.asarray(given, np.float64)
        if np.isfinite(numbers).all():
            return numbers
    return np.zeros(0)


def in_a_row(names: Sequence[str]) -> str:
    """Return different names as a sentence has them: ``"X, Y and Z"``."""
    *first, last = dict.fromkeys(names or ("the axis",))
    return f"{', '.join(first)} and {last}" if first else last


def dense_rows(shares: Float[np.ndarray, "t p"]) -> Rows:
    """Return rows that touch all values."""
    return np.broadcast_to(np.arange(shares.shape[1]), shares.shape), shares
