"""Channels that follow the motion and not the place: crosstalk and friction."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from ....models import (
    Conventions,
    Crosstalk,
    FrictionCompensation,
    LegacyCrosstalk,
)
from ._channel import AbstractChannel, Change, Parts, Way
from ._motion import LogMotion


@dataclasses.dataclass(eq=False)
class CrosstalkChannel(AbstractChannel):
    """Crosstalk: an offset over the acceleration of another axis.

    Attributes:
        masters: The axis that accelerates, then the adaptation axes.
        read: The law that the list makes under some conventions.
    """

    axis: int
    motion: LogMotion
    conventions: Conventions
    masters: tuple[int, ...]
    read: Callable[[Conventions], Crosstalk | LegacyCrosstalk]
    compensation: str = "crosstalk"
    relevant: tuple[str, ...] = (
        "crosstalk_accelerate",
        "crosstalk_velocity",
        "crosstalk_above",
        "filter_delay",
    )

    def __post_init__(self) -> None:
        self._laws: dict[Conventions, Crosstalk | LegacyCrosstalk] = {}
        law = self._law(self.conventions)
        self.cycles = law.cycles
        dynamic, *places = self.masters
        if isinstance(law, Crosstalk):
            points = np.asarray(law.surface.points)
            self.ways = tuple(_way(column) for column in points.T)
            if not law.velocity_dependent:
                self.relevant = (*self.relevant, "crosstalk_undirected")
            if places:
                self.relevant = (*self.relevant, "crosstalk_outside")
            if len(places) == 2:
                self.relevant = (*self.relevant, "crosstalk_surface")
        timed = self.motion.cycle is not None
        if timed and self.motion.has_actual(dynamic, self.axis):
            self.relevant = (*self.relevant, "crosstalk_input")
        known = sorted(self.motion.path.positions)
        swaps = [(number, *places) for number in known if number != dynamic]
        if len(places) == 2:
            swaps.insert(0, (dynamic, places[1], places[0]))
        self.swaps = tuple(swaps)
        _ = self.parts(self.plain, slice(0, 1))  # a log without a master is refused

    def parts(
        self,
        change: Change,
        rows: Int[np.ndarray, " r"] | slice,
        shift: Float[np.ndarray, "r k"] | None = None,
    ) -> Parts:
        why = f"for the crosstalk of A{self.axis}"
        dynamic, *places = change.masters or self.masters
        actual = change.conventions.crosstalk_input == "actual"
        velocity, acceleration = self.motion.rates(dynamic, why, actual)
        if change.conventions.crosstalk_velocity == "slave":
            velocity = self.motion.rates(self.axis, why, actual)[0]
        law = self._law(change.conventions)
        columns = [self.motion.position(axis, why)[rows] for axis in places]
        where: Float[np.ndarray, "r k"] | None = None
        if columns:
            where = np.stack(columns, axis=1)
            if shift is not None:
                where = where - shift
            elif change.is_shifted:
                where = where - np.asarray(change.shift)
        found = law.offset(acceleration[rows], velocity[rows], where)
        return Parts(np.asarray(found))

    def _law(self, conventions: Conventions) -> Crosstalk | LegacyCrosstalk:
        if conventions not in self._laws:
            self._laws[conventions] = self.read(conventions)
        return self._laws[conventions]


@dataclasses.dataclass(eq=False)
class FrictionChannel(AbstractChannel):
    """Friction: a current over the speed of the axis.

    Attributes:
        read: The law that the list makes under some conventions.
    """

    axis: int
    motion: LogMotion
    conventions: Conventions
    read: Callable[[Conventions], FrictionCompensation]
    compensation: str = "friction"
    unit: str = ""
    relevant: tuple[str, ...] = (
        "friction_below",
        "friction_above",
        "friction_rest",
        "friction_build_up",
        "friction_decay",
    )

    def __post_init__(self) -> None:
        self.masters = (self.axis,)
        law = self.read(self.conventions)
        if law.delay_cycles:
            self.relevant = (*self.relevant, "friction_delay")
        _ = self.motion.rates(self.axis, "for its friction compensation")

    def parts(
        self,
        change: Change,
        rows: Int[np.ndarray, " r"] | slice,
        shift: Float[np.ndarray, "r k"] | None = None,
    ) -> Parts:
        del shift
        why = "for its friction compensation"
        velocity, _ = self.motion.rates(self.axis, why)
        law = self.read(change.conventions)
        if self.motion.cycle is None:
            return Parts(np.asarray(law.current(velocity))[rows])
        place = self.motion.position(self.axis, why)
        current, _ = law.run(law.start(), place, velocity)
        return Parts(np.asarray(current)[rows])


def _way(points: Float[np.ndarray, " p"]) -> Way:
    places = np.unique(points)
    step = float(np.min(np.diff(places))) if len(places) > 1 else 1.0
    return Way(float(places[0]), float(places[-1]), step, ends=False)
