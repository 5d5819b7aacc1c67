"""What acts on one axis with its lists as they lie on the controller."""

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ....data.lists import ListFile
from ....models import TemperatureCurve
from ...exchange import (
    InUse,
    Motion,
    Reading,
    machine_lists,
    model_of,
    simulate,
)
from ...kinds import kinds


@dataclasses.dataclass(frozen=True)
class Loaded:
    """What acts on one axis: its lists, and how the controller reads them.

    Attributes:
        axis: Logical number.
        lists: Compensation list and axis list, as far as there are any. Without an axis
            list everything in the compensation list acts.
        reading: How they are read; what waits for COMP ON is taken as switched on.
    """

    axis: int
    lists: tuple[ListFile, ...]
    reading: Reading

    @functools.cached_property
    def used(self) -> Mapping[str, InUse]:
        """What adds to the position of the axis, by compensation.

        Raises:
            ExchangeError: If an entry that decides it is unreadable.
        """
        found = machine_lists(self.lists).in_use(
            self.reading.conventions, self.reading.lines
        )
        mine = {one.name: one for one in found if one.axis == self.axis}
        places = [each.name for each in kinds() if not each.adds_current]
        return {name: mine[name] for name in places if name in mine}

    def inputs(self, name: str) -> tuple[int, ...]:
        """Return the axes over whose positions a compensation acts at standstill."""
        one = self.used[name]
        return one.kind.entries.inputs(one.masters)

    @functools.cached_property
    def models(self) -> Mapping[str, object]:
        """The model of each compensation.

        Raises:
            ExchangeError: If a list makes none.
        """
        return {name: model_of(one, self.reading) for name, one in self.used.items()}

    def parts(self, motion: Motion) -> dict[str, Float[np.ndarray, " t"]]:
        """Return what the controller adds, by compensation, in mm or °.

        What the motion lacks positions, temperatures, a velocity or an acceleration for is
        left out.

        Raises:
            ExchangeError: If a list makes no table.
        """
        if not any(self._is_told(one, motion) for one in self.used.values()):
            return {}
        whole = motion
        if self.axis not in motion.positions and self._has_no_slope:
            still = {self.axis: np.zeros(motion.rows)}
            whole = dataclasses.replace(motion, positions={**motion.positions, **still})
        (found,) = simulate(
            self.lists,
            whole,
            self.reading,
            only=lambda one: self._is_told(one, motion),
        )
        return dict(found.parts)

    def _is_told(self, one: InUse, motion: Motion) -> bool:
        """Return whether it adds to this axis, and a motion has what it looks at."""
        if one.axis != self.axis or one.kind.adds_current:
            return False
        if one.kind.by_plc and self.axis in self.reading.lines:
            if not motion.temperatures:
                return False
            if self._has_no_slope:
                return True
        looks_at = one.kind.entries.looks_at(one, motion)
        return all(axis in motion.positions for axis in looks_at)

    @property
    def _has_no_slope(self) -> bool:
        """Whether the temperature law of the PLC is the same at all positions."""
        line = self.reading.lines.get(self.axis)
        coefficient = None if line is None else line.coefficient
        return isinstance(coefficient, TemperatureCurve) and not np.any(
            np.asarray(coefficient.values)
        )
