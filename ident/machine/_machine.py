"""A machine whose errors are known: it takes lists, and it can be measured."""

import dataclasses
from collections.abc import Iterable, Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ...data.errors import FoundError
from ...data.lists import ListFile
from ...models import Conventions, Motion, PositionController, TemperatureLine
from ..exchange import Reading, controller_from_lists
from ._sources import AbstractErrorSource, Positions, State

_WHERE = "virtual machine"


class MachineError(FoundError):
    """Something was asked of the virtual machine that it does not have."""


@dataclasses.dataclass(frozen=True, eq=False)
class VirtualMachine:
    """Axes with known errors behind a controller that applies lists.

    A new compensation needs one more source of error; what its list does, the
    controller model knows.

    Attributes:
        axes: Logical number by axis name.
        sources: Causes of error; those of one axis add up.
        controller: Has the lists that are loaded, a column per axis; None: no list.
        conventions: Rules that the controller follows.
    """

    axes: Mapping[str, int]
    sources: tuple[AbstractErrorSource, ...]
    controller: PositionController | None = None
    conventions: Conventions = dataclasses.field(default_factory=Conventions)

    def with_lists(
        self,
        listings: Iterable[ListFile],
        lines: Mapping[int, TemperatureLine] | None = None,
    ) -> "VirtualMachine":
        """Return the machine with these lists loaded and active, and no others.

        Args:
            listings: Compensation lists and axis lists; without an axis list everything
                in a compensation list is active.
            lines: Temperature lines as a PLC makes them, by axis number.

        Raises:
            ExchangeError: If a list makes no table, or names an axis that the machine
                does not have.
        """
        lists = list(listings)
        if not lists and not lines:
            return dataclasses.replace(self, controller=None)
        controller = controller_from_lists(
            lists,
            Reading(self.conventions, lines=lines or {}, commanded=True),
            axes=tuple(self.axes.values()),
        )
        return dataclasses.replace(self, controller=controller)

    def true_error(
        self, axis: str, positions: Positions, direction: Int[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return the error of the bare machine at standstill in mm.

        Args:
            axis: Axis whose error is asked for.
            positions: Commanded positions in mm of all axes that matter to it.
            direction: Of the last motion of ``axis``, ±1.
        """
        return self.error_in(axis, State(positions, {axis: direction}))

    def error_in(self, axis: str, state: State) -> Float[np.ndarray, " t"]:
        """Return the error of the bare machine in a state in mm."""
        total = np.zeros(state.rows)
        for each in self.causes(axis, state).values():
            total += each
        return total

    def causes(self, axis: str, state: State) -> dict[str, Float[np.ndarray, " t"]]:
        """Return the error of the bare machine in mm by the compensation it asks for."""
        found: dict[str, Float[np.ndarray, " t"]] = {}
        for source in self.sources:
            if source.axis == self._known(axis):
                kind = source.compensation
                found[kind] = found.get(kind, 0.0) + source.error(state)
        return found

    def error(
        self, axis: str, positions: Positions, direction: Int[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return the error at standstill in mm with the active lists."""
        total = self.true_error(axis, positions, direction)
        if self.controller is None:
            return total
        none = np.zeros(len(direction))
        where = np.stack([positions.get(name, none) for name in self.axes], axis=1)
        ways = np.repeat(np.asarray(direction, dtype=float)[:, None], len(self.axes), 1)
        still = jnp.zeros(where.shape)
        motion = Motion(jnp.asarray(where), still, still, direction=jnp.asarray(ways))
        column = list(self.axes).index(axis)
        added = np.asarray(self.controller.settled(motion).offset)[:, column]
        return np.asarray(total + added)

    def _known(self, axis: str) -> str:
        if axis not in self.axes:
            known = ", ".join(self.axes)
            raise MachineError(_WHERE, f"axis {axis}", f"one of {known}")
        return axis
