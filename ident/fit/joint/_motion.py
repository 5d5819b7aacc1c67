"""Effects of how axes move: backlash, the delay of what measured an axis, and crosstalk."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from .... import models
from ..._recording import JointData
from ...core import FitError, filled
from ...kinds.crosstalk import BRANCHES, MOST_TESTS
from ._effect import (
    AbstractEffect,
    Component,
    Inputs,
    Number,
    Ranges,
    Rank,
    Rows,
    dense_rows,
    numbers_of,
)


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
        valid = self.reference in (1, -1)
        self.expect(valid, f"reference {self.reference}", "1 or -1.")

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


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Crosstalk(AbstractEffect):
    """Error of an axis from the acceleration of another: entries of the tests in mm.

    Values: rows of `BRANCHES`, each with one value per test; where the directions do not
    differ, only the rows for acceleration and for deceleration, or the first of them where
    the controller has it for both (`Conventions.crosstalk_undirected`).

    Attributes:
        master: Axis that accelerates.
        acceleration: Specified, in mm/s², above 0.
        deceleration: Specified, in mm/s², below 0.
        adaptation: Axes on whose position the entries depend, none, one or two.
        positions: Of the tests along them in mm, one row each; None = one test.
        velocity_dependent: Each direction has entries of its own.
        conventions: How signs and directions are told apart; None = the defaults.
    """

    master: str
    acceleration: Number
    deceleration: Number
    adaptation: tuple[str, ...] = ()
    positions: Sequence[Sequence[Number]] | Float[np.ndarray, "p k"] | None = None
    velocity_dependent: bool = False
    conventions: models.Conventions | None = None

    compensation = "crosstalk"
    no_keys = ("conventions",)
    rank = Rank.CROSSTALK
    remedy = "accelerate and slow down {master} at all places of the tests, in both directions."
    remedies: ClassVar[Mapping[Rank | None, str]] = {
        None: "the acceleration of {master} never varied by itself. Accelerate and slow down in"
        " both directions, and stand still as well."
    }

    def __post_init__(self) -> None:
        if isinstance(self.adaptation, str):
            object.__setattr__(self, "adaptation", (self.adaptation,))
        if self.positions is not None:
            points, found = numbers_of(self.positions), f"positions {self.positions!r}"
            expected = "numbers in mm, a row of them for each test"
            self.expect(points.shape != (0,), found, expected)
            # Along one axis a row of numbers says it all.
            points = points[:, None] if points.ndim == 1 else np.atleast_2d(points)
            object.__setattr__(self, "positions", tuple(map(tuple, points.tolist())))
        axes, points = len(self.adaptation), self.points
        self.expect(axes <= 2, f"{axes} adaptation axes", "two at most.")
        self.expect(
            self.acceleration > 0 > self.deceleration,
            f"acceleration {self.acceleration:g} and deceleration {self.deceleration:g} mm/s²",
            "one above and one below 0.",
        )
        self.expect(
            points.shape[1] == axes and 1 <= len(points) <= MOST_TESTS,
            f"positions of shape {points.shape}",
            f"1 to {MOST_TESTS} tests along {axes} adaptation axes.",
        )

    @cached_property
    def masters(self) -> tuple[str, ...]:
        """The axis that accelerates, then the adaptation axes."""
        return (self.master, *self.adaptation)

    @property
    def name(self) -> str:
        return f"crosstalk of {self.axis} from {self.master}"

    @property
    def mode(self) -> int:
        """Of the list: 1, 2 or 3."""
        return 1 + len(self.adaptation)

    @property
    def points(self) -> Float[np.ndarray, "p k"]:
        """Positions of the tests in mm."""
        if self.positions is None:
            return np.zeros((1, 0))
        return np.asarray(self.positions, float)

    @property
    def rules(self) -> models.Conventions:
        """How signs and directions are told apart."""
        return self.conventions or models.Conventions()

    @property
    def branches(self) -> tuple[int, ...]:
        """Row of the values that stands for each row of `BRANCHES`."""
        if self.velocity_dependent:
            return (0, 1, 2, 3)
        return (0, 0, 1, 1) if self.rules.of_crosstalk["own_deceleration"] else (0,) * 4

    @property
    def inputs(self) -> Inputs:
        mover = self.axis if self.rules.crosstalk_velocity == "slave" else self.master
        motion = (("acceleration", self.master), ("velocity", mover))
        return (*motion, *(("position", axis) for axis in self.adaptation))

    @property
    def ranges(self) -> Ranges:
        top = 1.2 * max(self.acceleration, -self.deceleration)
        ranges = {
            ("position", axis): (float(places.min()), float(places.max()))
            for axis, places in zip(self.adaptation, self.points.T, strict=True)
        }
        return ranges | {("acceleration", self.master): (-top, top)}

    def to_model(self, table: Any, sign: float) -> models.Crosstalk:
        """See `AbstractEffect`.

        Raises:
            FitError: If the tests span no surface.
        """
        try:
            surface = models.surface_through(self.points)
        except ValueError as error:
            msg = f"{self.name}: {error}"
            raise FitError(msg) from error
        return models.Crosstalk(
            surface,
            jnp.asarray(sign * table),
            jnp.asarray(float(self.acceleration)),
            jnp.asarray(float(self.deceleration)),
            velocity_dependent=self.velocity_dependent,
            **self.rules.of_crosstalk,
        )

    def rows(self, columns: Sequence[Float[np.ndarray, " t"]]) -> Rows:
        count, tests = len(columns[0]), len(self.points)
        acceleration, speed, *places = map(filled, columns)
        stencil = self.to_model(np.zeros((4, tests)), 1.0).stencil(
            acceleration, speed, np.reshape(places, (-1, len(acceleration))).T
        )
        branch, test = np.divmod(np.asarray(stencil.nodes)[:count], tests)
        index = np.array(self.branches)[branch] * tests + test
        return index, np.asarray(stencil.weights)[:count]

    @cached_property
    def labels(self) -> tuple[str, ...]:
        words: tuple[str, ...] = BRANCHES
        if not self.velocity_dependent:
            words = ("acceleration", "deceleration")[: self.branches[-1] + 1]
        places = [
            "".join(
                f", {axis} = {value:g}"
                for axis, value in zip(self.adaptation, point, strict=True)
            )
            for point in self.points
        ]
        return tuple(word + place for word in words for place in places)

    def table(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, "..."]:
        """Return ``(4, p)``, rows as `BRANCHES`; equal rows where directions do not differ."""
        return values.reshape(-1, len(self.points))[list(self.branches)]
