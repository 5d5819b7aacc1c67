"""What a log shows of crosstalk."""

from typing import final

import numpy as np
from jaxtyping import Float

from ....models import Crosstalk
from ...proof.verify import AbstractChannel, Change, LogRows, Parts, Way


@final
class CrosstalkChannel(AbstractChannel):
    """An offset over the acceleration of another axis."""

    def prepare(self) -> None:
        self.relevant = (
            "crosstalk_accelerate",
            "crosstalk_velocity",
            "crosstalk_above",
            "filter_delay",
        )
        law = self.law(self.conventions)
        self.cycles = law.cycles
        dynamic, *places = self.masters
        if isinstance(law, Crosstalk):
            points = np.asarray(law.surface.points)
            self.ways = tuple(Way.of(column, ends=False) for column in points.T)
            if not law.velocity_dependent:
                self.relevant = (*self.relevant, "crosstalk_undirected")
            if places:
                self.relevant = (*self.relevant, "crosstalk_outside")
            if len(places) == 2:
                self.relevant = (*self.relevant, "crosstalk_surface")
        timed = self.motion.cycle is not None
        if timed and self.motion.has_actual(dynamic, self.axis):
            self.relevant = (*self.relevant, "crosstalk_input")
        axes = sorted(self.motion.positions)
        swaps = [(number, *places) for number in axes if number != dynamic]
        if len(places) == 2:
            swaps.insert(0, (dynamic, places[1], places[0]))
        self.swaps = tuple(swaps)
        _ = self.parts(self.plain, slice(0, 1))  # a log without a master is refused

    def parts(self, change: Change, rows: LogRows) -> Parts:
        purpose = f"for the crosstalk of A{self.axis}"
        dynamic, *places = change.masters or self.masters
        actual = change.conventions.crosstalk_input == "actual"
        velocity, acceleration = self.motion.required_rates(dynamic, purpose, actual)
        if change.conventions.crosstalk_velocity == "slave":
            velocity = self.motion.required_rates(self.axis, purpose, actual)[0]
        law = self.law(change.conventions)
        columns = [self.motion.position(axis, purpose)[rows] for axis in places]
        place: Float[np.ndarray, "r k"] | None = None
        if columns:
            place = change.moved(np.stack(columns, axis=1))
        offset = law.offset(acceleration[rows], velocity[rows], place)
        return Parts(np.asarray(offset))


CHANNEL = CrosstalkChannel
