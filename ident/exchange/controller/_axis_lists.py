"""The lists of one axis, and what acts on it with them."""

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ....data.lists import ListFile
from ....models import TemperatureCurve
from ...kinds import kinds
from .._machine_lists import InUse, Reading, machine_lists
from ._controller import model_of
from ._motion import Motion
from ._simulate import simulate


@dataclasses.dataclass(frozen=True, eq=False)
class AxisLists:
    """The lists of one axis, and how the controller reads them.

    Attributes:
        axis: Logical number.
        compensation: Its compensation list, or None.
        machine: Its axis list, or None: then everything in the compensation list acts.
        reading: How they are read; what waits for COMP ON is taken as switched on.
    """

    axis: int
    compensation: ListFile | None
    machine: ListFile | None
    reading: Reading

    @functools.cached_property
    def files(self) -> tuple[ListFile, ...]:
        """Those that say something, as lists of this axis also where they do not say so."""
        pairs = ("compensation", self.compensation), ("axis", self.machine)
        return tuple(
            one
            if one.integer("kopf.achs_nr")
            else one.merge({"kopf.achs_nr": self.axis})
            for kind, one in pairs
            if one is not None and one.kind == kind
        )

    @functools.cached_property
    def used(self) -> Mapping[str, InUse]:
        """What adds to the position of the axis, by compensation.

        Raises:
            ExchangeError: If an entry that decides it is unreadable.
        """
        found = machine_lists(self.files).in_use(
            self.reading.conventions, self.reading.lines
        )
        mine = {one.name: one for one in found if one.axis == self.axis}
        places = [each.name for each in kinds() if not each.adds_current]
        return {name: mine[name] for name in places if name in mine}

    def inputs(self, name: str) -> tuple[int, ...]:
        """Return the axes over whose positions a compensation acts at standstill."""
        one = self.used[name]
        return one.kind.entries.inputs(one.masters)

    def acts(self, name: str) -> bool:
        """Return whether it adds something: a table of zeros does not.

        Raises:
            ExchangeError: If an entry that decides it is unreadable.
        """
        one = self.used.get(name)
        return one is not None and not one.kind.entries.adds_nothing(one.listing)

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
        if not any(self._is_known(one, motion) for one in self.used.values()):
            return {}
        whole = motion
        if self.axis not in motion.positions and self._has_no_slope:
            still = {self.axis: np.zeros(motion.rows)}
            whole = dataclasses.replace(motion, positions={**motion.positions, **still})
        (found,) = simulate(
            self.files,
            whole,
            self.reading,
            only=lambda one: self._is_known(one, motion),
        )
        return dict(found.parts)

    def _is_known(self, one: InUse, motion: Motion) -> bool:
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
