"""Effects of how an axis moves: its backlash, and the delay of what measured it."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, final

import numpy as np
from jaxtyping import Float, Int

from .... import models
from ..._recording import JointData
from ...core import FitError
from ._effect import AbstractEffect, Component, Inputs, Rank, Rows, dense_rows


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
    rank = Rank.BACKLASH
    remedy = "measure {axis} in both directions."
    remedies: ClassVar[Mapping[Rank | None, str]] = {
        Rank.DATUM: "all readings were taken in one direction. Measure in both directions.",
        Rank.RUNS: "each run went one way. Measure both directions within each run.",
        None: "the direction changed together with the position. Approach the same positions"
        " from both sides.",
    }

    def __post_init__(self) -> None:
        if self.reference not in (1, -1):
            msg = f"{self.name}: found reference {self.reference}, expected 1 or -1."
            raise FitError(msg)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        return ("width",)

    @property
    def inputs(self) -> Inputs:
        return (("direction", self.axis),)

    def components(self, places: Int[np.ndarray, " p"]) -> list[Component]:
        shared = "A constant difference between the directions"
        return [Component(self.name, self.rank, places, self, shared=shared)]

    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        return dense_rows(-0.5 * (columns[0][:, None] - self.reference))

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
    rank = Rank.DELAY
    remedy = "move {axis} at several speeds."
    remedies: ClassVar[Mapping[Rank | None, str]] = {
        None: "the speed of {axes} never varied by itself. Move at several speeds in both"
        " directions."
    }
    one_unit = False

    @cached_property
    def labels(self) -> tuple[str, ...]:
        return ("delay", "rate of the delay")

    @property
    def inputs(self) -> Inputs:
        return (("velocity", self.axis),)

    @property
    def timed(self) -> bool:
        return True

    def placed(self, data: JointData) -> "Delay":
        if self.origin is not None:
            return self
        clock = data.clock_for(f"{self.name}: a rate")
        clock = clock[np.isfinite(clock)]
        middle = 0.5 * float(clock.min() + clock.max()) if len(clock) else 0.0
        return dataclasses.replace(self, origin=middle)

    def columns_of(self, data: JointData) -> list[Float[np.ndarray, " t"]]:
        """See `AbstractEffect`; the time of each reading beside its velocity."""
        origin = self.placed(data).origin or 0.0
        elapsed = data.clock_for(f"{self.name}: a rate") - origin
        return [*super().columns_of(data), elapsed]

    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        speed, elapsed = columns
        return dense_rows(-np.column_stack([speed, speed * elapsed]))
