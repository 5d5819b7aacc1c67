"""Which compensations are selected in each cycle, from the commands of the program."""

import dataclasses
from collections.abc import Iterable
from typing import final

import numpy as np
from jaxtyping import Bool

from ._controller import PositionController
from ._motion import COMPENSATIONS


@final
@dataclasses.dataclass(frozen=True)
class CompCommand:
    """A COMP command of the NC program: compensations of one axis on or off.

    Attributes:
        cycle: First cycle in which it acts, from 0.
        axis: Number of the axis, from 0.
        on: COMP ON, else COMP OFF.
        names: Of the compensations; none: all of them (OFF_ALL).
    """

    cycle: int
    axis: int
    on: bool
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse names that no compensation has.

        Raises:
            ValueError: If a name is unknown.
        """
        for name in self.names:
            if name not in COMPENSATIONS:
                msg = f"COMP: {name!r} is none of {', '.join(COMPENSATIONS)}."
                raise ValueError(msg)


@final
@dataclasses.dataclass(frozen=True)
class ProgramEnd:
    """The end of the NC program, a reset of the CNC, or the release of axes.

    It deselects what is activated by hand; what COMP OFF deselected stays so.

    Attributes:
        cycle: First cycle in which it acts, from 0.
        axes: Numbers of the axes, from 0; None: all.
    """

    cycle: int
    axes: tuple[int, ...] | None = None


def commanded(
    controller: PositionController,
    cycles: int,
    events: Iterable[CompCommand | ProgramEnd] = (),
    first: int = 0,
) -> Bool[np.ndarray, "t a c"]:
    """Return which of `COMPENSATIONS` are selected per cycle (for `Motion.active`).

    From the start all are that need no command, `AxisCompensations.manual` the others.
    A later event in the same cycle has the last word.

    Args:
        controller: The machine.
        cycles: Number of cycles of the piece.
        events: Of the whole log, in the order of their cycles.
        first: Number of the piece's first cycle in the log: events before it count.

    Raises:
        ValueError: If events are out of order or name an axis that does not exist.
    """
    axes = controller.axes
    automatic = [[name not in axis.manual for name in COMPENSATIONS] for axis in axes]
    selected = np.broadcast_to(automatic, (cycles, len(axes), len(COMPENSATIONS)))
    selected = selected.copy()
    latest = 0
    for event in events:
        if event.cycle < latest:
            msg = f"Events must be in order, got cycle {event.cycle} after {latest}."
            raise ValueError(msg)
        latest = event.cycle
        since = max(event.cycle - first, 0)
        if isinstance(event, ProgramEnd):
            for axis in range(len(axes)) if event.axes is None else event.axes:
                _refuse_unknown(axis, len(axes))
                for name in set(axes[axis].manual) & set(COMPENSATIONS):
                    selected[since:, axis, COMPENSATIONS.index(name)] = False
        else:
            _refuse_unknown(event.axis, len(axes))
            for name in event.names or COMPENSATIONS:
                selected[since:, event.axis, COMPENSATIONS.index(name)] = event.on
    return selected


def _refuse_unknown(axis: int, count: int) -> None:
    if not 0 <= axis < count:
        msg = f"Axis {axis} does not exist, there are {count} axes, from 0."
        raise ValueError(msg)
