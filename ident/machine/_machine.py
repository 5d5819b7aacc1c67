"""A machine whose errors are known: it takes lists, and it can be measured."""

import dataclasses
from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Float, Int

from ...data.errors import AxcompError
from ...data.lists import ListFile
from ...models import Conventions
from ._loaded import LoadedTable, load
from ._sources import AbstractErrorSource, Positions


class MachineError(AxcompError):
    """Something was asked of the virtual machine that it does not have."""

    def __init__(self, asked: str, expected: str) -> None:
        super().__init__(asked, expected)
        self.asked, self.expected = asked, expected

    def __str__(self) -> str:
        return f"virtual machine: found {self.asked}, expected {self.expected}"


@dataclasses.dataclass(frozen=True)
class VirtualMachine:
    """Axes with known errors behind a controller that applies lists.

    A new compensation needs one more source of error, and one more line in ``load``.

    Attributes:
        axes: Logical number by axis name.
        sources: Causes of error; those of one axis add up.
        tables: Tables that the controller applies at the moment.
        conventions: Rules that the controller follows.
    """

    axes: Mapping[str, int]
    sources: tuple[AbstractErrorSource, ...]
    tables: tuple[LoadedTable, ...] = ()
    conventions: Conventions = dataclasses.field(default_factory=Conventions)

    def with_lists(self, listings: Iterable[ListFile]) -> "VirtualMachine":
        """Return the machine with these compensation lists active, and no others.

        Raises:
            MachineError: If a list names an axis that the machine does not have.
        """
        tables = [
            table for listing in listings for table in load(listing, self.conventions)
        ]
        for table in tables:
            for number in (table.axis, *table.masters):
                if number not in self.axes.values():
                    known = ", ".join(f"{n} ({a})" for a, n in self.axes.items())
                    asked, expected = f"a list for axis {number}", f"one of {known}"
                    raise MachineError(asked, expected)
        return dataclasses.replace(self, tables=tuple(tables))

    def true_error(
        self, axis: str, positions: Positions, direction: Int[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return the error of the bare machine in mm, whatever lists are active.

        Args:
            axis: Axis whose error is asked for.
            positions: Commanded positions in mm of all axes that matter to it.
            direction: Of the last motion of ``axis``, ±1.
        """
        total = np.zeros(len(direction))
        for source in self.sources:
            if source.axis == self._known(axis):
                total += source.error(positions, direction)
        return total

    def error(
        self, axis: str, positions: Positions, direction: Int[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return the error in mm with the active lists: what they add included."""
        total = self.true_error(axis, positions, direction)
        by_number = {self.axes[name]: where for name, where in positions.items()}
        for table in self.tables:
            if table.axis == self.axes[axis]:
                total += table.offset(by_number, direction)
        return total

    def _known(self, axis: str) -> str:
        if axis not in self.axes:
            asked, expected = f"axis {axis}", f"one of {', '.join(self.axes)}"
            raise MachineError(asked, expected)
        return axis
